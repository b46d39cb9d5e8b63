// ReSTIR SSS's initial candidates, with the result of a shift written in place of the contribution.  Tests run it instead of
// `shaders/pass/sss_candidates.wgsl`, with a reuse pass that copies the result.
//
// TEST_ROUND_TRIP: the sample is packed and unpacked, shifted to a partner and back.  Writes (reason why it could not, 1: reconnected or 2:
// drawn again, +2 if the partner is in the last frame, relative error of contribution and Jacobians).  Where it could not, or has a large
// error, and lies at an edge, the reason is AT_EDGE.
// TEST_CENSUS: writes a bounded function, integrated over the samples that the shift takes to the partner, and over those that the
// partner's shift takes here: over all pixels both sums are the same integral.
// TEST_JACOBIAN: writes (ratio of the Jacobian to that of finite differences, 1, 0) for samples that are drawn again.
// TEST_BESIDE: the partner is near the pixel; for half of the pixels of a round trip it is the same point in the last frame.  Otherwise
// pixels are paired.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::common::ray::Hit
#import bevy_restir::common::rng::{pcg4d, rng_new, STREAM_SSS_CANDIDATES}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::sss::domain::{apply_shift, entry_point, evaluate, is_visible, Receiver, receiver_at, receiver_of, replayed_hit}
#import bevy_restir::restir::sss::initial_candidates::sample_candidates
#import bevy_restir::restir::sss::reservoir::{EntrySample, no_reservoir, PackedReservoir, Reservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::restir::types::{SUBSURFACE_HYBRID, SUBSURFACE_RECONNECTION}
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::surface::surface_at
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::subsurface::probe::disk_frame
#import bevy_restir::subsurface::profile::profile_pdf
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{barycentrics_on_ray, camera_position, pixel_cone, primary_ray}
#import bevy_restir::common::constants::FAR
#import bevy_restir::common::ray::Ray

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(3) var contribution: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn sss_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel);
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE {
        reservoirs[index] = reservoir_pack(no_reservoir());
        textureStore(contribution, pixel, vec4<f32>(0.0));
        return;
    }
    var rng = rng_new(pixel, view.frame, STREAM_SSS_CANDIDATES, view.seed);
    let r = receiver_of(ids, pixel, false);
    let selected = sample_candidates(r, pixel, &rng);
    reservoirs[index] = reservoir_pack(selected.reservoir);
    var result = vec3<f32>(0.0);
    if selected.reservoir.ucw > 0.0 {
        result = shown(reservoir_unpack(reservoir_pack(selected.reservoir)), selected.f, r, ids, pixel);
    }
    textureStore(contribution, pixel, vec4<f32>(result, 0.0));
}

fn is_reconnected(s: EntrySample) -> bool {
    return settings.subsurface_shift == SUBSURFACE_RECONNECTION || (settings.subsurface_shift == SUBSURFACE_HYBRID && s.is_far);
}

#ifdef TEST_ROUND_TRIP
// The sample lies at an edge, where rounding decides.
const AT_EDGE: f32 = 5.0;
// A relative error above this is large.
const COARSE: f32 = 0.05;
// Change of the random numbers of a probe: far above rounding, and so small that few paths lie this near to an edge.
const EDGE_STEP: f32 = 1.0e-4;

fn shown(stored: Reservoir, f: vec3<f32>, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    var to = partner(r, ids, pixel);
    let before = (pixel.x + pixel.y) % 2u == 1u;
    if before {
        to = same_point_before(ids, pixel);
    }
    let there = evaluate(to, stored);
    var reason = 0.0;
    var error = 0.0;
    if !(there.jacobian > 0.0) {
        reason = 50.0;
    } else {
        let moved = apply_shift(stored, there.result);
        let back = evaluate(r, moved);
        let found = back.result;
        let x2 = surface_point(stored.sample.instance, stored.sample.triangle, stored.sample.barycentrics, false);
        let again = surface_point(stored.sample.instance, found.triangle, found.barycentrics, false);
        if !(back.jacobian > 0.0) {
            reason = 1.0;
        } else if distance(x2, again) > 1.0e-3 * length(x2 - r.surface.position) + 1.0e-5 {
            reason = 2.0;
        } else if !(luminance(back.f) > 0.0) {
            reason = 3.0;
        } else if !is_visible(r, back, 0u) {
            reason = 4.0;
        } else {
            error = max(distance(back.f, f) / length(f), abs(there.jacobian * back.jacobian - 1.0));
        }
        if (reason > 0.0 || error > COARSE) && !is_reconnected(stored.sample) && is_at_edge(r, stored, f) {
            reason = AT_EDGE;
        }
    }
    return vec3<f32>(reason, select(2.0, 1.0, is_reconnected(stored.sample)) + select(0.0, 2.0, before), error);
}

// Whether the sample lies at an edge of the body or of a shadow, at the end of the reach of its probe, where the hybrid shift changes, or where
// its light is steep: of four samples whose probes are moved a little, some carry about the same light to the pixel, and some do not.  Where
// none does, the shift itself is wrong.
fn is_at_edge(r: Receiver, stored: Reservoir, f: vec3<f32>) -> bool {
    var alike = 0u;
    for (var i = 0u; i < 4u; i += 1u) {
        let step = select(EDGE_STEP, -EDGE_STEP, i % 2u == 1u);
        var moved = stored;
        moved.sample.probe.u_radius = clamp(stored.sample.probe.u_radius + select(0.0, step, i < 2u), 0.0, 0.9999999);
        moved.sample.probe.u_angle = stored.sample.probe.u_angle + select(0.0, step, i >= 2u);
        let e = evaluate(r, moved);
        alike += u32(e.jacobian > 0.0 && distance(e.f, f) < 0.25 * length(f) && is_visible(r, e, 0u));
    }
    return alike > 0u && alike < 4u;
}

fn same_point_before(ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), primary_ray(pixel));
    let to_eye = camera_position(true) - surface_point(ids.x, ids.y, barycentrics, true);
    let wo = normalize(to_eye);
    let cone = pixel_cone(view.previous, Ray(camera_position(true), 0.0, -wo, FAR), length(to_eye));
    return receiver_at(surface_at(ids.x, ids.y, barycentrics, wo, cone, true), wo, cone.width, true);
}
#else ifdef TEST_CENSUS
fn shown(stored: Reservoir, f: vec3<f32>, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    let to = partner(r, ids, pixel);
    let e = evaluate(to, stored);
    if textureLoad(visibility, pixel ^ PARTNER, 0).x == NONE || !(e.jacobian > 0.0) || !is_visible(to, e, 0u) {
        return vec3<f32>(0.0);
    }
    let here = luminance(f);
    let there = luminance(e.f);
    // J/(1 + J) and the lesser density bound both sides: samples that are rare in one pixel and frequent in the other, or rare in both,
    // weigh little.  Only samples with light in both pixels are candidates in both.
    let bound = min(stored.sample.density, e.result.density) * e.jacobian / (1.0 + e.jacobian);
    let share = stored.ucw * f32(there > 0.0) * bound;
    return share * vec3<f32>(there / (1.0 + there), here / (1.0 + here), 0.0);
}
#else ifdef TEST_JACOBIAN
fn shown(stored: Reservoir, f: vec3<f32>, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    let to = partner(r, ids, pixel);
    let e = evaluate(to, stored);
    var measures = vec2<f32>(0.0);
    for (var side = 0u; side < 2u; side += 1u) {
        var at = r;
        if side == 1u {
            at = to;
        }
        measures[side] = measure_of_probe(at, stored.sample);
    }
    if !(e.jacobian > 0.0) || !all(measures > vec2<f32>(0.0)) || is_reconnected(stored.sample) {
        return vec3<f32>(0.0);
    }
    return vec3<f32>(e.jacobian * measures.x / measures.y, 1.0, 0.0);
}

// The change of the point, in the measure of its triangle, with the random numbers of its probe; times the probability that this technique
// found the point.  0 if a finite difference leaves the triangle.
fn measure_of_probe(r: Receiver, s: EntrySample) -> f32 {
    let step = 2.0e-3;
    var hits = array<Hit, 3>();
    for (var i = 0u; i < 3u; i += 1u) {
        var moved = s;
        moved.probe.u_radius += select(0.0, select(step, -step, s.probe.u_radius > 0.5), i == 1u);
        moved.probe.u_angle += select(0.0, select(step, -step, s.probe.u_angle > 0.5), i == 2u);
        hits[i] = replayed_hit(r, moved);
    }
    let hit = hits[0];
    if hit.instance == NONE || hits[1].triangle != hit.triangle || hits[2].triangle != hit.triangle {
        return 0.0;
    }
    let at = surface_point(hit.instance, hit.triangle, hit.barycentrics, r.previous);
    let a = surface_point(hit.instance, hit.triangle, hits[1].barycentrics, r.previous) - at;
    let b = surface_point(hit.instance, hit.triangle, hits[2].barycentrics, r.previous) - at;
    let p = entry_point(r, hit);
    let t = world_triangle(hit.instance, hit.triangle, r.previous);
    let d = r.surface.radius[s.probe.channel];
    let disk = disk_frame(r.frame, s.probe.axis);
    let offset = at - r.surface.position;
    let across = length(vec2<f32>(dot(offset, disk[0]), dot(offset, disk[1]))) / d;
    // The difference is that of an annulus of finite width: near the axis of the probe it is too coarse.
    if across < 0.3 {
        return 0.0;
    }
    let chosen = profile_pdf(across) * abs(dot(t.normal, disk[2])) / (d * d) * t.area / p.density;
    return length(cross(a, b)) / (step * step) / t.area * chosen;
}
#else
fn shown(stored: Reservoir, f: vec3<f32>, r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    return f;
}
#endif

const PARTNER: vec2<u32> = vec2<u32>(8u, 4u);

#ifdef TEST_BESIDE
fn partner(r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    let bits = pcg4d(vec4<u32>(pixel, view.frame, view.seed));
    let at = vec2<u32>(clamp(vec2<i32>(pixel) + vec2<i32>(bits.xy % 17u) - 8, vec2<i32>(0), vec2<i32>(view.size) - 1));
    let other = textureLoad(visibility, at, 0).xy;
    if other.x == NONE {
        return r;
    }
    return receiver_of(other, at, false);
}
#else
fn partner(r: Receiver, ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    let at = pixel ^ PARTNER;
    let other = textureLoad(visibility, at, 0).xy;
    if other.x == NONE {
        return r;
    }
    return receiver_of(other, at, false);
}
#endif
