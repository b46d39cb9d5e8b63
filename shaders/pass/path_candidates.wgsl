// Initial candidates of ReSTIR PT and GI (Lin et al. 2026; Lanz 2025, 4.3.2): one tree of paths a pixel, resampled into one path.

#import bevy_restir::bsdf::bsdf::bsdf_is_delta
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::math::luminance
#import bevy_restir::common::rng::{pcg4d, rng_new, STREAM_TREE}
#import bevy_restir::path::sample::{arrived_path, PathSample}
#import bevy_restir::path::tree::{Chosen, path_tree}
#import bevy_restir::path::walk::Vertex
#import bevy_restir::restir::bindings::settings
#ifdef RESAMPLES_INDIRECT
#import bevy_restir::restir::indirect::measured
#import bevy_restir::restir::indirect_reservoir::{PackedReservoir, reservoir_pack, reservoir_unpack}
#else
#import bevy_restir::restir::path_reservoir::{PackedReservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::restir::paths::measured
#endif
#import bevy_restir::restir::kept_path::{no_reservoir, Reservoir}
#import bevy_restir::restir::paths::{Receiver, receiver_of}
#import bevy_restir::restir::tiling::reservoir_index
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::shift::connect::{Connection, connection_of}
#import bevy_restir::shift::hybrid::{hybrid_shift, is_free, SHIFT_APART, SHIFT_EARLIER, SHIFT_HIDDEN, SHIFT_UNCONNECTABLE}
#import bevy_restir::trace::offset::surface_point
#import bevy_restir::trace::ray::{Ray, rays_traced, trace_flags}
#import bevy_restir::view::bindings::{ray_counts, view, visibility}
#import bevy_restir::view::camera::{barycentrics_on_ray, camera_position, pixel_cone, primary_ray}

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
// What the paths carry.
@group(2) @binding(3) var carried: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn path_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel, view.size, settings.tiling);
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || view.bounces == 0u {
        reservoirs[index] = reservoir_pack(no_reservoir());
        textureStore(carried, pixel, vec4<f32>(0.0));
        return;
    }
    let r = receiver_of(ids, pixel, false);
    var rng = rng_new(pixel, view.frame, STREAM_TREE, view.seed);
    let chosen = measured(path_tree(r.first, pixel, r.connection, &rng), r);
    let kept = Reservoir(chosen.path, chosen.ucw, 1.0, true);
    reservoirs[index] = reservoir_pack(kept);
    textureStore(carried, pixel, vec4<f32>(carried_by(chosen, kept, r, ids, pixel), 0.0));
    let counted = textureLoad(ray_counts, pixel).x;
    textureStore(ray_counts, pixel, vec4<u32>((counted + rays_traced) | trace_flags << 24u));
}

// TEST_*: what only tests define.  The path goes through its packed form, is shifted to another receiver, and back, its end traced
// again: (why it could not be, what it is, the relative error of what it carries and of the product of both Jacobians beyond what the
// rounding of the reconnection vertex may do at the first one).
#ifdef TEST_ROUND_TRIP
fn carried_by(chosen: Chosen, kept: Reservoir, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    let away = partner(r, ids, pixel);
    let path = reservoir_unpack(reservoir_pack(kept)).path;
    var there = path;
    var reason = 0u;
    var jacobian = 1.0;
    var f = vec3<f32>(0.0);
    // Away and back; where a threshold is in the way back, it is tried again with thresholds a little lower and higher.
    for (var trip = 0u; trip < 4u && (trip < 2u || is_of_threshold(reason)); trip++) {
        var to = r;
        if trip == 0u {
            to = away;
        } else if trip > 1u {
            to.connection = nudged(r.connection, select(1.0 - NEAR, 1.0 + NEAR, trip == 3u));
        }
        let s = hybrid_shift(there, to.first, to.connection, to.previous, true);
        if trip == 0u && s.reason != 0u {
            // What does not arrive there need not come back.
            reason = NOT_THERE + s.reason;
            break;
        }
        if trip == 0u {
            there = arrived_path(path, s.arrival);
            jacobian = s.jacobian;
            continue;
        }
        if trip == 1u {
            reason = s.reason;
            f = s.f;
            if reason == 0u && !is_free(s, false) {
                reason = SHIFT_HIDDEN;
            }
            if reason == SHIFT_APART && max(jacobian, 1.0 / jacobian) * (1.0 + NEAR) >= settings.jacobian_limit {
                reason = AT_THRESHOLD;
            }
            jacobian *= s.jacobian;
        } else if s.reason == 0u {
            reason = AT_THRESHOLD;
        }
    }
    let error = max(distance(f, chosen.f) / max(length(chosen.f), 1.0e-30), abs(jacobian - 1.0));
    // 13 bits: few enough to survive the weight.
    let p = chosen.path;
    let lobes = p.lobe_before | p.lobe_after << 2u | u32(bsdf_is_delta(r.first.surface.bsdf)) << 4u;
    let kind = f32(p.end | p.length << 2u | p.reconnection << 5u | lobes << 8u);
    let shown = vec3<f32>(f32(reason), kind, max(error - rounding_at_first(chosen.path, r.first.surface), 0.0));
    return shown / max(chosen.ucw, 1.0e-30);
}

// The path was sampled in the direction of its hit, and goes to a place on a grid of 1/65535 of the triangle's edges: of a cosine that
// is all but 0 that is much.
fn rounding_at_first(path: PathSample, first: Surface) -> f32 {
    if path.reconnection != 2u || path.instance == NONE {
        return 0.0;
    }
    let t = world_triangle(path.instance, path.triangle, false);
    let away = surface_point(path.instance, path.triangle, path.barycentrics, false) - first.position;
    let rounded = (length(t.edge_b) + length(t.edge_c)) * 0.5 / 65535.0;
    return rounded / max(abs(dot(first.bsdf.n_geo, away)), 1.0e-30);
}

fn is_of_threshold(reason: u32) -> bool {
    return reason == SHIFT_EARLIER || reason == SHIFT_UNCONNECTABLE;
}

fn nudged(c: Connection, by: f32) -> Connection {
    return Connection(c.separation * by, c.roughness * by);
}

// Relative: what rounding to 16 bits may move a footprint, a density or a Jacobian by.
const NEAR: f32 = 0.01;
const AT_THRESHOLD: u32 = 40u;
const NOT_THERE: u32 = 50u;
// The volume that the shift to the partner covers, by what arrives there, and the volume that the partner's shift covers here, by what is here:
// over all pixels their sums are the same integral (`tests/path_census.rs`).
#else ifdef TEST_CENSUS
fn carried_by(chosen: Chosen, kept: Reservoir, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    let to = partner(r, ids, pixel);
    let s = hybrid_shift(reservoir_unpack(reservoir_pack(kept)).path, to.first, to.connection, to.previous, false);
    if textureLoad(visibility, pixel ^ PARTNER, 0).x == NONE || s.reason != 0u || !is_free(s, to.previous) {
        return vec3<f32>(0.0);
    }
    let here = luminance(chosen.f);
    let there = luminance(s.f);
    // 1/(1 + J), here J/(1 + J), is under both: what is rare in one pixel and not in the other weighs little.
    return s.jacobian / (1.0 + s.jacobian) * vec3<f32>(there / (1.0 + there), here / (1.0 + here), 0.0);
}
#else ifdef TEST_JACOBIAN
// (whether it arrives, |ln| of the Jacobian, whether others reconnect to it).
fn carried_by(chosen: Chosen, kept: Reservoir, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    let to = partner(r, ids, pixel);
    let s = hybrid_shift(reservoir_unpack(reservoir_pack(kept)).path, to.first, to.connection, to.previous, false);
    let shown = vec3<f32>(f32(s.reason == 0u), abs(log(max(s.jacobian, 1.0e-30))), f32(chosen.path.density > 0.0));
    return select(vec3<f32>(0.0, 0.0, shown.z), shown, s.reason == 0u) / max(chosen.ucw, 1.0e-30);
}
#else
fn carried_by(chosen: Chosen, kept: Reservoir, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    return chosen.f;
}
#endif

#ifdef TEST_JACOBIAN
const PARTNER: vec2<u32> = vec2<u32>(1u, 0u);
#else
const PARTNER: vec2<u32> = vec2<u32>(8u, 4u);
#endif

#ifdef TEST_PAIRED
// The pixel that has this one as its partner.
fn partner(r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    let at = pixel ^ PARTNER;
    let other = textureLoad(visibility, at, 0).xy;
    if other.x == NONE {
        return r;
    }
    return receiver_of(other, at, false);
}
#else ifdef TEST_BESIDE
// A pixel near by.
fn partner(r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    let bits = pcg4d(vec4<u32>(pixel, view.frame, view.seed));
    let at = vec2<u32>(clamp(vec2<i32>(pixel) + vec2<i32>(bits.xy % 17u) - 8, vec2<i32>(0), vec2<i32>(view.size) - 1));
    let other = textureLoad(visibility, at, 0).xy;
    if other.x == NONE {
        return r;
    }
    return receiver_of(other, at, false);
}
#else ifdef TEST_BEFORE
// The same point in the last frame.
fn partner(r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), primary_ray(pixel));
    let to_eye = camera_position(true) - surface_point(ids.x, ids.y, barycentrics, true);
    let wo = normalize(to_eye);
    let cone = pixel_cone(view.previous, Ray(camera_position(true), 0.0, -wo, FAR), length(to_eye));
    let s = surface_at(ids.x, ids.y, barycentrics, wo, cone, true);
    return Receiver(Vertex(s, wo, vec3<f32>(0.0), cone), connection_of(camera_position(true), s), true);
}
#else
// Itself.
fn partner(r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    return r;
}
#endif
