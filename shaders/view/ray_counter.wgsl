// Adds the rays of this invocation, if rays are counted, and its raised guards to the counts of its pixel.
#define_import_path bevy_restir::view::ray_counter

#import bevy_restir::common::guard::raised_guards
#import bevy_restir::common::ray::{rays_traced, trace_flags}
#import bevy_restir::view::bindings::{counts, LAYER_GUARDS, LAYER_RAYS}

fn count_rays(pixel: vec2<u32>) {
    add_rays(pixel);
    count_guards(pixel);
}

#ifdef COUNT_RAYS
fn add_rays(pixel: vec2<u32>) {
    textureStore(counts, pixel, LAYER_RAYS, textureLoad(counts, pixel, LAYER_RAYS) + rays_traced);
}
#else
fn add_rays(pixel: vec2<u32>) {
}
#endif

// For invocations that work on one pixel after another.
fn reset_counts() {
    rays_traced = 0u;
    trace_flags = 0u;
    raised_guards = 0u;
}

// For passes that trace no rays.
fn count_guards(pixel: vec2<u32>) {
    let raised = trace_flags | raised_guards;
    if raised != 0u {
        textureStore(counts, pixel, LAYER_GUARDS, textureLoad(counts, pixel, LAYER_GUARDS) | vec4<u32>(raised));
    }
}
