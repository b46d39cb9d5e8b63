// Ray tracing in software: traversal of two levels of 8-wide compressed trees (Ylitie, Karras and Laine 2017, "Efficient Incoherent Ray
// Traversal on GPUs Through Compressed Wide BVHs"; nodes in `trace/tree.wgsl`).  Only `trace::trace` imports this module.
#define_import_path bevy_restir::trace::software

#import bevy_restir::common::constants::{NONE, OVERFLOW_STACK, OVERFLOW_STEPS, WORLD_TREE}
#import bevy_restir::common::ray::{Hit, Ray, trace_flags}
#import bevy_restir::scene::bindings::{instances, nodes, scene}
#import bevy_restir::scene::triangle::{corners_of, stored_triangle}
#import bevy_restir::trace::alpha::accepts_hit
#ifdef SUBSURFACE
#import bevy_restir::trace::probe_hits::{failed_probe, has_too_many, no_probe_hits, ProbeHits, with_probe_hit}
#endif
#import bevy_restir::trace::space::object_ray
#import bevy_restir::trace::tree::{intersect_node, MIN_NODE_HITS, nearest_child, ROOT_HIT, tree_ray, TreeRay}
#import bevy_restir::trace::triangle::{intersect_corners, intersect_triangle}
#import bevy_restir::view::render_layers::instance_in_layers

// Equal to `blas::STACK_SIZE`: two groups for each level of a bottom-level tree, one for each of the top level, and the two that wait while a
// ray is in an instance.  NVIDIA's compiler keeps a stack of 40 entries in registers and selects among all of them at every access, so that
// half as many subgroups are resident.  A larger one lies in memory.
const STACK_SIZE: u32 = 80u;
// Limit on traversal steps, far above those of real scenes: a ray beyond it ends with an error instead of hanging the device.  Mesa's
// llvmpipe silently ends the loops of a shader after 65,535 iterations in total, so the limit must stay well below that.
const MAX_STEPS: u32 = 8192u;

// The stack holds the waiting groups of nodes and primitives, of both levels.  It is a variable of the module: a variable of a function
// would be filled with zeros for every ray, and an argument would be copied in HLSL, where naga writes a pointer as `inout`.
var<private> stack: array<vec2<u32>, STACK_SIZE>;
var<private> depth: u32;

// The groups that a ray visits next.
struct Groups {
    children: vec2<u32>,       // nodes
    primitives: vec2<u32>,     // triangles, or instances in the top level
}

fn push(group: vec2<u32>) {
    if depth == STACK_SIZE {
        trace_flags |= OVERFLOW_STACK;
        return;
    }
    stack[depth] = group;
    depth += 1u;
}

fn root_group(root: u32, exists: bool) -> Groups {
    return Groups(select(vec2<u32>(0u), vec2<u32>(root, ROOT_HIT), exists), vec2<u32>(0u));
}

// Visits the nearest child of the group of nodes, if there is one; the others wait.  So do the triangles of another node.
fn visit_nearest(groups: Groups, tree: TreeRay, t_min: f32, t_max: f32) -> Groups {
    if groups.children.y < MIN_NODE_HITS {
        return groups;
    }
    let nearest = nearest_child(groups.children, tree.octant);
    if nearest.others.y >= MIN_NODE_HITS {
        push(nearest.others);
    }
    let hits = intersect_node(nearest.node, tree, t_min, t_max);
    if hits.primitives.y == 0u {
        return Groups(hits.children, groups.primitives);
    }
    if groups.primitives.y != 0u {
        push(groups.primitives);
    }
    return Groups(hits.children, hits.primitives);
}

// Pops a group where no nodes are left to visit.  Triangles stay on the stack as long as the ray has other triangles to test.
fn with_waiting(groups: Groups) -> Groups {
    let group = stack[depth - 1u];
    let is_inner = group.y >= MIN_NODE_HITS;
    if !is_inner && groups.primitives.y != 0u {
        return groups;
    }
    depth -= 1u;
    return Groups(select(groups.children, group, is_inner), select(group, groups.primitives, is_inner));
}

// In place of an instance while a ray is in a tree over triangles in world space (`world_tree.rs`).
const IN_WORLD_TREE: u32 = 0xfffffffeu;

// A triangle of a leaf: its corners in the space of the tree, and whose it is.
struct LeafTriangle {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
    instance: u32,
    triangle: u32,
}

fn leaf_triangle(instance: u32, index: u32, previous: bool) -> LeafTriangle {
    if instance == IN_WORLD_TREE {
        let a = nodes[3u * index];
        let b = nodes[3u * index + 1u];
        let c = nodes[3u * index + 2u];
        return LeafTriangle(bitcast<vec3<f32>>(a.xyz), bitcast<vec3<f32>>(b.xyz), bitcast<vec3<f32>>(c.xyz), a.w, b.w);
    }
    let corners = corners_of(stored_triangle(instance, index, previous));
    return LeafTriangle(corners.a, corners.b, corners.c, instance, index);
}

// Whether rays of the camera can hit an instance.  A removed instance may remain in the trees of the last frame.
fn is_traced(instance: u32) -> bool {
    return instances[instance].blas_root != NONE && instance_in_layers(instance);
}

// Whether a ray that intersects a triangle hits it.  An instance with a tree of its own was tested when the ray entered that.
fn is_hit(t: LeafTriangle, is_in_world: bool, barycentrics: vec2<f32>, alpha_seed: u32) -> bool {
    return (!is_in_world || is_traced(t.instance)) && accepts_hit(t.instance, t.triangle, barycentrics, alpha_seed);
}

// The closer of `last` and the hit on the first triangle of a group, if it is accepted.
fn closer_hit(group: vec2<u32>, last: Hit, instance: u32, tree: TreeRay, t_min: f32, alpha_seed: u32, previous: bool) -> Hit {
    let leaf = leaf_triangle(instance, group.x + firstLeadingBit(group.y), previous);
    let found = intersect_corners(tree.line, leaf.a, leaf.b, leaf.c);
    if found.inside && found.t > t_min && found.t < last.t && is_hit(leaf, instance == IN_WORLD_TREE, found.barycentrics, alpha_seed) {
        return Hit(found.t, leaf.instance, leaf.triangle, found.barycentrics);
    }
    return last;
}

// The entry of a bit of a group of the top level: an instance, or WORLD_TREE and a root.
fn entry_of(group: vec2<u32>, bit: u32, previous: bool) -> u32 {
    let indices = select(scene.tlas_indices, scene.previous_tlas_indices, previous);
    let entry = group.x + bit;
    return nodes[indices + (entry >> 2u)][entry & 3u];
}

// The closest hit, or any hit, now or (`previous`) in the last frame.  One function serves all, so that any-hit and closest-hit rays agree
// bit by bit.
fn traverse(ray: Ray, alpha_seed: u32, any_hit: bool, previous: bool) -> Hit {
    var hit = Hit(ray.t_max, NONE, NONE, vec2<f32>(0.0));
    let root = select(scene.tlas_root, scene.previous_tlas_root, previous);
    if root == NONE {
        return hit;
    }
    depth = 0u;
    var instance = NONE;       // NONE in the top level
    var instance_depth = 0u;   // depth of the stack when the ray entered it
    var tree = tree_ray(ray.origin, ray.direction);
    var groups = root_group(root, true);

    // The inner loop stays within one tree, so that the lanes of a subgroup change trees together.  In each step a lane visits a node and
    // tests one triangle: lanes that have many triangles do not keep the others from their nodes (speculative traversal; Aila and Laine
    // 2009).
    var steps = 0u;
    loop {
        loop {
            steps += 1u;
            if steps > MAX_STEPS {
                trace_flags |= OVERFLOW_STEPS;
                return hit;
            }
            groups = visit_nearest(groups, tree, ray.t_min, hit.t);
            if groups.primitives.y != 0u {
                if instance == NONE {
                    break;
                }
                hit = closer_hit(groups.primitives, hit, instance, tree, ray.t_min, alpha_seed, previous);
                if any_hit && hit.instance != NONE {
                    return hit;
                }
                groups.primitives.y &= ~(1u << firstLeadingBit(groups.primitives.y));
            }
            if groups.children.y < MIN_NODE_HITS {
                if depth > instance_depth {
                    groups = with_waiting(groups);
                } else if groups.primitives.y == 0u {
                    break;
                }
            }
        }

        if groups.primitives.y == 0u {
            // This tree is done: return to the top level.
            if depth == 0u {
                return hit;
            }
            instance = NONE;
            instance_depth = 0u;
            tree = tree_ray(ray.origin, ray.direction);
            continue;
        }
        // Enter an entry; the rest of the top level waits.
        let bit = firstLeadingBit(groups.primitives.y);
        let entry = entry_of(groups.primitives, bit, previous);
        groups.primitives.y &= ~(1u << bit);
        if groups.children.y >= MIN_NODE_HITS {
            push(groups.children);
        }
        if groups.primitives.y != 0u {
            push(groups.primitives);
        }
        instance_depth = depth;
        if (entry & WORLD_TREE) != 0u {
            instance = IN_WORLD_TREE;
            groups = root_group(entry & ~WORLD_TREE, true);
            continue;
        }
        instance = entry;
        let inside = object_ray(ray, instance, previous);
        tree = tree_ray(inside.origin, inside.direction);
        groups = root_group(instances[instance].blas_root, is_traced(instance));
    }
    // Never reached, but naga wants it.
    return hit;
}

#ifdef SUBSURFACE
// All hits on one instance, now or (`previous`) in the last frame, by its bottom-level tree alone.  Every hit is wanted,
// so hits do not shorten the ray: this function shares the tests of nodes with `traverse`, but not its loop.
fn traverse_instance(ray: Ray, instance: u32, alpha_seed: u32, previous: bool) -> ProbeHits {
    var hits = no_probe_hits();
    let root = instances[instance].blas_root;
    if root == NONE || !instance_in_layers(instance) {
        return hits;
    }
    let inside = object_ray(ray, instance, previous);
    let tree = tree_ray(inside.origin, inside.direction);
    depth = 0u;
    var children = vec2<u32>(root, ROOT_HIT);
    for (var steps = 0u; steps < MAX_STEPS; steps += 1u) {
        let nearest = nearest_child(children, tree.octant);
        if nearest.others.y >= MIN_NODE_HITS {
            if depth == STACK_SIZE {
                trace_flags |= OVERFLOW_STACK;
                return failed_probe();
            }
            stack[depth] = nearest.others;
            depth += 1u;
        }
        let found = intersect_node(nearest.node, tree, ray.t_min, ray.t_max);
        children = found.children;
        for (var bits = found.primitives.y; bits != 0u; bits &= bits - 1u) {
            let triangle = found.primitives.x + firstTrailingBit(bits);
            let hit = intersect_triangle(tree.line, stored_triangle(instance, triangle, previous));
            if hit.inside && hit.t > ray.t_min && hit.t < ray.t_max && accepts_hit(instance, triangle, hit.barycentrics, alpha_seed) {
                hits = with_probe_hit(hits, hit.t, triangle);
                if has_too_many(hits) {
                    return failed_probe();
                }
            }
        }
        if children.y < MIN_NODE_HITS {
            if depth == 0u {
                return hits;
            }
            depth -= 1u;
            children = stack[depth];
        }
    }
    trace_flags |= OVERFLOW_STEPS;
    return failed_probe();
}
#endif
