// The radiance that the camera sees where there is no surface.
#define_import_path bevy_restir::light::backdrop

#import bevy_restir::common::constants::VIEW_ENVIRONMENT_IS_BACKDROP
#import bevy_restir::light::environment::environment_radiance
#import bevy_restir::view::bindings::view

fn backdrop(direction: vec3<f32>) -> vec3<f32> {
    if (view.flags & VIEW_ENVIRONMENT_IS_BACKDROP) != 0u {
        return environment_radiance(direction, false);
    }
    return view.background;
}
