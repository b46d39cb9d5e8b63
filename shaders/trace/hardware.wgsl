// Ray tracing by the ray queries of the device.  The device finds the triangle; distance and barycentrics are then computed by
// `intersect_triangle`, so that both back ends give the same values and need the same offsets.  They differ only where a ray passes an edge
// so closely that rounding decides.  Only `trace::trace` imports this module.
enable wgpu_ray_query;

#define_import_path bevy_restir::trace::hardware

#import bevy_restir::common::constants::{NONE, OVERFLOW_STEPS}
#import bevy_restir::common::math::is_finite_3
#import bevy_restir::common::ray::{Hit, Ray, trace_flags}
#import bevy_restir::scene::bindings::{instances, scene}
#import bevy_restir::scene::triangle::stored_triangle
#import bevy_restir::trace::alpha::accepts_hit
#import bevy_restir::trace::drawn_sides::hits_drawn_sides
#ifdef SUBSURFACE
#import bevy_restir::trace::probe_hits::{failed_probe, has_too_many, no_probe_hits, ProbeHits, with_probe_hit}
#endif
#import bevy_restir::trace::space::object_ray
#import bevy_restir::trace::triangle::{intersect_triangle, plane_distance, sheared_ray}
#import bevy_restir::view::render_layers::camera_mask

// Group 3: the acceleration structures of the device over the instances of this frame and of the last: equal if nothing moved.
// The custom index of an instance is its index in `instances`.
//
// This module declares the bindings itself because naga_oil writes every imported module as WGSL text, and for an acceleration structure
// naga's writer enables ray-tracing pipelines instead of ray queries.  It cannot pass a query to a function either.
@group(3) @binding(0) var top_level: acceleration_structure;
@group(3) @binding(1) var previous_top_level: acceleration_structure;

// Flags of a ray query, with the values of Vulkan and Direct3D.
const FORCE_OPAQUE: u32 = 1u;
const FORCE_NO_OPAQUE: u32 = 2u;
const TERMINATE_ON_FIRST_HIT: u32 = 4u;
#ifdef ALPHA
const OPACITY_FLAGS: u32 = 0u;
#else
const OPACITY_FLAGS: u32 = FORCE_OPAQUE;
#endif

const INTERSECTION_NONE: u32 = 0u;
const INTERSECTION_TRIANGLE: u32 = 1u;

// Greatest numbers of candidate triangles of a ray, and of its queries.  A further query follows each hit that is rejected because
// `intersect_triangle` gives another distance.
const MAX_CANDIDATES: u32 = 8192u;
const MAX_ATTEMPTS: u32 = 8u;

// The smallest normal number.  Some devices read smaller ones as 0, so that a query that starts there would find the hit at 0 again.
const SMALLEST_NORMAL: f32 = 0x1p-126;

// The closest hit, or any hit, now or (`previous`) in the last frame.
fn traverse(ray: Ray, alpha_seed: u32, any_hit: bool, previous: bool) -> Hit {
    let miss = Hit(ray.t_max, NONE, NONE, vec2<f32>(0.0));
    let root = select(scene.tlas_root, scene.previous_tlas_root, previous);
    // For an invalid ray, the behavior of the device is undefined.
    if root == NONE || !is_valid_ray(ray) {
        return miss;
    }
    var t_min = ray.t_min;
    var candidates = 0u;
    for (var attempt = 0u; attempt < MAX_ATTEMPTS; attempt += 1u) {
        // After a rejected hit the closest hit is needed, also where any hit would do.
        let first = any_hit && attempt == 0u;
        let description = RayDesc(
            select(OPACITY_FLAGS, FORCE_NO_OPAQUE, hits_drawn_sides()) | select(0u, TERMINATE_ON_FIRST_HIT, first),
            camera_mask(),
            t_min,
            ray.t_max,
            ray.origin,
            ray.direction,
        );
        var query: ray_query;
        if previous {
            rayQueryInitialize(&query, previous_top_level, description);
        } else {
            rayQueryInitialize(&query, top_level, description);
        }
        // Opaque triangles are no candidates: the device accepts them.
        while rayQueryProceed(&query) {
            candidates += 1u;
            if candidates > MAX_CANDIDATES {
                trace_flags |= OVERFLOW_STEPS;
                rayQueryTerminate(&query);
                break;
            }
            let candidate = rayQueryGetCandidateIntersection(&query);
            let candidate_instance = candidate.instance_custom_data;
            let triangle = instances[candidate_instance].first_triangle + candidate.primitive_index;
            if candidate.kind == INTERSECTION_TRIANGLE && accepts_hit(candidate_instance, triangle, candidate.barycentrics, alpha_seed) {
                rayQueryConfirmIntersection(&query);
            }
        }
        let committed = rayQueryGetCommittedIntersection(&query);
        // A removed instance may remain in the top level of the last frame.
        let instance = committed.instance_custom_data;
        if committed.kind == INTERSECTION_NONE || instances[instance].blas_root == NONE {
            return miss;
        }
        let triangle = instances[instance].first_triangle + min(committed.primitive_index, instances[instance].triangle_count - 1u);
        let inside = object_ray(ray, instance, previous);
        let stored = stored_triangle(instance, triangle, previous);
        var found = intersect_triangle(sheared_ray(inside.origin, inside.direction), stored);
        if !found.inside {
            // Rounding at an edge: the two intersection tests disagree.
            found.t = plane_distance(inside.origin, inside.direction, stored);
            found.barycentrics = committed.barycentrics;
        }
        if found.t > ray.t_min && found.t < ray.t_max {
            return Hit(found.t, instance, triangle, found.barycentrics);
        }
        // Outside of the interval by the exact distance: the surface that the ray starts from or ends on.  A query for any hit may have
        // passed over nearer surfaces, so that it starts again as a query for the closest hit; that one continues behind the surface.
        if first {
            continue;
        }
        t_min = max(bitcast<f32>(bitcast<u32>(max(committed.t, t_min)) + 1u), SMALLEST_NORMAL);
        if t_min >= ray.t_max {
            return miss;
        }
    }
    trace_flags |= OVERFLOW_STEPS;
    return miss;
}

fn is_valid_ray(ray: Ray) -> bool {
    return is_finite_3(ray.origin) && is_finite_3(ray.direction) && any(ray.direction != vec3<f32>(0.0))
        && ray.t_min >= 0.0 && ray.t_min < ray.t_max;
}

#ifdef SUBSURFACE
// All hits on one instance, now or (`previous`) in the last frame.  The device offers every triangle on the ray as a candidate, because none
// is opaque; those of other instances are passed over.
fn traverse_instance(ray: Ray, instance: u32, alpha_seed: u32, previous: bool) -> ProbeHits {
    var hits = no_probe_hits();
    // The root is not tested as in `traverse`: an empty top level has no candidates anyway, and in a shader that reads `scene` Mesa 25.0
    // finds no candidates here (docs/limits.md).
    if !is_valid_ray(ray) || instances[instance].blas_root == NONE {
        return hits;
    }
    let inside = object_ray(ray, instance, previous);
    let line = sheared_ray(inside.origin, inside.direction);
    let description = RayDesc(FORCE_NO_OPAQUE, camera_mask(), ray.t_min, ray.t_max, ray.origin, ray.direction);
    var query: ray_query;
    if previous {
        rayQueryInitialize(&query, previous_top_level, description);
    } else {
        rayQueryInitialize(&query, top_level, description);
    }
    var candidates = 0u;
    while rayQueryProceed(&query) {
        candidates += 1u;
        let candidate = rayQueryGetCandidateIntersection(&query);
        if candidates > MAX_CANDIDATES || has_too_many(hits) {
            rayQueryTerminate(&query);
            break;
        }
        if candidate.kind != INTERSECTION_TRIANGLE || candidate.instance_custom_data != instance {
            continue;
        }
        let triangle = instances[instance].first_triangle + min(candidate.primitive_index, instances[instance].triangle_count - 1u);
        let hit = intersect_triangle(line, stored_triangle(instance, triangle, previous));
        if hit.inside && hit.t > ray.t_min && hit.t < ray.t_max && accepts_hit(instance, triangle, hit.barycentrics, alpha_seed) {
            hits = with_probe_hit(hits, hit.t, triangle);
        }
    }
    if candidates > MAX_CANDIDATES {
        trace_flags |= OVERFLOW_STEPS;
        return failed_probe();
    }
    if has_too_many(hits) {
        return failed_probe();
    }
    return hits;
}
#endif
