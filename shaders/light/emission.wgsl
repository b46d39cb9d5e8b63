// Emission of one ray by a light of any kind, for light sub-paths: a light by power, a point on it uniformly, and a direction by the cosine.
// Lights at infinity sample a direction as next-event estimation does, and a point of a disk that is as wide as the scene.
#define_import_path bevy_restir::light::emission

#import bevy_restir::common::constants::{LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_RECT, LIGHT_SPHERE, LIGHT_SPOT, LIGHT_SUN, LIGHT_TRIANGLE, NONE}
#import bevy_restir::common::guard::{GUARD_LIGHT_SAMPLE, guarded_3}
#import bevy_restir::common::math::max_component
#import bevy_restir::light::analytic_area_light::DISTANCE_TOLERANCE
#import bevy_restir::light::emitted_ray::{area_emission_density, EmittedRay, infinite_emission_density, infinite_emitted_ray, no_emitted_ray, scene_sphere}
#import bevy_restir::light::light::{environment_light_sample, record_sample}
#import bevy_restir::light::point::{point_emission_pdf, point_emitted_ray}
#import bevy_restir::light::rect::rect_emitted_ray
#import bevy_restir::light::remap::light_record
#import bevy_restir::light::select::light_pmf
#import bevy_restir::light::sphere::{sphere_emission_density, sphere_emitted_ray, sphere_pdf_scale}
#import bevy_restir::light::triangle::{triangle_emission_density, triangle_emitted_ray}
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, LightSample}
#import bevy_restir::scene::bindings::{lights, scene}
#import bevy_restir::view::render_layers::{light_in_layers, light_kind}

// Greatest start of a ray, relative to the size of the light.
const EXTENT_TOLERANCE: f32 = 0x1p-8;

// Samples a ray of a light of this frame's table, now or (`previous`) as it was in the last frame.  The probability of the light, which is
// part of `power` and `pdf_point`, is that of this frame.
fn sample_emission_of(light: u32, u_point: vec2<f32>, u_direction: vec2<f32>, previous: bool) -> EmittedRay {
    let pmf = light_pmf(light);
    if !(pmf > 0.0) {
        return no_emitted_ray();
    }
    var ray = emitted_ray(light, u_point, u_direction, previous);
    ray.power = guarded_3(ray.power / pmf, GUARD_LIGHT_SAMPLE);
    ray.pdf_point *= pmf;
    if !(max_component(ray.power) > 0.0) {
        ray.light = NONE;
    }
    return ray;
}

// `EmittedRay::light` of the result is an index in `lights`; with `previous`, it is that of the record in the last frame's table.
fn emitted_ray(light: u32, u_point: vec2<f32>, u_direction: vec2<f32>, previous: bool) -> EmittedRay {
    if light == ENVIRONMENT_LIGHT {
        let l = environment_light_sample(u_direction, previous);
        return infinite_emitted_ray(light, l.wi, l.radiance, l.pdf_solid_angle, 0u, u_point, scene_sphere(previous));
    }
    let record = light_record(light, previous);
    if record == NONE || !light_in_layers(record) {
        return no_emitted_ray();
    }
    switch light_kind(record) {
        case LIGHT_TRIANGLE: {
            return triangle_emitted_ray(record, u_point, u_direction, previous);
        }
        case LIGHT_POINT, LIGHT_SPOT: {
            return point_emitted_ray(record, u_direction);
        }
        case LIGHT_SPHERE: {
            return past_tolerance(sphere_emitted_ray(record, u_point, u_direction), previous);
        }
        case LIGHT_RECT: {
            return past_tolerance(rect_emitted_ray(record, u_point, u_direction), previous);
        }
        case LIGHT_DIRECTIONAL, LIGHT_SUN: {
            // The receiver does not matter to a light at infinity.
            let l = record_sample(record, scene.center, u_direction);
            return infinite_emitted_ray(record, l.wi, l.radiance, l.pdf_solid_angle, l.delta, u_point, scene_sphere(previous));
        }
        default: {
            return no_emitted_ray();
        }
    }
}

// Lets the ray pass a surface if the light lies only a little behind it, as shadow rays do (DISTANCE_TOLERANCE).
fn past_tolerance(ray: EmittedRay, previous: bool) -> EmittedRay {
    if ray.light == NONE {
        return ray;
    }
    var r = ray;
    r.t_min = start_of_rays(ray.light, scene_sphere(previous).radius);
    return r;
}

// Distance from a sphere or a rectangle at which its rays start.  In a large scene the size of the light limits it, so that rays do not
// start outside of the lamp's housing.
fn start_of_rays(light: u32, scene_radius: f32) -> f32 {
    // The radius of a sphere, or half the width of a rectangle.
    let extent = bitcast<f32>(lights[light].data.x);
    return min(DISTANCE_TOLERANCE * scene_radius, EXTENT_TOLERANCE * extent);
}

fn is_at_infinity(light: u32) -> bool {
    if light == ENVIRONMENT_LIGHT {
        return true;
    }
    let kind = light_kind(light);
    return kind == LIGHT_DIRECTIONAL || kind == LIGHT_SUN;
}

// Density, for each unit of area perpendicular to the ray, with which a light emits rays from the point (or the direction) of a light
// sample to its receiver.  0 if the receiver is nearer than the start of these rays (`start_of_rays`).
fn emission_density(l: LightSample) -> f32 {
    if l.light == NONE {
        return 0.0;
    }
    if is_at_infinity(l.light) {
        return infinite_emission_density();
    }
    switch light_kind(l.light) {
        case LIGHT_TRIANGLE: {
            return triangle_emission_density(l);
        }
        case LIGHT_SPHERE: {
            return select(0.0, sphere_emission_density(l), l.distance > start_of_rays(l.light, scene.radius));
        }
        case LIGHT_RECT: {
            return select(0.0, area_emission_density(l), l.distance > start_of_rays(l.light, scene.radius));
        }
        default: {
            return point_emission_pdf(l.light, l.wi) / (l.distance * l.distance);
        }
    }
}

// Density with which next-event estimation at a point samples the origin of a ray that arrives there, divided by that of light paths.
fn nee_pdf_scale(ray: EmittedRay, at: vec3<f32>) -> f32 {
    if ray.light != ENVIRONMENT_LIGHT && light_kind(ray.light) == LIGHT_SPHERE {
        return sphere_pdf_scale(ray, at);
    }
    return 1.0;
}
