// The reservoir of a path, and the packing that ReSTIR PT and GI share (`restir/pt/reservoir.wgsl`, `restir/gi/reservoir.wgsl`).
#define_import_path bevy_restir::restir::stored_path

#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::restir::path_sample::{decode_barycentrics, no_path_sample, PathSample}

struct Reservoir {
    path: PathSample,
    ucw: f32,              // W: E[f(X) W] = ∫ f, in the measure of the technique; 0: no sample
    confidence: f32,       // in frames' worth of candidates
    seen: bool,            // always true: a path that is occluded is not stored
}

// Confidence is stored in sixteenths, 12 bits.
const CONFIDENCE_MAX: f32 = 255.0;

fn no_reservoir() -> Reservoir {
    return Reservoir(no_path_sample(), 0.0, 0.0, true);
}

fn confidence_pack(confidence: f32) -> u32 {
    return u32(clamp(confidence, 0.0, CONFIDENCE_MAX) * 16.0 + 0.5);
}

fn confidence_unpack(bits: u32) -> f32 {
    return f32(bits) / 16.0;
}

// The reconnection vertex, and the direction after it.
fn connection_pack(s: PathSample) -> vec4<u32> {
    return vec4<u32>(s.instance, s.triangle, pack2x16unorm(s.barycentrics), octahedral_encode(s.wi));
}

// A path with its termination and length, which are the lowest bits of `structure`, and this connection.
fn path_unpack(structure: u32, connection: vec4<u32>) -> PathSample {
    var s = no_path_sample();
    s.termination = structure & 3u;
    s.length = structure >> 2u & 127u;
    s.instance = connection.x;
    s.triangle = connection.y;
    s.barycentrics = decode_barycentrics(connection.z);
    s.wi = octahedral_decode(connection.w);
    return s;
}
