// Debug views of the reservoirs of ReSTIR SSS, without exposure.

#import bevy_restir::common::constants::{LEAST_MAGNITUDE, NONE}
#import bevy_restir::common::math::max_component
#import bevy_restir::common::ray::Hit
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::sss::domain::{entry_point, evaluate, is_visible, jacobian_of, Receiver, receiver_of, target_value}
#import bevy_restir::restir::sss::reservoir::{EntrySample, PackedReservoir, Reservoir, reservoir_unpack}
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::debug_shift::shift_destination
#import bevy_restir::view::pixel::pixel_index

@group(2) @binding(1) var<storage, read> reservoirs: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;

// A test holds them equal to the order of `DebugView` in src/settings/debug_view.rs.
const DEBUG_SUBSURFACE_DISTANCES: u32 = 32u;
const DEBUG_SUBSURFACE_RECONNECTIONS: u32 = 33u;
const DEBUG_SUBSURFACE_WEIGHTS: u32 = 34u;
const DEBUG_SUBSURFACE_CONFIDENCE: u32 = 35u;

const RED: vec3<f32> = vec3<f32>(1.0, 0.0, 0.0);
const GREEN: vec3<f32> = vec3<f32>(0.0, 1.0, 0.0);
const BLUE: vec3<f32> = vec3<f32>(0.0, 0.0, 1.0);
const YELLOW: vec3<f32> = vec3<f32>(1.0, 1.0, 0.0);

@compute @workgroup_size(8, 8)
fn debug_sss(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let r = reservoir_unpack(reservoirs[reservoir_index(pixel)]);
    let ids = textureLoad(visibility, pixel, 0).xy;
    var color = vec3<f32>(0.0);
    if view.debug_view == DEBUG_SUBSURFACE_CONFIDENCE {
        color = vec3<f32>(r.confidence);
    } else if ids.x != NONE && r.ucw > 0.0 {
        color = sample_view(r, ids, pixel);
    }
    radiance[pixel_index(pixel)] = vec4<f32>(color, 1.0);
}

fn sample_view(r: Reservoir, ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    switch view.debug_view {
        case DEBUG_SUBSURFACE_DISTANCES, DEBUG_SUBSURFACE_RECONNECTIONS: {
            return entry_view(r.sample, receiver_of(ids, pixel, false));
        }
        case DEBUG_SUBSURFACE_WEIGHTS: {
            return vec3<f32>(r.ucw);
        }
        default: {
            return shift_view(r, shift_destination(pixel));
        }
    }
}

// The distance of the point of entry, in multiples of d of the channel that scatters farthest; or which shift the hybrid shift would
// choose, which `is_far` of the sample tells only where the hybrid shift is in use.
fn entry_view(s: EntrySample, from_pixel: Receiver) -> vec3<f32> {
    let p = entry_point(from_pixel, Hit(0.0, s.instance, s.triangle, s.barycentrics));
    if view.debug_view == DEBUG_SUBSURFACE_RECONNECTIONS {
        return select(RED, GREEN, p.is_far);
    }
    let d = max(max_component(from_pixel.surface.radius), LEAST_MAGNITUDE);
    return vec3<f32>(distance(p.surface.position, from_pixel.surface.position) / d);
}

// The shift of the sample to another pixel: white if it succeeds, and otherwise a color for the reason.
fn shift_view(r: Reservoir, at: vec2<u32>) -> vec3<f32> {
    let ids = textureLoad(visibility, at, 0).xy;
    if ids.x == NONE {
        return vec3<f32>(0.0);
    }
    let to = receiver_of(ids, at, false);
    let e = evaluate(to, r);
    if !(jacobian_of(e) > 0.0) {
        return RED;
    }
    if !(target_value(e) > 0.0) {
        return BLUE;
    }
    return select(YELLOW, vec3<f32>(1.0), is_visible(to, e, 0u));
}
