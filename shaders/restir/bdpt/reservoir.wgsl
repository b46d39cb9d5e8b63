// The reservoir of ReSTIR BDPT: a path from the camera, its unbiased contribution weight and its confidence.  64 bytes.
#define_import_path bevy_restir::restir::bdpt::reservoir

#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, guarded_3, is_sound}
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::restir::stored_path::{no_reservoir, pack_radiance, PackedPath, path_pack, path_unpack, Reservoir, unpack_radiance}

// The reservoir as it is stored.
struct PackedReservoir {
    path: vec4<u32>,           // structure, seed, birth, W
    vertex: vec4<u32>,         // reconnection vertex and the direction after it
    suffix: vec4<u32>,         // radiance that arrives there; `mis_coefficients`
    light: vec4<u32>,          // point on the light; density; p̂
}

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    let s = r.path;
    let p = path_pack(r);
    // The format has no sign and no NaN, so both are detected before.
    let radiance = pack_radiance(guarded_3(s.radiance, GUARD_RESERVOIR));
    return PackedReservoir(
        vec4<u32>(p.structure, s.seed, p.birth, bitcast<u32>(r.ucw)),
        vec4<u32>(p.vertex, p.direction),
        vec4<u32>(radiance, bitcast<vec2<u32>>(s.mis_coefficients)),
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
    r.path.radiance = unpack_radiance(p.suffix.xy);
    r.path.mis_coefficients = bitcast<vec2<f32>>(p.suffix.zw);
    r.path.light = LightPoint(p.light.x, p.light.y);
    r.path.density = bitcast<f32>(p.light.z);
    r.path.target_value = bitcast<f32>(p.light.w);
    let s = r.path;
    let is_path_sound = is_sound(s.mis_coefficients.x) && is_sound(s.mis_coefficients.y) && is_sound(s.density) && is_sound(s.target_value);
    if !guard_holds(is_sound(r.ucw) && is_path_sound, GUARD_RESERVOIR) {
        return no_reservoir();
    }
    return r;
}
