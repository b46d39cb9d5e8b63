// The denoised picture: multiplies the filtered light by the albedo of its surface, and adds the light that the camera sees directly.

#import bevy_restir::common::constants::NONE
#import bevy_restir::denoiser::albedo::albedo_of
#import bevy_restir::denoiser::optical_image::with_image
#import bevy_restir::denoiser::types::{DIFFUSE, SPECULAR}
#import bevy_restir::light::direct_view::directly_seen
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::guard_counter::end_pixel
#import bevy_restir::view::pixel::pixel_index
#import bevy_restir::view::pixel_light::guarded_pixel
#import bevy_restir::view::primary::primary_surface

@group(2) @binding(0) var signals: texture_2d_array<f32>;
@group(2) @binding(1) var<storage, read_write> radiance: array<vec4<f32>>;
@group(2) @binding(2) var images: texture_2d<u32>;

@compute @workgroup_size(8, 8)
fn denoiser_output(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    var light = directly_seen(ids, pixel);
    if ids.x == NONE {
        light += textureLoad(signals, pixel, DIFFUSE, 0).rgb;
    } else {
        let s = primary_surface(ids, pixel, false);
        let image = textureLoad(images, min(pixel, textureDimensions(images) - 1u), 0);
        let albedo = with_image(albedo_of(s.surface.bsdf, s.wo), image);
        light += albedo.diffuse * textureLoad(signals, pixel, DIFFUSE, 0).rgb;
        light += albedo.specular * textureLoad(signals, pixel, SPECULAR, 0).rgb;
    }
    radiance[pixel_index(pixel)] = vec4<f32>(guarded_pixel(light), 1.0);
    end_pixel(pixel);
}
