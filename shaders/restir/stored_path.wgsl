// The reservoir of a path, and the packing that ReSTIR PT and GI share (`restir/pt/reservoir.wgsl`, `restir/gi/reservoir.wgsl`).
#define_import_path bevy_restir::restir::stored_path

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, is_sound}
#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::restir::path_sample::{decode_barycentrics, encode_barycentrics, no_path_sample, PathSample}

struct Reservoir {
    path: PathSample,
    ucw: f32,              // W: E[f(X) W] = ∫ f, in the measure of the technique; 0: no sample
    confidence: f32,       // in frames' worth of candidates
    seen: bool,            // always true: a path that is occluded is not stored
}

// Fields that both reservoirs store alike.
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

// Confidence is stored in sixteenths, 12 bits.
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
        s.termination | s.length << 3u | s.reconnection << 10u | s.lobe_before << 17u | s.lobe_after << 20u,
        (s.born & 0xffffu) | b.x << 16u,
        vec3<u32>(
            (s.instance & INSTANCE_BITS) | (b.x >> 16u) << 24u,
            (s.triangle & TRIANGLE_BITS) | (confidence >> 8u) << 28u,
            b.y | confidence << 24u,
        ),
        octahedral_encode(s.wi),
    );
}

// The path and its confidence; the other fields of the reservoir are left to the caller.
fn path_unpack(p: PackedPath) -> Reservoir {
    var s = no_path_sample();
    s.termination = p.structure & 7u;
    s.length = p.structure >> 3u & 127u;
    s.reconnection = p.structure >> 10u & 127u;
    s.lobe_before = p.structure >> 17u & 7u;
    s.lobe_after = p.structure >> 20u & 7u;
    s.born = p.birth & 0xffffu;
    s.instance = index_or_none(p.vertex.x & INSTANCE_BITS, INSTANCE_BITS);
    s.triangle = index_or_none(p.vertex.y & TRIANGLE_BITS, TRIANGLE_BITS);
    s.barycentrics = decode_barycentrics(vec2<u32>((p.birth >> 16u) | (p.vertex.x >> 24u) << 16u, p.vertex.z & 0xffffffu));
    s.wi = octahedral_decode(p.direction);
    let confidence = (p.vertex.z >> 24u) | (p.vertex.y >> 28u) << 8u;
    return Reservoir(s, 0.0, f32(confidence) / 16.0, true);
}

fn index_or_none(index: u32, missing: u32) -> u32 {
    return select(index, NONE, index == missing);
}
