// Directional lights with a disk: the illuminance is spread over the disk as uniform radiance, and sampled uniformly in its solid angle.
// The environment behind the disk stays visible.
#define_import_path bevy_restir::light::sun

#import bevy_restir::common::constants::TWO_PI
#import bevy_restir::common::math::{orthonormal_basis, precise_atan2}
#import bevy_restir::light::types::{LightSample, no_light_sample}
#import bevy_restir::scene::bindings::lights

#ifdef SUN_DISK
// The light sample of the direction at `uv`: u is (1 - cosine) over that of the rim, v the azimuth over 2π.  It is equal for all receivers.
fn sun_light_at(light: u32, uv: vec2<f32>) -> LightSample {
    let sampled_one_minus_cosine = uv.x * rim_one_minus_cosine(light);
    let sine = sqrt(max(sampled_one_minus_cosine * (2.0 - sampled_one_minus_cosine), 0.0));
    let local = vec3<f32>(sine * cos(TWO_PI * uv.y), sine * sin(TWO_PI * uv.y), 1.0 - sampled_one_minus_cosine);
    var s = no_light_sample();
    s.light = light;
    s.delta = 0u;
    s.wi = normalize(orthonormal_basis(-lights[light].direction) * local);
    s.position = s.wi;
    s.radiance = lights[light].emission;
    s.pdf_solid_angle = 1.0 / (TWO_PI * rim_one_minus_cosine(light));
    return s;
}

// 1 - cosine of the disk's angular radius.
fn rim_one_minus_cosine(light: u32) -> f32 {
    return bitcast<f32>(lights[light].data.x);
}

fn sun_coordinates(uv: vec2<f32>) -> u32 {
    return pack2x16unorm(uv);
}

fn sun_uv(coordinates: u32) -> vec2<f32> {
    return unpack2x16unorm(coordinates);
}

// `uv` of a direction in the disk.
fn sun_uv_of_direction(light: u32, direction: vec3<f32>) -> vec2<f32> {
    let frame = orthonormal_basis(-lights[light].direction);
    let turn = precise_atan2(dot(direction, frame[1]), dot(direction, frame[0])) / TWO_PI;
    return vec2<f32>(min(one_minus_cosine(light, direction) / rim_one_minus_cosine(light), 1.0), select(turn, turn + 1.0, turn < 0.0));
}

fn sun_is_hit(light: u32, direction: vec3<f32>) -> bool {
    return one_minus_cosine(light, direction) < rim_one_minus_cosine(light);
}

// 1 - cosine of the angle between a direction and the center of the disk, without cancellation.
fn one_minus_cosine(light: u32, direction: vec3<f32>) -> f32 {
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

fn sun_uv_of_direction(light: u32, direction: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(0.0);
}

fn sun_is_hit(light: u32, direction: vec3<f32>) -> bool {
    return false;
}
#endif
