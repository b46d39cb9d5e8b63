// Shows the data that a pixel reads of this frame and of the last one.  Tests run this pass instead of `shaders/pass/reuse.wgsl`.
//
// A block of 2 x 8 pixels belongs to one place in the image.  Its left column shows the data of this frame at that place, its right column
// those of the last frame, one quantity a row: the right column must equal the left one of the frame before.

#import domain::{PackedReservoir, receiver_of, reservoir_pack, reservoir_unpack}
#import bevy_restir::common::constants::{FAR, LIGHT_MESH, NONE}
#import bevy_restir::common::ray::Ray
#import bevy_restir::light::point_on_light::{light_point_at, LightPoint}
#import bevy_restir::light::select::light_pmf
#import bevy_restir::path::nee::emitter_nee_pdf
#import bevy_restir::restir::bindings::{previous_visibility, settings}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::shift::reconnection::triangle_factor
#import bevy_restir::scene::bindings::{lights, scene}
#import bevy_restir::trace::trace::trace_closest_in_frame
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::render_layers::light_kind

@group(2) @binding(1) var<storage, read> neighbors: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(4) var own_contribution: texture_2d<f32>;
@group(2) @binding(5) var resampled: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn reuse(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel);
    reservoirs[index] = reservoir_pack(reservoir_unpack(neighbors[index]));
    let place = pixel / vec2<u32>(2u, 8u) * vec2<u32>(2u, 8u) + vec2<u32>(0u, 4u);
    let previous = (pixel.x & 1u) != 0u;
    var ids = textureLoad(visibility, place, 0).xy;
    if previous {
        ids = textureLoad(previous_visibility, place, 0).xy;
    }
    var value = textureLoad(own_contribution, pixel, 0).rgb * 0.0;
    if ids.x != NONE && settings.temporal_samples > 0u {
        value = quantity(ids, place, previous, pixel.y & 7u);
    }
    textureStore(resampled, pixel, vec4<f32>(value, 0.0));
}

fn quantity(ids: vec2<u32>, place: vec2<u32>, previous: bool, row: u32) -> vec3<f32> {
    let r = receiver_of(ids, place, previous);
    let s = r.first.surface;
    // A direction of its own for each place.
    let turn = vec3<f32>(sin(f32(place.x)), cos(f32(place.y)), sin(f32(place.x + 3u * place.y)));
    let hit = trace_closest_in_frame(Ray(s.position + 0.01 * s.bsdf.n_geo, 0.0, normalize(s.bsdf.n_geo + 0.6 * turn), FAR), 7u, previous);
    switch row {
        case 0u: {
            return s.position;
        }
        case 1u: {
            return s.bsdf.n_geo + 0.5 * s.bsdf.n + s.bsdf.base_color;
        }
        case 2u: {
            return r.first.wo;
        }
        case 3u: {
            return vec3<f32>(r.first.cone.width, r.shift.separation, f32(s.front) + 1.0e5 * s.offset);
        }
        case 4u: {
            return vec3<f32>(min(hit.t, 100.0), f32(hit.instance & 0xffu), f32(hit.triangle & 0xffu));
        }
        case 5u: {
            if hit.instance == NONE {
                return vec3<f32>(0.0);
            }
            let factor = triangle_factor(s.position, s.position + vec3<f32>(0.3, 0.5, 0.7), hit.instance, hit.triangle, previous);
            let pdf = emitter_nee_pdf(0u, 1.0, hit.instance, hit.triangle, s.position, s.position + vec3<f32>(0.7, 0.3, 0.5), previous);
            return vec3<f32>(factor, min(pdf, 1.0e3), 0.0);
        }
        case 6u: {
            return sum_over_lights(s.position, previous, 0u);
        }
        default: {
            return sum_over_lights(s.position, previous, 1u);
        }
    }
}

// Sums over all lights, seen from a point.
fn sum_over_lights(from_point: vec3<f32>, previous: bool, which: u32) -> vec3<f32> {
    var sum = vec3<f32>(0.0);
    for (var bin = scene.first_bin; bin < scene.first_bin + scene.light_bins; bin++) {
        // The bin of a mesh stands for all its triangles.
        let is_mesh = light_kind(bin) == LIGHT_MESH;
        let first = select(bin, lights[bin].data.x, is_mesh);
        for (var light = first; light < first + select(1u, lights[bin].data.y, is_mesh); light++) {
            sum += value_of_light(light, from_point, previous, which);
        }
    }
    return sum;
}

fn value_of_light(light: u32, from_point: vec3<f32>, previous: bool, which: u32) -> vec3<f32> {
    let l = light_point_at(LightPoint(light, 0x50003000u), from_point, previous);
    if which == 0u {
        return l.radiance * (1.0 + abs(l.wi.x));
    }
    // The probability of a light is that of this frame in both.
    let is_chosen_alike = light_pmf(l.light) == light_pmf(light);
    return vec3<f32>(min(l.pdf_solid_angle, 1.0e3), min(l.distance, 1.0e3), select(0.0, l.pdf_scale, is_chosen_alike));
}
