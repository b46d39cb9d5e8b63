// The reservoir of a path, and the packing that ReSTIR PT, GI and BDPT share (`reservoir.wgsl` in their rooms).
#define_import_path bevy_restir::restir::stored_path

#import bevy_restir::common::constants::{LEAST_STORED_COLOR, NONE}
#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, is_sound}
#import bevy_restir::common::math::{max_component, octahedral_decode, octahedral_encode}
#import bevy_restir::restir::path_sample::{decode_barycentrics, encode_barycentrics, no_path_sample, PathSample}

struct Reservoir {
    path: PathSample,
    ucw: f32,              // W: E[f(X) W] = ∫ f, in the measure of the domain; 0: no sample
    confidence: f32,       // in frames' worth of candidates
    seen: bool,            // always true: a path that is occluded is not stored
}

// The fields that reservoirs of PT, GI and BDPT pack in the same way.
struct PackedPath {
    structure: u32,        // 3 bits of termination, 7 of length, 7 of reconnection, 3 of each lobe; 9 are free
    birth: u32,            // 16 bits of the frame, the low 16 of the first barycentric
    vertex: vec3<u32>,     // 24 bits of the instance and the high 8 of the first barycentric; 28 of the triangle and the high 4 of the
                           // confidence; 24 of the second barycentric and the low 8 of the confidence
    direction: u32,        // after the reconnection vertex, octahedral
}

// More instances and triangles than any device can bind.  A missing index has all bits set.
const INSTANCE_BITS: u32 = 0xffffffu;
const TRIANGLE_BITS: u32 = 0xfffffffu;

// Confidence is stored in sixteenths, 12 bits.  Several iterations of many neighbors exceed this limit; it adds no bias, because confidence
// does not depend on the samples.
const CONFIDENCE_MAX: f32 = 255.0;

fn no_reservoir() -> Reservoir {
    return Reservoir(no_path_sample(), 0.0, 0.0, true);
}

fn path_pack(r: Reservoir) -> PackedPath {
    let s = r.path;
    let is_confidence = guard_holds(is_sound(r.confidence), GUARD_RESERVOIR);
    let confidence = u32(select(0.0, min(r.confidence, CONFIDENCE_MAX), is_confidence) * 16.0 + 0.5);
    let b = encode_barycentrics(s.barycentrics);
    return PackedPath(
        s.termination | (s.length << 3u) | (s.reconnection << 10u) | (s.lobe_before << 17u) | (s.lobe_after << 20u),
        (s.born & 0xffffu) | (b.x << 16u),
        vec3<u32>(
            (s.instance & INSTANCE_BITS) | ((b.x >> 16u) << 24u),
            (s.triangle & TRIANGLE_BITS) | ((confidence >> 8u) << 28u),
            b.y | (confidence << 24u),
        ),
        octahedral_encode(s.wi),
    );
}

// The path and its confidence; the other fields of the reservoir are left to the caller.
fn path_unpack(p: PackedPath) -> Reservoir {
    var s = no_path_sample();
    s.termination = p.structure & 7u;
    s.length = (p.structure >> 3u) & 127u;
    s.reconnection = (p.structure >> 10u) & 127u;
    s.lobe_before = (p.structure >> 17u) & 7u;
    s.lobe_after = (p.structure >> 20u) & 7u;
    s.born = p.birth & 0xffffu;
    s.instance = index_or_none(p.vertex.x & INSTANCE_BITS, INSTANCE_BITS);
    s.triangle = index_or_none(p.vertex.y & TRIANGLE_BITS, TRIANGLE_BITS);
    s.barycentrics = decode_barycentrics(vec2<u32>((p.birth >> 16u) | ((p.vertex.x >> 24u) << 16u), p.vertex.z & 0xffffffu));
    s.wi = octahedral_decode(p.direction);
    let confidence = (p.vertex.z >> 24u) | ((p.vertex.y >> 28u) << 8u);
    return Reservoir(s, 0.0, f32(confidence) / 16.0, true);
}

fn index_or_none(index: u32, missing: u32) -> u32 {
    return select(index, NONE, index == missing);
}

// 18 bits a channel and a shared exponent of 8: exact to 2^-18 of the greatest channel.  Radiance below LEAST_STORED_COLOR is stored
// as black, and above 1e38 as 1e38.
fn pack_radiance(c: vec3<f32>) -> vec2<u32> {
    let greatest = min(max_component(c), 1.0e38);
    if !(greatest > LEAST_STORED_COLOR) {
        return vec2<u32>(0u);
    }
    // The biased exponent of the power of two above it; 2^(145 - exponent) scales smaller values to 18 bits.
    let exponent = (bitcast<u32>(greatest) >> 23u) + 1u;
    let scale = bitcast<f32>((272u - exponent) << 23u);
    let m = min(vec3<u32>(max(c, vec3<f32>(0.0)) * scale + 0.5), vec3<u32>(0x3ffffu));
    return vec2<u32>(m.x | (m.y << 18u), (m.y >> 14u) | (m.z << 4u) | (exponent << 22u));
}

fn unpack_radiance(w: vec2<u32>) -> vec3<f32> {
    let exponent = (w.y >> 22u) & 0xffu;
    if exponent < 19u {
        return vec3<f32>(0.0);
    }
    let m = vec3<u32>(w.x & 0x3ffffu, ((w.x >> 18u) | (w.y << 14u)) & 0x3ffffu, (w.y >> 4u) & 0x3ffffu);
    return vec3<f32>(m) * bitcast<f32>((exponent - 18u) << 23u);
}
