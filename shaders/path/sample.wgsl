// What is kept of a whole path: how its random numbers begin, where other pixels reconnect to it, and what it carries from there on.
// Its measure: primary sample space as far as it is sampled by BSDFs, the light's own measure for a point that is aimed at.
// Vertices are numbered from the camera's, 0; the one on the light is `length`.
#define_import_path bevy_restir::path::sample

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::light::point_on_light::{LightPoint, no_light_point}

// How a path came to its light.
const END_NONE: u32 = 0u;             // there is no path
const END_LIGHT: u32 = 1u;            // aimed at a point of a light
const END_EMITTER: u32 = 2u;          // its last ray met an emissive triangle, or passed a ball or rectangle
const END_ENVIRONMENT: u32 = 3u;      // or met nothing, but perhaps the disc of a sun

struct PathSample {
    seed: u32,                // of the random numbers that it is replayed with
    born: u32,                // frame that it was sampled in
    end: u32,                 // END_*
    length: u32,              // index of the vertex on the light, from 2
    reconnection: u32,        // index k of the first vertex that is kept as it is; 0: all is replayed
    lobe_before: u32,         // LOBE_* at k - 1
    lobe_after: u32,          // and at k, where the path goes on
    instance: u32,            // of vertex k
    triangle: u32,
    barycentrics: vec2<f32>,
    wi: vec3<f32>,            // from vertex k on; of an environment its direction
    radiance: vec3<f32>,      // that arrives at k from there, over the densities of what is sampled after k
    light_pdf: f32,           // with which k aims at the light that its ray met, solid angle; 0: it cannot
    light: LightPoint,        // of END_LIGHT, and of ball, rectangle and sun; none of triangles and the environment that were met
    density: f32,             // of reaching k from k - 1, in the own measure of its triangle or light (uniform, whole), and of going on,
                              // solid angle: denominator of the shift's Jacobian
    target_value: f32,        // p̂ in the pixel that keeps it
}

fn no_path_sample() -> PathSample {
    return PathSample(
        0u, 0u, END_NONE, 0u, 0u, 0u, 0u, NONE, NONE, vec2<f32>(0.0), vec3<f32>(0.0, 0.0, 1.0), vec3<f32>(0.0), 0.0,
        no_light_point(), 0.0, 0.0,
    );
}

// What of a path is another where it was shifted to.
struct Arrival {
    radiance: vec3<f32>,
    light_pdf: f32,
    density: f32,
    target_value: f32,
}

fn arrived_path(s: PathSample, a: Arrival) -> PathSample {
    var p = s;
    p.radiance = a.radiance;
    p.light_pdf = a.light_pdf;
    p.density = a.density;
    p.target_value = a.target_value;
    return p;
}

// Where a ray lands: a vertex that others may reconnect to lies where it is decoded.
fn landed_barycentrics(b: vec2<f32>, may_be_kept: bool) -> vec2<f32> {
    return select(b, kept_barycentrics(b), may_be_kept);
}

// Barycentrics and directions as they are kept: the path itself goes by the decoded values.
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
