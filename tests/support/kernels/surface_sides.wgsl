// Turns the surface that each pixel sees to its other side (`surface_towards`), and back.  Tests run it instead of
// `shaders/pass/reference.wgsl`.  Writes (difference from the surfaces that are seen from these sides, share of light that scatters below
// the side that the pixel sees, the same below the other side).
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::max_component
#import bevy_restir::path::light_path::surface_towards
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{barycentrics_on_ray, primary_ray}

@group(2) @binding(0) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn reference(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    var shown = vec3<f32>(0.0);
    if ids.x != NONE {
        let ray = primary_ray(pixel);
        let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), ray);
        let seen = surface_at(ids.x, ids.y, barycentrics, -ray.direction, Cone(0.0, 0.0), false);
        let other = surface_at(ids.x, ids.y, barycentrics, ray.direction, Cone(0.0, 0.0), false);
        let away = difference(surface_towards(seen, ray.direction), other);
        let back = difference(surface_towards(other, -ray.direction), seen);
        shown = vec3<f32>(max(away, back), max_component(seen.bsdf.subsurface), max_component(other.bsdf.subsurface));
    }
    radiance[pixel.y * view.size.x + pixel.x] = vec4<f32>(shown, 1.0);
}

// The greatest difference between fields that depend on the side.
fn difference(a: Surface, b: Surface) -> f32 {
    let below = abs(a.bsdf.subsurface - b.bsdf.subsurface);
    let normals = max(abs(a.bsdf.n - b.bsdf.n), max(abs(a.bsdf.n_geo - b.bsdf.n_geo), abs(a.bsdf.coat_normal - b.bsdf.coat_normal)));
    let sides = abs(f32(a.front) - f32(b.front));
    return max(max(max_component(max(below, normals)), sides), abs(a.bsdf.eta - b.bsdf.eta));
}
