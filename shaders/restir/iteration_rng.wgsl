// Random numbers of an iteration of reuse.
#define_import_path bevy_restir::restir::iteration_rng

#import bevy_restir::common::rng::{Rng, rng_new, STREAM_REUSE, STREAMS_PER_DOMAIN}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::view::bindings::view

fn iteration_rng(pixel: vec2<u32>) -> Rng {
    return rng_new(pixel, view.frame, iteration_stream(STREAM_REUSE), view.seed);
}

// The stream of this iteration.  `first`: that of the first iteration of the first domain.
fn iteration_stream(first: u32) -> u32 {
    return first + settings.domain * STREAMS_PER_DOMAIN + settings.iteration;
}
