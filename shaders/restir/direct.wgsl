// The domain of direct lighting: points of lights seen from a surface.  What the resampling routine asks of it: draw, evaluate.
#define_import_path bevy_restir::restir::direct

#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_pdf}
#import bevy_restir::common::math::{is_finite_3, luminance}
#import bevy_restir::light::point_on_light::{LightPoint, light_point_at}
#import bevy_restir::light::triangle::triangle_light_presence
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, LightSample}
#import bevy_restir::path::medium::{medium_towards, transmittance}
#import bevy_restir::path::shadow::light_is_visible
#import bevy_restir::scene::surface::{Shape, shape_at, Surface, surface_at}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::camera::{barycentrics_on_ray, camera_position, previous_primary_ray, primary_ray}

// A pixel's surface and the direction to the viewer, of this frame or the last.
struct Receiver {
    surface: Surface,
    wo: vec3<f32>,
    previous: bool,
}

// A point of a light from a receiver: what it would contribute, without the visibility between them.
struct Evaluated {
    f: vec3<f32>,              // f·L·|cos| per unit of the light's measure
    light: LightSample,
}

// The shape that a pixel shows, or showed in the last frame.
fn shape_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Shape {
    var ray = primary_ray(pixel);
    if previous {
        ray = previous_primary_ray(pixel);
    }
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, previous), ray);
    return shape_at(ids.x, ids.y, barycentrics, camera_position(previous), previous);
}

// The shape that a pixel shows, where it was in the last frame.
fn previous_shape_of(ids: vec2<u32>, pixel: vec2<u32>) -> Shape {
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), primary_ray(pixel));
    return shape_at(ids.x, ids.y, barycentrics, camera_position(true), true);
}

// Whether two surfaces are alike enough to share light (paper 003, Eq. 24).
fn are_alike(a: Shape, b: Shape, reach: f32, normal_threshold: f32, depth_threshold: f32) -> bool {
    return dot(a.n, b.n) >= normal_threshold && abs(dot(b.position - a.position, a.n_geo)) <= depth_threshold * reach;
}

fn receiver_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Receiver {
    var ray = primary_ray(pixel);
    if previous {
        ray = previous_primary_ray(pixel);
    }
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, previous), ray);
    return Receiver(surface_at(ids.x, ids.y, barycentrics, -ray.direction, previous), -ray.direction, previous);
}

fn evaluate(r: Receiver, p: LightPoint) -> Evaluated {
    return evaluate_sample(r, light_point_at(p, r.surface.position, r.previous));
}

fn evaluate_sample(r: Receiver, l: LightSample) -> Evaluated {
    if !(l.pdf_solid_angle > 0.0) {
        return Evaluated(vec3<f32>(0.0), l);
    }
    let carried = transmittance(medium_towards(r.surface, l.wi, vec3<f32>(0.0)), l.distance);
    let f = bsdf_eval(r.surface.bsdf, r.wo, l.wi) * l.radiance * carried / l.pdf_solid_angle;
    return Evaluated(select(vec3<f32>(0.0), f, is_finite_3(f)), l);
}

// The light that arrives, whatever the surface does with it: positive wherever `evaluate_sample` is.
fn evaluate_arriving(r: Receiver, l: LightSample) -> Evaluated {
    if !(l.pdf_solid_angle > 0.0) {
        return Evaluated(vec3<f32>(0.0), l);
    }
    let f = l.radiance * abs(dot(r.surface.bsdf.n, l.wi)) / l.pdf_solid_angle;
    return Evaluated(select(vec3<f32>(0.0), f, is_finite_3(f)), l);
}

fn target_value(e: Evaluated) -> f32 {
    return luminance(e.f);
}

// Density, in the light's measure, with which the receiver's BSDF finds the point, which a ray that comes there meets with probability
// `presence`: where alpha leaves no surface it passes.
fn bsdf_pdf_of(r: Receiver, l: LightSample, presence: f32) -> f32 {
    if l.delta != 0u || !(l.pdf_solid_angle > 0.0) {
        return 0.0;
    }
    return presence * bsdf_pdf(r.surface.bsdf, r.wo, l.wi) / l.pdf_solid_angle;
}

fn presence_of(l: LightSample) -> f32 {
    if l.delta != 0u || l.light == ENVIRONMENT_LIGHT {
        return 1.0;
    }
    return triangle_light_presence(l.light, l.barycentrics);
}

fn is_visible(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return light_is_visible(r.surface, e.light, alpha_seed, r.previous);
}
