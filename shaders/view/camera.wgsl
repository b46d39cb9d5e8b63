// Primary rays and projections of a camera, perspective or orthographic, and where a pixel's surface was in the last frame.
#define_import_path bevy_restir::view::camera

#import bevy_restir::common::constants::{FAR, VIEW_ORTHOGRAPHIC}
#import bevy_restir::scene::cone::{Cone, cone_along}
#import bevy_restir::scene::triangle::WorldTriangle
#import bevy_restir::common::ray::Ray
#import bevy_restir::view::bindings::view
#import bevy_restir::view::types::Camera

// The ray through a point of the image; pixels, y down.
fn camera_ray(camera: Camera, at: vec2<f32>) -> Ray {
    let uv = at / vec2<f32>(view.size);
    let near = camera.view_from_clip * vec4<f32>(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y, 1.0, 1.0);
    let p = near.xyz / near.w;
    if (view.flags & VIEW_ORTHOGRAPHIC) != 0u {
        let origin = (camera.world_from_view * vec4<f32>(p, 1.0)).xyz;
        return Ray(origin, 0.0, -normalize(camera.world_from_view[2].xyz), FAR);
    }
    let direction = (camera.world_from_view * vec4<f32>(p, 0.0)).xyz;
    return Ray(camera.world_from_view[3].xyz, 0.0, normalize(direction), FAR);
}

// What a pixel covers round its ray, `distance` along it.
fn pixel_cone(camera: Camera, ray: Ray, distance: f32) -> Cone {
    let half = abs(vec2<f32>(camera.view_from_clip[0].x, camera.view_from_clip[1].y));
    let pixel = 2.0 * sqrt(half.x * half.y / (f32(view.size.x) * f32(view.size.y)));
    if (view.flags & VIEW_ORTHOGRAPHIC) != 0u {
        return Cone(pixel, 0.0);
    }
    // Pixels are alike in the plane of the image, not in angle.
    let cosine = abs(dot(ray.direction, normalize(camera.world_from_view[2].xyz)));
    return cone_along(Cone(0.0, pixel * cosine), distance);
}

// Where the camera is, or was in the last frame, whatever its projection.
fn camera_position(previous: bool) -> vec3<f32> {
    return select(view.current.world_from_view[3].xyz, view.previous.world_from_view[3].xyz, previous);
}

// The ray that the visibility buffer stands for.
fn primary_ray(pixel: vec2<u32>) -> Ray {
    return camera_ray(view.current, vec2<f32>(pixel) + 0.5 + view.jitter);
}

// The ray that the last frame's visibility buffer stands for.
fn previous_primary_ray(pixel: vec2<u32>) -> Ray {
    return camera_ray(view.previous, vec2<f32>(pixel) + 0.5 + view.previous_jitter);
}

// Pixels, y down, without jitter; behind the camera: far outside of the image.
fn project(camera: Camera, p: vec3<f32>) -> vec2<f32> {
    let clip = camera.clip_from_world * vec4<f32>(p, 1.0);
    if !(clip.w > 0.0) {
        return vec2<f32>(-1.0e9);
    }
    let ndc = clip.xy / clip.w;
    return vec2<f32>(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y) * vec2<f32>(view.size);
}

// Barycentrics (of v1, v2) where a ray meets a triangle that the rasterizer says it meets: clamped into it, since the two may
// differ by rounding at an edge.
fn barycentrics_on_ray(t: WorldTriangle, ray: Ray) -> vec2<f32> {
    let p = cross(ray.direction, t.edge_c);
    let det = dot(t.edge_b, p);
    let s = ray.origin - t.corner;
    let b = vec2<f32>(dot(s, p), dot(ray.direction, cross(s, t.edge_b))) / det;
    // Edge on: no point is better than another.
    if !(abs(det) > 0.0) || !(abs(b.x) < 1.0e6) || !(abs(b.y) < 1.0e6) {
        return vec2<f32>(1.0 / 3.0);
    }
    let inside = max(b, vec2<f32>(0.0));
    return inside / max(1.0, inside.x + inside.y);
}

// Motion of a surface point over the image since the last frame, pixels, y down: add it to go back in time.  Free of jitter.
fn motion_of_point(position: vec3<f32>, before: vec3<f32>) -> vec2<f32> {
    return project(view.previous, before) - project(view.current, position);
}

// The same of the sky in a direction: it turns with the camera only.
fn motion_of_sky(direction: vec3<f32>) -> vec2<f32> {
    let now = project(view.current, view.current.world_from_view[3].xyz + direction);
    let before = project(view.previous, view.previous.world_from_view[3].xyz + direction);
    return before - now;
}
