// Adds up the parts of a frame's picture: emission of the primary surfaces, and the light of all domains.  Limits the light of the domains to
// a multiple of that of the pixels around (`limited`), and sums up frames while they are accumulated.  With TO_DENOISER the light goes to the
// denoiser instead, without its albedo and beside the guide.

#import bevy_restir::common::constants::LEAST_MAGNITUDE
#import bevy_restir::common::math::luminance
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::pixel::pixel_index
#import bevy_restir::view::pixel_light::{add_to_sum, guarded_pixel}
#ifdef TO_DENOISER
#import bevy_restir::common::constants::{LEAST_DIVISOR, NONE}
#import bevy_restir::denoiser::albedo::{albedo_of, has_albedo, without_albedo}
#import bevy_restir::denoiser::guide::{Guide, guide_depth, guide_pack, no_guide, plane_slope}
#import bevy_restir::denoiser::optical_image::{is_image, with_image}
#import bevy_restir::denoiser::types::{DIFFUSE, SPECULAR}
#import bevy_restir::view::primary::primary_surface
#import bevy_restir::view::ray_counter::count_guards
#else
#import bevy_restir::light::direct_view::directly_seen
#import bevy_restir::view::guard_counter::end_pixel
#endif

// The texture of a part that the technique does not compute has one black texel (`light_in`).
@group(2) @binding(0) var unresampled: texture_2d<f32>;
@group(2) @binding(1) var resampled_direct: texture_2d<f32>;
@group(2) @binding(2) var resampled_paths: texture_2d<f32>;
@group(2) @binding(3) var resampled_splats: texture_2d<f32>;
@group(2) @binding(4) var resampled_subsurface: texture_2d<f32>;
@group(2) @binding(5) var resampled_reconnected: texture_2d<f32>;

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    store(ids, pixel, limited(scattered_light(pixel), pixel, ids.x));
}

#ifdef TO_DENOISER
@group(2) @binding(6) var signals: texture_storage_2d_array<rgba32float, write>;
@group(2) @binding(7) var guides: texture_storage_2d<rgba32uint, write>;
// Optical images; one empty texel where the scene has nothing smooth.
@group(2) @binding(8) var images: texture_2d<u32>;

// `scattered`: as `shown_light` returns it.
fn store(ids: vec2<u32>, pixel: vec2<u32>, scattered: vec4<f32>) {
    if ids.x == NONE {
        textureStore(signals, pixel, DIFFUSE, vec4<f32>(guarded_pixel(scattered.rgb), -1.0));
        textureStore(signals, pixel, SPECULAR, vec4<f32>(0.0, 0.0, 0.0, -1.0));
        textureStore(guides, pixel, guide_pack(no_guide()));
        count_guards(pixel);
        return;
    }
    let light = guarded_pixel(scattered.rgb);
    let s = primary_surface(ids, pixel, false);
    let image = textureLoad(images, min(pixel, textureDimensions(images) - 1u), 0);
    let albedo = with_image(albedo_of(s.surface.bsdf, s.wo), image);
    let share = scattered.a / max(luminance(light), LEAST_DIVISOR);
    let diffuse = select(0.0, min(share, 1.0), share > 0.0);
    textureStore(signals, pixel, DIFFUSE, signal(light * diffuse, albedo.diffuse));
    textureStore(signals, pixel, SPECULAR, signal(light * (1.0 - diffuse), albedo.specular));
    let p = s.surface.position;
    let depth = guide_depth(view.current, p, false);
    let guide = Guide(depth, plane_slope(p, s.surface.bsdf.n_geo), s.surface.bsdf.n, albedo.roughness, is_image(image));
    textureStore(guides, pixel, guide_pack(guide));
    count_guards(pixel);
}

// Light without its albedo; alpha < 0: the surface has no such light.
fn signal(light: vec3<f32>, albedo: vec3<f32>) -> vec4<f32> {
    return select(vec4<f32>(0.0, 0.0, 0.0, -1.0), vec4<f32>(without_albedo(light, albedo), 0.0), has_albedo(albedo));
}
#else
@group(2) @binding(6) var<storage, read_write> radiance: array<vec4<f32>>;

fn store(ids: vec2<u32>, pixel: vec2<u32>, scattered: vec4<f32>) {
    let index = pixel_index(pixel);
    var before = vec4<f32>(0.0);
    if view.accumulated > 0u {
        before = radiance[index];
    }
    radiance[index] = add_to_sum(before, guarded_pixel(directly_seen(ids, pixel) + scattered.rgb));
    end_pixel(pixel);
}
#endif

// The light of all domains.  Where the camera ray of a pixel misses all surfaces, only light paths contribute: they may land anywhere in
// the pixel, on a surface that this ray has missed.
fn scattered_light(pixel: vec2<u32>) -> vec4<f32> {
    return light_in(unresampled, pixel) + light_in(resampled_direct, pixel) + light_in(resampled_paths, pixel)
        + subsurface_light(pixel) + light_in(resampled_splats, pixel) + light_in(resampled_reconnected, pixel);
}

// Not every device defines reads outside of a texture.
fn light_in(part: texture_2d<f32>, pixel: vec2<u32>) -> vec4<f32> {
    return textureLoad(part, min(pixel, textureDimensions(part) - 1u), 0);
}

// Least number of pixels that a limit is taken from.  Fewer pixels may all be dark by chance, and a pixel of a thin object may have none
// around it that shows the same object.
const FEWEST_NEIGHBORS: u32 = 3u;

// Limits the light of a pixel to a multiple of that of the brightest of the eight pixels around it that show the same object.
fn limited(light: vec4<f32>, pixel: vec2<u32>, instance: u32) -> vec4<f32> {
    if !(view.firefly_limit > 0.0) {
        return light;
    }
    var brightest = 0.0;
    var neighbors = 0u;
    for (var i = 0u; i < 9u; i++) {
        // Coordinates left of or above the image wrap around to numbers above the size.
        let neighbor = pixel + vec2<u32>(i % 3u, i / 3u) - 1u;
        if i != 4u && all(neighbor < view.size) && textureLoad(visibility, neighbor, 0).x == instance {
            brightest = max(brightest, luminance(scattered_light(neighbor).rgb));
            neighbors += 1u;
        }
    }
    if neighbors < FEWEST_NEIGHBORS {
        return light;
    }
    return light * min(view.firefly_limit * brightest / max(luminance(light.rgb), LEAST_MAGNITUDE), 1.0);
}

#ifdef SUBSURFACE
fn subsurface_light(pixel: vec2<u32>) -> vec4<f32> {
    return light_in(resampled_subsurface, pixel);
}
#else
fn subsurface_light(pixel: vec2<u32>) -> vec4<f32> {
    return vec4<f32>(0.0);
}
#endif
