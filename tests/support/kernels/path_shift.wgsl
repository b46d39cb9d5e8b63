// ReSTIR PT's initial candidates, with the result of a shift written in place of the contribution.  Tests run it instead of
// `shaders/pass/path_candidates.wgsl`.
//
// TEST_ROUND_TRIP: the path is packed and unpacked, shifted to a partner and back with its suffix replayed.  Writes (reason why it could
// not, kind of path, relative error of contribution and Jacobians beyond the rounding at the first vertex).
// TEST_STORED: in addition, the path is shifted to the partner with its stored suffix, whose contribution there must be that of the replay.
// TEST_CENSUS: writes a bounded function, integrated over the paths that the shift takes to the partner, and over those that the partner's
// shift takes here: over all pixels both sums are the same integral.
// TEST_JACOBIAN: writes (whether the shift is defined, |ln| of its Jacobian, whether the path has a reconnection vertex).
// TEST_PAIRED, TEST_BESIDE, TEST_BEFORE: choose the partner; without them it is the pixel itself.
// TEST_COPIED: a pass that copies the results to the picture runs in place of reuse, which multiplies them by the weight of the path.

#import domain::{in_domain_measure, no_reservoir, PackedReservoir, Receiver, receiver_of, Reservoir, reservoir_pack, reservoir_unpack, shift_parameters, SHORTEST_LENGTH}
#import bevy_restir::bsdf::bsdf::bsdf_is_delta
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::math::luminance
#import bevy_restir::common::ray::Ray
#import bevy_restir::common::rng::{pcg4d, rng_new, STREAM_PATH_CANDIDATES}
#import bevy_restir::path::walk::Vertex
#import bevy_restir::restir::path_sample::{PathSample, with_shift_result}
#import bevy_restir::restir::pt::initial_candidates::{sample_candidates, SelectedPath}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::shift::hybrid::hybrid_shift
#import bevy_restir::restir::shift::reconnection::ShiftParameters
#import bevy_restir::restir::shift::shifted_path::{is_unoccluded, SHIFT_EARLIER_CONNECTABLE, SHIFT_JACOBIAN_LIMIT, SHIFT_NOT_CONNECTABLE, SHIFT_OCCLUDED}
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{barycentrics_on_ray, camera_position, pixel_cone, primary_ray}
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(3) var contribution: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn path_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel);
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || view.bounces == 0u {
        reservoirs[index] = reservoir_pack(no_reservoir());
        textureStore(contribution, pixel, vec4<f32>(0.0));
        return;
    }
    let r = receiver_of(ids, pixel, false);
    var rng = rng_new(pixel, view.frame, STREAM_PATH_CANDIDATES, view.seed);
    let selected = in_domain_measure(sample_candidates(r.first, pixel, SHORTEST_LENGTH, r.shift, &rng), r);
    let stored = Reservoir(selected.path, selected.ucw, 1.0, true);
    reservoirs[index] = reservoir_pack(stored);
    textureStore(contribution, pixel, vec4<f32>(shown(selected, stored, r, ids, pixel), 0.0));
    count_rays(pixel);
}

#ifdef TEST_ROUND_TRIP
fn shown(selected: SelectedPath, stored: Reservoir, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    let away = partner(r, ids, pixel);
    let path = reservoir_unpack(reservoir_pack(stored)).path;
    var there = path;
    var reason = 0u;
    var jacobian = 1.0;
    var f = vec3<f32>(0.0);
    var with_stored_suffix = vec3<f32>(0.0);
    // To the partner and back; if a threshold prevents the way back, twice more with thresholds slightly lower and higher.
    for (var trip = FIRST_TRIP; trip < 5u && (trip < 3u || is_of_threshold(reason)); trip++) {
        var to = r;
        if trip < 2u {
            to = away;
        } else if trip > 2u {
            to.shift = scaled_thresholds(r.shift, select(1.0 - NEAR, 1.0 + NEAR, trip == 4u));
        }
        let s = hybrid_shift(there, to.first, to.shift, to.previous, trip != 0u);
        if trip == 0u {
            with_stored_suffix = s.f;
            continue;
        }
        if trip == 1u && s.reason != 0u {
            // Undefined there.
            reason = NOT_THERE + s.reason;
            break;
        }
        if trip == 1u {
            there = with_shift_result(path, s.result);
            jacobian = s.jacobian;
            if FIRST_TRIP == 0u && distance(with_stored_suffix, s.f) > STORED_PRECISION * length(s.f) {
                reason = STORED_DIFFERS;
                break;
            }
            continue;
        }
        if trip == 2u {
            reason = s.reason;
            f = s.f;
            if reason == 0u && !is_unoccluded(s, false) {
                reason = SHIFT_OCCLUDED;
            }
            if reason == SHIFT_JACOBIAN_LIMIT && max(jacobian, 1.0 / jacobian) * (1.0 + NEAR) >= r.shift.jacobian_limit {
                reason = AT_THRESHOLD;
            }
            jacobian *= s.jacobian;
        } else if s.reason == 0u {
            reason = AT_THRESHOLD;
        }
    }
    let error = max(distance(f, selected.f) / max(length(selected.f), 1.0e-30), abs(jacobian - 1.0));
    // 15 bits: exact in a float after the multiplication by the weight.
    let p = selected.path;
    let lobes = p.lobe_before | p.lobe_after << 2u | u32(bsdf_is_delta(r.first.surface.bsdf)) << 5u;
    let kind = f32(p.termination | p.length << 3u | p.reconnection << 6u | lobes << 9u);
    let result = vec3<f32>(f32(reason), kind, max(error - rounding_at_first(selected.path, r.first.surface), 0.0));
    return unweighted(result, selected.ucw);
}

// Relative error that rounding may cause at the first vertex: a path is sampled in the direction of its hit, but goes to a point on a grid
// of 2^-24 of the triangle's edges, which changes a cosine close to 0.
fn rounding_at_first(path: PathSample, first: Surface) -> f32 {
    if path.reconnection != 2u || path.instance == NONE {
        return 0.0;
    }
    let t = world_triangle(path.instance, path.triangle, false);
    let away = surface_point(path.instance, path.triangle, path.barycentrics, false) - first.position;
    let rounded = (length(t.edge_b) + length(t.edge_c)) * 0.5 * 0x1p-24;
    return rounded / max(abs(dot(first.bsdf.n_geo, away)), 1.0e-30);
}

fn is_of_threshold(reason: u32) -> bool {
    return reason == SHIFT_EARLIER_CONNECTABLE || reason == SHIFT_NOT_CONNECTABLE;
}

fn scaled_thresholds(c: ShiftParameters, by: f32) -> ShiftParameters {
    var scaled = c;
    scaled.separation *= by;
    scaled.roughness *= by;
    return scaled;
}

// The trips: 0 with the stored suffix to the partner, 1 with a replayed suffix to the partner, 2 and more back.
#ifdef TEST_STORED
const FIRST_TRIP: u32 = 0u;
#else
const FIRST_TRIP: u32 = 1u;
#endif
// Radiance is stored with a relative precision of 2^-18 of its greatest channel.
const STORED_PRECISION: f32 = 1.0e-3;
const STORED_DIFFERS: u32 = 30u;
// Relative change that the rounding of stored directions and positions may cause in a footprint, a density or a Jacobian.
const NEAR: f32 = 0.01;
const AT_THRESHOLD: u32 = 40u;
const NOT_THERE: u32 = 50u;
#else ifdef TEST_CENSUS
fn shown(selected: SelectedPath, stored: Reservoir, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    let to = partner(r, ids, pixel);
    let s = hybrid_shift(reservoir_unpack(reservoir_pack(stored)).path, to.first, to.shift, to.previous, false);
    if textureLoad(visibility, pixel ^ PARTNER, 0).x == NONE || s.reason != 0u || !is_unoccluded(s, to.previous) {
        return vec3<f32>(0.0);
    }
    let here = luminance(selected.f);
    let there = luminance(s.f);
    // J/(1 + J) bounds both sides: paths that are rare in one pixel and frequent in the other weigh little.
    return s.jacobian / (1.0 + s.jacobian) * vec3<f32>(there / (1.0 + there), here / (1.0 + here), 0.0);
}
#else ifdef TEST_JACOBIAN
fn shown(selected: SelectedPath, stored: Reservoir, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    let to = partner(r, ids, pixel);
    let s = hybrid_shift(reservoir_unpack(reservoir_pack(stored)).path, to.first, to.shift, to.previous, false);
    let result = vec3<f32>(f32(s.reason == 0u), abs(log(max(s.jacobian, 1.0e-30))), f32(selected.path.density > 0.0));
    return unweighted(select(vec3<f32>(0.0, 0.0, result.z), result, s.reason == 0u), selected.ucw);
}
#else
fn shown(selected: SelectedPath, stored: Reservoir, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    return selected.f;
}
#endif

#ifdef TEST_COPIED
fn unweighted(result: vec3<f32>, ucw: f32) -> vec3<f32> {
    return select(vec3<f32>(0.0), result, ucw > 0.0);
}
#else
fn unweighted(result: vec3<f32>, ucw: f32) -> vec3<f32> {
    return result / max(ucw, 1.0e-30);
}
#endif

#ifdef TEST_JACOBIAN
const PARTNER: vec2<u32> = vec2<u32>(1u, 0u);
#else
const PARTNER: vec2<u32> = vec2<u32>(8u, 4u);
#endif

#ifdef TEST_PAIRED
// The pixel whose partner is this one.
fn partner(r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    let at = pixel ^ PARTNER;
    let other = textureLoad(visibility, at, 0).xy;
    if other.x == NONE {
        return r;
    }
    return receiver_of(other, at, false);
}
#else ifdef TEST_BESIDE
// A random pixel near this one.
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
    let v = Vertex(s, wo, vec3<f32>(0.0), cone);
    return Receiver(v, shift_parameters(camera_position(true), v, true), true);
}
#else
// The pixel itself.
fn partner(r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    return r;
}
#endif
