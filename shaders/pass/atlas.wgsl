// Fills a rectangle of the texture atlas from an image or from the finer mip level.  Each texel is the mean of the source area that it
// covers, in linear light, so that the mean color of a texture is the same at every distance.

#import bevy_restir::common::texel::{decode_texel, encode_texel}

struct Copy {
    source_corner: vec2<u32>,  // texels
    source_size: vec2<u32>,
    corner: vec2<u32>,         // in the page
    size: vec2<u32>,
    layer: u32,                // page of the atlas
    decode: u32,               // ENCODING_* of the source
    encode: u32,               // ENCODING_* of the target
    pad: u32,
}

@group(0) @binding(0) var<uniform> job: Copy;
@group(0) @binding(1) var source: texture_2d<f32>;
@group(0) @binding(2) var target_page: texture_storage_2d_array<rgba8unorm, write>;

// Overlap of texel i of n and texel j of m, which divide the same length, in units of 1/(n m) of that length.
fn overlap(i: u32, n: u32, j: u32, m: u32) -> f32 {
    return f32(min((i + 1u) * m, (j + 1u) * n) - max(i * m, j * n));
}

@compute @workgroup_size(8, 8)
fn copy(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= job.size) {
        return;
    }
    let full = job.source_size;
    let low = id.xy * full / job.size;
    let high = ((id.xy + 1u) * full + job.size - 1u) / job.size;
    var sum = vec4<f32>(0.0);
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let weight = overlap(id.x, job.size.x, x, full.x) * overlap(id.y, job.size.y, y, full.y);
            sum += weight * decode_texel(textureLoad(source, job.source_corner + vec2<u32>(x, y), 0), job.decode);
        }
    }
    let color = sum / (f32(full.x) * f32(full.y));
    textureStore(target_page, job.corner + id.xy, job.layer, encode_texel(color, job.encode));
}
