// A vertex of a light sub-path in the light vertex cache (Hedstrom et al. 2025, 7.1).  Each sub-path keeps one of its vertices that can be
// connected, chosen uniformly, which stands for all `count` of them.  The cache has one entry for each sub-path, whatever its length, so that
// it never overflows and does not depend on the order of execution.
#define_import_path bevy_restir::restir::bdpt::light_vertex

#import bevy_restir::bsdf::bsdf::bsdf_is_delta
#import bevy_restir::common::rng::{Rng, rng_1}
#import bevy_restir::path::bidirectional_mis::MisState
#import bevy_restir::path::light_path::LightWalk

struct LightVertex {
    instance: u32,
    triangle: u32,
    barycentrics: vec2<f32>,
    towards_light: vec3<f32>,  // direction to the vertex before
    throughput: vec3<f32>,     // power that arrives, over the density of the sub-path
    state: MisState,
    events: u32,               // scattering events of the sub-path up to this vertex, with it; 0: no vertex
    count: u32,                // vertices of the sub-path that can be connected
    open_distance: f32,        // as in `LightWalk`
}

// The light vertex as it is stored.
struct PackedLightVertex {
    hit: vec4<u32>,
    towards_light: vec4<f32>,
    throughput: vec4<f32>,
    counts: vec4<u32>,
}

// Offers the newest vertex of a walk: after n vertices each of them is kept with probability 1/n.
fn offer_vertex(kept: LightVertex, w: LightWalk, rng: ptr<function, Rng>) -> LightVertex {
    let u = rng_1(rng);
    var v = kept;
    if bsdf_is_delta(w.surface.bsdf) {
        return v;
    }
    let count = kept.count + 1u;
    if u * f32(count) < 1.0 {
        v = LightVertex(
            w.hit.instance, w.hit.triangle, w.hit.barycentrics, w.towards_light, w.throughput, w.state, w.events, count, w.open_distance,
        );
    }
    v.count = count;
    return v;
}

fn light_vertex_pack(v: LightVertex) -> PackedLightVertex {
    return PackedLightVertex(
        vec4<u32>(v.instance, v.triangle, bitcast<vec2<u32>>(v.barycentrics)),
        vec4<f32>(v.towards_light, v.state.last),
        vec4<f32>(v.throughput, v.state.earlier),
        vec4<u32>(v.events, v.count, bitcast<u32>(v.open_distance), 0u),
    );
}

fn light_vertex_unpack(p: PackedLightVertex) -> LightVertex {
    return LightVertex(
        p.hit.x,
        p.hit.y,
        bitcast<vec2<f32>>(p.hit.zw),
        p.towards_light.xyz,
        p.throughput.xyz,
        MisState(p.towards_light.w, p.throughput.w),
        p.counts.x,
        p.counts.y,
        bitcast<f32>(p.counts.z),
    );
}
