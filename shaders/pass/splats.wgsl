// Adds the splats of light sub-paths to the light of the camera's sub-paths.  `pass/light_paths.wgsl` describes the light map.

#import bevy_restir::common::constants::OVERFLOW_STEPS
#import bevy_restir::common::math::max_component
#import bevy_restir::common::ray::trace_flags
#import bevy_restir::view::bindings::view
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(1) var<storage, read> light_map: array<u32>;
@group(2) @binding(2) var camera_light: texture_2d<f32>;
@group(2) @binding(3) var light: texture_storage_2d<rgba32float, write>;

// Entries of a list that are read at most, so that no invocation takes seconds.  Further ones are left out, and reported as an overflow.
const MAX_ENTRIES: u32 = 1u << 20u;

@compute @workgroup_size(8, 8)
fn splats(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let sum = sum_of_list(light_map[pixel.y * view.size.x + pixel.x]);
    textureStore(light, pixel, vec4<f32>(textureLoad(camera_light, pixel, 0).rgb + sum, 0.0));
    count_rays(pixel);
}

// The order of a list depends on the order of execution, and a sum of floats would, too: entries are added as fixed-point numbers of 64 bits.
fn sum_of_list(head: u32) -> vec3<f32> {
    var largest = 0.0;
    var next = head;
    for (var i = 0u; next != 0u && i < MAX_ENTRIES; i++) {
        largest = max(largest, max_component(radiance_of(next)));
        next = light_map[word_of(next)];
    }
    // A power of two that takes the largest value to at least 2^30.
    let exponent = bitcast<u32>(largest) >> 23u;
    let scale = bitcast<f32>(clamp(284u - exponent, 1u, 254u) << 23u);
    var low = vec3<u32>(0u);
    var high = vec3<u32>(0u);
    next = head;
    for (var i = 0u; next != 0u && i < MAX_ENTRIES; i++) {
        let value = vec3<u32>(radiance_of(next) * scale);
        low += value;
        high += select(vec3<u32>(0u), vec3<u32>(1u), low < value);
        next = light_map[word_of(next)];
    }
    if next != 0u {
        trace_flags |= OVERFLOW_STEPS;
    }
    return (vec3<f32>(high) * 0x1p32 + vec3<f32>(low)) / scale;
}

// First word of the entry that a link names.
fn word_of(link: u32) -> u32 {
    return view.size.x * view.size.y + 4u * (link - 1u);
}

fn radiance_of(link: u32) -> vec3<f32> {
    let word = word_of(link);
    return bitcast<vec3<f32>>(vec3<u32>(light_map[word + 1u], light_map[word + 2u], light_map[word + 3u]));
}
