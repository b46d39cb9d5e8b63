// Debug views of the primary surfaces, without exposure: false colors of ids from the rasterizer or a traced ray, depth, motion, normals
// and base color.  All other views are black: the technique or the scene has nothing to show in them.

#import bevy_restir::common::constants::NONE
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::surface::surface_at
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::trace::trace::trace_closest
#import bevy_restir::view::alpha_seed::primary_alpha_seed
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{barycentrics_on_ray, motion_of_point, motion_of_sky, pixel_cone, primary_ray}
#import bevy_restir::view::false_color::false_color
#import bevy_restir::view::pixel::pixel_index
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(0) var<storage, read_write> radiance: array<vec4<f32>>;

// A test holds them equal to the order of `DebugView` in src/settings/debug_view.rs.
const DEBUG_INSTANCES: u32 = 1u;
const DEBUG_TRIANGLES: u32 = 2u;
const DEBUG_TRACED_INSTANCES: u32 = 3u;
const DEBUG_TRACED_TRIANGLES: u32 = 4u;
const DEBUG_DEPTH: u32 = 5u;
const DEBUG_MOTION: u32 = 6u;
const DEBUG_NORMALS: u32 = 7u;
const DEBUG_ALBEDO: u32 = 8u;

@compute @workgroup_size(8, 8)
fn debug(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let ray = primary_ray(pixel);
    var ids = textureLoad(visibility, pixel, 0).xy;
    if view.debug_view == DEBUG_TRACED_INSTANCES || view.debug_view == DEBUG_TRACED_TRIANGLES {
        let hit = trace_closest(ray, primary_alpha_seed(pixel));
        ids = vec2<u32>(hit.instance, hit.triangle);
    }

    var color = vec3<f32>(0.0);
    if ids.x != NONE {
        let t = world_triangle(ids.x, ids.y, false);
        let barycentrics = barycentrics_on_ray(t, ray);
        let cone = pixel_cone(view.current, ray, distance(ray.origin, surface_point(ids.x, ids.y, barycentrics, false)));
        let s = surface_at(ids.x, ids.y, barycentrics, -ray.direction, cone, false);
        switch view.debug_view {
            case DEBUG_INSTANCES, DEBUG_TRACED_INSTANCES: {
                color = false_color(vec2<u32>(ids.x, NONE));
            }
            case DEBUG_TRIANGLES, DEBUG_TRACED_TRIANGLES: {
                color = false_color(ids);
            }
            case DEBUG_DEPTH: {
                color = vec3<f32>(distance(ray.origin, s.position));
            }
            case DEBUG_MOTION: {
                let motion = motion_of_point(s.position, surface_point(ids.x, ids.y, barycentrics, true));
                color = vec3<f32>(motion, 0.0);
            }
            case DEBUG_NORMALS: {
                color = 0.5 + 0.5 * s.bsdf.n;
            }
            case DEBUG_ALBEDO: {
                color = s.bsdf.base_color;
            }
            default: {
            }
        }
    } else if view.debug_view == DEBUG_MOTION {
        color = vec3<f32>(motion_of_sky(ray.direction), 0.0);
    }
    radiance[pixel_index(pixel)] = vec4<f32>(color, 1.0);
    count_rays(pixel);
}
