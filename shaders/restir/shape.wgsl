// The shapes that pixels show, which decide who reuses whose samples.
#define_import_path bevy_restir::restir::shape

#import bevy_restir::scene::surface::{Shape, shape_at}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::camera::{barycentrics_on_ray, camera_position, previous_primary_ray, primary_ray}

// The shape that a pixel shows, or showed in the last frame.
fn shape_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Shape {
    var ray = primary_ray(pixel);
    if previous {
        ray = previous_primary_ray(pixel);
    }
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, previous), ray);
    return shape_at(ids.x, ids.y, barycentrics, camera_position(previous), previous);
}

// The shape that a pixel shows, where it was in the last frame.
fn previous_shape_of(ids: vec2<u32>, pixel: vec2<u32>) -> Shape {
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), primary_ray(pixel));
    return shape_at(ids.x, ids.y, barycentrics, camera_position(true), true);
}

// Whether two surfaces are alike enough to share light (Wyman and Panteleev 2021, Eq. 24).
fn are_alike(a: Shape, b: Shape, reach: f32, normal_threshold: f32, depth_threshold: f32) -> bool {
    return dot(a.n, b.n) >= normal_threshold && abs(dot(b.position - a.position, a.n_geo)) <= depth_threshold * reach;
}
