// The reservoir of ReSTIR GI: a path from its reconnection vertex on, its unbiased contribution weight and its confidence.  48 bytes.
#define_import_path bevy_restir::restir::gi::reservoir

#import bevy_restir::common::math::{is_finite, max_component}
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::restir::path_sample::TERMINATION_NEE
#import bevy_restir::restir::stored_path::{confidence_pack, confidence_unpack, connection_pack, no_reservoir, path_unpack, Reservoir}

// The same in memory.
struct PackedReservoir {
    structure: vec4<u32>,      // termination, length, reconnection, lobes and confidence; seed; W; density
    connection: vec4<u32>,     // reconnection vertex and the direction after it
    light: vec4<u32>,          // NEE: point on the light; otherwise: density of NEE and id of the light; then the packed radiance
}

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    // 2 + 7 + 2 + 2 + 2 bits of structure, 12 of confidence.
    let s = r.path;
    let reconnection = min(s.reconnection, 3u);
    let structure = s.termination | s.length << 2u | reconnection << 9u | s.lobe_before << 11u | s.lobe_after << 13u | confidence_pack(r.confidence) << 20u;
    let light = select(vec2<u32>(bitcast<u32>(s.light_pdf), s.light.light), vec2<u32>(s.light.light, s.light.coordinates), s.termination == TERMINATION_NEE);
    return PackedReservoir(
        vec4<u32>(structure, s.seed, bitcast<u32>(r.ucw), bitcast<u32>(s.density)),
        connection_pack(s),
        vec4<u32>(light, pack_radiance(s.radiance)),
    );
}

// A reservoir with a value that is not finite is dropped with its confidence: kept confidence would make the picture dark.
fn reservoir_unpack(p: PackedReservoir) -> Reservoir {
    let structure = p.structure.x;
    var s = path_unpack(structure, p.connection);
    s.reconnection = structure >> 9u & 3u;
    s.lobe_before = structure >> 11u & 3u;
    s.lobe_after = structure >> 13u & 3u;
    s.seed = p.structure.y;
    s.density = bitcast<f32>(p.structure.w);
    if s.termination == TERMINATION_NEE {
        s.light = LightPoint(p.light.x, p.light.y);
    } else {
        // Paths that hit their light are shifted without its point, which is not stored.
        s.light_pdf = bitcast<f32>(p.light.x);
        s.light = LightPoint(p.light.y, 0u);
    }
    s.radiance = unpack_radiance(p.light.zw);
    let confidence = confidence_unpack(structure >> 20u);
    let ucw = bitcast<f32>(p.structure.z);
    if !is_finite(ucw) || !is_finite(s.light_pdf) || !is_finite(s.density) || !(ucw >= 0.0) {
        return no_reservoir();
    }
    return Reservoir(s, ucw, confidence, true);
}

// Three mantissas of 18 bits with a shared exponent of 8 bits; the error is below 2^-18 of the greatest channel.
fn pack_radiance(c: vec3<f32>) -> vec2<u32> {
    let greatest = min(max_component(c), 1.0e38);
    if !(greatest > 1.0e-30) {
        return vec2<u32>(0u);
    }
    // The biased exponent of the next power of two; 2^(145 - exponent) scales smaller values to 18 bits.
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
