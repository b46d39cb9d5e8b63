// Radiance times exposure into Bevy's view target, and the visibility buffer's depth beside it, so that gizmos, transparent objects of
// other materials and post processing go on as ever.

#import bevy_restir::view::bindings::view

@group(2) @binding(0) var<storage, read> radiance: array<vec4<f32>>;
@group(2) @binding(1) var depth: texture_depth_2d;

struct Pixel {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

@vertex
fn vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(vec2<u32>((vertex << 1u) & 2u, vertex & 2u));
    return vec4<f32>(corner * 2.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> Pixel {
    let pixel = min(vec2<u32>(position.xy) - view.origin, view.size - 1u);
    let sum = radiance[pixel.y * view.size.x + pixel.x];
    let color = sum.rgb / max(sum.a, 1.0) * view.exposure;
    // Half floats end at 65504.
    return Pixel(vec4<f32>(min(color, vec3<f32>(6.0e4)), 1.0), textureLoad(depth, pixel, 0));
}
