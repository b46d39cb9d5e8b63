// Origins of rays that do not hit the surface that they leave: points from barycentrics, and a bound on their rounding error (after
// Wächter and Binder 2019, "A Fast and Robust Method for Avoiding Self-Intersection", with the error derived from the coordinates instead
// of fixed constants).
#define_import_path bevy_restir::scene::offset

#import bevy_restir::scene::triangle::{Corners, corners_of, instance_transform, linear_inverse, stored_triangle}

// Half an ulp of 1, times a factor for errors that the bound neglects.
const ROUNDING: f32 = 0x1p-24 * 2.0;
// Bound on the rounding errors of an intersection test, relative to the distance of the ray's origin.
const END_ROUNDING: f32 = 0x1p-20;

// A point in world space.  `offset_distance` bounds the error of this order of operations.
fn surface_point(instance: u32, triangle: u32, barycentrics: vec2<f32>, previous: bool) -> vec3<f32> {
    let corners = corners_of(stored_triangle(instance, triangle, previous));
    return vec4<f32>(object_point(corners, barycentrics), 1.0) * instance_transform(instance, previous);
}

// Bound on the distance (m, along the geometric `normal`) of `surface_point` from the plane of its triangle, with the rounding errors of the
// intersection test of a ray that starts there.
fn offset_distance(instance: u32, triangle: u32, barycentrics: vec2<f32>, normal: vec3<f32>, previous: bool) -> f32 {
    let corners = corners_of(stored_triangle(instance, triangle, previous));
    let world = instance_transform(instance, previous);
    let object = linear_inverse(instance, previous);
    let linear = mat3x3<f32>(world[0].xyz, world[1].xyz, world[2].xyz);
    let linear_size = mat3x3<f32>(abs(linear[0]), abs(linear[1]), abs(linear[2]));
    let object_size = mat3x3<f32>(abs(object[0]), abs(object[1]), abs(object[2]));

    // In object space: rounding of the point, and of the intersection, which is relative to the triangle's extent.
    let p = object_point(corners, barycentrics);
    let extent = max(max(abs(corners.b - corners.a), abs(corners.c - corners.b)), abs(corners.a - corners.c));
    let offset_from_center = p * linear;
    let back = abs(offset_from_center) * object_size;
    let in_object = 1.5 * abs(p) + 12.0 * extent + 5.0 * back;
    // In world space: rounding of the transform, and of the ray's origin.
    let position = abs(offset_from_center + vec3<f32>(world[0].w, world[1].w, world[2].w));
    let in_world = (in_object + 3.0 * abs(p)) * linear_size + 2.0 * position;
    return ROUNDING * dot(abs(normal), in_world);
}

// Moves a point off its surface, to the side that `direction` points to.
fn offset_point(position: vec3<f32>, n_geo: vec3<f32>, direction: vec3<f32>, distance: f32) -> vec3<f32> {
    return position + n_geo * select(-distance, distance, dot(direction, n_geo) >= 0.0);
}

// Moves the end of a ray of this length off its surface.  The intersection test rounds relative to the distance of the ray's origin, which
// may be far greater than the surface.
fn offset_end(position: vec3<f32>, n_geo: vec3<f32>, direction: vec3<f32>, distance: f32, ray_length: f32) -> vec3<f32> {
    return offset_point(position, n_geo, direction, distance + END_ROUNDING * ray_length);
}

// Interpolated by the edges, not by weights of three corners: far from the mesh's origin, edges are more precise.
fn object_point(corners: Corners, barycentrics: vec2<f32>) -> vec3<f32> {
    return corners.a + (barycentrics.x * (corners.b - corners.a) + barycentrics.y * (corners.c - corners.a));
}
