// Point lights and spots without a radius: deltas with irradiance intensity/d².  The falloff of a spot is Bevy's: the square of a linear
// ramp between the cosines of the outer and the inner angle.
#define_import_path bevy_restir::light::point

#import bevy_restir::common::constants::{FOUR_PI, LIGHT_SPOT, TWO_PI}
#import bevy_restir::common::math::orthonormal_basis
#import bevy_restir::light::emitted_ray::{EmittedRay, no_emitted_ray}
#import bevy_restir::light::types::{LightSample, no_light_sample}
#import bevy_restir::scene::bindings::lights
#import bevy_restir::scene::triangle::safe_normalize
#import bevy_restir::view::render_layers::light_kind

#ifdef LIGHT_POINTS
fn point_light_sample(light: u32, from_point: vec3<f32>) -> LightSample {
    var s = no_light_sample();
    let d = lights[light].position - from_point;
    let d2 = dot(d, d);
    if !(d2 > 0.0) {
        return s;
    }
    s.light = light;
    s.wi = safe_normalize(d);
    s.distance = sqrt(d2);
    s.radiance = lights[light].emission * (spot_falloff(light, s.wi) / d2);
    s.pdf_solid_angle = 1.0;
    s.position = lights[light].position;
    return s;
}

// Factor of the intensity in the direction -wi.
fn spot_falloff(light: u32, wi: vec3<f32>) -> f32 {
    if light_kind(light) != LIGHT_SPOT {
        return 1.0;
    }
    let cone = spot_cone(light);
    let ramp = saturate((-dot(wi, lights[light].direction) - cone.outer) / cone.width);
    return ramp * ramp;
}

// The ramp of the falloff, in cosines.
struct SpotCone {
    outer: f32,
    width: f32,
}

fn spot_cone(light: u32) -> SpotCone {
    let outer = bitcast<f32>(lights[light].data.y);
    return SpotCone(outer, max(bitcast<f32>(lights[light].data.x) - outer, 1.0e-4));
}

// A ray with a direction in proportion to the intensity.
fn point_emitted_ray(light: u32, u: vec2<f32>) -> EmittedRay {
    var axis = vec3<f32>(0.0, 0.0, 1.0);
    var cosine = 1.0 - 2.0 * u.y;
    if light_kind(light) == LIGHT_SPOT {
        axis = lights[light].direction;
        cosine = spot_emission_cosine(light, u.y);
    }
    let sine = sqrt(max((1.0 - cosine) * (1.0 + cosine), 0.0));
    let around = vec2<f32>(cos(TWO_PI * u.x), sin(TWO_PI * u.x));
    var ray = no_emitted_ray();
    ray.origin = lights[light].position;
    ray.direction = normalize(orthonormal_basis(axis) * vec3<f32>(sine * around, cosine));
    ray.delta = 1u;
    ray.pdf_point = 1.0;
    ray.pdf_direction = point_emission_pdf(light, -ray.direction);
    if ray.pdf_direction > 0.0 {
        ray.light = light;
        ray.power = lights[light].emission * emission_solid_angle(light);
    }
    return ray;
}

// Density of the direction -wi, solid angle.
fn point_emission_pdf(light: u32, wi: vec3<f32>) -> f32 {
    return spot_falloff(light, wi) / emission_solid_angle(light);
}

// Power over the greatest intensity.
fn emission_solid_angle(light: u32) -> f32 {
    if light_kind(light) != LIGHT_SPOT {
        return FOUR_PI;
    }
    return TWO_PI * (spot_ramp_integral(spot_cone(light)) + spot_full_integral(spot_cone(light)));
}

// Integrals of the falloff over the cosine: over the ramp, and over the cone inside of it, where the falloff is 1.  The axis may cut off
// the ramp.
fn spot_ramp_integral(cone: SpotCone) -> f32 {
    let end = min((1.0 - cone.outer) / cone.width, 1.0);
    return cone.width * end * end * end / 3.0;
}

fn spot_full_integral(cone: SpotCone) -> f32 {
    return max(1.0 - cone.outer - cone.width, 0.0);
}

fn spot_emission_cosine(light: u32, u: f32) -> f32 {
    let cone = spot_cone(light);
    let ramp = spot_ramp_integral(cone);
    let share = u * (ramp + spot_full_integral(cone));
    if share < ramp {
        return min(cone.outer + cone.width * pow(3.0 * share / cone.width, 1.0 / 3.0), 1.0);
    }
    return min(cone.outer + cone.width + (share - ramp), 1.0);
}
#else
fn point_emitted_ray(light: u32, u: vec2<f32>) -> EmittedRay {
    return no_emitted_ray();
}

fn point_emission_pdf(light: u32, wi: vec3<f32>) -> f32 {
    return 0.0;
}

fn point_light_sample(light: u32, from_point: vec3<f32>) -> LightSample {
    return no_light_sample();
}
#endif
