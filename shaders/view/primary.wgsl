// The surface that a pixel shows, in this frame or the last, from its (instance, triangle) in the visibility buffer.
#define_import_path bevy_restir::view::primary

#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::surface::{Shape, shape_at, Surface, surface_at}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::{barycentrics_on_ray, eye_of, pixel_cone, previous_primary_ray, primary_ray}

struct PrimarySurface {
    surface: Surface,
    wo: vec3<f32>,
    cone: Cone,                // footprint of the pixel
}

fn primary_surface(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> PrimarySurface {
    var ray = primary_ray(pixel);
    var camera = view.current;
    if previous {
        ray = previous_primary_ray(pixel);
        camera = view.previous;
    }
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, previous), ray);
    let cone = pixel_cone(camera, ray, distance(ray.origin, surface_point(ids.x, ids.y, barycentrics, previous)));
    return PrimarySurface(surface_at(ids.x, ids.y, barycentrics, -ray.direction, cone, previous), -ray.direction, cone);
}

// The surface that a pixel shows, or showed in the last frame.
fn pixel_shape(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Shape {
    var ray = primary_ray(pixel);
    if previous {
        ray = previous_primary_ray(pixel);
    }
    let t = world_triangle(ids.x, ids.y, previous);
    return shape_at(ids.x, ids.y, barycentrics_on_ray(t, ray), eye_of(t.corner, previous), previous);
}

// The surface that a pixel shows, where it was in the last frame.
fn previous_pixel_shape(ids: vec2<u32>, pixel: vec2<u32>) -> Shape {
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), primary_ray(pixel));
    return shape_at(ids.x, ids.y, barycentrics, eye_of(world_triangle(ids.x, ids.y, true).corner, true), true);
}
