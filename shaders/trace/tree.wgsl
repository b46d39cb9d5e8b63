// Nodes of an 8-wide compressed tree (CWBVH; Ylitie, Karras and Laine 2017; node layout of obvhs 0.4) over triangles, instances or lights.
#define_import_path bevy_restir::trace::tree

#import bevy_restir::scene::bindings::nodes
#import bevy_restir::trace::triangle::{sheared_ray, ShearedRay}

// A group is a vec2.  x: index of the first child node or primitive.  y: for nodes, hit bits << 24 | mask of inner children; for
// primitives, up to 24 hit bits.  So y is at least MIN_NODE_HITS exactly if the group holds a node that the ray hits.
const MIN_NODE_HITS: u32 = 0x01000000u;
// y of the group in which a traversal starts: it holds the root alone.
const ROOT_HIT: u32 = 0x80000000u;

// A ray in the space of a tree.
struct TreeRay {
    line: ShearedRay,
    inverse: vec3<f32>,        // reciprocal of the direction
    octant: u32,               // signs of the direction, 3 bits in each byte
}

// The nearest child of a group of nodes, and the rest of the group.
struct NearestChild {
    node: u32,
    others: vec2<u32>,
}

// Groups of the children and primitives of a node whose boxes a ray hits.
struct NodeHits {
    children: vec2<u32>,
    primitives: vec2<u32>,
}

fn tree_ray(origin: vec3<f32>, direction: vec3<f32>) -> TreeRay {
    // The reciprocal of a tiny component is clamped, so that it stays finite.
    let size = abs(direction);
    let tiny = max(size.x, max(size.y, size.z)) * 0x1p-60;
    let safe = select(direction, select(vec3<f32>(tiny), vec3<f32>(-tiny), direction < vec3<f32>(0.0)), size < vec3<f32>(tiny));
    let up = select(vec3<u32>(0u), vec3<u32>(4u, 2u, 1u), safe >= vec3<f32>(0.0));
    return TreeRay(sheared_ray(origin, direction), 1.0 / safe, (up.x | up.y | up.z) * 0x01010101u);
}

// `intersect_node` orders the hit bits by the ray's octant, with the nearest child highest; the exclusive or undoes this order.  Child
// nodes are stored in the order of their slots, without gaps.
fn nearest_child(children: vec2<u32>, octant: u32) -> NearestChild {
    let bit = firstLeadingBit(children.y);
    let slot = (bit - 24u) ^ (octant & 7u);
    let node = children.x + countOneBits(children.y & ~(0xffffffffu << slot) & 0xffu);
    return NearestChild(node, vec2<u32>(children.x, children.y & ~(1u << bit)));
}

// Tests the boxes of the eight children of a node.
fn intersect_node(node: u32, ray: TreeRay, t_min: f32, t_max: f32) -> NodeHits {
    let first = node * 5u;
    let n0 = nodes[first];
    let n1 = nodes[first + 1u];
    let n2 = nodes[first + 2u];
    let n3 = nodes[first + 3u];
    let n4 = nodes[first + 4u];

    // Planes are p + scale·q.  Rounding of the planes, of the ray and in the builder is far below 2^-21 of the largest term.  The boxes
    // grow by that, so that no triangle is culled that `intersect_triangle` would accept.
    let scale = bitcast<vec3<f32>>((vec3<u32>(n0.w, n0.w >> 8u, n0.w >> 16u) & vec3<u32>(255u)) << vec3<u32>(23u));
    let to_node = bitcast<vec3<f32>>(n0.xyz) - ray.line.origin;
    let slope = scale * ray.inverse;
    let base = to_node * ray.inverse;
    let error = (abs(to_node) + 256.0 * scale) * abs(ray.inverse) * 0x1p-21;
    let base_near = base - error;
    let base_far = base + error;

    let backward = ray.inverse < vec3<f32>(0.0);
    let near_x = select(n2.xy, n2.zw, backward.x);
    let far_x = select(n2.zw, n2.xy, backward.x);
    let near_y = select(n3.xy, n3.zw, backward.y);
    let far_y = select(n3.zw, n3.xy, backward.y);
    let near_z = select(n4.xy, n4.zw, backward.z);
    let far_z = select(n4.zw, n4.xy, backward.z);

    var bits = 0u;
    for (var half = 0u; half < 2u; half += 1u) {
        let near = max(
            max(plane_t(word(near_x, half), slope.x, base_near.x), plane_t(word(near_y, half), slope.y, base_near.y)),
            max(plane_t(word(near_z, half), slope.z, base_near.z), vec4<f32>(t_min)),
        );
        let far = min(
            min(plane_t(word(far_x, half), slope.x, base_far.x), plane_t(word(far_y, half), slope.y, base_far.y)),
            min(plane_t(word(far_z, half), slope.z, base_far.z), vec4<f32>(t_max)),
        );
        // A byte of the node's field `meta` has the bits to set (high 3) and their position (low 5); inner children are reordered by the
        // ray's octant.
        let code = word(n1.zw, half);
        let inner = ((code & (code << 1u) & 0x10101010u) >> 4u) * 255u;
        let shift = unpack4xU8((code ^ (ray.octant & inner)) & 0x1f1f1f1fu);
        let marks = unpack4xU8((code >> 5u) & 0x07070707u) << shift;
        let hits = select(vec4<u32>(0u), marks, near <= far);
        bits |= hits.x | hits.y | hits.z | hits.w;
    }
    return NodeHits(vec2<u32>(n1.x, (bits & 0xff000000u) | (n0.w >> 24u)), vec2<u32>(n1.y, bits & 0x00ffffffu));
}

fn word(words: vec2<u32>, half: u32) -> u32 {
    return select(words.x, words.y, half == 1u);
}

// Ray distances of four planes.  Bytes are below 256, so that the cheaper conversion from signed integers is correct.
fn plane_t(bytes: u32, slope: f32, base: f32) -> vec4<f32> {
    return vec4<f32>(bitcast<vec4<i32>>(unpack4xU8(bytes))) * slope + base;
}
