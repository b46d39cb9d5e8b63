// The camera's sub-paths of bidirectional path tracing, one a pixel: the light of all techniques but t = 1.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::rng::{rng_new, STREAM_PATH_CANDIDATES}
#import bevy_restir::path::walk::Vertex
#import bevy_restir::restir::bdpt::camera_path::sample_camera_path
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{camera_density, primary_ray}
#import bevy_restir::view::primary::primary_surface
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(3) var light: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn bdpt_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE {
        textureStore(light, pixel, vec4<f32>(0.0));
        return;
    }
    let s = primary_surface(ids, pixel, false);
    let ray = primary_ray(pixel);
    let density = camera_density(view.current, ray, distance(ray.origin, s.surface.position));
    var rng = rng_new(pixel, view.frame, STREAM_PATH_CANDIDATES, view.seed);
    let radiance = sample_camera_path(Vertex(s.surface, s.wo, vec3<f32>(0.0), s.cone), density, pixel, &rng);
    textureStore(light, pixel, vec4<f32>(radiance, 0.0));
    count_rays(pixel);
}
