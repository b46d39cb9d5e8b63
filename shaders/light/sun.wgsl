// Directional lights with a disc: their illuminance, spread over it as uniform radiance; sampled uniformly in its solid angle.  What
// is behind a disc, the environment, is seen through it.
#define_import_path bevy_restir::light::sun

#import bevy_restir::common::constants::TWO_PI
#import bevy_restir::common::math::{orthonormal_basis, precise_atan2}
#import bevy_restir::light::types::{LightSample, no_light_sample}
#import bevy_restir::scene::bindings::lights

#ifdef SUN_DISK
// The direction at `uv` (1 - cosine over that of the rim, turn); every point of the scene sees it there.
fn sun_light_at(light: u32, uv: vec2<f32>) -> LightSample {
    let one_less_cosine = uv.x * rim(light);
    let sine = sqrt(max(one_less_cosine * (2.0 - one_less_cosine), 0.0));
    let local = vec3<f32>(sine * cos(TWO_PI * uv.y), sine * sin(TWO_PI * uv.y), 1.0 - one_less_cosine);
    var s = no_light_sample();
    s.light = light;
    s.delta = 0u;
    s.wi = normalize(orthonormal_basis(-lights[light].direction) * local);
    s.position = s.wi;
    s.radiance = lights[light].emission;
    s.pdf_solid_angle = 1.0 / (TWO_PI * rim(light));
    return s;
}

// 1 - cosine at the rim.
fn rim(light: u32) -> f32 {
    return bitcast<f32>(lights[light].data.x);
}

fn sun_coordinates(uv: vec2<f32>) -> u32 {
    return pack2x16unorm(uv);
}

fn sun_uv(coordinates: u32) -> vec2<f32> {
    return unpack2x16unorm(coordinates);
}

// Of a direction in the disc.
fn sun_uv_of(light: u32, direction: vec3<f32>) -> vec2<f32> {
    let frame = orthonormal_basis(-lights[light].direction);
    let turn = precise_atan2(dot(direction, frame[1]), dot(direction, frame[0])) / TWO_PI;
    return vec2<f32>(min(away(light, direction) / rim(light), 1.0), select(turn, turn + 1.0, turn < 0.0));
}

fn sun_is_met(light: u32, direction: vec3<f32>) -> bool {
    return away(light, direction) < rim(light);
}

// 1 - cosine of the angle to the middle, without a cancellation.
fn away(light: u32, direction: vec3<f32>) -> f32 {
    let d = direction + lights[light].direction;
    return 0.5 * dot(d, d);
}
#else
fn sun_light_at(light: u32, uv: vec2<f32>) -> LightSample {
    return no_light_sample();
}

fn sun_coordinates(uv: vec2<f32>) -> u32 {
    return 0u;
}

fn sun_uv(coordinates: u32) -> vec2<f32> {
    return vec2<f32>(0.0);
}

fn sun_uv_of(light: u32, direction: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(0.0);
}

fn sun_is_met(light: u32, direction: vec3<f32>) -> bool {
    return false;
}
#endif
