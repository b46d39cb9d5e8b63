// MIS weights of all techniques of a path, by recursion, and after a reconnection of the camera sub-path from three stored floats
// (Hedstrom et al. 2025, 6, reduced).
#import bevy_restir::path::bidirectional_mis::{mis_arrive, mis_camera_start, mis_connection_weight, mis_light_start, mis_scatter, mis_scatter_delta, mis_splat_weight, mis_sum, MisEnd, MisState}

// The path x0 to xk.  Index i: at the vertex xi.
struct Path {
    k: u32,
    delta_light: u32,
    connectable: u32,               // bit i: xi scatters by no delta lobe
    reconnection: u32,              // the first vertex that the base path and the shifted path share
    splats: f32,
    nee: f32,                       // densities of the light's point in area
    light: f32,
    error: u32,                     // a planted error
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
const ERROR_DIRECTION: u32 = 4u;
const ERROR_DELTA_SUFFIX: u32 = 5u;

var<private> p: Path;
var<private> camera: array<MisState, 10>;    // after the arrival at a vertex
var<private> camera_ray: MisState;           // before the arrival at xk
var<private> light: array<MisState, 10>;

fn is_connectable(i: u32) -> bool {
    return (p.connectable & (1u << i)) != 0u;
}

fn trace_camera() {
    let splats = select(p.splats, 1.0, p.error == ERROR_SPLATS);
    camera_ray = mis_arrive(mis_camera_start(splats, p.forward[1] / p.distance2[1]), 1.0 / p.distance2[1], 1.0);
    camera[1] = mis_arrive(camera_ray, p.distance2[1], p.cos_in[1]);
    for (var i = 2u; i <= p.k; i++) {
        if is_connectable(i - 1u) {
            camera_ray = mis_scatter(camera[i - 1u], p.cos_out[i - 1u], p.forward[i], p.reverse[i - 2u]);
        } else {
            camera_ray = mis_scatter_delta(camera[i - 1u], p.cos_out[i - 1u]);
        }
        camera[i] = mis_arrive(camera_ray, p.distance2[i], p.cos_in[i]);
    }
}

// From area at the light to solid angle at the vertex before.
fn at_receiver(pdf: f32) -> f32 {
    return pdf * p.distance2[p.k] / p.cos_in[p.k];
}

fn emission_density() -> f32 {
    return p.reverse[p.k - 1u] / p.distance2[p.k];
}

fn trace_light() {
    let is_delta = p.delta_light != 0u || p.error == ERROR_ENVIRONMENT;
    let start = mis_light_start(at_receiver(p.nee), at_receiver(p.light), emission_density(), is_delta);
    light[p.k - 1u] = mis_arrive(start, 1.0, p.cos_out[p.k - 1u]);
    for (var i = p.k - 2u; i >= 1u; i--) {
        var ray: MisState;
        if is_connectable(i + 1u) {
            ray = mis_scatter(light[i + 1u], p.cos_in[i + 1u], p.reverse[i], p.forward[i + 2u]);
        } else {
            ray = mis_scatter_delta(light[i + 1u], p.cos_in[i + 1u]);
        }
        light[i] = mis_arrive(ray, p.distance2[i + 1u], p.cos_out[i]);
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
    return is_connectable(t) && (t == 1u || is_connectable(t - 1u));
}

// The sums of `rivals_of_hit` and `rivals_of_nee` (`path/technique_weights.wgsl`), of numbers in place of coefficients.
//
// Technique s = 0: the camera sub-path hits a light.  `ray`: its state before it arrives there.  The densities are those of
// `mis_light_start`, in solid angle at the vertex before.
fn mis_hit_weight(ray: MisState, nee_density: f32, light_density: f32, emission_density: f32) -> f32 {
    return 1.0 / (1.0 + nee_density * ray.last + light_density * emission_density * ray.earlier);
}

// Technique s = 1: next-event estimation at the vertex z.  `pdf_forward`: of z's direction towards the light, 0 for a delta light.
// `camera`: state at z, and `pdf_reverse` traces its sub-path back.  The densities are those of `mis_light_start`.
fn mis_nee_weight(
    pdf_forward: f32,
    nee_density: f32,
    light_density: f32,
    emission_density: f32,
    cos_z: f32,
    camera: MisState,
    pdf_reverse: f32,
) -> f32 {
    let found_by_light = light_density / nee_density * emission_density * cos_z * mis_sum(camera, pdf_reverse);
    return 1.0 / (1.0 + pdf_forward / nee_density + found_by_light);
}

fn weight(t: u32) -> f32 {
    let k = p.k;
    if t == k + 1u {
        return mis_hit_weight(camera_ray, at_receiver(p.nee), at_receiver(p.light), emission_density());
    }
    if t == k {
        let pdf = select(p.forward[k], 0.0, p.delta_light != 0u);
        return mis_nee_weight(
            pdf, at_receiver(p.nee), at_receiver(p.light), emission_density(), p.cos_out[k - 1u], camera[k - 1u], p.reverse[k - 2u],
        );
    }
    if t == 1u {
        var reverse = p.forward[2];
        if p.error == ERROR_SPLAT_DENSITY {
            reverse = p.forward[1] * p.cos_in[1] / p.distance2[1];
        }
        return mis_splat_weight(p.forward[1] / p.distance2[1], p.splats, p.cos_in[1], light[1], reverse);
    }
    let eye = MisEnd(camera[t - 1u], p.cos_out[t - 1u], p.forward[t], p.reverse[t - 2u]);
    return mis_connection_weight(eye, MisEnd(light[t], p.cos_in[t], p.reverse[t - 1u], p.forward[t + 1u]), p.distance2[t]);
}

// The weight of technique t after a reconnection at r: 1 / (c0 + (c1 S + c2) / pdf), or for the last vertex before the connection
// 1 / (c0 + c1 pdf + c2 S), where S sums the techniques of the new prefix and pdf is the new density at r.
struct MisCache {
    c0: f32,
    c1: f32,
    c2: f32,
}

fn cache_of(t: u32, r: u32) -> MisCache {
    let k = p.k;
    let e = t - 1u;
    var per_last = at_receiver(p.light) / at_receiver(p.nee) * emission_density() * p.cos_out[e];
    var found_by_camera = select(p.forward[k] / at_receiver(p.nee), 0.0, p.delta_light != 0u);
    var per_earlier = 0.0;
    if t == k + 1u {
        per_last = p.nee;
        per_earlier = p.light * p.reverse[k - 1u];
        found_by_camera = 0.0;
    } else if t < k {
        per_last = p.reverse[e] * p.cos_out[e] / p.distance2[t];
        found_by_camera = p.forward[t] * p.cos_in[t] / p.distance2[t] * mis_sum(light[t], p.forward[t + 1u]);
    }
    if t <= k {
        per_earlier = per_last * p.reverse[e - 1u];
    }
    if e == r {
        return MisCache(1.0, found_by_camera / p.forward[t], per_last);
    }
    let g = p.cos_in[r + 1u] / p.distance2[r + 1u];
    let cosines = p.cos_out[r] / p.cos_in[r + 1u];
    if e == r + 1u {
        return MisCache(1.0 + found_by_camera, per_earlier * cosines, per_last / g);
    }
    var of_prefix = p.reverse[r] * cosines;
    var of_first = select(0.0, 1.0, is_connectable(r + 1u));
    var of_suffix = 0.0;
    for (var i = r + 3u; i <= e; i++) {
        var ratio = p.reverse[i - 2u] * p.cos_out[i - 2u] / (p.forward[i - 1u] * p.cos_in[i - 1u]);
        if p.error == ERROR_DELTA_SUFFIX && !is_connectable(i - 2u) {
            ratio *= p.forward[i - 1u];
        }
        of_prefix *= ratio;
        of_first *= ratio;
        of_suffix = of_suffix * ratio + select(0.0, camera[i - 1u].last, is_connectable(i - 1u));
    }
    var last_edge = p.cos_out[e - 1u] / (p.forward[e] * p.cos_in[e]);
    if p.error == ERROR_DIRECTION {
        last_edge = p.cos_in[e - 1u] * p.distance2[e] / (p.distance2[e - 1u] * p.forward[e] * p.cos_in[e]);
    }
    let scale = per_earlier * last_edge;
    return MisCache(1.0 + found_by_camera + per_last * camera[e].last + scale * of_suffix, scale * of_prefix, scale * of_first / g);
}

fn cached_weight(c: MisCache, is_last: bool, prefix: f32, pdf: f32) -> f32 {
    return 1.0 / select(c.c0 + (c.c1 * prefix + c.c2) / pdf, c.c0 + c.c1 * pdf + c.c2 * prefix, is_last);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&base_paths) {
        return;
    }
    p = base_paths[id.x];
    trace_camera();
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
    var caches: array<MisCache, 10>;
    for (var t = r + 1u; t <= p.k + 1u; t++) {
        caches[t] = cache_of(t, r);
    }
    p = shifted_paths[id.x];
    trace_camera();
    let prefix = mis_sum(camera[r], p.reverse[r - 1u]);
    for (var t = r + 1u; t <= p.k + 1u; t++) {
        // A light that the reconnection vertex itself hits needs no cache.
        if exists(t) && !(t == p.k + 1u && r == p.k) {
            weights[id.x].cached[t] = cached_weight(caches[t], t == r + 1u, prefix, p.forward[r + 1u]);
        }
    }
}
