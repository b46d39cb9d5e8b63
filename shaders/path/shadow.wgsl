// Whether a point of a light is seen from a surface: one ray, free of the triangles at both its ends.
#define_import_path bevy_restir::path::shadow

#import bevy_restir::common::constants::{FAR, LIGHT_TRIANGLE}
#import bevy_restir::light::types::LightSample
#import bevy_restir::scene::bindings::lights
#import bevy_restir::scene::surface::Surface
#import bevy_restir::trace::offset::{offset_distance, offset_point}
#import bevy_restir::trace::ray::Ray
#import bevy_restir::trace::software::trace_any

// `previous`: whether it was seen in the last frame; surface and sample are of that frame.
fn light_is_visible(s: Surface, l: LightSample, alpha_seed: u32, previous: bool) -> bool {
    // From an offset point to one just short of the light's surface.
    let origin = offset_point(s.position, s.bsdf.n_geo, l.wi, s.offset);
    var ray = Ray(origin, 0.0, l.wi, FAR);
    if l.distance < FAR {
        let end = offset_point(l.position, l.normal, -l.wi, light_offset(l));
        ray.direction = end - origin;
        ray.t_max = 1.0;
    }
    return !trace_any(ray, alpha_seed, previous);
}

// Whether one surface is seen from another.
fn surface_is_visible(a: Surface, b: Surface, alpha_seed: u32, previous: bool) -> bool {
    let direction = b.position - a.position;
    let origin = offset_point(a.position, a.bsdf.n_geo, direction, a.offset);
    let end = offset_point(b.position, b.bsdf.n_geo, -direction, b.offset);
    return !trace_any(Ray(origin, 0.0, end - origin, 1.0), alpha_seed, previous);
}

fn light_offset(l: LightSample) -> f32 {
    if lights[l.light].kind != LIGHT_TRIANGLE {
        return 0.0;
    }
    return offset_distance(lights[l.light].data.x, lights[l.light].data.y, l.barycentrics);
}
