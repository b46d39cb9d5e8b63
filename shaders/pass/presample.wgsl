// Subsets of light points, drawn once a frame (Wyman and Panteleev 2021, 5): what a tile of pixels then picks from lies together in
// memory, however many lights there are.  One table of all kinds is drawn from by power, so that the kinds are mixed as they come.

#import bevy_restir::common::rng::{rng_4, rng_new, STREAM_PRESAMPLE}
#import bevy_restir::light::presampled::{presample_light, PresampledLight}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::view::bindings::view

@group(2) @binding(1) var<storage, read_write> subsets: array<PresampledLight>;

// x: in the subset; y: which one.
@compute @workgroup_size(64)
fn presample(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= settings.subset_size {
        return;
    }
    var rng = rng_new(id.xy, view.frame, STREAM_PRESAMPLE, view.seed);
    subsets[id.y * settings.subset_size + id.x] = presample_light(rng_4(&rng));
}
