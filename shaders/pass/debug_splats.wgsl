// Debug views of the reservoirs of light sub-paths that the camera sees, without exposure.

#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::splats::reservoir::{PackedReservoir, Reservoir, reservoir_unpack}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::pixel::pixel_index

@group(2) @binding(1) var<storage, read> reservoirs: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;

// A test holds them equal to the order of `DebugView` in src/settings/debug_view.rs.
const DEBUG_LIGHT_PATH_LENGTHS: u32 = 25u;
const DEBUG_LIGHT_PATH_WEIGHTS: u32 = 26u;
const DEBUG_LIGHT_PATH_CONFIDENCE: u32 = 27u;

@compute @workgroup_size(8, 8)
fn debug_splats(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let r = reservoir_unpack(reservoirs[reservoir_index(pixel)]);
    var shown = 0.0;
    if view.debug_view == DEBUG_LIGHT_PATH_CONFIDENCE {
        shown = r.confidence;
    } else if r.ucw > 0.0 {
        shown = sample_view(r);
    }
    radiance[pixel_index(pixel)] = vec4<f32>(vec3<f32>(shown), 1.0);
}

fn sample_view(r: Reservoir) -> f32 {
    switch view.debug_view {
        case DEBUG_LIGHT_PATH_LENGTHS: {
            return f32(r.events);
        }
        case DEBUG_LIGHT_PATH_WEIGHTS: {
            return r.ucw;
        }
        default: {
            return f32(view.frame - r.frame);
        }
    }
}
