// Shadow rays to lights and between surfaces.  Both ends are offset, so that the ray does not hit the surfaces at its ends.
#define_import_path bevy_restir::path::shadow_ray

#import bevy_restir::common::constants::{FAR, LIGHT_TRIANGLE}
#import bevy_restir::common::ray::Ray
#import bevy_restir::light::analytic_area_light::DISTANCE_TOLERANCE
#import bevy_restir::light::types::LightSample
#import bevy_restir::scene::bindings::lights
#import bevy_restir::scene::offset::{offset_distance, offset_end, offset_point}
#import bevy_restir::scene::surface::Surface
#import bevy_restir::trace::trace::trace_any
#import bevy_restir::view::render_layers::light_kind

// The shadow ray to a point of a light, from an offset point to an offset point before the light.  `previous`: both belong to the last frame.
fn ray_to_light(s: Surface, l: LightSample, previous: bool) -> Ray {
    let origin = offset_point(s.position, s.bsdf.n_geo, l.wi, s.offset);
    var ray = Ray(origin, 0.0, l.wi, FAR);
    if l.distance < FAR {
        let end = offset_end(l.position, l.normal, -l.wi, light_offset(l, previous), l.distance);
        ray.direction = end - origin;
        ray.t_max = shadow_ray_t_max(l);
    }
    return ray;
}

// The shadow ray between two surfaces.
fn ray_between(a: Surface, b: Surface) -> Ray {
    let direction = b.position - a.position;
    let origin = offset_point(a.position, a.bsdf.n_geo, direction, a.offset);
    let end = offset_end(b.position, b.bsdf.n_geo, -direction, b.offset, length(direction));
    return Ray(origin, 0.0, end - origin, 1.0);
}

// Whether a surface sees a light sample; with `previous`, both belong to the last frame.
fn light_is_visible(s: Surface, l: LightSample, alpha_seed: u32, previous: bool) -> bool {
    return !trace_any(ray_to_light(s, l, previous), alpha_seed, previous);
}

// End of the ray.  Spherical and rectangular lights may lie a little behind a surface (DISTANCE_TOLERANCE).
#ifdef LIGHT_SHAPES
fn shadow_ray_t_max(l: LightSample) -> f32 {
    return select(1.0 - DISTANCE_TOLERANCE, 1.0, l.delta != 0u || light_kind(l.light) == LIGHT_TRIANGLE);
}
#else
fn shadow_ray_t_max(l: LightSample) -> f32 {
    return 1.0;
}
#endif

// Offset of a point on a light, m.
fn light_offset(l: LightSample, previous: bool) -> f32 {
    if light_kind(l.light) != LIGHT_TRIANGLE {
        return 0.0;
    }
    return offset_distance(lights[l.light].data.x, lights[l.light].data.y, l.barycentrics, l.normal, previous);
}
