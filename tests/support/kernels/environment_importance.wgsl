// Writes level 0 of the importance texture to a buffer.
#import bevy_restir::light::environment::environment_cell_importance

@group(2) @binding(0) var<storage, read> size: vec2<u32>;
@group(2) @binding(1) var<storage, read_write> cells: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < size.x * size.y {
        cells[id.x] = environment_cell_importance(vec2<u32>(id.x % size.x, id.x / size.x), size);
    }
}
