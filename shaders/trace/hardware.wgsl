// Rays by the device's ray queries.  The device finds the triangle; where on it, and whether the ray really meets it, is worked out
// again by the software's intersection, so that both back ends give the same numbers and need the same offsets.  They differ only where
// a ray passes an edge so closely that rounding decides.  `trace::trace` alone imports it.
enable wgpu_ray_query;

#define_import_path bevy_restir::trace::hardware

#import bevy_restir::common::constants::{NONE, OVERFLOW_STEPS}
#import bevy_restir::common::math::is_finite_3
#import bevy_restir::scene::bindings::{scene, instances}
#import bevy_restir::trace::alpha::accepts
#import bevy_restir::common::ray::{Ray, Hit, trace_flags}
#import bevy_restir::trace::space::object_ray
#import bevy_restir::trace::triangle::{sheared_ray, intersect_triangle, plane_distance}
#import bevy_restir::view::render_layers::camera_mask

// Group 3: the device's own acceleration structures, over this frame's instances and the last frame's; the same one where nothing moved.
// The custom index of each is its place in `instances`.  No binding module has them: naga writes what a module imports out as WGSL, and
// for an acceleration structure it asks for ray-tracing pipelines, not for ray queries; nor does it translate a query that is handed to a
// function.
@group(3) @binding(0) var top_level: acceleration_structure;
@group(3) @binding(1) var previous_top_level: acceleration_structure;

// Flags of a ray query, as Vulkan, Direct3D and Metal number them.
const FORCE_OPAQUE: u32 = 1u;
const TERMINATE_ON_FIRST_HIT: u32 = 4u;
#ifdef ALPHA
const OPACITY: u32 = 0u;
#else
const OPACITY: u32 = FORCE_OPAQUE;
#endif

const INTERSECTION_NONE: u32 = 0u;
const INTERSECTION_TRIANGLE: u32 = 1u;

// Surfaces with an alpha that a ray may pass, and hits that it may pass because the exact intersection does not count them.
const MAX_CANDIDATES: u32 = 8192u;
const MAX_PASSES: u32 = 8u;

// The closest hit, or any, now or in the last frame.
fn traverse(ray: Ray, alpha_seed: u32, any_hit: bool, previous: bool) -> Hit {
    let miss = Hit(ray.t_max, NONE, NONE, vec2<f32>(0.0));
    let root = select(scene.tlas_root, scene.previous_tlas_root, previous);
    // What is no ray is undefined to a device.
    if root == NONE || !is_ray(ray) {
        return miss;
    }
    var t_min = ray.t_min;
    var candidates = 0u;
    for (var pass_number = 0u; pass_number < MAX_PASSES; pass_number += 1u) {
        // Any hit will do, until one was met that does not count: then the nearest behind it.
        let first = any_hit && pass_number == 0u;
        let description = RayDesc(
            OPACITY | select(0u, TERMINATE_ON_FIRST_HIT, first),
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
        // Opaque triangles never come back from here.
        while rayQueryProceed(&query) {
            candidates += 1u;
            if candidates > MAX_CANDIDATES {
                trace_flags |= OVERFLOW_STEPS;
                rayQueryTerminate(&query);
                break;
            }
            let candidate = rayQueryGetCandidateIntersection(&query);
            let slot = candidate.instance_custom_data;
            let triangle = instances[slot].first_triangle + candidate.primitive_index;
            if candidate.kind == INTERSECTION_TRIANGLE && accepts(slot, triangle, candidate.barycentrics, alpha_seed) {
                rayQueryConfirmIntersection(&query);
            }
        }
        let committed = rayQueryGetCommittedIntersection(&query);
        // An instance that is gone leaves its place in the last frame's top level.
        let instance = committed.instance_custom_data;
        if committed.kind == INTERSECTION_NONE || instances[instance].blas_root == NONE {
            return miss;
        }
        let triangle = instances[instance].first_triangle + min(committed.primitive_index, instances[instance].triangle_count - 1u);
        let inside = object_ray(ray, instance, previous);
        var found = intersect_triangle(sheared_ray(inside.origin, inside.direction), triangle);
        if !found.inside {
            // On the very edge.
            found.t = plane_distance(inside.origin, inside.direction, triangle);
            found.barycentrics = committed.barycentrics;
        }
        if found.t > ray.t_min && found.t < ray.t_max {
            return Hit(found.t, instance, triangle, found.barycentrics);
        }
        // The surface that the ray starts from or ends on, but for rounding.
        t_min = bitcast<f32>(bitcast<u32>(max(committed.t, t_min)) + 1u);
        if t_min >= ray.t_max {
            return miss;
        }
    }
    trace_flags |= OVERFLOW_STEPS;
    return miss;
}

fn is_ray(ray: Ray) -> bool {
    return is_finite_3(ray.origin) && is_finite_3(ray.direction) && any(ray.direction != vec3<f32>(0.0))
        && ray.t_min >= 0.0 && ray.t_min < ray.t_max;
}
