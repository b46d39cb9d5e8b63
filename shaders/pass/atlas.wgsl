// Copies an image into its rectangle of the texture atlas, averaging where the rectangle is smaller.  sRGB images are read as linear
// values and stored encoded: eight bits in, the same eight bits out.

struct Copy {
    corner: vec2<u32>,
    size: vec2<u32>,
    layer: u32,
    encode_srgb: u32,
    pad: vec2<u32>,
}

@group(0) @binding(0) var<uniform> job: Copy;
@group(0) @binding(1) var source: texture_2d<f32>;
@group(0) @binding(2) var target_page: texture_storage_2d_array<rgba8unorm, write>;

fn linear_to_srgb(c: vec3<f32>) -> vec3<f32> {
    let curve = 1.055 * pow(max(c, vec3<f32>(0.0)), vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curve, c * 12.92, c <= vec3<f32>(0.0031308));
}

@compute @workgroup_size(8, 8)
fn copy(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= job.size) {
        return;
    }
    let full = textureDimensions(source);
    let low = id.xy * full / job.size;
    let high = max((id.xy + 1u) * full / job.size, low + 1u);
    var sum = vec4<f32>(0.0);
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            sum += textureLoad(source, vec2<u32>(x, y), 0);
        }
    }
    var color = sum / f32((high.x - low.x) * (high.y - low.y));
    if job.encode_srgb != 0u {
        color = vec4<f32>(linear_to_srgb(color.rgb), color.a);
    }
    textureStore(target_page, job.corner + id.xy, job.layer, color);
}
