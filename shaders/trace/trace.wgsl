// Rays through the scene, by the back end that the pipelines are made for.  What traces imports this module and no back end.
#define_import_path bevy_restir::trace::trace

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::ray::{Ray, Hit, rays_traced}
#ifdef RAY_QUERY
#import bevy_restir::trace::hardware::traverse
#else
#import bevy_restir::trace::software::traverse
#endif

// The closest hit.
fn trace_closest(ray: Ray, alpha_seed: u32) -> Hit {
    return counted(ray, alpha_seed, false, false);
}

// The closest hit, now or in the last frame.
fn trace_closest_of(ray: Ray, alpha_seed: u32, previous: bool) -> Hit {
    return counted(ray, alpha_seed, false, previous);
}

// Whether anything stops the ray, now or in the last frame.
fn trace_any(ray: Ray, alpha_seed: u32, previous: bool) -> bool {
    return counted(ray, alpha_seed, true, previous).instance != NONE;
}

fn counted(ray: Ray, alpha_seed: u32, any_hit: bool, previous: bool) -> Hit {
    rays_traced += 1u;
    return traverse(ray, alpha_seed, any_hit, previous);
}
