// Lights in two frames: ids of this frame's table and of the last one's, where they differ.
#define_import_path bevy_restir::light::remap

#import bevy_restir::common::constants::NONE
#import bevy_restir::light::types::ENVIRONMENT_LIGHT
#import bevy_restir::scene::bindings::{lights, scene}

// The id that a light of the last frame has now; NONE where it is gone.
fn current_light_id(previous: u32) -> u32 {
    if scene.previous_lights == 0u || previous >= ENVIRONMENT_LIGHT {
        return previous;
    }
    let record = scene.previous_lights + previous;
    if record >= arrayLength(&lights) {
        return NONE;
    }
    return lights[record].counterpart;
}

// The record of a light of this frame, as it is or as it was in the last frame; NONE where it did not exist.
fn light_record(light: u32, previous: bool) -> u32 {
    if light >= scene.light_count {
        return NONE;
    }
    if !previous || scene.previous_lights == 0u {
        return light;
    }
    let counterpart = lights[light].counterpart;
    return select(scene.previous_lights + counterpart, NONE, counterpart == NONE);
}
