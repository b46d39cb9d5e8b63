// Render layers: which instances and lights exist for a camera.  Without RENDER_LAYERS, every camera sees the whole scene.
#define_import_path bevy_restir::view::render_layers

#import bevy_restir::common::constants::{LIGHT_HIDDEN_SHIFT, LIGHT_KIND_BITS}
#import bevy_restir::scene::bindings::{instances, lights}
#import bevy_restir::view::bindings::view

fn light_kind(light: u32) -> u32 {
    return lights[light].kind & LIGHT_KIND_BITS;
}

#ifdef RENDER_LAYERS
// Mask for ray queries: the device compares it with the masks of instances.
fn camera_mask() -> u32 {
    return view.layers;
}

// Whether rays of the camera can hit an instance.  An instance that they cannot hit does not emit either.
fn instance_in_layers(instance: u32) -> bool {
    return (instances[instance].layers & view.layers) != 0u;
}

// Whether an analytic light illuminates the scene of the camera.
fn light_in_layers(light: u32) -> bool {
    return (~(lights[light].kind >> LIGHT_HIDDEN_SHIFT) & view.layers) != 0u;
}
#else
fn camera_mask() -> u32 {
    return 0xffu;
}

fn instance_in_layers(instance: u32) -> bool {
    return true;
}

fn light_in_layers(light: u32) -> bool {
    return true;
}
#endif
