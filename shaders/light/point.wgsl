// Point lights and spots without a radius: deltas with irradiance intensity/d².  The falloff of a spot is Bevy's: the square of a linear
// ramp between the cosines of the outer and the inner angle.
#define_import_path bevy_restir::light::point

#import bevy_restir::common::constants::LIGHT_SPOT
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
    let inner = bitcast<f32>(lights[light].data.x);
    let outer = bitcast<f32>(lights[light].data.y);
    let ramp = saturate((-dot(wi, lights[light].direction) - outer) / max(inner - outer, 1.0e-4));
    return ramp * ramp;
}
#else
fn point_light_sample(light: u32, from_point: vec3<f32>) -> LightSample {
    return no_light_sample();
}
#endif
