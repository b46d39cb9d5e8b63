// Connections of camera sub-paths, one a pixel, with light sub-paths.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::rng::{rng_new, STREAM_CONNECTIONS}
#import bevy_restir::path::walk::Vertex
#import bevy_restir::restir::bdpt::connections::sample_connections
#import bevy_restir::restir::bindings::settings
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{camera_density, primary_ray}
#import bevy_restir::view::primary::primary_surface
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(2) var light: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn connections(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || settings.light_paths == 0u {
        textureStore(light, pixel, vec4<f32>(0.0));
        return;
    }
    let s = primary_surface(ids, pixel, false);
    let density = camera_density(view.current, s.wo, distance(primary_ray(pixel).origin, s.surface.position));
    var rng = rng_new(pixel, view.frame, STREAM_CONNECTIONS, view.seed);
    let connected = sample_connections(Vertex(s.surface, s.wo, vec3<f32>(0.0), s.cone), density, &rng);
    textureStore(light, pixel, connected);
    count_rays(pixel);
}
