// Rays through two levels of 8-wide compressed trees (Ylitie, Karras and Laine 2017, "Efficient Incoherent Ray Traversal
// on GPUs Through Compressed Wide BVHs"; node layout of obvhs 0.4).  `trace::trace` alone imports it.
#define_import_path bevy_restir::trace::software

#import bevy_restir::common::constants::{NONE, OVERFLOW_STACK, OVERFLOW_STEPS}
#import bevy_restir::scene::bindings::{scene, nodes, instances}
#import bevy_restir::trace::alpha::accepts
#import bevy_restir::trace::ray::{Ray, Hit, trace_flags}
#import bevy_restir::trace::space::object_ray
#import bevy_restir::trace::triangle::{ShearedRay, sheared_ray, intersect_triangle}
#import bevy_restir::view::mask::is_met

// Equal to `blas::STACK_SIZE`: both trees' depth and the two groups kept on entering an instance.
const STACK_SIZE: u32 = 40u;
// Far more nodes than a sound scene makes a ray visit; beyond it there is a hole in the picture, not a hung device.  Mesa's
// llvmpipe ends a shader's loops in silence after 65,535 turns in all, so it must stay well below that.
const MAX_STEPS: u32 = 8192u;

// A group of children or primitives still to visit: x = index of the first, y = hit bits << 24 | inner mask for children,
// up to 24 hit bits for primitives.  Children are told apart by their high bits.
const HIGH_BITS: u32 = 0x01000000u;

// The ray in the space of the tree that it is in.
struct TreeRay {
    line: ShearedRay,
    inverse: vec3<f32>,
    octant: u32,
}

struct Visit {
    children: vec2<u32>,
    primitives: vec2<u32>,
}

// The closest hit, or any, now or in the last frame.  One body for all, so that any-hit and closest-hit rays agree bit by bit and it is
// compiled once a call.
fn traverse(ray: Ray, alpha_seed: u32, any_hit: bool, previous: bool) -> Hit {
    var hit = Hit(ray.t_max, NONE, NONE, vec2<f32>(0.0));
    let root = select(scene.tlas_root, scene.previous_tlas_root, previous);
    let indices = select(scene.tlas_indices, scene.previous_tlas_indices, previous);
    if root == NONE {
        return hit;
    }
    var stack: array<vec2<u32>, STACK_SIZE>;
    var depth = 0u;
    var instance = NONE;       // NONE while in the top level
    var instance_depth = 0u;   // depth of the stack on entering it
    var tree = tree_ray(ray.origin, ray.direction);
    var children = vec2<u32>(root, 0x80000000u);
    var primitives = vec2<u32>(0u);

    // A turn of the outer loop stays within one tree, so that what is done on its border is done by all lanes together.
    var steps = 0u;
    loop {
        loop {
            steps += 1u;
            if steps > MAX_STEPS {
                break;
            }
            // Visit the nearest child of the group, and keep the others for later.
            if children.y >= HIGH_BITS {
                let bit = firstLeadingBit(children.y);
                let slot = (bit - 24u) ^ (tree.octant & 7u);
                let node = children.x + countOneBits(children.y & ~(0xffffffffu << slot) & 0xffu);
                children.y &= ~(1u << bit);
                if children.y >= HIGH_BITS {
                    if depth < STACK_SIZE {
                        stack[depth] = children;
                        depth += 1u;
                    } else {
                        trace_flags |= OVERFLOW_STACK;
                    }
                }
                let visit = visit_node(node, tree, ray.t_min, hit.t);
                children = visit.children;
                primitives = visit.primitives;
            }
            if instance == NONE && primitives.y != 0u {
                break;
            }
            while primitives.y != 0u {
                let bit = firstLeadingBit(primitives.y);
                primitives.y &= ~(1u << bit);
                let triangle = primitives.x + bit;
                let found = intersect_triangle(tree.line, triangle);
                if found.inside && found.t > ray.t_min && found.t < hit.t
                    && accepts(instance, triangle, found.barycentrics, alpha_seed) {
                    hit = Hit(found.t, instance, triangle, found.barycentrics);
                    if any_hit {
                        return hit;
                    }
                }
            }
            if children.y < HIGH_BITS {
                if depth == instance_depth {
                    break;
                }
                depth -= 1u;
                let group = stack[depth];
                let inner = group.y >= HIGH_BITS;
                children = select(vec2<u32>(0u), group, inner);
                primitives = select(group, vec2<u32>(0u), inner);
            }
        }

        if steps > MAX_STEPS {
            trace_flags |= OVERFLOW_STEPS;
            return hit;
        }
        if primitives.y == 0u {
            // This tree is done: back to what is left of the top level.
            if depth == 0u {
                return hit;
            }
            instance = NONE;
            instance_depth = 0u;
            depth -= 1u;
            let group = stack[depth];
            let inner = group.y >= HIGH_BITS;
            children = select(vec2<u32>(0u), group, inner);
            primitives = select(group, vec2<u32>(0u), inner);
        }
        if primitives.y != 0u {
            // Enter an instance; what is left of the top level waits on the stack.
            let bit = firstLeadingBit(primitives.y);
            primitives.y &= ~(1u << bit);
            if depth + 2u <= STACK_SIZE {
                if children.y >= HIGH_BITS {
                    stack[depth] = children;
                    depth += 1u;
                }
                if primitives.y != 0u {
                    stack[depth] = primitives;
                    depth += 1u;
                }
            } else {
                trace_flags |= OVERFLOW_STACK;
            }
            let place = primitives.x + bit;
            instance = nodes[indices + (place >> 2u)][place & 3u];
            instance_depth = depth;
            let inside = object_ray(ray, instance, previous);
            tree = tree_ray(inside.origin, inside.direction);
            // An instance that is gone leaves its place in the last frame's top level.
            let blas = instances[instance].blas_root;
            children = select(vec2<u32>(blas, 0x80000000u), vec2<u32>(0u), blas == NONE || !is_met(instance));
            primitives = vec2<u32>(0u);
        } else {
            tree = tree_ray(ray.origin, ray.direction);
        }
    }
    return hit;
}

fn tree_ray(origin: vec3<f32>, direction: vec3<f32>) -> TreeRay {
    // A component too small to matter gets a reciprocal that is large but finite.
    let size = abs(direction);
    let tiny = max(size.x, max(size.y, size.z)) * 0x1p-60;
    let safe = select(direction, select(vec3<f32>(tiny), vec3<f32>(-tiny), direction < vec3<f32>(0.0)), size < vec3<f32>(tiny));
    let up = select(vec3<u32>(0u), vec3<u32>(4u, 2u, 1u), safe >= vec3<f32>(0.0));
    return TreeRay(sheared_ray(origin, direction), 1.0 / safe, (up.x | up.y | up.z) * 0x01010101u);
}

// Tests the eight children of a node.
fn visit_node(node: u32, ray: TreeRay, t_min: f32, t_max: f32) -> Visit {
    let first = node * 5u;
    let n0 = nodes[first];
    let n1 = nodes[first + 1u];
    let n2 = nodes[first + 2u];
    let n3 = nodes[first + 3u];
    let n4 = nodes[first + 4u];

    // Planes are p + scale q.  What rounding may do to them, to the ray and in the builder is far below 2^-21 of their
    // largest term; the boxes grow by that, so that no triangle that the intersection would accept is culled.
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
            max(planes(pick(near_x, half), slope.x, base_near.x), planes(pick(near_y, half), slope.y, base_near.y)),
            max(planes(pick(near_z, half), slope.z, base_near.z), vec4<f32>(t_min)),
        );
        let far = min(
            min(planes(pick(far_x, half), slope.x, base_far.x), planes(pick(far_y, half), slope.y, base_far.y)),
            min(planes(pick(far_z, half), slope.z, base_far.z), vec4<f32>(t_max)),
        );
        // A byte of `meta`: high 3 bits what to set, low 5 where; inner children are reordered by the ray's octant.
        let code = pick(n1.zw, half);
        let inner = ((code & (code << 1u) & 0x10101010u) >> 4u) * 255u;
        let shift = unpack4xU8((code ^ (ray.octant & inner)) & 0x1f1f1f1fu);
        let marks = unpack4xU8((code >> 5u) & 0x07070707u) << shift;
        let hits = select(vec4<u32>(0u), marks, near <= far);
        bits |= hits.x | hits.y | hits.z | hits.w;
    }
    return Visit(vec2<u32>(n1.x, (bits & 0xff000000u) | (n0.w >> 24u)), vec2<u32>(n1.y, bits & 0x00ffffffu));
}

fn pick(words: vec2<u32>, half: u32) -> u32 {
    return select(words.x, words.y, half == 1u);
}

// Bytes are below 256, so the cheaper conversion from signed integers serves.
fn planes(bytes: u32, slope: f32, base: f32) -> vec4<f32> {
    return vec4<f32>(bitcast<vec4<i32>>(unpack4xU8(bytes))) * slope + base;
}
