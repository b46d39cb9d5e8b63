// Lights that are no triangles and have an extent: balls, rectangles, discs of suns.  A ray meets them on its segment, as many as there are,
// and none of them stops it: each adds its radiance.  The camera's own rays meet none.
#define_import_path bevy_restir::light::analytic_area_light

#import bevy_restir::common::constants::{FAR, LIGHT_RECT, LIGHT_SPHERE, LIGHT_SUN, NONE, OVERFLOW_STACK, OVERFLOW_STEPS}
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::light::rect::{rect_coordinates, rect_distance, rect_uv_at}
#import bevy_restir::light::sphere::{sphere_coordinates, sphere_distance}
#import bevy_restir::light::sun::{sun_coordinates, sun_is_met, sun_uv_of}
#import bevy_restir::scene::bindings::{lights, nodes, scene}
#import bevy_restir::scene::triangle::safe_normalize
#import bevy_restir::common::ray::trace_flags
#import bevy_restir::trace::tree::{HIGH_BITS, nearest_child, tree_ray, visit_node}
#import bevy_restir::view::render_layers::light_kind

// Of its distance, by which a light may lie behind a surface and still be before it: one in the very plane of a ceiling shines.
const SLACK: f32 = 0x1p-16;
// More lights one behind the other than a ray is asked for.
const LIGHT_HITS_MAX: u32 = 64u;

// A way from a point in a unit direction, as far as `reach`: FAR where nothing stops it.
struct RaySegment {
    origin: vec3<f32>,
    reach: f32,
    direction: vec3<f32>,
}

#ifdef LIGHT_SHAPES
// Levels of the tree, at most `blas::MAX_TLAS_DEPTH`.
const STACK_SIZE: u32 = 16u;
const MAX_STEPS: u32 = 2048u;

// The least id, from `first` on, of a light that is met; NONE where there is none.  A walk of its own, not `trace/software.wgsl`'s: it
// knows one level, and no hit shortens the segment.  WGSL cannot be told what to do at a leaf but by a branch in the loop that all rays take.
fn next_light_hit(segment: RaySegment, first: u32) -> u32 {
    // Suns come first in the table.
    if segment.reach >= FAR {
        for (var light = first; light < scene.sun_count; light++) {
            if sun_is_met(light, segment.direction) {
                return light;
            }
        }
    }
    var found = NONE;
    if scene.shapes_root == NONE {
        return found;
    }
    let tree = tree_ray(segment.origin, segment.direction);
    let reach = min(segment.reach, FAR * 0.5) * (1.0 + SLACK);
    var stack: array<vec2<u32>, STACK_SIZE>;
    var depth = 0u;
    var children = vec2<u32>(scene.shapes_root, 0x80000000u);
    var primitives = vec2<u32>(0u);
    for (var steps = 0u; steps < MAX_STEPS; steps++) {
        // The nearest child of the group; the others wait.
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
        let visit = visit_node(nearest.node, tree, 0.0, reach);
        children = visit.children;
        primitives = visit.primitives;
        while primitives.y != 0u {
            let place = primitives.x + firstLeadingBit(primitives.y);
            primitives.y &= ~(1u << firstLeadingBit(primitives.y));
            let light = nodes[scene.shapes_indices + (place >> 2u)][place & 3u];
            if light >= first && light < found && shape_distance(light, segment) >= 0.0 {
                found = light;
            }
        }
        if children.y < HIGH_BITS {
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

// How far along a way a ball or rectangle, of this frame or the last, is met; negative where it is not.
fn shape_distance(record: u32, segment: RaySegment) -> f32 {
    var t = -1.0;
    if light_kind(record) == LIGHT_SPHERE {
        t = sphere_distance(record, segment.origin, segment.direction);
    } else if light_kind(record) == LIGHT_RECT {
        t = rect_distance(record, segment.origin, segment.direction);
    }
    return select(-1.0, t, t < segment.reach * (1.0 + SLACK));
}

// The point of a light, of this frame or the last, that is met on a way; of no light where it is not.
fn light_hit_point(light: u32, record: u32, segment: RaySegment) -> LightPoint {
    if light_kind(record) == LIGHT_SUN {
        let is_hit = segment.reach >= FAR && sun_is_met(record, segment.direction);
        return LightPoint(select(NONE, light, is_hit), sun_coordinates(sun_uv_of(record, segment.direction)));
    }
    let t = shape_distance(record, segment);
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
