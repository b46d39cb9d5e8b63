// The baseline of `lab rays`: closest hits in one compressed tree and nothing else, to measure the cost of bare traversal.  It has no
// instances, alpha tests, watertight edges, bounds on rounding, counters or limit of steps.
#import bevy_restir::scene::bindings::nodes
#import bevy_restir::scene::triangle::corners_of
#import bevy_restir::common::ray::Ray

@group(1) @binding(0) var<storage, read> rays: array<Ray>;
@group(1) @binding(1) var<storage, read_write> distances: array<f32>;

struct Children {
    inner: vec2<u32>,
    leaves: vec2<u32>,
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&rays) {
        return;
    }
    let ray = rays[id.x];
    let inverse = 1.0 / select(ray.direction, vec3<f32>(1e-20), abs(ray.direction) < vec3<f32>(1e-20));
    let up = select(vec3<u32>(0u), vec3<u32>(4u, 2u, 1u), ray.direction >= vec3<f32>(0.0));
    let octant = (up.x | up.y | up.z) * 0x01010101u;
    var stack: array<vec2<u32>, 32>;
    var depth = 0u;
    var inner = vec2<u32>(0u, 0x80000000u);
    var leaves = vec2<u32>(0u);
    var t = ray.t_max;
    loop {
        if inner.y >= 0x01000000u {
            let bit = firstLeadingBit(inner.y);
            let slot = (bit - 24u) ^ (octant & 7u);
            let node = inner.x + countOneBits(inner.y & ~(0xffffffffu << slot) & 0xffu);
            inner.y &= ~(1u << bit);
            if inner.y >= 0x01000000u {
                stack[depth] = inner;
                depth += 1u;
            }
            let found = children(node, ray, inverse, octant, t);
            inner = found.inner;
            leaves = found.leaves;
        } else {
            leaves = inner;
            inner = vec2<u32>(0u);
        }
        while leaves.y != 0u {
            let bit = firstLeadingBit(leaves.y);
            leaves.y &= ~(1u << bit);
            t = closer(ray, leaves.x + bit, t);
        }
        if inner.y < 0x01000000u {
            if depth == 0u {
                break;
            }
            depth -= 1u;
            inner = stack[depth];
        }
    }
    distances[id.x] = t;
}

// Möller and Trumbore 1997, "Fast, Minimum Storage Ray/Triangle Intersection".
fn closer(ray: Ray, index: u32, t_max: f32) -> f32 {
    let corners = corners_of(index);
    let a = corners.a;
    let e1 = corners.b - a;
    let e2 = corners.c - a;
    let p = cross(ray.direction, e2);
    let scale = 1.0 / dot(e1, p);
    let s = ray.origin - a;
    let u = dot(s, p) * scale;
    let q = cross(s, e1);
    let v = dot(ray.direction, q) * scale;
    let t = dot(e2, q) * scale;
    return select(t_max, t, u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > ray.t_min && t < t_max);
}

fn children(node: u32, ray: Ray, inverse: vec3<f32>, octant: u32, t_max: f32) -> Children {
    let n0 = nodes[node * 5u];
    let n1 = nodes[node * 5u + 1u];
    let n2 = nodes[node * 5u + 2u];
    let n3 = nodes[node * 5u + 3u];
    let n4 = nodes[node * 5u + 4u];
    let slope = bitcast<vec3<f32>>((vec3<u32>(n0.w, n0.w >> 8u, n0.w >> 16u) & vec3<u32>(255u)) << vec3<u32>(23u)) * inverse;
    let base = (bitcast<vec3<f32>>(n0.xyz) - ray.origin) * inverse;
    let backward = inverse < vec3<f32>(0.0);
    var bits = 0u;
    for (var half = 0u; half < 2u; half += 1u) {
        let x = planes(n2, half, slope.x, base.x, backward.x);
        let y = planes(n3, half, slope.y, base.y, backward.y);
        let z = planes(n4, half, slope.z, base.z, backward.z);
        let near = max(max(x[0], y[0]), max(z[0], vec4<f32>(ray.t_min)));
        let far = min(min(x[1], y[1]), min(z[1], vec4<f32>(t_max)));
        let code = select(n1.z, n1.w, half == 1u);
        let is_inner = ((code & (code << 1u) & 0x10101010u) >> 4u) * 255u;
        let marks = unpack4xU8((code >> 5u) & 0x07070707u) << unpack4xU8((code ^ (octant & is_inner)) & 0x1f1f1f1fu);
        let hits = select(vec4<u32>(0u), marks, near <= far);
        bits |= hits.x | hits.y | hits.z | hits.w;
    }
    return Children(vec2<u32>(n1.x, (bits & 0xff000000u) | (n0.w >> 24u)), vec2<u32>(n1.y, bits & 0x00ffffffu));
}

// Near and far planes of four boxes.
fn planes(bytes: vec4<u32>, half: u32, slope: f32, base: f32, backward: bool) -> mat2x4<f32> {
    let near = select(bytes.xy, bytes.zw, backward);
    let far = select(bytes.zw, bytes.xy, backward);
    let of_near = vec4<f32>(bitcast<vec4<i32>>(unpack4xU8(select(near.x, near.y, half == 1u))));
    let of_far = vec4<f32>(bitcast<vec4<i32>>(unpack4xU8(select(far.x, far.y, half == 1u))));
    return mat2x4<f32>(of_near * slope + base, of_far * slope + base);
}
