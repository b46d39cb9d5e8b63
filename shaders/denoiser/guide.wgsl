// The guide: what the denoiser knows of the surface of each pixel.  Pixels with similar surfaces share their light.
#define_import_path bevy_restir::denoiser::guide

#import bevy_restir::common::math::{exponential_decay, octahedral_decode, octahedral_encode}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::{clip_of, eye_of, is_orthographic}
#import bevy_restir::view::types::Camera

struct Guide {
    depth: f32,                // `guide_depth` of the surface; 0: the pixel shows none
    slope: vec2<f32>,          // change of the depth from a pixel to the next, right and down, on the plane of the surface; in `depth_unit`s
    n: vec3<f32>,              // shading normal
    roughness: f32,            // GGX α of the smoothest specular lobe
    shows_image: bool,         // its specular light is that of an optical image
}

fn no_guide() -> Guide {
    return Guide(0.0, vec2<f32>(0.0), vec3<f32>(0.0, 0.0, 1.0), 1.0, false);
}

fn guide_pack(g: Guide) -> vec4<u32> {
    // A roughness below 0 says that the surface shows an optical image.
    let roughness = select(g.roughness, -g.roughness, g.shows_image);
    return vec4<u32>(bitcast<u32>(g.depth), pack2x16float(g.slope), octahedral_encode(g.n), bitcast<u32>(roughness));
}

fn guide_unpack(p: vec4<u32>) -> Guide {
    let roughness = bitcast<f32>(p.w);
    return Guide(bitcast<f32>(p.x), unpack2x16float(p.y), octahedral_decode(p.z), abs(roughness), roughness < 0.0);
}

// A depth that is linear in the image over each plane, so that the depth of a plane at other pixels is known: 1/z for a perspective camera,
// and for an orthographic one 1 plus the distance from the far plane, relative to that of `eye_of`.
fn guide_depth(camera: Camera, p: vec3<f32>, previous: bool) -> f32 {
    let clip = clip_of(camera, p);
    return select(1.0 / clip.w, 1.0 + clip.z * depth_range(camera, p, previous), is_orthographic());
}

// The change of a depth where the distance from the camera changes by itself.
fn depth_unit(depth: f32) -> f32 {
    return select(depth, 1.0, is_orthographic());
}

// Distance of the near plane and the far one of an orthographic camera, relative to that of `eye_of`.
fn depth_range(camera: Camera, p: vec3<f32>, previous: bool) -> f32 {
    return length(camera.world_from_view[2].xyz) * abs(camera.view_from_clip[2].z) / distance(p, eye_of(p, previous));
}

// Greatest slope: a surface whose depth changes by half from a pixel to the next has no place for a filter.
const MAX_SLOPE: f32 = 0.5;

// The slope of the plane through a point.
fn plane_slope(p: vec3<f32>, n: vec3<f32>) -> vec2<f32> {
    let camera = view.current;
    // The normal in view space: planes are transformed by the transposed inverse.
    let in_view = (vec4<f32>(n, 0.0) * camera.world_from_view).xyz;
    // Change of a direction whose z is -1, or of a position in the image of an orthographic camera.
    let pixel = vec2<f32>(camera.view_from_clip[0].x, -camera.view_from_clip[1].y) * 2.0 / vec2<f32>(view.size);
    let d = p - camera.world_from_view[3].xyz;
    let distance_in_view = -dot(d, camera.world_from_view[2].xyz) / dot(camera.world_from_view[2].xyz, camera.world_from_view[2].xyz);
    let perspective = in_view.xy * pixel * (distance_in_view / dot(n, d));
    let orthographic = -in_view.xy / in_view.z * pixel * (depth_range(camera, p, false) / abs(camera.view_from_clip[2].z));
    let slope = select(perspective, orthographic, is_orthographic());
    return clamp(select(vec2<f32>(MAX_SLOPE), slope, abs(slope) < vec2<f32>(MAX_SLOPE)), vec2<f32>(-MAX_SLOPE), vec2<f32>(MAX_SLOPE));
}

// Distance from a plane, relative to that of the camera, at which weights fall to 1/e.
const PLANE_DISTANCE: f32 = 0.005;

// Weight of another pixel, by its distance from the plane of this one.  `offset`: to the other pixel.
fn plane_weight(own: Guide, other_depth: f32, offset: vec2<f32>) -> f32 {
    let unit = depth_unit(own.depth);
    let expected = own.depth + unit * dot(own.slope, offset);
    // Where the plane is steep, its depth within a pixel is uncertain.
    let tolerance = unit * (PLANE_DISTANCE + 0.5 * (abs(own.slope.x) + abs(own.slope.y)));
    return exponential_decay(abs(other_depth - expected) / tolerance);
}
