// Presamples subsets of light points once per frame (Wyman and Panteleev 2021, 5).  A tile of pixels draws candidates from one subset,
// which is contiguous in memory, however many lights there are.  Lights of all kinds are drawn from one table by power.

#import bevy_restir::common::constants::ONE_MINUS_EPSILON
#import bevy_restir::common::rng::{rng_4, rng_new, STREAM_PRESAMPLE}
#import bevy_restir::light::presampled::{presample_light, PresampledLight}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::view::bindings::view

@group(2) @binding(1) var<storage, read_write> subsets: array<PresampledLight>;

// x: index in the subset; y: index of the subset.
@compute @workgroup_size(64)
fn presample(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= settings.subset_size {
        return;
    }
    var rng = rng_new(id.xy, view.frame, STREAM_PRESAMPLE, view.seed);
    var u = rng_4(&rng);
    // The first number chooses a bin of the table of lights.  It is stratified, so that each subset has its share of every light.  A pixel
    // draws entries uniformly, so that the density of a candidate is that of independent entries: no bias.  The number must stay below 1.
    u.x = min((f32(id.x) + u.x) / f32(settings.subset_size), ONE_MINUS_EPSILON);
    subsets[id.y * settings.subset_size + id.x] = presample_light(u);
}
