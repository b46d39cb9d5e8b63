// The surface that a pixel shows, of this frame or the last, from the visibility buffer.
#define_import_path bevy_restir::view::primary

#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::camera::{barycentrics_on_ray, previous_primary_ray, primary_ray}

struct PrimarySurface {
    surface: Surface,
    wo: vec3<f32>,
}

fn primary_surface(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> PrimarySurface {
    var ray = primary_ray(pixel);
    if previous {
        ray = previous_primary_ray(pixel);
    }
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, previous), ray);
    return PrimarySurface(surface_at(ids.x, ids.y, barycentrics, -ray.direction, previous), -ray.direction);
}
