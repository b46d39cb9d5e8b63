// Writes radiance times exposure to Bevy's view target, and the depth and motion of the visibility buffer to Bevy's prepass textures, so
// that gizmos, transparent objects of other materials and post-processing work as usual.  The traced picture may have fewer pixels than the
// viewport: then it is enlarged, and the surfaces of the shown pixels are known.

#import bevy_restir::common::constants::{HALF_BOUND, LEAST_MAGNITUDE, NONE, VIEW_ENVIRONMENT_IS_BACKDROP, VIEW_JITTERED_MEAN, VIEW_NO_BACKDROP}
#import bevy_restir::common::math::exponential_decay
#import bevy_restir::common::ray::Ray
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::{barycentrics_on_ray, camera_ray, motion_of_point, motion_of_sky, pixel_cone, primary_ray}
#import bevy_restir::view::pixel::{pixel_at, pixel_index}

@group(2) @binding(0) var<storage, read> radiance: array<vec4<f32>>;
// Surfaces of the shown pixels.
@group(2) @binding(1) var depth: texture_depth_2d;
@group(2) @binding(2) var visibility_buffer: texture_2d<u32>;
// Surfaces of the traced pixels.
@group(2) @binding(3) var traced_visibility: texture_2d<u32>;

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
    return Output(color_at(pixel, d), d);
}

@fragment
fn fragment_with_motion(@builtin(position) position: vec4<f32>) -> OutputWithMotion {
    let pixel = shown_pixel(position);
    let d = textureLoad(depth, pixel, 0);
    if keeps_earlier_picture(d) {
        discard;
    }
    let motion = clamp(-motion_at(pixel) / vec2<f32>(view.size), vec2<f32>(-MAX_MOTION), vec2<f32>(MAX_MOTION));
    return OutputWithMotion(color_at(pixel, d), motion, d);
}

// Greatest motion that is written, in pictures.  A surface that was behind the camera has none that its texture of half floats could hold,
// and infinity would become NaN in temporal anti-aliasing.
const MAX_MOTION: f32 = 100.0;

// The pixel of the viewport.
fn shown_pixel(position: vec4<f32>) -> vec2<u32> {
    return vec2<u32>(position.xy) - view.origin;
}

// The center of a shown pixel in the traced picture.
fn traced_place(pixel: vec2<u32>) -> vec2<f32> {
    return (vec2<f32>(pixel) + 0.5) * (vec2<f32>(view.size) / vec2<f32>(view.target_size));
}

// The ray through a shown pixel.
fn shown_ray(pixel: vec2<u32>) -> Ray {
    return camera_ray(view.current, traced_place(pixel) + view.jitter);
}

// Whether the picture of an earlier camera stays: with VIEW_NO_BACKDROP, where there is no surface.
fn keeps_earlier_picture(d: f32) -> bool {
    return d == 0.0 && (view.flags & VIEW_NO_BACKDROP) != 0u;
}

// Radiance times exposure.  Where only the clear color is seen, its alpha is kept, for windows and images that show something behind.
fn color_at(pixel: vec2<u32>, d: f32) -> vec4<f32> {
    var color: vec3<f32>;
    if all(view.size == view.target_size) {
        color = color_of(pixel);
    } else {
        color = color_between(pixel);
    }
    let shows_clear_color = d == 0.0 && (view.flags & VIEW_ENVIRONMENT_IS_BACKDROP) == 0u;
    return vec4<f32>(color, select(1.0, view.background_alpha, shows_clear_color));
}

// Of a traced pixel.
fn color_of(pixel: vec2<u32>) -> vec3<f32> {
    let sum = radiance[pixel_index(pixel)];
    // The bound is below the greatest half float, because later passes may add to it.
    return min(sum.rgb / max(sum.a, 1.0) * view.exposure, vec3<f32>(HALF_BOUND));
}

// The surface that a pixel shows.
struct Seen {
    instance: u32,             // NONE: no surface
    position: vec3<f32>,
    normal: vec3<f32>,         // of the triangle
    width: f32,                // of a traced pixel there, m
}

fn seen_by(ids: vec2<u32>, ray: Ray) -> Seen {
    if ids.x == NONE {
        return Seen(NONE, vec3<f32>(0.0), vec3<f32>(0.0), 0.0);
    }
    let t = world_triangle(ids.x, ids.y, false);
    let b = barycentrics_on_ray(t, ray);
    let position = t.corner + b.x * t.edge_b + b.y * t.edge_c;
    return Seen(ids.x, position, t.normal, pixel_cone(view.current, ray, distance(position, ray.origin)).width);
}

// Interpolates between the four traced pixels around, as far as they show the same surface.
fn color_between(pixel: vec2<u32>) -> vec3<f32> {
    let own = seen_by(textureLoad(visibility_buffer, pixel, 0).xy, shown_ray(pixel));
    let place = traced_place(pixel);
    // A mean of jittered frames is not weighted by surfaces: these are of this frame alone, so that edges would move from frame to frame.
    let is_jittered_mean = (view.flags & VIEW_JITTERED_MEAN) != 0u;
    let corner = max(place - 0.5, vec2<f32>(0.0));
    let share = fract(corner);
    var color = vec3<f32>(0.0);
    var weights = 0.0;
    for (var i = 0u; i < 4u; i++) {
        let offset = vec2<u32>(i & 1u, i >> 1u);
        let sides = select(1.0 - share, share, offset == vec2<u32>(1u));
        let traced = pixel_at(corner + vec2<f32>(offset));
        let other = seen_by(textureLoad(traced_visibility, traced, 0).xy, primary_ray(traced));
        // The floor keeps a weight for a traced pixel at the far end, in case it is the only one that shows the surface.
        let weight = select(max(sides.x * sides.y, 1.0e-3) * similarity(own, other), sides.x * sides.y, is_jittered_mean);
        color += weight * color_of(traced);
        weights += weight;
    }
    return color / weights;
}

// Least similarity: a surface that no traced pixel shows gets the light of the others.
const LEAST_SIMILARITY: f32 = 1.0e-4;
// Similarity of parts of other objects in the same plane, such as a lamp in a ceiling.
const OTHER_OBJECT: f32 = 0.01;

fn similarity(own: Seen, other: Seen) -> f32 {
    if own.instance == NONE || other.instance == NONE {
        return select(LEAST_SIMILARITY, 1.0, own.instance == other.instance);
    }
    let from_plane = abs(dot(own.normal, other.position - own.position));
    let cosine = max(dot(own.normal, other.normal), 0.0);
    let of_shape = exponential_decay(from_plane / max(own.width, LEAST_MAGNITUDE)) * cosine * cosine;
    return max(select(OTHER_OBJECT, 1.0, own.instance == other.instance) * of_shape, LEAST_SIMILARITY);
}

// Offset to the position in the last frame, traced pixels.
fn motion_at(pixel: vec2<u32>) -> vec2<f32> {
    let ids = textureLoad(visibility_buffer, pixel, 0).xy;
    let ray = shown_ray(pixel);
    if ids.x == NONE {
        return motion_of_sky(ray.direction);
    }
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), ray);
    let now = surface_point(ids.x, ids.y, barycentrics, false);
    return motion_of_point(now, surface_point(ids.x, ids.y, barycentrics, true));
}
