// Subsets of light points, drawn once a frame (paper 003, 5): what a tile of pixels then picks from lies together in memory, however
// many lights there are.

#import bevy_restir::common::rng::{rng_4, rng_new, STREAM_PRESAMPLE}
#import bevy_restir::light::point_on_light::light_point_sample
#import bevy_restir::light::select::light_select
#import bevy_restir::restir::types::DirectSettings
#import bevy_restir::view::bindings::view

@group(2) @binding(0) var<uniform> settings: DirectSettings;
// (light, coordinates, bits of the probability of the light, 0)
@group(2) @binding(1) var<storage, read_write> subsets: array<vec4<u32>>;

// x: in the subset; y: which one.
@compute @workgroup_size(64)
fn presample(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= settings.subset_size {
        return;
    }
    var rng = rng_new(id.xy, view.frame, STREAM_PRESAMPLE, view.seed);
    let u = rng_4(&rng);
    let choice = light_select(u.xy);
    let p = light_point_sample(choice.light, u.zw);
    subsets[id.y * settings.subset_size + id.x] = vec4<u32>(p.light, p.coordinates, bitcast<u32>(choice.pmf), 0u);
}
