// What sampling a light gives, as seen from a point.
#define_import_path bevy_restir::light::types

#import bevy_restir::common::constants::{FAR, NONE}

// Id of the environment where lights of the table have their index.
const ENVIRONMENT_LIGHT: u32 = 0xfffffffeu;

struct LightSample {
    wi: vec3<f32>,
    distance: f32,             // FAR where infinite
    radiance: vec3<f32>,       // area, environment: radiance towards the point; delta: irradiance at normal incidence
    pdf_solid_angle: f32,      // of the light's own measure; 1 for a delta, 0: nothing was sampled
    position: vec3<f32>,       // on the light; of an infinite one its direction
    delta: u32,                // 1: no other technique finds this light
    normal: vec3<f32>,         // the light's geometric; 0 for point, spot and infinite lights
    light: u32,
    barycentrics: vec2<f32>,   // of a triangle
    aim: f32,                  // density, over `pdf_solid_angle`, with which a vertex there aims at the point: 1 but for spheres
}

fn no_light_sample() -> LightSample {
    return LightSample(
        vec3<f32>(0.0, 0.0, 1.0), FAR, vec3<f32>(0.0), 0.0, vec3<f32>(0.0), 1u, vec3<f32>(0.0), NONE, vec2<f32>(0.0), 1.0,
    );
}
