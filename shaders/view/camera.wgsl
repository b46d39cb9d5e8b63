// Primary rays, projection and motion vectors of a camera, perspective or orthographic.
#define_import_path bevy_restir::view::camera

#import bevy_restir::common::constants::{FAR, VIEW_ORTHOGRAPHIC}
#import bevy_restir::common::guard::{GUARD_SURFACE, guard_holds, is_nan}
#import bevy_restir::common::ray::Ray
#import bevy_restir::scene::cone::{Cone, cone_along}
#import bevy_restir::scene::triangle::WorldTriangle
#import bevy_restir::view::bindings::view
#import bevy_restir::view::pixel::is_in_picture
#import bevy_restir::view::types::Camera

// The functions below are called in many places of a program, and select by `is_orthographic` without a branch: Mesa's driver for the CPU
// (22.3) takes a uniform that decides many branches as a constant, and then compiles the program again in every frame.
fn is_orthographic() -> bool {
    return (view.flags & VIEW_ORTHOGRAPHIC) != 0u;
}

// The point of the near plane, in view space, at a point of the image (pixels, y down).
fn near_point(camera: Camera, at: vec2<f32>) -> vec3<f32> {
    let uv = at / vec2<f32>(view.size);
    let near = camera.view_from_clip * vec4<f32>(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y, 1.0, 1.0);
    return near.xyz / near.w;
}

// The ray through a point of the image.
fn camera_ray(camera: Camera, at: vec2<f32>) -> Ray {
    let p = near_point(camera, at);
    let point = (camera.world_from_view * vec4<f32>(p, 1.0)).xyz;
    let offset = (camera.world_from_view * vec4<f32>(p, 0.0)).xyz;
    let origin = select(camera.world_from_view[3].xyz, point, is_orthographic());
    let direction = select(offset, -camera.world_from_view[2].xyz, is_orthographic());
    return Ray(origin, 0.0, normalize(direction), FAR);
}

// Footprint of a pixel at a distance along its ray.
fn pixel_cone(camera: Camera, ray: Ray, distance: f32) -> Cone {
    let pixel = sqrt(camera.image_area / (f32(view.size.x) * f32(view.size.y)));
    // Pixels have equal sizes in the image plane, not equal angles.
    let cosine = abs(dot(ray.direction, camera.image_normal));
    let perspective = cone_along(Cone(0.0, pixel * cosine), distance);
    let width = select(perspective.width, pixel, is_orthographic());
    return Cone(width, select(perspective.spread, 0.0, is_orthographic()));
}

// The camera, now or (`previous`) in the last frame.
fn camera_of(previous: bool) -> Camera {
    if previous {
        return view.previous;
    }
    return view.current;
}

// Position of the camera, now or (`previous`) in the last frame.
fn camera_position(previous: bool) -> vec3<f32> {
    return select(view.current.world_from_view[3].xyz, view.previous.world_from_view[3].xyz, previous);
}

// 1/(2 tan(fov/2)) for Bevy's default field of view, 45 degrees.
const DISTANCE_FOR_HEIGHT: f32 = 1.2071068;

// The position from which the camera sees a point.  An orthographic camera has only a direction; its position is set as far away as that of
// a perspective camera whose image has the same height at the point, for lengths that are relative to the distance.
fn eye_of(point: vec3<f32>, previous: bool) -> vec3<f32> {
    let back = select(view.current.world_from_view[2].xyz, view.previous.world_from_view[2].xyz, previous);
    let half_height = select(view.current.view_from_clip[1].y, view.previous.view_from_clip[1].y, previous);
    let orthographic = point + normalize(back) * (2.0 * abs(half_height) * DISTANCE_FOR_HEIGHT);
    return select(camera_position(previous), orthographic, is_orthographic());
}

// The ray whose hit the visibility buffer stores.
fn primary_ray(pixel: vec2<u32>) -> Ray {
    return camera_ray(view.current, vec2<f32>(pixel) + 0.5 + view.jitter);
}

// The ray whose hit the last frame's visibility buffer stores.
fn previous_primary_ray(pixel: vec2<u32>) -> Ray {
    return camera_ray(view.previous, vec2<f32>(pixel) + 0.5 + view.previous_jitter);
}

// A point as the camera sees it.
struct CameraPoint {
    at: vec2<f32>,             // pixels, y down, without jitter
    inside: bool,              // within the image, and between the near plane and the far one
    ray: Ray,                  // of the camera, through the point
    near: vec3<f32>,           // where the ray passes the near plane
}

fn camera_point(camera: Camera, p: vec3<f32>) -> CameraPoint {
    let clip = clip_of(camera, p);
    let at = pixels_of(clip);
    let inside = clip.w > 0.0 && clip.z >= 0.0 && clip.z <= clip.w && is_in_picture(at);
    return CameraPoint(at, inside, camera_ray(camera, at), near_position(camera, at));
}

// Where the ray through a point of the image passes the near plane.
fn near_position(camera: Camera, at: vec2<f32>) -> vec3<f32> {
    return (camera.world_from_view * vec4<f32>(near_point(camera, at), 1.0)).xyz;
}

// Whether a point lies beyond the far plane.
fn is_beyond_far_plane(camera: Camera, p: vec3<f32>) -> bool {
    return clip_of(camera, p).z < 0.0;
}

// Density of a camera ray that is uniform in its pixel, at a distance: samples per unit of area perpendicular to the ray, 1/m².
// `direction`: of the ray, to either end.
fn camera_density(camera: Camera, direction: vec3<f32>, distance: f32) -> f32 {
    let pixel = camera.image_area / (f32(view.size.x) * f32(view.size.y));
    let cosine = abs(dot(direction, camera.image_normal));
    let perspective = pixel * cosine * cosine * cosine * distance * distance;
    return 1.0 / select(perspective, pixel * cosine, is_orthographic());
}

// A point in clip space.  The position of the camera is subtracted first: far from the origin, products of both with a matrix would be
// rounded to more than a pixel.
fn clip_of(camera: Camera, p: vec3<f32>) -> vec4<f32> {
    return camera.clip_from_offset * vec4<f32>(p - camera.world_from_view[3].xyz, 1.0);
}

// Projects a point to pixels, y down, without jitter.  Points behind the camera are far outside of the image.
fn project(camera: Camera, p: vec3<f32>) -> vec2<f32> {
    return pixels_of(clip_of(camera, p));
}

// The pixel coordinates of a point in clip space.
fn pixels_of(clip: vec4<f32>) -> vec2<f32> {
    if !(clip.w > 0.0) {
        return vec2<f32>(-1.0e9);
    }
    let ndc = clip.xy / clip.w;
    return vec2<f32>(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y) * vec2<f32>(view.size);
}

// Barycentrics (weights of the second and third corner) where a ray hits a triangle that the rasterizer found; clamped to the triangle,
// because rounding at edges may differ.
fn barycentrics_on_ray(t: WorldTriangle, ray: Ray) -> vec2<f32> {
    let p = cross(ray.direction, t.edge_c);
    let det = dot(t.edge_b, p);
    let s = ray.origin - t.corner;
    let b = vec2<f32>(dot(s, p), dot(ray.direction, cross(s, t.edge_b))) / det;
    // The triangle is seen edge-on: use its center.
    if !(abs(det) > 0.0) || !(abs(b.x) < 1.0e6) || !(abs(b.y) < 1.0e6) {
        _ = guard_holds(det == 0.0 || !(is_nan(b.x) || is_nan(b.y)), GUARD_SURFACE);
        return vec2<f32>(1.0 / 3.0);
    }
    let inside = max(b, vec2<f32>(0.0));
    return inside / max(1.0, inside.x + inside.y);
}

// Offset in the image from a surface point to its projection in the last frame, `before`; pixels, y down, without jitter.
fn motion_of_point(position: vec3<f32>, before: vec3<f32>) -> vec2<f32> {
    return project(view.previous, before) - project(view.current, position);
}

// The same for the sky, which moves only if the camera rotates; 0 for an orthographic camera.
fn motion_of_sky(direction: vec3<f32>) -> vec2<f32> {
    let now = pixels_of(view.current.clip_from_offset * vec4<f32>(direction, 0.0));
    let before = pixels_of(view.previous.clip_from_offset * vec4<f32>(direction, 0.0));
    return before - now;
}
