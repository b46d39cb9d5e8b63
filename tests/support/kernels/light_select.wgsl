// Choices among all lights.
#import bevy_restir::common::rng::{rng_2, rng_of_key}
#import bevy_restir::light::select::{light_pmf, light_select}

@group(2) @binding(0) var<storage, read> seed: array<u32>;
// (light, pmf, pmf by the other function)
@group(2) @binding(1) var<storage, read_write> choices: array<vec4<u32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    var rng = rng_of_key(id.x, seed[0], 79u, 0u);
    let c = light_select(rng_2(&rng));
    choices[id.x] = vec4<u32>(c.light, bitcast<u32>(c.pmf), bitcast<u32>(light_pmf(c.light)), 0u);
}
