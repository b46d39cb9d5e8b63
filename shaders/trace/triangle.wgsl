// Ray-triangle intersection, watertight after Woop, Benthin and Wald 2013 ("Watertight Ray/Triangle Intersection"), double-sided.  Each
// edge is evaluated from its lower to its higher end, so that two triangles that share it get exactly opposite values, whichever
// multiplications the driver fuses.
#define_import_path bevy_restir::trace::triangle

#import bevy_restir::scene::triangle::{corners_of, triangle_normal}

// A ray in object space, and the shear that maps its direction to its longest axis.
struct ShearedRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
    axis: u32,
    shear: vec2<f32>,
}

// t is meaningless unless `inside`.
struct TriangleHit {
    inside: bool,
    t: f32,
    barycentrics: vec2<f32>,
}

fn sheared_ray(origin: vec3<f32>, direction: vec3<f32>) -> ShearedRay {
    let size = abs(direction);
    let axis = select(select(2u, 1u, size.y > size.z), 0u, size.x > max(size.y, size.z));
    let d = long_axis_last(direction, axis);
    return ShearedRay(origin, direction, axis, d.xy / d.z);
}

// Intersects the whole line with a stored triangle; the caller compares t with its interval.
fn intersect_triangle(ray: ShearedRay, index: u32) -> TriangleHit {
    let corners = corners_of(index);
    return intersect_corners(ray, corners.a, corners.b, corners.c);
}

fn intersect_corners(ray: ShearedRay, v0: vec3<f32>, v1: vec3<f32>, v2: vec3<f32>) -> TriangleHit {
    let a = long_axis_last(v0 - ray.origin, ray.axis);
    let b = long_axis_last(v1 - ray.origin, ray.axis);
    let c = long_axis_last(v2 - ray.origin, ray.axis);
    let x = vec3<f32>(a.x, b.x, c.x) - ray.shear.x * vec3<f32>(a.z, b.z, c.z);
    let y = vec3<f32>(a.y, b.y, c.y) - ray.shear.y * vec3<f32>(a.z, b.z, c.z);

    // For the edge opposite to each corner: twice the area that it spans with the ray.
    let flip = (x.yzx > x.zxy) | ((x.yzx == x.zxy) & (y.yzx > y.zxy));
    let low_x = select(x.yzx, x.zxy, flip);
    let low_y = select(y.yzx, y.zxy, flip);
    let high_x = select(x.zxy, x.yzx, flip);
    let high_y = select(y.zxy, y.yzx, flip);
    let area = low_x * high_y - low_y * high_x;
    let edges = select(area, -area, flip);

    var hit = TriangleHit(false, 0.0, vec2<f32>(0.0));
    let determinant = edges.x + edges.y + edges.z;
    if (all(edges >= vec3<f32>(0.0)) || all(edges <= vec3<f32>(0.0))) && determinant != 0.0 {
        let n = triangle_normal(v0, v1, v2);
        let slope = dot(n, ray.direction);
        hit.t = dot(n, v0 - ray.origin) / slope;
        hit.barycentrics = edges.yz / determinant;
        hit.inside = slope != 0.0;
    }
    return hit;
}

// Distance along a line to the plane of a triangle; -1 if the line is parallel to it.
fn plane_distance(origin: vec3<f32>, direction: vec3<f32>, index: u32) -> f32 {
    let corners = corners_of(index);
    let n = triangle_normal(corners.a, corners.b, corners.c);
    let slope = dot(n, direction);
    return select(-1.0, dot(n, corners.a - origin) / slope, slope != 0.0);
}

// Cyclic permutation, which keeps the handedness.
fn long_axis_last(v: vec3<f32>, axis: u32) -> vec3<f32> {
    return select(select(v, v.zxy, axis == 1u), v.yzx, axis == 0u);
}
