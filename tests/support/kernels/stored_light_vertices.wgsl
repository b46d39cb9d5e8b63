// Debug view of the paths that store a light vertex, run in place of `shaders/pass/debug_paths.wgsl`: (1, whether their light sub-path, which is
// traced again in this frame, has that vertex, whether the path comes from an earlier frame).

#import domain::{PackedReservoir, reservoir_unpack}
#import bevy_restir::restir::connection::connection::{replayed_light_vertex, stores_light_vertex}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::view::bindings::view

@group(2) @binding(1) var<storage, read> reservoirs: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn debug_paths(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let r = reservoir_unpack(reservoirs[reservoir_index(pixel)]);
    var shown = vec3<f32>(0.0);
    if r.ucw > 0.0 && stores_light_vertex(r.path) {
        let p = replayed_light_vertex(r.path, false);
        let is_near = distance(p.barycentrics, r.path.barycentrics) < 1.0e-5 && dot(p.towards_light, r.path.wi) > 0.9999;
        let is_same = p.events > 0u && p.instance == r.path.instance && p.triangle == r.path.triangle && is_near;
        shown = vec3<f32>(1.0, f32(is_same), f32(((view.frame - r.path.born) & 0xffffu) > 0u));
    }
    radiance[pixel.y * view.size.x + pixel.x] = vec4<f32>(shown, 1.0);
}
