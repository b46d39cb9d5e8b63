// The reservoir of ReSTIR GI: a path from its secondary vertex on, its unbiased contribution weight and its confidence.  52 bytes.
#define_import_path bevy_restir::restir::gi::reservoir

#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, guarded_3, is_sound}
#import bevy_restir::common::math::max_component
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::restir::path_sample::TERMINATION_NEE
#import bevy_restir::restir::stored_path::{no_reservoir, PackedPath, path_pack, path_unpack, Reservoir}

// The reservoir as it is stored: structure, seed, birth, W; vertex and direction; density; light; radiance.
struct PackedReservoir {
    words: array<u32, 13>,
}

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    let s = r.path;
    let p = path_pack(r);
    // The point on a light that the last ray hit matters only to paths that stay in their pixel: the density of NEE takes its place.
    let of_hit = vec2<u32>(s.light.light, bitcast<u32>(s.light_pdf));
    let light = select(of_hit, vec2<u32>(s.light.light, s.light.coordinates), s.termination == TERMINATION_NEE);
    // The format has no sign and no NaN: it would hide both.
    let radiance = pack_radiance(guarded_3(s.radiance, GUARD_RESERVOIR));
    return PackedReservoir(array<u32, 13>(
        p.structure, s.seed, p.birth, bitcast<u32>(r.ucw),
        p.vertex.x, p.vertex.y, p.vertex.z, p.direction,
        bitcast<u32>(s.density), light.x, light.y, radiance.x, radiance.y,
    ));
}

// A reservoir with a value that is not finite or negative is dropped with its confidence: kept confidence would make the picture dark.
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
        r.path.light_pdf = bitcast<f32>(w[10]);
    }
    r.path.radiance = unpack_radiance(vec2<u32>(w[11], w[12]));
    if !guard_holds(is_sound(r.ucw) && is_sound(r.path.light_pdf) && is_sound(r.path.density), GUARD_RESERVOIR) {
        return no_reservoir();
    }
    return r;
}

// 18 bits a channel and a shared exponent of 8: exact to 2^-18 of the greatest channel.  Radiance below 1e-30 is stored as black, and
// above 1e38 as 1e38.
fn pack_radiance(c: vec3<f32>) -> vec2<u32> {
    let greatest = min(max_component(c), 1.0e38);
    if !(greatest > 1.0e-30) {
        return vec2<u32>(0u);
    }
    // The biased exponent of the power of two above it; 2^(145 - exponent) scales smaller values to 18 bits.
    let exponent = (bitcast<u32>(greatest) >> 23u) + 1u;
    let scale = bitcast<f32>((272u - exponent) << 23u);
    let m = min(vec3<u32>(max(c, vec3<f32>(0.0)) * scale + 0.5), vec3<u32>(0x3ffffu));
    return vec2<u32>(m.x | m.y << 18u, m.y >> 14u | m.z << 4u | exponent << 22u);
}

fn unpack_radiance(w: vec2<u32>) -> vec3<f32> {
    let exponent = w.y >> 22u & 0xffu;
    if exponent < 19u {
        return vec3<f32>(0.0);
    }
    let m = vec3<u32>(w.x & 0x3ffffu, (w.x >> 18u | w.y << 14u) & 0x3ffffu, w.y >> 4u & 0x3ffffu);
    return vec3<f32>(m) * bitcast<f32>((exponent - 18u) << 23u);
}
