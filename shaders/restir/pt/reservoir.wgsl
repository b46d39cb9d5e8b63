// The reservoir of ReSTIR PT: a path, its unbiased contribution weight and its confidence.  64 bytes (Lin et al. 2026, supplement, 8).
#define_import_path bevy_restir::restir::pt::reservoir

#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, is_sound, is_sound_3}
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::restir::stored_path::{no_reservoir, PackedPath, path_pack, path_unpack, Reservoir}

// The reservoir as it is stored.
struct PackedReservoir {
    path: vec4<u32>,           // structure, seed, birth, W
    vertex: vec4<u32>,         // reconnection vertex and the direction after it
    suffix: vec4<u32>,         // radiance that arrives there; `mis_coefficients`, of which the second is 0
    light: vec4<u32>,          // point on the light; density; p̂
}

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    let s = r.path;
    let p = path_pack(r);
    return PackedReservoir(
        vec4<u32>(p.structure, s.seed, p.birth, bitcast<u32>(r.ucw)),
        vec4<u32>(p.vertex, p.direction),
        vec4<u32>(bitcast<vec3<u32>>(s.radiance), bitcast<u32>(s.mis_coefficients.x)),
        vec4<u32>(s.light.light, s.light.coordinates, bitcast<u32>(s.density), bitcast<u32>(s.target_value)),
    );
}

// Reservoirs that hold the same candidate have the same identity, wherever it was shifted.
fn identity_of(p: PackedReservoir) -> vec2<u32> {
    return vec2<u32>(p.path.y, p.path.z & 0xffffu);
}

// A reservoir with a value that is negative or not finite is dropped with its confidence: kept confidence would make the picture dark.
fn reservoir_unpack(p: PackedReservoir) -> Reservoir {
    var r = path_unpack(PackedPath(p.path.x, p.path.z, p.vertex.xyz, p.vertex.w));
    r.path.seed = p.path.y;
    r.ucw = bitcast<f32>(p.path.w);
    r.path.radiance = bitcast<vec3<f32>>(p.suffix.xyz);
    r.path.mis_coefficients = vec2<f32>(bitcast<f32>(p.suffix.w), 0.0);
    r.path.light = LightPoint(p.light.x, p.light.y);
    r.path.density = bitcast<f32>(p.light.z);
    r.path.target_value = bitcast<f32>(p.light.w);
    let s = r.path;
    let is_path_sound = is_sound_3(s.radiance) && is_sound(s.mis_coefficients.x) && is_sound(s.density) && is_sound(s.target_value);
    if !guard_holds(is_sound(r.ucw) && is_path_sound, GUARD_RESERVOIR) {
        return no_reservoir();
    }
    return r;
}
