// Debug views of the reservoirs of ReSTIR DI, without exposure.

#import bevy_restir::common::constants::NONE
#import bevy_restir::light::remap::is_bin
#import bevy_restir::restir::di::reservoir::{PackedReservoir, reservoir_unpack}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::scene::bindings::scene
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::false_color::false_color
#import bevy_restir::view::pixel::pixel_index

@group(2) @binding(1) var<storage, read> reservoirs: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;

// A test holds them equal to the order of `DebugView` in src/settings/debug_view.rs.
const DEBUG_RESERVOIR_LIGHTS: u32 = 9u;
const DEBUG_RESERVOIR_POINTS: u32 = 10u;
const DEBUG_RESERVOIR_WEIGHTS: u32 = 11u;
const DEBUG_RESERVOIR_CONFIDENCE: u32 = 12u;

@compute @workgroup_size(8, 8)
fn debug_di(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let r = reservoir_unpack(reservoirs[reservoir_index(pixel)]);
    let is_empty = textureLoad(visibility, pixel, 0).x == NONE || !(r.ucw > 0.0);
    var color = vec3<f32>(0.0);
    switch view.debug_view {
        case DEBUG_RESERVOIR_LIGHTS: {
            color = select(color_of_light(r.point.light), vec3<f32>(0.0), is_empty);
        }
        case DEBUG_RESERVOIR_POINTS: {
            color = select(vec3<f32>(unpack2x16unorm(r.point.coordinates), 0.0), vec3<f32>(0.0), is_empty);
        }
        case DEBUG_RESERVOIR_WEIGHTS: {
            color = vec3<f32>(r.ucw);
        }
        case DEBUG_RESERVOIR_CONFIDENCE: {
            color = vec3<f32>(r.confidence);
        }
        default: {
            color = select(select(vec3<f32>(1.0, 0.0, 0.0), vec3<f32>(0.0, 1.0, 0.0), r.seen), vec3<f32>(0.0), is_empty);
        }
    }
    radiance[pixel_index(pixel)] = vec4<f32>(color, 1.0);
}

// A color that a light keeps as long as no light appears or disappears: bins change their places.
fn color_of_light(light: u32) -> vec3<f32> {
    return false_color(select(vec2<u32>(light, NONE), vec2<u32>(light - scene.first_bin, 0u), is_bin(light, false)));
}
