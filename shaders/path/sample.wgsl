// What is kept of a whole path: how its random numbers begin, where other pixels reconnect to it, and what it carries from there on.
// 64 bytes (paper 000, 8).  Vertices are numbered from the camera's, 0; the one on the light is `length`.
#define_import_path bevy_restir::path::sample

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::{is_finite, is_finite_3, octahedral_decode, octahedral_encode}
#import bevy_restir::light::point_on_light::{LightPoint, no_light_point}

// How a path came to its light.
const END_NONE: u32 = 0u;             // there is no path
const END_LIGHT: u32 = 1u;            // aimed at a point of a light
const END_EMITTER: u32 = 2u;          // its last ray met an emissive triangle
const END_ENVIRONMENT: u32 = 3u;      // or nothing

struct PathSample {
    seed: vec2<u32>,          // pixel (y << 16 | x) and frame whose random numbers it is replayed with
    end: u32,                 // END_*
    length: u32,              // index of the vertex on the light, from 2
    reconnection: u32,        // index k of the first vertex that is kept as it is; 0: all is replayed
    lobe_before: u32,         // LOBE_* at k - 1
    lobe_after: u32,          // and at k, where the path goes on
    instance: u32,            // of vertex k
    triangle: u32,
    barycentrics: vec2<f32>,
    wi: vec3<f32>,            // from vertex k on; of an environment its direction
    radiance: vec3<f32>,      // that arrives at k from there, over the densities after k
    light_pdf: f32,           // with which k aims at the light that its ray met, solid angle; 0: it cannot
    light: LightPoint,        // of END_LIGHT
    density: f32,             // of reaching k from k - 1 and of going on, area and solid angle: denominator of the shift's Jacobian
    target_value: f32,        // p̂ in the pixel that keeps it
    ucw: f32,                 // W, in primary sample space; 0: nothing was found
    confidence: f32,          // candidates' worth
}

fn no_path_sample() -> PathSample {
    return PathSample(
        vec2<u32>(0u), END_NONE, 0u, 0u, 0u, 0u, NONE, NONE, vec2<f32>(0.0), vec3<f32>(0.0, 0.0, 1.0), vec3<f32>(0.0), 0.0,
        no_light_point(), 0.0, 0.0, 0.0, 0.0,
    );
}

// Barycentrics and directions as they are kept: the path itself goes by the decoded values (trap T6).
fn kept_barycentrics(b: vec2<f32>) -> vec2<f32> {
    return decode_barycentrics(pack2x16unorm(b));
}

fn decode_barycentrics(word: u32) -> vec2<f32> {
    // Rounding may put a point beyond the diagonal.
    let b = unpack2x16unorm(word);
    return b / max(1.0, b.x + b.y);
}

fn kept_direction(d: vec3<f32>) -> vec3<f32> {
    return octahedral_decode(octahedral_encode(d));
}

// Four words of 16 bytes.
struct PackedPath {
    a: vec4<u32>,
    b: vec4<u32>,
    c: vec4<u32>,
    d: vec4<u32>,
}

const LENGTH_MAX: u32 = 127u;

fn path_pack(s: PathSample) -> PackedPath {
    // 2 + 7 + 7 + 2 + 2 bits of structure, 12 of confidence in sixteenths.
    let confidence = u32(clamp(s.confidence, 0.0, 255.0) * 16.0 + 0.5);
    let structure = s.end | s.length << 2u | s.reconnection << 9u | s.lobe_before << 16u | s.lobe_after << 18u | confidence << 20u;
    return PackedPath(
        vec4<u32>(structure, s.seed, bitcast<u32>(s.ucw)),
        vec4<u32>(s.instance, s.triangle, pack2x16unorm(s.barycentrics), octahedral_encode(s.wi)),
        vec4<u32>(bitcast<vec3<u32>>(s.radiance), bitcast<u32>(s.light_pdf)),
        vec4<u32>(s.light.light, s.light.coordinates, bitcast<u32>(s.density), bitcast<u32>(s.target_value)),
    );
}

// A number that is not finite must not spread over the screen (trap T23).
fn path_unpack(p: PackedPath) -> PathSample {
    var s = no_path_sample();
    let structure = p.a.x;
    s.end = structure & 3u;
    s.length = structure >> 2u & 127u;
    s.reconnection = structure >> 9u & 127u;
    s.lobe_before = structure >> 16u & 3u;
    s.lobe_after = structure >> 18u & 3u;
    s.confidence = f32(structure >> 20u) / 16.0;
    s.seed = p.a.yz;
    s.ucw = bitcast<f32>(p.a.w);
    s.instance = p.b.x;
    s.triangle = p.b.y;
    s.barycentrics = decode_barycentrics(p.b.z);
    s.wi = octahedral_decode(p.b.w);
    s.radiance = bitcast<vec3<f32>>(p.c.xyz);
    s.light_pdf = bitcast<f32>(p.c.w);
    s.light = LightPoint(p.d.x, p.d.y);
    s.density = bitcast<f32>(p.d.z);
    s.target_value = bitcast<f32>(p.d.w);
    let sound = is_finite(s.ucw) && is_finite_3(s.radiance) && is_finite(s.light_pdf) && is_finite(s.density) && is_finite(s.target_value);
    if !sound || !(s.ucw >= 0.0) {
        let confidence = s.confidence;
        s = no_path_sample();
        s.confidence = confidence;
    }
    return s;
}
