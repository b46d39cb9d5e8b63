// Analytic area lights: spheres, rectangles and the disks of suns.  They are not part of the scene's geometry: a ray passes through all of
// those on its segment, and receives the radiance of each.  Primary rays of the camera ignore them.
#define_import_path bevy_restir::light::analytic_area_light

#import bevy_restir::common::constants::{FAR, LIGHT_RECT, LIGHT_SPHERE, LIGHT_SUN, NONE, OVERFLOW_STACK, OVERFLOW_STEPS}
#import bevy_restir::common::ray::trace_flags
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::light::rect::{rect_coordinates, rect_distance, rect_uv_at}
#import bevy_restir::light::sphere::{sphere_coordinates, sphere_distance}
#import bevy_restir::light::sun::{sun_coordinates, sun_is_hit, sun_uv_of_direction}
#import bevy_restir::scene::bindings::{lights, nodes, scene}
#import bevy_restir::scene::triangle::safe_normalize
#import bevy_restir::trace::tree::{intersect_node, MIN_NODE_HITS, nearest_child, ROOT_HIT, tree_ray}
#import bevy_restir::view::render_layers::light_kind

// Relative distance by which a light may lie behind a surface without being occluded, so that a light in the plane of a ceiling is visible.
const DISTANCE_TOLERANCE: f32 = 0x1p-16;
// Greatest number of lights that one ray can hit.
const LIGHT_HITS_MAX: u32 = 64u;

// A segment of a ray; `direction` is a unit vector, and `length` is FAR if the ray hits no surface.
struct RaySegment {
    origin: vec3<f32>,
    length: f32,
    direction: vec3<f32>,
}

#ifdef LIGHT_SHAPES
// At least the depth of the tree over lights, which is at most `blas::MAX_TLAS_DEPTH`, 14.
const STACK_SIZE: u32 = 16u;
// A bound on the loop, for the same reason as in `trace/software.wgsl`.
const MAX_STEPS: u32 = 2048u;

// Least id, from `first` on, of a light that the segment hits; NONE if there is no further one.  The tree names lights by their bins, counted
// from the first one.  The traversal is not shared with `trace/software.wgsl`: it has one level, and hits do not shorten the segment.  WGSL
// has no function pointers: sharing would add a branch at each leaf to the loop of all rays.
fn next_light_hit(segment: RaySegment, first: u32) -> u32 {
    // Suns have the first bins.
    if segment.length >= FAR {
        for (var light = max(first, scene.first_bin); light < scene.first_bin + scene.sun_count; light++) {
            if sun_is_hit(light, segment.direction) {
                return light;
            }
        }
    }
    var found = NONE;
    if scene.shapes_root == NONE {
        return found;
    }
    let tree = tree_ray(segment.origin, segment.direction);
    let max_distance = segment.length * (1.0 + DISTANCE_TOLERANCE);
    // Not a variable of the module, as in `trace/software.wgsl`: a stack this small lies in registers, which it would then hold for the whole
    // program (Mesa's compiler for RDNA 2: 32 more).
    var stack: array<vec2<u32>, STACK_SIZE>;
    var depth = 0u;
    var children = vec2<u32>(scene.shapes_root, ROOT_HIT);
    var primitives = vec2<u32>(0u);
    for (var steps = 0u; steps < MAX_STEPS; steps++) {
        // Visit the nearest child of the group, and push the others.
        let nearest = nearest_child(children, tree.octant);
        children = nearest.others;
        if children.y >= MIN_NODE_HITS {
            if depth < STACK_SIZE {
                stack[depth] = children;
                depth += 1u;
            } else {
                trace_flags |= OVERFLOW_STACK;
            }
        }
        let hits = intersect_node(nearest.node, tree, 0.0, max_distance);
        children = hits.children;
        primitives = hits.primitives;
        while primitives.y != 0u {
            let entry = primitives.x + firstLeadingBit(primitives.y);
            primitives.y &= ~(1u << firstLeadingBit(primitives.y));
            let light = scene.first_bin + nodes[scene.shapes_indices + (entry >> 2u)][entry & 3u];
            if light >= first && light < found && light_distance(light, segment) >= 0.0 {
                found = light;
            }
        }
        if children.y < MIN_NODE_HITS {
            if depth == 0u {
                return found;
            }
            depth -= 1u;
            children = stack[depth];
        }
    }
    trace_flags |= OVERFLOW_STEPS;
    return found;
}

// Distance at which a segment hits a spherical or rectangular light of this frame or the last; negative without a hit.
fn light_distance(record: u32, segment: RaySegment) -> f32 {
    var t = -1.0;
    if light_kind(record) == LIGHT_SPHERE {
        t = sphere_distance(record, segment.origin, segment.direction);
    } else if light_kind(record) == LIGHT_RECT {
        t = rect_distance(record, segment.origin, segment.direction);
    }
    return select(-1.0, t, t < segment.length * (1.0 + DISTANCE_TOLERANCE));
}

// The point where a segment hits a light.  `record`: the light's index in `lights`, of this frame or the last.  Without a hit, the point
// has the light NONE.
fn light_hit_point(light: u32, record: u32, segment: RaySegment) -> LightPoint {
    if light_kind(record) == LIGHT_SUN {
        let is_hit = segment.length >= FAR && sun_is_hit(record, segment.direction);
        return LightPoint(select(NONE, light, is_hit), sun_coordinates(sun_uv_of_direction(record, segment.direction)));
    }
    let t = light_distance(record, segment);
    let position = segment.origin + t * segment.direction;
    var coordinates = rect_coordinates(rect_uv_at(record, position));
    if light_kind(record) == LIGHT_SPHERE {
        coordinates = sphere_coordinates(safe_normalize(position - lights[record].position));
    }
    return LightPoint(select(NONE, light, t >= 0.0), coordinates);
}
#else
fn next_light_hit(segment: RaySegment, first: u32) -> u32 {
    return NONE;
}

fn light_hit_point(light: u32, record: u32, segment: RaySegment) -> LightPoint {
    return LightPoint(NONE, 0u);
}
#endif
