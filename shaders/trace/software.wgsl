// Rays through two levels of 8-wide compressed trees (Ylitie, Karras and Laine 2017, "Efficient Incoherent Ray Traversal
// on GPUs Through Compressed Wide BVHs"; nodes by `trace/tree.wgsl`).  `trace::trace` alone imports it.
#define_import_path bevy_restir::trace::software

#import bevy_restir::common::constants::{NONE, OVERFLOW_STACK, OVERFLOW_STEPS}
#import bevy_restir::scene::bindings::{scene, nodes, instances}
#import bevy_restir::trace::alpha::accepts
#import bevy_restir::common::ray::{Ray, Hit, trace_flags}
#import bevy_restir::trace::space::object_ray
#import bevy_restir::trace::tree::{HIGH_BITS, nearest_child, tree_ray, TreeRay, visit_node}
#import bevy_restir::trace::triangle::intersect_triangle
#import bevy_restir::view::render_layers::instance_in_layers

// Equal to `blas::STACK_SIZE`: both trees' depth and the two groups kept on entering an instance.
const STACK_SIZE: u32 = 40u;
// Far more nodes than a sound scene makes a ray visit; beyond it there is a hole in the picture, not a hung device.  Mesa's
// llvmpipe ends a shader's loops in silence after 65,535 turns in all, so it must stay well below that.
const MAX_STEPS: u32 = 8192u;

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
                let nearest = nearest_child(children, tree.octant);
                children = nearest.others;
                if children.y >= HIGH_BITS {
                    if depth < STACK_SIZE {
                        stack[depth] = children;
                        depth += 1u;
                    } else {
                        trace_flags |= OVERFLOW_STACK;
                    }
                }
                let visit = visit_node(nearest.node, tree, ray.t_min, hit.t);
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
            children = select(vec2<u32>(blas, 0x80000000u), vec2<u32>(0u), blas == NONE || !instance_in_layers(instance));
            primitives = vec2<u32>(0u);
        } else {
            tree = tree_ray(ray.origin, ray.direction);
        }
    }
    return hit;
}
