// The reservoir of ReSTIR GI: a path from its secondary vertex on, its unbiased contribution weight and its confidence.  52 bytes.
#define_import_path bevy_restir::restir::gi::reservoir

#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, guarded_3, is_sound}
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::restir::path_sample::TERMINATION_NEE
#import bevy_restir::restir::stored_path::{no_reservoir, pack_radiance, PackedPath, path_pack, path_unpack, Reservoir, unpack_radiance}

// The reservoir as it is stored: structure, seed, birth, W; vertex and direction; density; light; radiance.
struct PackedReservoir {
    words: array<u32, 13>,
}

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    let s = r.path;
    let p = path_pack(r);
    // The point on a light that the last ray hit matters only to paths that stay in their pixel: `mis_coefficients` takes its place.
    let of_hit = vec2<u32>(s.light.light, bitcast<u32>(s.mis_coefficients.x));
    let light = select(of_hit, vec2<u32>(s.light.light, s.light.coordinates), s.termination == TERMINATION_NEE);
    // The format has no sign and no NaN, so both are detected before.
    let radiance = pack_radiance(guarded_3(s.radiance, GUARD_RESERVOIR));
    return PackedReservoir(array<u32, 13>(
        p.structure, s.seed, p.birth, bitcast<u32>(r.ucw),
        p.vertex.x, p.vertex.y, p.vertex.z, p.direction,
        bitcast<u32>(s.density), light.x, light.y, radiance.x, radiance.y,
    ));
}

// Reservoirs that hold the same candidate have the same identity, wherever it was shifted.
fn identity_of(p: PackedReservoir) -> vec2<u32> {
    return vec2<u32>(p.words[1], p.words[2] & 0xffffu);
}

// A reservoir with a value that is negative or not finite is dropped with its confidence: kept confidence would make the picture dark.
fn reservoir_unpack(p: PackedReservoir) -> Reservoir {
    let w = p.words;
    var r = path_unpack(PackedPath(w[0], w[2], vec3<u32>(w[4], w[5], w[6]), w[7]));
    r.path.seed = w[1];
    r.ucw = bitcast<f32>(w[3]);
    r.path.density = bitcast<f32>(w[8]);
    if r.path.termination == TERMINATION_NEE {
        r.path.light = LightPoint(w[9], w[10]);
    } else {
        r.path.light = LightPoint(w[9], 0u);
        r.path.mis_coefficients = vec2<f32>(bitcast<f32>(w[10]), 0.0);
    }
    r.path.radiance = unpack_radiance(vec2<u32>(w[11], w[12]));
    if !guard_holds(is_sound(r.ucw) && is_sound(r.path.mis_coefficients.x) && is_sound(r.path.density), GUARD_RESERVOIR) {
        return no_reservoir();
    }
    return r;
}
