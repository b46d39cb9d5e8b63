// The last guard of the light of a pixel, and the sum of its frames.
#define_import_path bevy_restir::view::pixel_light

#import bevy_restir::common::constants::NON_FINITE
#import bevy_restir::common::guard::{as_planted, GUARD_NEGATIVE_PIXEL, guard_holds, raise}
#import bevy_restir::common::math::is_finite_3

// Light that is not finite becomes black; negative light is only reported.
fn guarded_pixel(light: vec3<f32>) -> vec3<f32> {
    let seen = vec3<f32>(as_planted(light.x, NON_FINITE), light.yz);
    if !is_finite_3(seen) {
        raise(NON_FINITE);
        return vec3<f32>(0.0);
    }
    _ = guard_holds(all(seen >= vec3<f32>(0.0)), GUARD_NEGATIVE_PIXEL);
    return seen;
}

// Greatest number of frames in a sum: f32 counts no further.
const MAX_ACCUMULATED: f32 = 16777216.0;

// The sum of the earlier frames with that of this frame; alpha counts frames.  A full sum stays as it is.
fn add_to_sum(sum: vec4<f32>, light: vec3<f32>) -> vec4<f32> {
    return select(sum + vec4<f32>(light, 1.0), sum, sum.a >= MAX_ACCUMULATED);
}
