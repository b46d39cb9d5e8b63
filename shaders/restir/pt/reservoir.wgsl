// The reservoir of ReSTIR PT: a path, its unbiased contribution weight and its confidence.  64 bytes (Lin et al. 2026, supplement, 8).
#define_import_path bevy_restir::restir::pt::reservoir

#import bevy_restir::common::math::{is_finite, is_finite_3}
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::restir::stored_path::{confidence_pack, confidence_unpack, connection_pack, no_reservoir, path_unpack, Reservoir}

// The same in memory.
struct PackedReservoir {
    structure: vec4<u32>,      // termination, length, reconnection, lobes and confidence; seed; frame of birth; W
    connection: vec4<u32>,     // reconnection vertex and the direction after it
    suffix: vec4<u32>,         // radiance that arrives there; density of NEE
    light: vec4<u32>,          // point on the light; density; p̂
}

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    // 2 + 7 + 7 + 2 + 2 bits of structure, 12 of confidence.
    let s = r.path;
    let structure = s.termination | s.length << 2u | s.reconnection << 9u | s.lobe_before << 16u | s.lobe_after << 18u | confidence_pack(r.confidence) << 20u;
    return PackedReservoir(
        vec4<u32>(structure, s.seed, s.born, bitcast<u32>(r.ucw)),
        connection_pack(s),
        vec4<u32>(bitcast<vec3<u32>>(s.radiance), bitcast<u32>(s.light_pdf)),
        vec4<u32>(s.light.light, s.light.coordinates, bitcast<u32>(s.density), bitcast<u32>(s.target_value)),
    );
}

// A reservoir with a value that is not finite is dropped with its confidence: kept confidence would make the picture dark.
fn reservoir_unpack(p: PackedReservoir) -> Reservoir {
    let structure = p.structure.x;
    var s = path_unpack(structure, p.connection);
    s.reconnection = structure >> 9u & 127u;
    s.lobe_before = structure >> 16u & 3u;
    s.lobe_after = structure >> 18u & 3u;
    s.seed = p.structure.y;
    s.born = p.structure.z;
    s.radiance = bitcast<vec3<f32>>(p.suffix.xyz);
    s.light_pdf = bitcast<f32>(p.suffix.w);
    s.light = LightPoint(p.light.x, p.light.y);
    s.density = bitcast<f32>(p.light.z);
    s.target_value = bitcast<f32>(p.light.w);
    let confidence = confidence_unpack(structure >> 20u);
    let ucw = bitcast<f32>(p.structure.w);
    let sound = is_finite(ucw) && is_finite_3(s.radiance) && is_finite(s.light_pdf) && is_finite(s.density) && is_finite(s.target_value);
    if !sound || !(ucw >= 0.0) {
        return no_reservoir();
    }
    return Reservoir(s, ucw, confidence, true);
}
