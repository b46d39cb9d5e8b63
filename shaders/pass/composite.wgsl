// Radiance times exposure into Bevy's view target, and the visibility buffer's depth and motion beside it, so that gizmos, transparent
// objects of other materials and post processing go on as ever.

#import bevy_restir::common::constants::{NONE, VIEW_NO_BACKDROP}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::{barycentrics_on_ray, motion_of_point, motion_of_sky, primary_ray}

@group(2) @binding(0) var<storage, read> radiance: array<vec4<f32>>;
@group(2) @binding(1) var depth: texture_depth_2d;
@group(2) @binding(2) var seen: texture_2d<u32>;

struct Pixel {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

// Motion as Bevy's prepass has it: what to take off a place in [0, 1]² to go back in time.
struct PixelWithMotion {
    @location(0) color: vec4<f32>,
    @location(1) motion: vec2<f32>,
    @builtin(frag_depth) depth: f32,
}

@vertex
fn vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(vec2<u32>((vertex << 1u) & 2u, vertex & 2u));
    return vec4<f32>(corner * 2.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> Pixel {
    let pixel = pixel_at(position);
    let d = textureLoad(depth, pixel, 0);
    if is_another_cameras(d) {
        discard;
    }
    return Pixel(vec4<f32>(shown(pixel), 1.0), d);
}

@fragment
fn fragment_with_motion(@builtin(position) position: vec4<f32>) -> PixelWithMotion {
    let pixel = pixel_at(position);
    let d = textureLoad(depth, pixel, 0);
    if is_another_cameras(d) {
        discard;
    }
    return PixelWithMotion(vec4<f32>(shown(pixel), 1.0), -motion_at(pixel) / vec2<f32>(view.size), d);
}

// The picture may be smaller than the viewport.
fn pixel_at(position: vec4<f32>) -> vec2<u32> {
    let at = (position.xy - vec2<f32>(view.origin)) * (vec2<f32>(view.size) / vec2<f32>(view.target_size));
    return min(vec2<u32>(max(at, vec2<f32>(0.0))), view.size - 1u);
}

// Where there is no surface, an earlier camera's picture stays, if that is wanted.
fn is_another_cameras(d: f32) -> bool {
    return d == 0.0 && (view.flags & VIEW_NO_BACKDROP) != 0u;
}

fn shown(pixel: vec2<u32>) -> vec3<f32> {
    let sum = radiance[pixel.y * view.size.x + pixel.x];
    // Half floats end at 65504.
    return min(sum.rgb / max(sum.a, 1.0) * view.exposure, vec3<f32>(6.0e4));
}

// Pixels, to go back in time.
fn motion_at(pixel: vec2<u32>) -> vec2<f32> {
    let ids = textureLoad(seen, pixel, 0).xy;
    let ray = primary_ray(pixel);
    if ids.x == NONE {
        return motion_of_sky(ray.direction);
    }
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), ray);
    let now = surface_point(ids.x, ids.y, barycentrics, false);
    return motion_of_point(now, surface_point(ids.x, ids.y, barycentrics, true));
}
