// MIS weights of all techniques of a path, and after a shift that replaces its camera sub-path up to a reconnection vertex, by the functions
// that the passes call.  The test edits the places of `path/technique_weights.wgsl` that ask surfaces and lights for densities: they take
// numbers of the path, which this kernel puts into fields of vertices and light samples.
#import bevy_restir::light::types::{LightSample, no_light_sample}
#import bevy_restir::path::bidirectional_mis::{LightEnd, mis_arrive, mis_connection_ratios, mis_light_start, mis_scatter, mis_scatter_delta, mis_splat_weight, MisState}
#import bevy_restir::path::technique_weights::{below_surface, camera_state, CameraState, LightShares, mis_sum_of_connection, mis_sum_of_hit, mis_sum_of_nee, state_at, state_of_ray, stored_weight, TechniqueCounts, weight_of}
#import bevy_restir::path::walk::{no_step, Step, Vertex}
#import bevy_restir::restir::connection::light_sub_path::over_share
#import bevy_restir::scene::surface::Surface

// The path x0 to xk.  Index i: at the vertex xi.
struct Path {
    k: u32,
    delta_light: u32,
    connectable: u32,               // bit i: xi scatters by no delta lobe
    reconnection: u32,              // the first vertex that the base path and the shifted path share
    below: u32,                     // the last vertex below which light scatters, or 0
    error: u32,                     // a planted error
    candidates: u32,                // of next-event estimation at x1
    splats: f32,
    connections: f32,
    nee_share: f32,                 // factors of the densities of light sub-paths (`LightShares`)
    caustic_share: f32,
    nee: f32,                       // densities of the light's point in area
    light: f32,
    cos_in: array<f32, 10>,         // towards the vertex before
    cos_out: array<f32, 10>,        // towards the next vertex
    distance2: array<f32, 10>,      // to the vertex before
    forward: array<f32, 10>,        // density of choosing this vertex from the one before, solid angle
    reverse: array<f32, 10>,        // from the next one
}

struct Weights {
    recursive: array<f32, 10>,      // index t
    cached: array<f32, 10>,         // of the shifted path
}

@group(0) @binding(0) var<storage, read> base_paths: array<Path>;
@group(0) @binding(1) var<storage, read> shifted_paths: array<Path>;
@group(0) @binding(2) var<storage, read_write> weights: array<Weights>;

const ERROR_SPLATS: u32 = 1u;
const ERROR_ENVIRONMENT: u32 = 2u;
const ERROR_SPLAT_DENSITY: u32 = 3u;
const ERROR_CANDIDATES: u32 = 4u;
const ERROR_DIRECTION: u32 = 5u;
const ERROR_DELTA_SUFFIX: u32 = 6u;

var<private> p: Path;
var<private> light: array<MisState, 10>;     // of the light sub-path, after the arrival at a vertex

fn is_connectable(i: u32) -> bool {
    return (p.connectable & (1u << i)) != 0u;
}

fn counts() -> TechniqueCounts {
    let splats = select(p.splats, 1.0, p.error == ERROR_SPLATS);
    return TechniqueCounts(p.candidates, splats, p.connections, LightShares(p.nee_share, p.caustic_share));
}

// Density of the camera's rays at x1.
fn density_of_camera() -> f32 {
    return p.forward[1] / p.distance2[1];
}

// From area at the light to solid angle at the vertex before.
fn at_receiver(pdf: f32) -> f32 {
    return pdf * p.distance2[p.k] / p.cos_in[p.k];
}

// Density of rays of the light at the vertex before it, for each unit of perpendicular area.
fn density_of_rays() -> f32 {
    return p.reverse[p.k - 1u] / p.distance2[p.k];
}

// The surface of xi, for a sub-path that comes from the origin.
fn surface(i: u32) -> Surface {
    var s: Surface;
    s.bsdf.n_geo = vec3<f32>(0.0, 0.0, 1.0);
    s.position = vec3<f32>(sqrt(p.distance2[i]), 0.0, 0.0);
    return s;
}

fn vertex(i: u32) -> Vertex {
    var v: Vertex;
    v.surface = surface(i);
    v.wo = vec3<f32>(0.0, 0.0, p.cos_in[i]);
    // The result of `reverse_pdf`.
    v.medium.x = p.reverse[i - 1u];
    return v;
}

fn step_from(i: u32) -> Step {
    var s = no_step();
    s.valid = true;
    s.wi = vec3<f32>(0.0, 0.0, p.cos_out[i]);
    s.delta = !is_connectable(i);
    s.pdf = select(p.forward[i + 1u], 0.0, s.delta);
    return s;
}

// The light's point as the vertex before it samples it.
fn light_sample() -> LightSample {
    var l = no_light_sample();
    l.light = 0u;
    l.delta = p.delta_light;
    l.wi = vec3<f32>(0.0, 0.0, p.cos_out[p.k - 1u]);
    l.pdf_solid_angle = at_receiver(p.light);
    l.pdf_scale = p.nee / p.light;
    // The result of `emission_density`.
    l.distance = density_of_rays();
    return l;
}

// The state of a camera sub-path that scatters at xi.
fn scattering(s: CameraState, i: u32) -> CameraState {
    if i == p.below {
        return below_surface(s);
    }
    return s;
}

fn leaving(s: CameraState, i: u32, reconnection: u32) -> CameraState {
    var ray = state_of_ray(s, vertex(i), step_from(i), i == reconnection && i != p.below);
    if p.error == ERROR_DELTA_SUFFIX && i > reconnection && !is_connectable(i) {
        ray.earlier *= p.reverse[i - 1u];
    }
    return ray;
}

// Eq. 42 as printed, at the last vertex x_e of a camera sub-path: the last edge has the geometry term of the edge before, in the direction of
// the sub-path.  The state lacks the distance of the last edge, which cancels.
fn with_printed_direction(s: CameraState, e: u32, reconnection: u32) -> CameraState {
    var printed = s;
    if p.error == ERROR_DIRECTION && reconnection > 0u && e >= reconnection + 2u {
        printed.earlier *= p.cos_in[e - 1u] * p.distance2[e] / (p.distance2[e - 1u] * p.cos_out[e - 1u]);
    }
    return printed;
}

// The state at x_last of a camera sub-path that has this reconnection vertex; 0: none.
fn state_at_vertex(last: u32, reconnection: u32) -> CameraState {
    var s = scattering(camera_state(vertex(1u), density_of_camera(), counts()), 1u);
    for (var i = 1u; i < last; i++) {
        let ray = leaving(s, i, reconnection);
        s = scattering(state_at(ray, surface(i + 1u), vec3<f32>(0.0, 0.0, p.cos_in[i + 1u]), vec3<f32>(0.0), counts()), i + 1u);
    }
    return s;
}

// Coefficients of the sum for technique t >= 2, and its state.
struct MisSum {
    coefficients: vec3<f32>,
    state: CameraState,
}

fn mis_sum_of(t: u32, reconnection: u32) -> MisSum {
    let last = min(t, p.k) - 1u;
    let state = state_at_vertex(last, reconnection);
    if t > p.k {
        let ray = with_printed_direction(leaving(state, last, reconnection), p.k, reconnection);
        return MisSum(mis_sum_of_hit(ray, light_sample(), !is_connectable(last), last, counts()), ray);
    }
    let at = with_printed_direction(state, last, reconnection);
    if t < p.k {
        return MisSum(mis_sum_of_connection(at, vertex(last), vec3<f32>(0.0), p.forward[t], ratios_of_connection(t)), at);
    }
    return MisSum(mis_sum_of_nee(at, vertex(last), light_sample(), p.forward[p.k], last, counts()), at);
}

// As `restir/connection/connection.wgsl` does it.
fn ratios_of_connection(t: u32) -> vec2<f32> {
    let end = LightEnd(light[t], p.cos_in[t], p.reverse[t - 1u], p.forward[t + 1u]);
    return mis_connection_ratios(end, p.cos_out[t - 1u], p.distance2[t], p.connections);
}

// As `restir/connection/light_sub_path.wgsl` does it.
fn trace_light() {
    let is_delta = p.delta_light != 0u || p.error == ERROR_ENVIRONMENT;
    let start = mis_light_start(at_receiver(p.nee), at_receiver(p.light), density_of_rays(), is_delta);
    light[p.k - 1u] = over_share(mis_arrive(start, 1.0, p.cos_out[p.k - 1u]), p.nee_share);
    for (var i = p.k - 2u; i >= 1u; i--) {
        var ray = mis_scatter_delta(light[i + 1u], p.cos_in[i + 1u]);
        if is_connectable(i + 1u) {
            ray = mis_scatter(light[i + 1u], p.cos_in[i + 1u], p.reverse[i], p.forward[i + 2u]);
        }
        var s = mis_arrive(ray, p.distance2[i + 1u], p.cos_out[i]);
        if i + 2u == p.k && !is_connectable(i + 1u) {
            s = over_share(s, p.caustic_share / p.nee_share);
        }
        s.last *= p.connections;
        light[i] = s;
    }
}

// Whether technique (k + 1 - t, t) can find the path.
fn exists(t: u32) -> bool {
    if t == p.k + 1u {
        return p.delta_light == 0u;
    }
    if t == p.k {
        return t >= 2u && is_connectable(t - 1u);
    }
    return t > p.below && is_connectable(t) && (t == 1u || (p.connections > 0.0 && is_connectable(t - 1u)));
}

fn weight(t: u32) -> f32 {
    if t == 1u {
        var reverse = p.forward[2];
        if p.error == ERROR_SPLAT_DENSITY {
            reverse = p.forward[1] * p.cos_in[1] / p.distance2[1];
        }
        // As `restir/bdpt/splat.wgsl` does it.
        var state = light[1];
        if p.k == 2u && p.error != ERROR_CANDIDATES {
            state.last *= f32(p.candidates);
        }
        return mis_splat_weight(density_of_camera(), p.splats, p.cos_in[1], state, reverse);
    }
    let sum = mis_sum_of(t, p.reconnection);
    return weight_of(sum.coefficients, sum.state);
}

// The weight of a shifted path, from the coefficients of the base path.  A reservoir stores two numbers, and its radiance is divided by the
// third one.
fn weight_after_shift(base: vec3<f32>, s: CameraState) -> f32 {
    return stored_weight(base.yz / base.x, s) / base.x;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&base_paths) {
        return;
    }
    p = base_paths[id.x];
    trace_light();
    for (var t = 1u; t <= p.k + 1u; t++) {
        if exists(t) {
            weights[id.x].recursive[t] = weight(t);
        }
    }
    let r = p.reconnection;
    if r == 0u {
        return;
    }
    var stored: array<vec3<f32>, 10>;
    for (var t = r + 1u; t <= p.k + 1u; t++) {
        stored[t] = mis_sum_of(t, r).coefficients;
    }
    let ratios = ratios_of_connection(r + 1u);
    p = shifted_paths[id.x];
    let at = state_at_vertex(r, r);
    var s = at;
    if r != p.below {
        s = leaving(s, r, r);
    }
    for (var t = r + 1u; t <= p.k + 1u; t++) {
        // The last vertex of a camera sub-path does not store its direction's weight.
        let ends_at_reconnection = t == r + 1u && r != p.below;
        if exists(t) && !ends_at_reconnection {
            weights[id.x].cached[t] = weight_after_shift(stored[t], s);
        }
    }
    if exists(r + 1u) && r + 1u < p.k && r != p.below {
        let sum = mis_sum_of_connection(at, vertex(r), vec3<f32>(0.0), p.forward[r + 1u], ratios);
        weights[id.x].cached[r + 1u] = weight_of(sum, at);
    }
}
