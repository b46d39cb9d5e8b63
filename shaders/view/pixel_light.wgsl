// The last guard: the light of a pixel before it is shown and accumulated.
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
