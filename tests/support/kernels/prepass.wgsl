// Reads the prepass textures of a camera: motion and depth.
@group(0) @binding(0) var motion: texture_2d<f32>;
@group(0) @binding(1) var depth: texture_depth_2d;
@group(0) @binding(2) var<storage, read_write> texels: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = textureDimensions(motion);
    if any(id.xy >= size) {
        return;
    }
    let moved = textureLoad(motion, id.xy, 0).xy;
    texels[id.y * size.x + id.x] = vec4<f32>(moved, textureLoad(depth, id.xy, 0), 0.0);
}
