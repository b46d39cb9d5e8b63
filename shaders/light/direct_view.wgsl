// The light that the camera sees without any scattering: emission of surfaces, and the backdrop.
#define_import_path bevy_restir::light::direct_view

#import bevy_restir::common::constants::NONE
#import bevy_restir::light::backdrop::backdrop
#import bevy_restir::scene::material::may_emit
#import bevy_restir::view::camera::primary_ray
#import bevy_restir::view::light_part::shown_emission
#import bevy_restir::view::primary::primary_surface

// `ids`: (instance, triangle) of the pixel.
fn directly_seen(ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    if ids.x == NONE {
        return shown_emission(backdrop(primary_ray(pixel).direction));
    }
    if !may_emit(ids.x) {
        return vec3<f32>(0.0);
    }
    let s = primary_surface(ids, pixel, false).surface;
    return shown_emission(s.emission + s.unlit);
}
