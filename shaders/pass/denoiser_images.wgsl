// Follows the rays of pixels that show smooth mirrors or clear glass, for the denoiser: writes the optical image, and its place in the last
// frame.

#import bevy_restir::common::constants::{ALPHA_DELTA, FAR, NONE}
#import bevy_restir::common::math::{luminance, max_component}
#import bevy_restir::common::ray::Ray
#import bevy_restir::denoiser::albedo::{albedo_of, has_albedo}
#import bevy_restir::denoiser::guide::{Guide, guide_depth, plane_slope}
#import bevy_restir::denoiser::optical_image::{image_pack, no_image, seen_direction}
#import bevy_restir::scene::cone::cone_along
#import bevy_restir::scene::offset::offset_point
#import bevy_restir::scene::surface::{shape_at, surface_at}
#import bevy_restir::trace::trace::trace_closest
#import bevy_restir::view::alpha_seed::primary_alpha_seed
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::primary::{previous_pixel_shape, primary_surface}
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(0) var images: texture_storage_2d<rgba32uint, write>;
@group(2) @binding(1) var last_places: texture_storage_2d<rgba32float, write>;

struct Image {
    guide_and_albedo: vec4<u32>,
    last_place: vec3<f32>,     // where the last frame showed it
}

@compute @workgroup_size(8, 8)
fn denoiser_images(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy + view.first_pixel;
    if any(pixel >= view.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    var image = Image(no_image(), vec3<f32>(0.0));
    if ids.x != NONE {
        image = image_of(ids, pixel);
    }
    textureStore(images, pixel, image.guide_and_albedo);
    textureStore(last_places, pixel, vec4<f32>(image.last_place, 0.0));
    count_rays(pixel);
}

// Where a point behind mirrors and glass seems to be: linear * point + offset.
struct Imaging {
    linear: mat3x3<f32>,
    offset: vec3<f32>,
}

const IDENTITY: mat3x3<f32> = mat3x3<f32>(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);

// Adds a mirror or an interface that maps the space around `point`.
fn behind_surface(i: Imaging, point: vec3<f32>, map: mat3x3<f32>) -> Imaging {
    return Imaging(i.linear * map, i.offset + i.linear * (point - map * point));
}

// The linear map from the space behind a surface to the image that it shows: a mirror reflects; glass turns, so that the ray looks straight.
fn map_of(wi: vec3<f32>, wo: vec3<f32>, n: vec3<f32>) -> mat3x3<f32> {
    if dot(wi, n) > 0.0 {
        return IDENTITY - 2.0 * outer(n, n);
    }
    let axis = cross(wi, -wo);
    let cross_axis = mat3x3<f32>(vec3<f32>(0.0, axis.z, -axis.y), vec3<f32>(-axis.z, 0.0, axis.x), vec3<f32>(axis.y, -axis.x, 0.0));
    return IDENTITY + cross_axis + cross_axis * cross_axis * (1.0 / (1.0 + dot(wi, -wo)));
}

fn outer(a: vec3<f32>, b: vec3<f32>) -> mat3x3<f32> {
    return mat3x3<f32>(a * b.x, a * b.y, a * b.z);
}

// Greatest number of mirrors and interfaces that a ray passes.
const MAX_SURFACES: u32 = 6u;

fn image_of(ids: vec2<u32>, pixel: vec2<u32>) -> Image {
    let none = Image(no_image(), vec3<f32>(0.0));
    let first = primary_surface(ids, pixel, false);
    var s = first.surface;
    var wo = first.wo;
    var cone = first.cone;
    var seen = seen_direction(s.bsdf, wo);
    if !seen.exists {
        return none;
    }
    var albedo = albedo_of(s.bsdf, wo);
    var last = previous_pixel_shape(ids, pixel);
    var now = Imaging(IDENTITY, vec3<f32>(0.0));
    var before = now;
    // The albedo is sum + tint * that of the next surface.  Light from other directions counts as that of a white surface: it may be brighter
    // than all that a dark image reflects.
    let specular = max(albedo.specular, seen.tint);
    // The quotient may exceed 1 by rounding, and an albedo below 0 has no square root (`image_pack`).
    var tint = min(seen.tint / max(specular, vec3<f32>(1.0e-6)), vec3<f32>(1.0));
    var sum = 1.0 - tint;
    var roughest = 0.0;
    for (var i = 0u; i < MAX_SURFACES && seen.exists; i++) {
        let wi = seen.wi;
        roughest = max(roughest, s.bsdf.roughness);
        now = behind_surface(now, s.position, map_of(wi, wo, s.bsdf.n));
        // The normal of the last frame, bent by a normal map as that of this frame is.
        before = behind_surface(before, last.position, map_of(wi, wo, normalize(last.n + (s.bsdf.n - s.smooth_n))));
        let hit = trace_closest(Ray(offset_point(s.position, s.bsdf.n_geo, wi, s.offset), 0.0, wi, FAR), primary_alpha_seed(pixel));
        if hit.instance == NONE {
            return none;
        }
        cone = cone_along(cone, hit.t);
        last = shape_at(hit.instance, hit.triangle, hit.barycentrics, last.position, true);
        s = surface_at(hit.instance, hit.triangle, hit.barycentrics, -wi, cone, false);
        wo = -wi;
        albedo = albedo_of(s.bsdf, wo);
        seen = seen_direction(s.bsdf, wo);
        seen.exists = seen.exists && luminance(seen.tint) > luminance(albedo.diffuse);
        if seen.exists {
            sum += tint * max(albedo.diffuse + albedo.specular - seen.tint, vec3<f32>(0.0));
            tint *= seen.tint;
        }
    }
    // Emitted light is not filtered.
    if seen.exists || max_component(s.emission + s.unlit) > 0.0 {
        return none;
    }
    var total = sum + tint * (albedo.diffuse + albedo.specular);
    if !has_albedo(total) {
        return none;
    }
    let p = now.linear * s.position + now.offset;
    var roughness = select(albedo.roughness, 1.0, luminance(albedo.diffuse) > luminance(albedo.specular));
    if roughest >= ALPHA_DELTA {
        // The light also comes from points around, which may be a hundred times as bright.
        total = vec3<f32>(1.0);
        roughness = roughest;
    }
    let guide = Guide(guide_depth(view.current, p, false), plane_slope(p, now.linear * s.bsdf.n_geo), now.linear * s.bsdf.n, roughness, false);
    return Image(image_pack(guide, total), before.linear * last.position + before.offset);
}
