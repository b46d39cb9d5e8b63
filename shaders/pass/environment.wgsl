// The mip chain for importance sampling of the environment map: level 0 from the map, each further level the 2x2 sums of the one before
// (Wyman and Panteleev 2021, 5.3).

#import bevy_restir::light::environment::environment_cell_importance

@group(2) @binding(0) var source: texture_2d<f32>;
@group(2) @binding(1) var level: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn importance(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = textureDimensions(level);
    if any(id.xy >= size) {
        return;
    }
    textureStore(level, id.xy, vec4<f32>(environment_cell_importance(id.xy, size)));
}

@compute @workgroup_size(8, 8)
fn reduce(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= textureDimensions(level)) {
        return;
    }
    // A side of 1 cell is not halved further.
    let size = textureDimensions(source);
    let step = vec2<u32>(2u) - vec2<u32>(size < vec2<u32>(2u));
    var sum = 0.0;
    for (var y = 0u; y < step.y; y++) {
        for (var x = 0u; x < step.x; x++) {
            sum += textureLoad(source, id.xy * step + vec2<u32>(x, y), 0).x;
        }
    }
    textureStore(level, id.xy, vec4<f32>(sum));
}
