// Draws the probe of each stored sample of ReSTIR SSS again, at the pixel that stores it.  Tests run it instead of
// `shaders/pass/debug_sss.wgsl`.  Writes (1 for each sample, 1 if its probe finds its point of entry again, 0).

#import bevy_restir::common::constants::NONE
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::sss::domain::{Receiver, receiver_of, replayed_hit}
#import bevy_restir::restir::sss::reservoir::{EntrySample, PackedReservoir, reservoir_unpack}
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::view::bindings::{view, visibility}

@group(2) @binding(1) var<storage, read> reservoirs: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn debug_sss(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let stored = reservoir_unpack(reservoirs[reservoir_index(pixel)]);
    let ids = textureLoad(visibility, pixel, 0).xy;
    var found = vec2<f32>(0.0);
    if ids.x != NONE && stored.ucw > 0.0 {
        found = vec2<f32>(1.0, f32(finds_its_point(receiver_of(ids, pixel, false), stored.sample)));
    }
    radiance[pixel.y * view.size.x + pixel.x] = vec4<f32>(found, 0.0, 1.0);
}

fn finds_its_point(r: Receiver, s: EntrySample) -> bool {
    let hit = replayed_hit(r, s);
    if hit.instance == NONE {
        return false;
    }
    let x2 = surface_point(s.instance, s.triangle, s.barycentrics, false);
    let again = surface_point(hit.instance, hit.triangle, hit.barycentrics, false);
    return distance(x2, again) <= 1.0e-3 * distance(x2, r.surface.position) + 1.0e-5;
}
