// A vertex of a light sub-path in the light vertex cache (Hedstrom et al. 2025, 7.1).  Each sub-path keeps one of its vertices that can be
// connected, chosen uniformly, which stands for all `count` of them.  The cache has one entry for each sub-path, whatever its length, so that
// it never overflows and does not depend on the order of execution.  It is a texture, because passes of candidates bind eight storage buffers.
#define_import_path bevy_restir::restir::connection::light_vertex

#import bevy_restir::bsdf::bsdf::bsdf_is_delta
#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::common::rng::{Rng, rng_1}
#import bevy_restir::path::bidirectional_mis::MisState
#import bevy_restir::path::light_path::LightWalk
#import bevy_restir::restir::path_sample::{decode_barycentrics, encode_barycentrics, quantized_barycentrics}

struct LightVertex {
    instance: u32,
    triangle: u32,
    barycentrics: vec2<f32>,   // on the grid of reservoirs
    towards_light: vec3<f32>,  // direction to the vertex before
    throughput: vec3<f32>,     // power that arrives, over the density of the sub-path
    state: MisState,
    events: u32,               // scattering events of the sub-path up to this vertex, with it; 0: no vertex
    count: u32,                // vertices of the sub-path that can be connected
    open_distance: f32,        // as in `LightWalk`
    light: u32,                // where the sub-path starts
    path: u32,                 // index of the sub-path
}

// The texels of a vertex lie side by side.
const VERTEX_TEXELS: u32 = 3u;
const VERTICES_PER_ROW: u32 = 2048u;

fn vertex_texel(index: u32) -> vec2<u32> {
    return vec2<u32>(index % VERTICES_PER_ROW * VERTEX_TEXELS, index / VERTICES_PER_ROW);
}

// Offers the newest vertex of a walk: after n vertices each of them is kept with probability 1/n.
fn offer_vertex(kept: LightVertex, w: LightWalk, light: u32, path: u32, rng: ptr<function, Rng>) -> LightVertex {
    let u = rng_1(rng);
    var v = kept;
    if bsdf_is_delta(w.surface.bsdf) {
        return v;
    }
    let count = kept.count + 1u;
    if u * f32(count) < 1.0 {
        v = newest_vertex(w, light, path);
    }
    v.count = count;
    return v;
}

// The newest vertex of a walk, which stands for itself alone.
fn newest_vertex(w: LightWalk, light: u32, path: u32) -> LightVertex {
    let barycentrics = quantized_barycentrics(w.hit.barycentrics);
    return LightVertex(
        w.hit.instance, w.hit.triangle, barycentrics, w.towards_light, w.throughput, w.state, w.events, 1u, w.open_distance, light, path,
    );
}

fn light_vertex_pack(v: LightVertex) -> array<vec4<u32>, VERTEX_TEXELS> {
    let barycentrics = encode_barycentrics(v.barycentrics);
    return array<vec4<u32>, VERTEX_TEXELS>(
        vec4<u32>(v.instance, v.triangle, barycentrics | (vec2<u32>(v.events, v.count) << vec2<u32>(24u))),
        vec4<u32>(bitcast<vec3<u32>>(v.throughput), octahedral_encode(v.towards_light)),
        vec4<u32>(bitcast<vec3<u32>>(vec3<f32>(v.state.last, v.state.earlier, v.open_distance)), v.light),
    );
}

fn light_vertex_at(cache: texture_2d<u32>, index: u32) -> LightVertex {
    let texel = vertex_texel(index);
    var texels: array<vec4<u32>, VERTEX_TEXELS>;
    for (var i = 0u; i < VERTEX_TEXELS; i++) {
        texels[i] = textureLoad(cache, texel + vec2<u32>(i, 0u), 0);
    }
    return light_vertex_unpack(texels, index);
}

fn light_vertex_unpack(texels: array<vec4<u32>, VERTEX_TEXELS>, path: u32) -> LightVertex {
    let hit = texels[0];
    let arrived = texels[1];
    let rest = texels[2];
    let numbers = bitcast<vec3<f32>>(rest.xyz);
    return LightVertex(
        hit.x,
        hit.y,
        decode_barycentrics(hit.zw & vec2<u32>(0xffffffu)),
        octahedral_decode(arrived.w),
        bitcast<vec3<f32>>(arrived.xyz),
        MisState(numbers.x, numbers.y),
        hit.z >> 24u,
        hit.w >> 24u,
        numbers.z,
        rest.w,
        path,
    );
}
