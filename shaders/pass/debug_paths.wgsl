// Debug views of the reservoirs of paths, without exposure.

#import bevy_restir::view::pixel::pixel_index
#import domain::{evaluate, is_visible, jacobian_of, PackedReservoir, receiver_of, Reservoir, reservoir_unpack}
#import bevy_restir::common::constants::NONE
#import bevy_restir::restir::path_sample::{TERMINATION_EMITTER, TERMINATION_ENVIRONMENT, TERMINATION_NEE}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::connection::connection::{ends_with_connection, events_of_light}
#import bevy_restir::restir::shift::shifted_path::{SHIFT_OCCLUDED, SHIFT_OK}
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::debug_shift::shift_destination
#import bevy_restir::view::false_color::false_color

@group(2) @binding(1) var<storage, read> reservoirs: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;

// A test holds them equal to the order of `DebugView` in src/settings/debug_view.rs.
const DEBUG_PATH_ENDS: u32 = 14u;
const DEBUG_PATH_LENGTHS: u32 = 15u;
const DEBUG_PATH_RECONNECTIONS: u32 = 16u;
const DEBUG_PATH_WEIGHTS: u32 = 17u;
const DEBUG_PATH_CONFIDENCE: u32 = 18u;
const DEBUG_PATH_AGES: u32 = 19u;
const DEBUG_PATH_SHIFTS: u32 = 20u;
const DEBUG_PATH_TECHNIQUES: u32 = 24u;

@compute @workgroup_size(8, 8)
fn debug_paths(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let r = reservoir_unpack(reservoirs[reservoir_index(pixel)]);
    var color = vec3<f32>(0.0);
    if view.debug_view == DEBUG_PATH_CONFIDENCE {
        color = vec3<f32>(r.confidence);
    } else if textureLoad(visibility, pixel, 0).x != NONE && r.ucw > 0.0 {
        color = path_view(r, pixel);
    }
    radiance[pixel_index(pixel)] = vec4<f32>(color, 1.0);
}

fn path_view(r: Reservoir, pixel: vec2<u32>) -> vec3<f32> {
    switch view.debug_view {
        case DEBUG_PATH_ENDS: {
            if ends_with_connection(r.path) {
                return vec3<f32>(1.0, 1.0, 0.0);
            }
            return vec3<f32>(vec3<u32>(r.path.termination) == vec3<u32>(TERMINATION_NEE, TERMINATION_EMITTER, TERMINATION_ENVIRONMENT));
        }
        case DEBUG_PATH_LENGTHS: {
            // Scattering events.
            return vec3<f32>(f32(r.path.length - 1u + events_of_light(r.path)));
        }
        case DEBUG_PATH_RECONNECTIONS: {
            return vec3<f32>(f32(r.path.reconnection));
        }
        case DEBUG_PATH_WEIGHTS: {
            return vec3<f32>(r.ucw);
        }
        case DEBUG_PATH_TECHNIQUES: {
            // s + t vertices: that on the light has the index `length`.
            if ends_with_connection(r.path) {
                return vec3<f32>(f32(events_of_light(r.path) + 1u), f32(r.path.length), 0.0);
            }
            let s = u32(r.path.termination == TERMINATION_NEE);
            return vec3<f32>(f32(s), f32(r.path.length + 1u - s), 0.0);
        }
        case DEBUG_PATH_AGES: {
            return vec3<f32>(f32((view.frame - r.path.born) & 0xffffu));
        }
        default: {
            return shift_view(r, pixel);
        }
    }
}

// The shift of the path to another pixel: its Jacobian; or white if it succeeds, and otherwise a false color for the reason.
fn shift_view(r: Reservoir, pixel: vec2<u32>) -> vec3<f32> {
    let at = shift_destination(pixel);
    let ids = textureLoad(visibility, at, 0).xy;
    if ids.x == NONE {
        return vec3<f32>(0.0);
    }
    let to = receiver_of(ids, at, false);
    let e = evaluate(to, r);
    if view.debug_view != DEBUG_PATH_SHIFTS {
        return vec3<f32>(jacobian_of(e));
    }
    var reason = e.shifted.reason;
    if reason == SHIFT_OK && !is_visible(to, e, 0u) {
        reason = SHIFT_OCCLUDED;
    }
    return select(false_color(vec2<u32>(reason, 8u)), vec3<f32>(1.0), reason == SHIFT_OK);
}
