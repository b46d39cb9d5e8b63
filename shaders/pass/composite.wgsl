// Writes radiance times exposure to Bevy's view target, and the depth and motion of the visibility buffer to Bevy's prepass textures, so
// that gizmos, transparent objects of other materials and post-processing work as usual.

#import bevy_restir::common::constants::{NONE, VIEW_ENVIRONMENT_IS_BACKDROP, VIEW_NO_BACKDROP}
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::{barycentrics_on_ray, motion_of_point, motion_of_sky, primary_ray}
#import bevy_restir::view::pixel::{pixel_at, pixel_index}

@group(2) @binding(0) var<storage, read> radiance: array<vec4<f32>>;
@group(2) @binding(1) var depth: texture_depth_2d;
@group(2) @binding(2) var visibility_buffer: texture_2d<u32>;

struct Output {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

// Motion as in Bevy's prepass: the position in [0, 1]² minus the position in the last frame.
struct OutputWithMotion {
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
fn fragment(@builtin(position) position: vec4<f32>) -> Output {
    let pixel = shown_pixel(position);
    let d = textureLoad(depth, pixel, 0);
    if keeps_earlier_picture(d) {
        discard;
    }
    return Output(color_at(position, d), d);
}

@fragment
fn fragment_with_motion(@builtin(position) position: vec4<f32>) -> OutputWithMotion {
    let pixel = shown_pixel(position);
    let d = textureLoad(depth, pixel, 0);
    if keeps_earlier_picture(d) {
        discard;
    }
    return OutputWithMotion(color_at(position, d), -motion_at(pixel) / vec2<f32>(view.size), d);
}

fn shown_pixel(position: vec4<f32>) -> vec2<u32> {
    return pixel_at(traced_place(position));
}

// The place in the traced picture, which may be smaller than the viewport.
fn traced_place(position: vec4<f32>) -> vec2<f32> {
    return max((position.xy - vec2<f32>(view.origin)) * (vec2<f32>(view.size) / vec2<f32>(view.target_size)), vec2<f32>(0.0));
}

// Whether the picture of an earlier camera stays: with VIEW_NO_BACKDROP, where there is no surface.
fn keeps_earlier_picture(d: f32) -> bool {
    return d == 0.0 && (view.flags & VIEW_NO_BACKDROP) != 0u;
}

// Radiance times exposure.  Where only the clear color is seen, its alpha is kept, for windows and images that show something behind.
fn color_at(position: vec4<f32>, d: f32) -> vec4<f32> {
    let at = traced_place(position);
    var color = color_of(pixel_at(at));
    if any(view.size != view.target_size) {
        color = color_between(at);
    }
    let shows_clear_color = d == 0.0 && (view.flags & VIEW_ENVIRONMENT_IS_BACKDROP) == 0u;
    return vec4<f32>(color, select(1.0, view.background_alpha, shows_clear_color));
}

fn color_of(pixel: vec2<u32>) -> vec3<f32> {
    let sum = radiance[pixel_index(pixel)];
    // The greatest half float is 65504; later passes may add to it.
    return min(sum.rgb / max(sum.a, 1.0) * view.exposure, vec3<f32>(6.0e4));
}

// Enlarges the traced picture: interpolates between the centers of the four pixels around.
fn color_between(at: vec2<f32>) -> vec3<f32> {
    let corner = max(at - 0.5, vec2<f32>(0.0));
    let share = fract(corner);
    var color = vec3<f32>(0.0);
    for (var i = 0u; i < 4u; i++) {
        let offset = vec2<u32>(i & 1u, i >> 1u);
        let sides = select(1.0 - share, share, offset == vec2<u32>(1u));
        color += sides.x * sides.y * color_of(pixel_at(corner + vec2<f32>(offset)));
    }
    return color;
}

// Offset to the position in the last frame, pixels.
fn motion_at(pixel: vec2<u32>) -> vec2<f32> {
    let ids = textureLoad(visibility_buffer, pixel, 0).xy;
    let ray = primary_ray(pixel);
    if ids.x == NONE {
        return motion_of_sky(ray.direction);
    }
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), ray);
    let now = surface_point(ids.x, ids.y, barycentrics, false);
    return motion_of_point(now, surface_point(ids.x, ids.y, barycentrics, true));
}
