// Shows the lights of this frame and of the last one, and where they are found in the other frame.  Tests run this pass instead of
// `shaders/pass/reuse.wgsl`.
//
// Each light has two pixels.  Those of this frame fill the upper half of the image, those of the last frame the lower half.

#import bevy_restir::common::constants::{LIGHT_MESH, LIGHT_TRIANGLE, NONE}
#import bevy_restir::light::remap::{current_light_id, light_record}
#import bevy_restir::light::select::light_pmf
#import bevy_restir::scene::bindings::{instances, lights, scene}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::render_layers::light_kind

@group(2) @binding(5) var resampled: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn reuse(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = pixel.y * view.size.x + pixel.x;
    let pixels = view.size.x * view.size.y / 2u;
    let previous = index >= pixels;
    let light = light_at((index % pixels) / 2u, previous);
    var value = vec3<f32>(0.0);
    if light != NONE {
        value = shown(light, previous, (index & 1u) != 0u);
    }
    textureStore(resampled, pixel, vec4<f32>(value, 0.0));
}

// The light with this number; NONE if there are fewer lights.
fn light_at(number: u32, previous: bool) -> u32 {
    let first_bin = select(scene.first_bin, scene.previous_first_bin, previous);
    let bins = select(scene.light_bins, scene.previous_light_bins, previous);
    var left = number;
    for (var bin = first_bin; bin < first_bin + bins; bin++) {
        let is_mesh = light_kind(bin) == LIGHT_MESH;
        let count = select(1u, lights[bin].data.y, is_mesh);
        if left < count {
            return select(bin, lights[bin].data.x, is_mesh) + left;
        }
        left -= count;
    }
    return NONE;
}

// The name and the probability of a light, or (`is_second`) the name of the same light in the other frame and whether the way back leads to
// the light.
fn shown(light: u32, previous: bool, is_second: bool) -> vec3<f32> {
    if !is_second {
        return vec3<f32>(name_of(light), light_pmf(light));
    }
    var other = light_record(light, true);
    var back = current_light_id(other);
    if previous {
        other = current_light_id(light);
        back = light_record(other, true);
    }
    return vec3<f32>(name_of(other), select(0.0, 1.0, other == NONE || back == light));
}

// Two numbers that name a light: 1 + the entity and 1 + the triangle, or a number of its place and its kind.
fn name_of(light: u32) -> vec2<f32> {
    if light == NONE {
        return vec2<f32>(0.0);
    }
    let data = lights[light].data;
    if light_kind(light) == LIGHT_TRIANGLE {
        return vec2<f32>(f32(instances[data.x].entity + 1u), f32(data.y - instances[data.x].first_triangle + 1u));
    }
    return vec2<f32>(lights[light].position.x + 1000.0 * f32(light_kind(light)), 0.0);
}
