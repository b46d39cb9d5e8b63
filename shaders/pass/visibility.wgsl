// Rasterizes the visibility buffer, (instance, triangle) of each pixel, by vertex pulling with three vertices per triangle.  It draws the
// same triangles that rays hit, and needs neither primitive indices nor vertex layouts.

#import bevy_restir::scene::bindings::{instances, triangles}
#import bevy_restir::scene::triangle::{is_mirrored, transform_point, vertex_position}
#import bevy_restir::trace::alpha::passes_alpha_test
#import bevy_restir::view::alpha_seed::primary_alpha_seed
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::clip_of

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) ids: vec2<u32>,
    @location(1) barycentrics: vec2<f32>,
}

@vertex
fn vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let triangle = instances[instance].first_triangle + vertex / 3u;
    // Mirroring reverses the winding; the front face stays the image of the front face in object space.
    let mirrored = is_mirrored(instance);
    var corner = vertex % 3u;
    if mirrored && corner != 0u {
        corner = 3u - corner;
    }
    var at = triangles[triangle].a;
    var b = vec2<f32>(0.0, 0.0);
    if corner == 1u {
        at = triangles[triangle].b;
        b = vec2<f32>(1.0, 0.0);
    } else if corner == 2u {
        at = triangles[triangle].c;
        b = vec2<f32>(0.0, 1.0);
    }
    var clip = clip_of(view.current, transform_point(instances[instance].world_from_object, vertex_position(at)));
    // Primary rays go through center + jitter, so that the image moves in the opposite direction.
    clip.x -= 2.0 * view.jitter.x / f32(view.size.x) * clip.w;
    clip.y += 2.0 * view.jitter.y / f32(view.size.y) * clip.w;
    return Corner(clip, vec2<u32>(instance, triangle), b);
}

#ifdef ALPHA
@fragment
fn fragment(corner: Corner) -> @location(0) vec2<u32> {
    let pixel = vec2<u32>(corner.position.xy);
    if !passes_alpha_test(corner.ids.x, corner.ids.y, corner.barycentrics, primary_alpha_seed(pixel)) {
        discard;
    }
    return corner.ids;
}
#else
@fragment
fn fragment(corner: Corner) -> @location(0) vec2<u32> {
    return corner.ids;
}
#endif
