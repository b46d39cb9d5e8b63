// Directional lights without a disk: deltas at infinity, with a given illuminance at normal incidence.
#define_import_path bevy_restir::light::directional

#import bevy_restir::light::types::{LightSample, no_light_sample}
#import bevy_restir::scene::bindings::lights

#ifdef LIGHT_DIRECTIONAL
fn directional_light_sample(light: u32) -> LightSample {
    var s = no_light_sample();
    s.light = light;
    s.wi = -lights[light].direction;
    s.radiance = lights[light].emission;
    s.pdf_solid_angle = 1.0;
    s.position = s.wi;
    return s;
}
#else
fn directional_light_sample(light: u32) -> LightSample {
    return no_light_sample();
}
#endif
