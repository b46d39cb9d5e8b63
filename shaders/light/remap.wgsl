// Ids of lights in this frame's table and in the last frame's, which may differ.
#define_import_path bevy_restir::light::remap

#import bevy_restir::common::constants::NONE
#import bevy_restir::light::types::ENVIRONMENT_LIGHT
#import bevy_restir::scene::bindings::{lights, scene}

// The id in this frame of a light of the last frame; NONE if it was removed.
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

// Whether a light of this frame exists, or (`previous`) existed in the last frame.
fn light_exists(light: u32, previous: bool) -> bool {
    return light == ENVIRONMENT_LIGHT || light_record(light, previous) != NONE;
}

// Index in `lights` of a light of this frame, as it is or (`previous`) as it was in the last frame; NONE if it did not exist.
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
