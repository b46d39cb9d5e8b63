// A resampled path: its random seed, the vertex at which other pixels reconnect to it, and the radiance that it carries from there on.
// The measure is primary sample space for everything that BSDFs sample, and the light's own measure for a point that NEE sampled.
// Vertices are numbered from the camera, 0; the vertex on the light has the index `length`.
#define_import_path bevy_restir::restir::path_sample

#import bevy_restir::common::constants::NONE
#import bevy_restir::light::point_on_light::{LightPoint, no_light_point}

// How a path ends.
const TERMINATION_NONE: u32 = 0u;             // there is no path
const TERMINATION_NEE: u32 = 1u;              // NEE sampled a point of a light
const TERMINATION_EMITTER: u32 = 2u;          // the last ray hit an emissive triangle, or passed a spherical or rectangular light
const TERMINATION_ENVIRONMENT: u32 = 3u;      // the last ray escaped: the environment, or the disk of a sun
const TERMINATION_CONNECTION: u32 = 4u;       // the last vertex was joined with a light vertex (`restir/connection/connection.wgsl`)

struct PathSample {
    seed: u32,                // of the random numbers that replay uses
    born: u32,                // frame that the path was sampled in; a stored path keeps its low 16 bits
    termination: u32,         // TERMINATION_*
    length: u32,              // index of the vertex on the light, or of the light vertex of a connection; from 2
    reconnection: u32,        // index k of the reconnection vertex; 0: the whole path is replayed
    lobe_before: u32,         // LOBE_* at vertex k - 1
    lobe_after: u32,          // LOBE_* at vertex k
    instance: u32,            // of vertex k
    triangle: u32,
    barycentrics: vec2<f32>,
    wi: vec3<f32>,            // direction after vertex k; direction of the environment where the path ends there
    radiance: vec3<f32>,      // arriving at vertex k from wi, divided by the densities of everything sampled after k, and by the
                              // coefficient of 1 (`path/technique_weights.wgsl`); its missing factor is `stored_weight`
    mis_coefficients: vec2<f32>,  // the coefficients of 1/p and S/p, divided by that of 1 (`stored_weight`); with COPIED_MIS the path's
                              // MIS weight in the pixel that sampled it, and 0: the radiance is divided by densities only
    light: LightPoint,        // of NEE, and of a sphere, rectangle or sun that was hit; NONE for triangles and the environment
    density: f32,             // of sampling vertex k from k - 1, in the measure of its triangle or light (uniform, total 1), times that
                              // of the direction after it, solid angle; denominator of the shift's Jacobian (Lin et al. 2026,
                              // supplement, Eq. 4).  Where vertex k is a light vertex: the length of its sub-path in an unknown medium, m
    target_value: f32,        // p̂ in the pixel that stores it
}

fn no_path_sample() -> PathSample {
    return PathSample(
        0u, 0u, TERMINATION_NONE, 0u, 0u, 0u, 0u, NONE, NONE, vec2<f32>(0.0), vec3<f32>(0.0, 0.0, 1.0), vec3<f32>(0.0), vec2<f32>(0.0),
        no_light_point(), 0.0, 0.0,
    );
}

// Path fields that a shift changes.  The shift of a connection may change its light vertex.
#ifdef CONNECTIONS
struct ShiftResult {
    radiance: vec3<f32>,
    mis_coefficients: vec2<f32>,
    density: f32,
    target_value: f32,
    vertex: vec2<u32>,
    barycentrics: vec2<f32>,
    wi: vec3<f32>,
}

fn shift_result(p: PathSample) -> ShiftResult {
    return ShiftResult(p.radiance, p.mis_coefficients, p.density, p.target_value, vec2<u32>(p.instance, p.triangle), p.barycentrics, p.wi);
}

fn with_shift_result(s: PathSample, r: ShiftResult) -> PathSample {
    var p = with_shifted_fields(s, r.radiance, r.mis_coefficients, r.density, r.target_value);
    p.instance = r.vertex.x;
    p.triangle = r.vertex.y;
    p.barycentrics = r.barycentrics;
    p.wi = r.wi;
    return p;
}
#else
struct ShiftResult {
    radiance: vec3<f32>,
    mis_coefficients: vec2<f32>,
    density: f32,
    target_value: f32,
}

fn shift_result(p: PathSample) -> ShiftResult {
    return ShiftResult(p.radiance, p.mis_coefficients, p.density, p.target_value);
}

fn with_shift_result(s: PathSample, r: ShiftResult) -> PathSample {
    return with_shifted_fields(s, r.radiance, r.mis_coefficients, r.density, r.target_value);
}
#endif

// Sets the fields that every shift changes.
fn with_shifted_fields(s: PathSample, radiance: vec3<f32>, mis_coefficients: vec2<f32>, density: f32, target_value: f32) -> PathSample {
    var p = s;
    p.radiance = radiance;
    p.mis_coefficients = mis_coefficients;
    p.density = density;
    p.target_value = target_value;
    return p;
}

// COPIED_MIS (`Bdpt::mis`): a shift copies the MIS weight of the path, which the path stores in place of coefficients (Hedstrom et al. 2025, 6.4).
#ifdef COPIED_MIS
const COPIES_MIS: bool = true;

// The path with the light behind its reconnection vertex.
fn with_suffix(s: PathSample, radiance: vec3<f32>, coefficients: vec3<f32>) -> PathSample {
    var path = s;
    path.radiance = radiance;
    return path;
}

// A new path with its MIS weight.
fn with_mis_weight(s: PathSample, weight: f32) -> PathSample {
    var path = s;
    path.mis_coefficients = vec2<f32>(weight, 0.0);
    return path;
}

// A shifted path with the MIS weight of the path that it is a shift of.
fn with_mis_of(shifted: PathSample, s: PathSample) -> PathSample {
    var path = shifted;
    path.mis_coefficients = s.mis_coefficients;
    return path;
}
#else
const COPIES_MIS: bool = false;

// The path with the light behind its reconnection vertex.  `coefficients`: its MIS coefficients (`path/technique_weights.wgsl`).
fn with_suffix(s: PathSample, radiance: vec3<f32>, coefficients: vec3<f32>) -> PathSample {
    var path = s;
    path.radiance = radiance / coefficients.x;
    path.mis_coefficients = coefficients.yz / coefficients.x;
    return path;
}

fn with_mis_weight(s: PathSample, weight: f32) -> PathSample {
    return s;
}

fn with_mis_of(shifted: PathSample, s: PathSample) -> PathSample {
    return shifted;
}
#endif

// Barycentrics of a new vertex.  A vertex that may become the reconnection vertex is rounded as a reservoir stores it, so that the path
// that is weighted is the one that is stored.
fn vertex_barycentrics(b: vec2<f32>, may_reconnect: bool) -> vec2<f32> {
    return select(b, quantized_barycentrics(b), may_reconnect);
}

fn quantized_barycentrics(b: vec2<f32>) -> vec2<f32> {
    return decode_barycentrics(encode_barycentrics(b));
}

// Barycentrics are stored on a grid of 2^-24: 24 bits each.  The second is limited so that the point stays within the triangle; encoding a
// decoded point changes nothing.
fn encode_barycentrics(b: vec2<f32>) -> vec2<u32> {
    let x = u32(clamp(round(b.x * 0x1p24), 0.0, 16777215.0));
    let y = u32(clamp(round(b.y * 0x1p24), 0.0, 16777215.0));
    return vec2<u32>(x, min(y, 0x1000000u - x));
}

fn decode_barycentrics(bits: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(bits) * 0x1p-24;
}
