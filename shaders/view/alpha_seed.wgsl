// The random number of a pixel for alpha tests of blended surfaces; rasterizer and primary rays share it.
#define_import_path bevy_restir::view::alpha_seed

#import bevy_restir::common::rng::{pcg4d, seeded, STREAM_ALPHA}
#import bevy_restir::view::bindings::view

fn primary_alpha_seed(pixel: vec2<u32>) -> u32 {
    return pcg4d(vec4<u32>(pixel, view.frame, seeded(STREAM_ALPHA, view.seed))).x;
}
