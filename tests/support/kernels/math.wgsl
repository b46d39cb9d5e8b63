// Encodes and decodes directions (octahedral, equirectangular), builds a frame, and computes the sine and cosine of the azimuth.
#import bevy_restir::common::constants::{PI, TWO_PI}
#import bevy_restir::common::math::{equirectangular_uv, octahedral_decode, octahedral_encode, orthonormal_basis, precise_sine_cosine}

struct Out {
    octahedral: vec3<f32>,
    u: f32,
    equirectangular: vec3<f32>,
    v: f32,
    t: vec3<f32>,
    sine: f32,
    b: vec3<f32>,
    cosine: f32,
}

@group(0) @binding(0) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> results: array<Out>;

// Direction of a point of an equirectangular map: the inverse of `equirectangular_uv`.
fn equirectangular_direction(uv: vec2<f32>) -> vec3<f32> {
    let phi = (uv.x - 0.5) * TWO_PI;
    let theta = uv.y * PI;
    let s = sin(theta);
    return vec3<f32>(s * sin(phi), cos(theta), -s * cos(phi));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&directions) {
        return;
    }
    let d = directions[id.x].xyz;
    let uv = equirectangular_uv(d);
    let frame = orthonormal_basis(d);
    let azimuth = precise_sine_cosine(TWO_PI * (uv.x - 0.5));
    results[id.x] = Out(
        octahedral_decode(octahedral_encode(d)), uv.x, equirectangular_direction(uv), uv.y,
        frame[0], azimuth.x, frame[1], azimuth.y,
    );
}
