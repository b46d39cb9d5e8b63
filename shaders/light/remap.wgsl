// Ids of lights in this frame and in the last one.  The id of a light is the index of its record in `lights`.  An analytic light that exists in
// both frames may have two records; a mesh whose triangles have not changed has the same records in both.
#define_import_path bevy_restir::light::remap

#import bevy_restir::common::constants::NONE
#import bevy_restir::light::types::ENVIRONMENT_LIGHT
#import bevy_restir::scene::bindings::{lights, scene}
#import bevy_restir::view::bindings::view

// The id in this frame of a light of the last frame; NONE if it was removed.
fn current_light_id(previous: u32) -> u32 {
    if previous == ENVIRONMENT_LIGHT {
        return select(NONE, previous, environment_existed());
    }
    return light_in_other_frame(previous, true);
}

// The id in this frame of the light of a record, which may be one of the last frame; NONE if the light was removed.
fn current_light_of(record: u32) -> u32 {
    if record >= scene.lights_end || is_bin(record, false) {
        return record;
    }
    if is_bin(record, true) || lights[lights[record].link].data.x == NONE {
        return current_light_id(record);
    }
    return record;
}

// Whether a light of this frame existed in the last one.
fn light_existed(light: u32) -> bool {
    if light == ENVIRONMENT_LIGHT {
        return environment_existed();
    }
    return light_record(light, true) != NONE;
}

// Whether the last frame had the environment of this one.  After a change of its image it counts as another light, whose color in the last
// frame is 0 (`src/view/uniforms.rs`).
fn environment_existed() -> bool {
    return any(view.previous_environment_color > vec3<f32>(0.0));
}

// Index in `lights` of a light of this frame, as it is or (`previous`) as it was in the last frame; NONE if it did not exist.
fn light_record(light: u32, previous: bool) -> u32 {
    if !previous {
        return select(light, NONE, light >= scene.lights_end);
    }
    return light_in_other_frame(light, false);
}

// Whether a record is a bin of this frame or (`previous`) of the last one.
fn is_bin(record: u32, previous: bool) -> bool {
    if previous {
        return record - scene.previous_first_bin < scene.previous_light_bins;
    }
    return record - scene.first_bin < scene.light_bins;
}

// Id in the other frame of a light of this frame, or (`previous`) of the last frame; NONE if the other frame does not have it.
fn light_in_other_frame(light: u32, previous: bool) -> u32 {
    if light >= scene.lights_end || scene.previous_first_bin == NONE {
        return NONE;
    }
    if scene.previous_first_bin == scene.first_bin {
        return light;
    }
    let link = lights[light].link;
    if is_bin(light, previous) {
        return link;
    }
    // The triangles of a mesh stand behind its header, and keep their order.
    let first = lights[link].link;
    return select(first + (light - link - 1u), NONE, first == NONE);
}
