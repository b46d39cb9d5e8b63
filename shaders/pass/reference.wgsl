// The reference path tracer: one path per pixel and frame from the surface in the visibility buffer, summed up until the picture changes.
// Debug views show the number of rays or bounces of the path instead of its radiance.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::ray::{Hit, rays_traced}
#import bevy_restir::common::rng::{rng_new, STREAM_REFERENCE}
#import bevy_restir::light::backdrop::backdrop
#import bevy_restir::path::reference_integrator::{bounces_taken, estimate_radiance}
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{barycentrics_on_ray, primary_ray}
#import bevy_restir::view::guard_counter::end_pixel
#import bevy_restir::view::light_part::shown_emission
#import bevy_restir::view::pixel::pixel_index
#import bevy_restir::view::pixel_light::{add_to_sum, guarded_pixel}
#import bevy_restir::view::ray_counter::add_rays

// Sum of radiance (rgb), and number of samples (a).
@group(2) @binding(0) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn reference(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy + view.first_pixel;
    if any(pixel >= view.size) {
        return;
    }
    var rng = rng_new(pixel, view.frame, STREAM_REFERENCE, view.seed);
    let ray = primary_ray(pixel);
    let ids = textureLoad(visibility, pixel, 0).xy;
    var sample = vec3<f32>(0.0);
    if ids.x == NONE {
        sample = shown_emission(backdrop(ray.direction));
    } else {
        let t = world_triangle(ids.x, ids.y, false);
        let barycentrics = barycentrics_on_ray(t, ray);
        let position = surface_point(ids.x, ids.y, barycentrics, false);
        sample = estimate_radiance(Hit(distance(ray.origin, position), ids.x, ids.y, barycentrics), ray, &rng);
    }

    let index = pixel_index(pixel);
    var before = vec4<f32>(0.0);
    if view.accumulated > 0u {
        before = radiance[index];
    }
    radiance[index] = add_to_sum(before, displayed(guarded_pixel(sample)));
    add_rays(pixel);
    end_pixel(pixel);
}

#ifdef SHOWS_RAYS
fn displayed(light: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(f32(rays_traced));
}
#else ifdef SHOWS_BOUNCES
fn displayed(light: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(f32(bounces_taken));
}
#else
fn displayed(light: vec3<f32>) -> vec3<f32> {
    return light;
}
#endif
