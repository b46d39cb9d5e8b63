// What a pixel keeps of a path, and what of it lies in memory alike whether whole paths are kept or indirect light
// (`restir/path_reservoir.wgsl`, `restir/indirect_reservoir.wgsl`).
#define_import_path bevy_restir::restir::kept_path

#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::path::sample::{decode_barycentrics, no_path_sample, PathSample}

struct Reservoir {
    path: PathSample,
    ucw: f32,              // W: E[f(X) W] = ∫ f, in the measure of the domain; 0: nothing was found
    confidence: f32,       // candidates' worth that it stands for
    seen: bool,            // always: paths that are not seen are not kept
}

// Confidence is kept in sixteenths, 12 bits.
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

// The vertex that other pixels reconnect to, and where the path goes from there.
fn connection_pack(s: PathSample) -> vec4<u32> {
    return vec4<u32>(s.instance, s.triangle, pack2x16unorm(s.barycentrics), octahedral_encode(s.wi));
}

// A path with its end and length, which are the lowest bits of either structure, and this connection.
fn path_unpack(structure: u32, connection: vec4<u32>) -> PathSample {
    var s = no_path_sample();
    s.end = structure & 3u;
    s.length = structure >> 2u & 127u;
    s.instance = connection.x;
    s.triangle = connection.y;
    s.barycentrics = decode_barycentrics(connection.z);
    s.wi = octahedral_decode(connection.w);
    return s;
}
