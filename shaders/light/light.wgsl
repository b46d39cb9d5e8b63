// Sampling of one light of any kind.
#define_import_path bevy_restir::light::light

#import bevy_restir::common::constants::{LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_RECT, LIGHT_SPHERE, LIGHT_SPOT, LIGHT_SUN, LIGHT_TRIANGLE}
#import bevy_restir::light::directional::directional_light_sample
#import bevy_restir::light::environment::{environment_radiance, environment_sample}
#import bevy_restir::light::point::point_light_sample
#import bevy_restir::light::rect::rect_light_at
#import bevy_restir::light::sphere::{sample_sphere_solid_angle, sphere_light_at}
#import bevy_restir::light::sun::sun_light_at
#import bevy_restir::light::triangle::triangle_light_sample
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, guarded_light_sample, LightSample, no_light_sample}
#import bevy_restir::scene::bindings::scene
#import bevy_restir::view::render_layers::{light_in_layers, light_kind}

// Samples a light as seen from a point.  `light`: an index in the table, ENVIRONMENT_LIGHT or NONE.
fn light_sample(light: u32, from_point: vec3<f32>, u: vec2<f32>) -> LightSample {
    if light == ENVIRONMENT_LIGHT {
        return guarded_light_sample(environment_light_sample(u, false));
    }
    if light >= scene.lights_end {
        return no_light_sample();
    }
    return guarded_light_sample(record_sample(light, from_point, u));
}

// Samples any record of `lights`, of this frame or the last.
fn record_sample(light: u32, from_point: vec3<f32>, u: vec2<f32>) -> LightSample {
    if !light_in_layers(light) {
        return no_light_sample();
    }
    switch light_kind(light) {
        case LIGHT_TRIANGLE: {
            return triangle_light_sample(light, from_point, u);
        }
        case LIGHT_POINT, LIGHT_SPOT: {
            return point_light_sample(light, from_point);
        }
        case LIGHT_DIRECTIONAL: {
            return directional_light_sample(light);
        }
        case LIGHT_SPHERE: {
            return sphere_light_at(light, sample_sphere_solid_angle(light, from_point, u), from_point);
        }
        case LIGHT_RECT: {
            return rect_light_at(light, u, from_point);
        }
        case LIGHT_SUN: {
            return sun_light_at(light, u);
        }
        default: {
            return no_light_sample();
        }
    }
}

// The environment in a direction.
fn environment_light(wi: vec3<f32>, pdf_solid_angle: f32, previous: bool) -> LightSample {
    var s = no_light_sample();
    s.light = ENVIRONMENT_LIGHT;
    s.delta = 0u;
    s.wi = wi;
    s.position = wi;
    s.radiance = environment_radiance(wi, previous);
    s.pdf_solid_angle = pdf_solid_angle;
    return s;
}

fn environment_light_sample(u: vec2<f32>, previous: bool) -> LightSample {
    let e = environment_sample(u, previous);
    if !(e.pdf_solid_angle > 0.0) {
        return no_light_sample();
    }
    return environment_light(e.direction, e.pdf_solid_angle, previous);
}
