// Adds the rays and flags of this invocation to the counters of its pixel.
#define_import_path bevy_restir::view::ray_counter

#import bevy_restir::common::ray::{rays_traced, trace_flags}
#import bevy_restir::view::bindings::ray_counts

fn count_rays(pixel: vec2<u32>) {
    let counted = textureLoad(ray_counts, pixel).x;
    textureStore(ray_counts, pixel, vec4<u32>((counted + rays_traced) | trace_flags << 24u));
}
