// Ray tracing through the scene, by the back end of the pipeline: ray queries or software.  Other modules import this one and no back end.
#define_import_path bevy_restir::trace::trace

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_RAY, guard_holds}
#import bevy_restir::common::math::{is_finite, is_finite_3}
#import bevy_restir::common::ray::{Hit, Ray, rays_traced}
#import bevy_restir::trace::drawn_sides::{begin_drawn_ray, end_drawn_ray}
#ifdef RAY_QUERY
#import bevy_restir::trace::hardware::traverse
#else
#import bevy_restir::trace::software::traverse
#endif
#ifdef SUBSURFACE
#import bevy_restir::scene::triangle::stored_triangle
#import bevy_restir::trace::probe_hits::ProbeHits
#import bevy_restir::trace::space::object_ray
#import bevy_restir::trace::triangle::{intersect_triangle, sheared_ray}
#ifdef RAY_QUERY
#import bevy_restir::trace::hardware::traverse_instance
#else
#import bevy_restir::trace::software::traverse_instance
#endif
#endif

// The closest hit in this frame.
fn trace_closest(ray: Ray, alpha_seed: u32) -> Hit {
    return trace_counted(ray, alpha_seed, false, false);
}

// The closest hit, now or (`previous`) in the last frame.
fn trace_closest_in_frame(ray: Ray, alpha_seed: u32, previous: bool) -> Hit {
    return trace_counted(ray, alpha_seed, false, previous);
}

// Whether the ray hits anything, now or (`previous`) in the last frame.
fn trace_any(ray: Ray, alpha_seed: u32, previous: bool) -> bool {
    return trace_counted(ray, alpha_seed, true, previous).instance != NONE;
}

// Whether the ray hits a side of a surface that the camera draws.
fn trace_drawn(ray: Ray, alpha_seed: u32, previous: bool) -> bool {
    return drawn_hit(ray, alpha_seed, true, previous).instance != NONE;
}

// The closest hit on such a side.
fn trace_drawn_closest(ray: Ray, alpha_seed: u32, previous: bool) -> Hit {
    return drawn_hit(ray, alpha_seed, false, previous);
}

fn drawn_hit(ray: Ray, alpha_seed: u32, any_hit: bool, previous: bool) -> Hit {
    begin_drawn_ray(ray.direction, previous);
    let hit = trace_counted(ray, alpha_seed, any_hit, previous);
    end_drawn_ray();
    return hit;
}

fn trace_counted(ray: Ray, alpha_seed: u32, any_hit: bool, previous: bool) -> Hit {
    rays_traced += 1u;
    var hit = Hit(ray.t_max, NONE, NONE, vec2<f32>(0.0));
    if guard_holds(is_finite_3(ray.origin) && is_finite_3(ray.direction) && is_finite(ray.t_max), GUARD_RAY) {
        hit = traverse(ray, alpha_seed, any_hit, previous);
        // Barycentrics that are not finite would be hidden where a reservoir rounds them.
        _ = guard_holds(is_finite(hit.t) && is_finite(hit.barycentrics.x) && is_finite(hit.barycentrics.y), GUARD_RAY);
    }
    return hit;
}

#ifdef SUBSURFACE
// All hits on one instance, now or (`previous`) in the last frame, sorted along the ray.  Counts as one ray.
fn trace_probe(ray: Ray, instance: u32, alpha_seed: u32, previous: bool) -> ProbeHits {
    rays_traced += 1u;
    return traverse_instance(ray, instance, alpha_seed, previous);
}

// A hit of a probe with its barycentrics, which `ProbeHits` does not hold.
fn probe_hit(ray: Ray, instance: u32, triangle: u32, t: f32, previous: bool) -> Hit {
    let inside = object_ray(ray, instance, previous);
    let stored = stored_triangle(instance, triangle, previous);
    return Hit(t, instance, triangle, intersect_triangle(sheared_ray(inside.origin, inside.direction), stored).barycentrics);
}
#endif
