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
    return counterpart(previous, true);
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
    let before = counterpart(light, false);
    return select(scene.previous_lights + before, NONE, before == NONE);
}

// Id in the other frame of a light of this frame, or (`previous`) of the last frame; NONE if the other frame does not have it.
fn counterpart(light: u32, previous: bool) -> u32 {
    let table = select(0u, scene.previous_lights, previous);
    let link = lights[table + light].counterpart_or_mesh;
    if light < select(scene.light_bins, scene.previous_light_bins, previous) {
        return link;
    }
    // The triangles of a mesh keep their order.
    let mesh = table + link;
    let first = lights[mesh].counterpart_or_mesh;
    return select(first + (light - lights[mesh].data.x), NONE, first == NONE);
}
