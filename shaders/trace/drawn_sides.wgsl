// Sides of surfaces that the camera draws.  It does not draw those that a material culls, and rays between the camera and a light path pass
// them; all other rays hit both sides.
#define_import_path bevy_restir::trace::drawn_sides

#import bevy_restir::common::constants::{MATERIAL_CULL_BACK, MATERIAL_CULL_FRONT, VIEW_SEES_BACK_FACES}
#import bevy_restir::common::guard::{GUARD_RAY, guard_holds}
#import bevy_restir::scene::bindings::{instances, materials}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::bindings::view

// Whether the camera draws the side of a triangle that faces a direction, now or (`previous`) in the last frame.
fn is_drawn(instance: u32, triangle: u32, direction: vec3<f32>, previous: bool) -> bool {
    let flags = materials[instances[instance].material].flags;
    let faces = dot(direction, world_triangle(instance, triangle, previous).normal) > 0.0;
    let front = faces != ((view.flags & VIEW_SEES_BACK_FACES) != 0u);
    return (flags & select(MATERIAL_CULL_BACK, MATERIAL_CULL_FRONT, front)) == 0u;
}

// DRAWN_SIDES: in passes with rays that hit only such sides.  Traversals do not know the direction of a ray in world space, so that it is
// kept here.
#ifdef DRAWN_SIDES
// Against the current ray, which hits drawn sides only; 0: it hits all sides.
var<private> viewer_direction: vec3<f32>;
var<private> viewer_is_previous: bool;

fn begin_drawn_ray(direction: vec3<f32>, previous: bool) {
    viewer_direction = -direction;
    viewer_is_previous = previous;
}

fn end_drawn_ray() {
    viewer_direction = vec3<f32>(0.0);
}

fn hits_drawn_sides() -> bool {
    return any(viewer_direction != vec3<f32>(0.0));
}

// Whether the current ray can hit a triangle.
fn hits_side(instance: u32, triangle: u32) -> bool {
    return !hits_drawn_sides() || is_drawn(instance, triangle, viewer_direction, viewer_is_previous);
}
#else
// Without DRAWN_SIDES no pass may trace such a ray: it would hit both sides.
fn begin_drawn_ray(direction: vec3<f32>, previous: bool) {
    _ = guard_holds(false, GUARD_RAY);
}

fn end_drawn_ray() {
}

fn hits_drawn_sides() -> bool {
    return false;
}

fn hits_side(instance: u32, triangle: u32) -> bool {
    return true;
}
#endif
