// The result of a hybrid shift, and the shadow rays that decide whether it succeeds.
#define_import_path bevy_restir::restir::shift::shifted_path

#import bevy_restir::common::ray::Ray
#import bevy_restir::restir::path_sample::ShiftResult
#import bevy_restir::trace::trace::trace_any

// Why a path cannot be shifted.
const SHIFT_OK: u32 = 0u;
const SHIFT_NO_PATH: u32 = 1u;
const SHIFT_REPLAY_ENDED: u32 = 2u;           // the replay ended, or hit a light, where the path does not
const SHIFT_EARLIER_CONNECTABLE: u32 = 3u;    // the shifted path would reconnect earlier
const SHIFT_NOT_CONNECTABLE: u32 = 4u;        // the shifted path could not reconnect there
const SHIFT_NO_CONTRIBUTION: u32 = 5u;
const SHIFT_JACOBIAN_LIMIT: u32 = 6u;
const SHIFT_OCCLUDED: u32 = 7u;               // `is_unoccluded` is false

// A ray that must be unoccluded for the shift to succeed.
struct ShadowRay {
    ray: Ray,
    alpha_seed: u32,
}

struct ShiftedPath {
    result: ShiftResult,
    f: vec3<f32>,             // contribution at the receiver, without the visibility that `rays` ask for
    density: f32,             // `PathSample::density` at the receiver
    jacobian: f32,            // 0 where the shift is not defined
    reason: u32,              // SHIFT_*
    rays: ShadowRays,
}

// At most two.  An array would lie in memory instead of registers.
struct ShadowRays {
    count: u32,
    first: ShadowRay,
    second: ShadowRay,
}

fn failed(reason: u32) -> ShiftedPath {
    var none: ShiftedPath;
    none.reason = reason;
    return none;
}

// Whether the shadow rays of a shifted path are free.
fn is_unoccluded(s: ShiftedPath, previous: bool) -> bool {
    if s.rays.count == 0u {
        return true;
    }
    // A loop with one call of `trace_any`, because each call is inlined.
    var is_free = true;
    var shadow = s.rays.first;
    var left = s.rays.count;
    loop {
        is_free = !trace_any(shadow.ray, shadow.alpha_seed, previous);
        shadow = s.rays.second;
        left -= 1u;
        if !is_free || left == 0u {
            break;
        }
    }
    return is_free;
}

fn with_shadow_ray(rays: ShadowRays, ray: Ray, alpha_seed: u32) -> ShadowRays {
    var extended = rays;
    if extended.count == 0u {
        extended.first = ShadowRay(ray, alpha_seed);
    } else {
        extended.second = ShadowRay(ray, alpha_seed);
    }
    extended.count += 1u;
    return extended;
}
