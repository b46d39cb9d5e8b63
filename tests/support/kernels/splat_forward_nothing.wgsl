// Leaves the samples of the last frame as they are.  Tests run it instead of `shaders/pass/splats_forward.wgsl`.

@group(2) @binding(1) var<storage, read_write> words: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn splats_forward(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x == 0xffffffffu {
        atomicStore(&words[0], 0u);
    }
}
