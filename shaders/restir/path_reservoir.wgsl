// What a pixel of whole paths keeps: a path, its unbiased contribution weight, and how much it is worth.  64 bytes (paper 000, 8).
#define_import_path bevy_restir::restir::path_reservoir

#import bevy_restir::common::math::{is_finite, is_finite_3, octahedral_decode, octahedral_encode}
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::path::sample::{decode_barycentrics, no_path_sample, PathSample}

struct Reservoir {
    path: PathSample,
    ucw: f32,              // W: E[f(X) W] = ∫ f, in the measure of the path; 0: nothing was found
    confidence: f32,       // candidates' worth that it stands for
    seen: bool,            // always: paths that are not seen are not kept
}

// As it lies in memory.
struct PackedReservoir {
    structure: vec4<u32>,      // end, length, reconnection, lobes and confidence; seed; birth; W
    connection: vec4<u32>,     // vertex k and where the path goes from there
    suffix: vec4<u32>,         // what it carries from there on
    light: vec4<u32>,          // the light that is aimed at; density; p̂
}

fn no_reservoir() -> Reservoir {
    return Reservoir(no_path_sample(), 0.0, 0.0, true);
}

// Confidence is kept in sixteenths.
const CONFIDENCE_MAX: f32 = 255.0;

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    // 2 + 7 + 7 + 2 + 2 bits of structure, 12 of confidence.
    let s = r.path;
    let confidence = u32(clamp(r.confidence, 0.0, CONFIDENCE_MAX) * 16.0 + 0.5);
    let structure = s.end | s.length << 2u | s.reconnection << 9u | s.lobe_before << 16u | s.lobe_after << 18u | confidence << 20u;
    return PackedReservoir(
        vec4<u32>(structure, s.seed, s.born, bitcast<u32>(r.ucw)),
        vec4<u32>(s.instance, s.triangle, pack2x16unorm(s.barycentrics), octahedral_encode(s.wi)),
        vec4<u32>(bitcast<vec3<u32>>(s.radiance), bitcast<u32>(s.light_pdf)),
        vec4<u32>(s.light.light, s.light.coordinates, bitcast<u32>(s.density), bitcast<u32>(s.target_value)),
    );
}

// A number that is not finite must not spread over the screen (trap T23).
fn reservoir_unpack(p: PackedReservoir) -> Reservoir {
    var s = no_path_sample();
    let structure = p.structure.x;
    s.end = structure & 3u;
    s.length = structure >> 2u & 127u;
    s.reconnection = structure >> 9u & 127u;
    s.lobe_before = structure >> 16u & 3u;
    s.lobe_after = structure >> 18u & 3u;
    s.seed = p.structure.y;
    s.born = p.structure.z;
    s.instance = p.connection.x;
    s.triangle = p.connection.y;
    s.barycentrics = decode_barycentrics(p.connection.z);
    s.wi = octahedral_decode(p.connection.w);
    s.radiance = bitcast<vec3<f32>>(p.suffix.xyz);
    s.light_pdf = bitcast<f32>(p.suffix.w);
    s.light = LightPoint(p.light.x, p.light.y);
    s.density = bitcast<f32>(p.light.z);
    s.target_value = bitcast<f32>(p.light.w);
    let confidence = f32(structure >> 20u) / 16.0;
    let ucw = bitcast<f32>(p.structure.w);
    let sound = is_finite(ucw) && is_finite_3(s.radiance) && is_finite(s.light_pdf) && is_finite(s.density) && is_finite(s.target_value);
    if !sound || !(ucw >= 0.0) {
        return Reservoir(no_path_sample(), 0.0, confidence, true);
    }
    return Reservoir(s, ucw, confidence, true);
}
