// Emissive triangles, sampled uniformly in area.  They emit from the front face, or from both if the material is double-sided, and their
// emission is multiplied by opacity.
#define_import_path bevy_restir::light::triangle

#import bevy_restir::common::constants::MATERIAL_DOUBLE_SIDED
#import bevy_restir::light::emitted_ray::{area_emission_density, area_emitted_ray, EmittedRay, no_emitted_ray}
#import bevy_restir::light::types::{area_density, LightSample, no_light_sample}
#import bevy_restir::scene::bindings::{instances, lights, materials}
#import bevy_restir::scene::material::{emission_at, opacity_at}
#import bevy_restir::scene::offset::{offset_distance, offset_point, surface_point}
#import bevy_restir::scene::triangle::{safe_normalize, world_triangle, WorldTriangle}
#import bevy_restir::view::render_layers::instance_in_layers

#ifdef LIGHT_TRIANGLES
fn triangle_light_sample(light: u32, from_point: vec3<f32>, u: vec2<f32>) -> LightSample {
    return triangle_light_at(light, uniform_barycentrics(u), from_point, false);
}

// The light sample of a point of the triangle at the receiver `from_point`, now or (`previous`) in the last frame.
fn triangle_light_at(light: u32, barycentrics: vec2<f32>, from_point: vec3<f32>, previous: bool) -> LightSample {
    let instance = lights[light].data.x;
    let triangle = lights[light].data.y;
    let t = world_triangle(instance, triangle, previous);
    let position = surface_point(instance, triangle, barycentrics, previous);

    var s = no_light_sample();
    s.light = light;
    s.delta = 0u;
    s.position = position;
    s.normal = t.normal;
    s.barycentrics = barycentrics;
    s.wi = safe_normalize(position - from_point);
    s.distance = length(position - from_point);
    s.pdf_solid_angle = area_to_solid_angle(t, from_point, position);
    if s.pdf_solid_angle > 0.0 {
        s.radiance = triangle_light_radiance(instance, triangle, t.normal, barycentrics, s.wi);
    }
    return s;
}

// Density with which `triangle_light_sample` samples a point, solid angle; exactly the value that the sample has.
fn triangle_light_pdf_solid_angle(instance: u32, triangle: u32, from_point: vec3<f32>, position: vec3<f32>, previous: bool) -> f32 {
    return area_to_solid_angle(world_triangle(instance, triangle, previous), from_point, position);
}

// A ray that the triangle emits, now or (`previous`) in the last frame; a double-sided one emits from either side.
fn triangle_emitted_ray(light: u32, u_point: vec2<f32>, u_direction: vec2<f32>, previous: bool) -> EmittedRay {
    let instance = lights[light].data.x;
    let triangle = lights[light].data.y;
    let t = world_triangle(instance, triangle, previous);
    let barycentrics = uniform_barycentrics(u_point);
    var normal = t.normal;
    var u = u_direction;
    let both_sides = is_double_sided(instance);
    if both_sides {
        normal *= select(1.0, -1.0, u.x < 0.5);
        u.x = fract(2.0 * u.x);
    }
    if !(t.area > 0.0) {
        return no_emitted_ray();
    }
    let position = surface_point(instance, triangle, barycentrics, previous);
    var ray = area_emitted_ray(light, position, normal, triangle_light_color(instance, triangle, barycentrics), 1.0 / t.area, u);
    ray.origin = offset_point(position, normal, normal, offset_distance(instance, triangle, barycentrics, t.normal, previous));
    if both_sides {
        ray.pdf_direction *= 0.5;
        ray.power *= 2.0;
    }
    return ray;
}

fn triangle_emission_density(l: LightSample) -> f32 {
    return select(1.0, 0.5, is_double_sided(lights[l.light].data.x)) * area_emission_density(l);
}

// Probability that the alpha test keeps the surface at a point.
fn triangle_light_opacity(light: u32, barycentrics: vec2<f32>) -> f32 {
    return opacity_at(lights[light].data.x, lights[light].data.y, barycentrics);
}
#else
fn triangle_emitted_ray(light: u32, u_point: vec2<f32>, u_direction: vec2<f32>, previous: bool) -> EmittedRay {
    return no_emitted_ray();
}

fn triangle_emission_density(l: LightSample) -> f32 {
    return 0.0;
}

fn triangle_light_opacity(light: u32, barycentrics: vec2<f32>) -> f32 {
    return 1.0;
}

fn triangle_light_sample(light: u32, from_point: vec3<f32>, u: vec2<f32>) -> LightSample {
    return no_light_sample();
}

fn triangle_light_at(light: u32, barycentrics: vec2<f32>, from_point: vec3<f32>, previous: bool) -> LightSample {
    return no_light_sample();
}

fn triangle_light_pdf_solid_angle(instance: u32, triangle: u32, from_point: vec3<f32>, position: vec3<f32>, previous: bool) -> f32 {
    return 0.0;
}
#endif

fn is_double_sided(instance: u32) -> bool {
    return (materials[instances[instance].material].flags & MATERIAL_DOUBLE_SIDED) != 0u;
}

// Radiance emitted along -wi; `normal` is the geometric normal.
fn triangle_light_radiance(instance: u32, triangle: u32, normal: vec3<f32>, barycentrics: vec2<f32>, wi: vec3<f32>) -> vec3<f32> {
    if !is_double_sided(instance) && !(dot(wi, normal) < 0.0) {
        return vec3<f32>(0.0);
    }
    return triangle_light_color(instance, triangle, barycentrics);
}

// Radiance emitted from a side that emits; 0 for instances that rays cannot hit.
fn triangle_light_color(instance: u32, triangle: u32, barycentrics: vec2<f32>) -> vec3<f32> {
    if !instance_in_layers(instance) {
        return vec3<f32>(0.0);
    }
    return emission_at(instance, triangle, barycentrics) * opacity_at(instance, triangle, barycentrics);
}

// Density in solid angle of a uniform point of a triangle; 0 if the triangle is seen edge-on or has no area.
fn area_to_solid_angle(t: WorldTriangle, from_point: vec3<f32>, position: vec3<f32>) -> f32 {
    let d = position - from_point;
    return area_density(dot(d, d), abs(dot(t.normal, d)) * t.area);
}

fn uniform_barycentrics(u: vec2<f32>) -> vec2<f32> {
    let r = sqrt(u.x);
    return vec2<f32>(r * (1.0 - u.y), r * u.y);
}
