// The optical image: the surface that a smooth mirror or clear glass shows, at the place where it seems to be.  The denoiser treats it like a
// surface that the pixel shows.
#define_import_path bevy_restir::denoiser::optical_image

#import bevy_restir::bsdf::reflection::reflectance
#import bevy_restir::bsdf::transmission::transmitted_share
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::math::max_component
#import bevy_restir::denoiser::albedo::{Albedo, has_albedo}
#import bevy_restir::denoiser::guide::{Guide, guide_pack, guide_unpack}

// GGX α below which most specular light comes from one direction.
const SMOOTH: f32 = 0.02;

// The direction that a surface shows to its viewer.
struct SeenDirection {
    exists: bool,
    wi: vec3<f32>,
    tint: vec3<f32>,           // share of the light from there
}

// Of the reflected direction and the refracted one, that with more light.
fn seen_direction(b: Bsdf, wo: vec3<f32>) -> SeenDirection {
    let cosine = abs(dot(wo, b.n));
    let reflects = reflectance(b, cosine);
    var seen = SeenDirection(true, reflect(-wo, b.n), reflects);
    let transmits = transmitted_share(b, cosine);
    if max_component(transmits) > max_component(reflects) {
        seen = SeenDirection(true, refract(-wo, b.n, 1.0 / b.eta), transmits);
    }
    let same_side = dot(seen.wi, b.n) * dot(seen.wi, b.n_geo) > 0.0;
    seen.exists = b.roughness < SMOOTH && !is_coated(b) && has_albedo(seen.tint) && same_side;
    return seen;
}

#ifdef CLEARCOAT
fn is_coated(b: Bsdf) -> bool {
    return b.coat > 0.0;
}
#else
fn is_coated(b: Bsdf) -> bool {
    return false;
}
#endif

// A guide and an albedo.  Square roots keep dark albedos precise; every pass reads the same rounded one.
fn image_pack(g: Guide, albedo: vec3<f32>) -> vec4<u32> {
    return vec4<u32>(guide_pack(g).xyz, pack4x8unorm(sqrt(vec4<f32>(albedo, g.roughness))));
}

fn no_image() -> vec4<u32> {
    return vec4<u32>(0u);
}

fn is_image(p: vec4<u32>) -> bool {
    return p.x != 0u;
}

fn image_guide(p: vec4<u32>) -> Guide {
    var g = guide_unpack(p);
    let root = unpack4x8unorm(p.w).a;
    g.roughness = root * root;
    g.shows_image = false;
    return g;
}

// The albedos of a surface that may show an image: its specular light has the albedo of the image, too.
fn with_image(albedo: Albedo, p: vec4<u32>) -> Albedo {
    let root = unpack4x8unorm(p.w).rgb;
    return Albedo(albedo.diffuse, albedo.specular * select(vec3<f32>(1.0), root * root, is_image(p)), albedo.roughness);
}
