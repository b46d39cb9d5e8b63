//! A frame of a moving scene equals on average the reference of the still scene at that moment.  The mean is over seeds of the last
//! frame of a scripted motion of four, at 64 x 64 pixels; margin 1 % (1.5 % for lights, 4 % in the first tier) at α = 0.01, and
//! chi-squared of the 8 x 8 tiles.

use crate::support::{
    app::*,
    proof::{Proof, Subject},
    reuse_settings::{di, paths},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{Direct, Mis, Reuse};

const ALL: [&str; 4] = ["both", "bilinear", "balance", "defaults"];

/// Disocclusions are frequent here: use as many neighbors as possible.
fn both() -> Direct {
    Direct { reuse: Reuse { disocclusion_samples: 5, ..di::all_reuse().reuse }, ..di::all_reuse() }
}

/// Compares these kinds of reuse, of [`ALL`], with the reference.
fn check(name: &str, rig: &mut Rig, margin: f64, seeds: u32, kinds: &[&str], pose: impl Fn(&mut Rig, u32)) {
    // At rest, without jitter, a place of the last frame is the middle of a pixel: bilinear weights have no effect there.
    let bilinear = Direct { reuse: Reuse { bilinear: true, ..both().reuse }, ..both() };
    let mut techniques = vec![
        ("both", both()),
        ("bilinear", bilinear),
        (
            "balance",
            Direct {
                reuse: Reuse { spatial_samples: 1, ..di::across_edges(Mis::Balance).reuse },
                ..di::across_edges(Mis::Balance)
            },
        ),
        ("defaults", Direct::default()),
    ];
    techniques.retain(|(kind, _)| kinds.contains(kind));
    Proof { margin, pose: Some(&pose), ..Proof::of((seeds, 1), (14, 48)) }.check(name, rig, &techniques);
}

/// In the last step a light leaves its hiding place behind the wall, a shade leaves the lamp, and another light appears, which changes the
/// indices of all others.  A shader that takes any of this for the last frame's loses most of this light, so that the margin may be wide.
#[test]
#[ignore = "second tier: ./run test --more"]
fn lights_and_occluders_that_change_at_once_have_their_effect_at_once() {
    let (mut lights, mut shade) = ([Entity::PLACEHOLDER; 3], Entity::PLACEHOLDER);
    let Some(mut rig) = scene(64, |rig| {
        room(rig);
        let light = PointLight { intensity: 30.0, ..default() };
        // The first light of the table appears late, so that the indices of all others change.
        lights = [(1.0, 1.2), (-1.0, 1.2), (0.0, 0.0)]
            .map(|(x, z)| rig.spawn_bundle((light, Transform::from_xyz(x, 0.2, z))));
        shade = rig.spawn(Cuboid::new(1.4, 0.02, 1.4), lambert(0.4), Transform::default());
    }) else {
        return;
    };
    let pose = |rig: &mut Rig, step: u32| {
        let [late, early, hidden] = lights;
        let (is_last, s) = (step >= STEPS, step as f32);
        let shown = |yes| if yes { Visibility::Inherited } else { Visibility::Hidden };
        *rig.get_mut::<Visibility>(late) = shown(is_last);
        *rig.get_mut::<Visibility>(early) = shown(step + 1 < STEPS);
        let behind = if is_last { 0.8 } else { -1.6 };
        rig.get_mut::<Transform>(hidden).translation = Vec3::new(0.3 * s - 0.8, 0.6, behind);
        rig.get_mut::<PointLight>(hidden).intensity = 20.0 + 15.0 * s;
        rig.get_mut::<PointLight>(hidden).color = Color::linear_rgb(1.0, 0.3 + 0.2 * s, 0.5);
        let above = if is_last { 3.0 } else { 1.15 };
        rig.get_mut::<Transform>(shade).translation = Vec3::new(0.4 + 0.05 * s, above, 0.28);
    };
    let proof = Proof { margin: 0.04, pose: Some(&pose), ..Proof::of((16, 1), (10, 24)) };
    let (direct, paths) = (both(), paths::all_reuse());
    let techniques = [("direct light", &direct as &dyn Subject), ("paths", &paths as &dyn Subject)];
    proof.check("changes at once", &mut rig, &techniques);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_moving_occluder_leaves_no_trail_of_light_or_shadow() {
    let mut block = Entity::PLACEHOLDER;
    let Some(mut rig) = scene(64, |rig| block = room(rig)) else { return };
    check("occluder", &mut rig, 0.01, 30, &["both", "balance"], |rig, step| {
        rig.get_mut::<Transform>(block).translation = Vec3::new(0.9 - 0.3 * step as f32, 0.1, 0.0);
    });
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_moving_emitter_lights_from_its_current_position() {
    let mut lamps = Entity::PLACEHOLDER;
    let Some(mut rig) = scene(64, |rig| {
        room(rig);
        lamps = rig.spawn(Cuboid::new(0.3, 0.3, 0.3), lamp(4.0, 8.0, 8.0), Transform::default());
    }) else {
        return;
    };
    check("emitter", &mut rig, 0.01, 40, &["both", "balance"], |rig, step| {
        *rig.get_mut::<Transform>(lamps) = Transform::from_xyz(-0.9 + 0.3 * step as f32, 0.4, 0.5)
            .with_rotation(Quat::from_rotation_y(0.3 * step as f32));
    });
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_moving_camera_sees_the_same_as_one_at_rest() {
    let Some(mut rig) = room_scene(64) else { return };
    check("camera", &mut rig, 0.01, 40, &ALL, |rig, step| {
        let place = Vec3::new(0.9 - 0.2 * step as f32, 0.2 + 0.1 * step as f32, 4.0 - 0.1 * step as f32);
        *rig.get_mut::<Transform>(rig.camera) =
            Transform::from_translation(place).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
    });
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn lights_that_move_change_come_and_go_have_their_current_effect() {
    check_changing_lights(&["both"]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn lights_that_change_have_their_current_effect_with_further_kinds_of_reuse() {
    check_changing_lights(&["balance"]);
}

fn check_changing_lights(kinds: &[&str]) {
    let (mut moving, mut late, mut early) = (Entity::PLACEHOLDER, Entity::PLACEHOLDER, Entity::PLACEHOLDER);
    let Some(mut rig) = scene(64, |rig| {
        room(rig);
        let light = |intensity| PointLight { intensity, ..default() };
        // The first light of the table appears late, so that all other ids change in the last frame.
        late = rig.spawn_bundle((light(60.0), Transform::from_xyz(1.0, 0.2, 1.2)));
        moving = rig.spawn_bundle((light(40.0), Transform::default()));
        early = rig.spawn_bundle((light(90.0), Transform::from_xyz(-1.0, -0.5, 1.0)));
    }) else {
        return;
    };
    // Lamps close to surfaces are noisier than the others, hence the margin of 1.5 %.
    check("lights", &mut rig, 0.015, 112, kinds, |rig, step| {
        let step = step as f32;
        let shown = |yes| if yes { Visibility::Inherited } else { Visibility::Hidden };
        *rig.get_mut::<Visibility>(late) = shown(step >= STEPS as f32);
        *rig.get_mut::<Visibility>(early) = shown(step < STEPS as f32);
        rig.get_mut::<Transform>(moving).translation = Vec3::new(0.9 - 0.5 * step, 0.6, 0.8);
        rig.get_mut::<PointLight>(moving).intensity = 20.0 + 15.0 * step;
        rig.get_mut::<PointLight>(moving).color = Color::linear_rgb(1.0, 0.3 + 0.2 * step, 0.5);
    });
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_lights_that_only_move_light_from_their_current_position() {
    let mut moving = [Entity::PLACEHOLDER; 2];
    let Some(mut rig) = scene(64, |rig| {
        room(rig);
        let light = PointLight { intensity: 60.0, ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(1.0, 0.2, 1.2)));
        let spot = SpotLight { intensity: 200.0, outer_angle: 0.6, inner_angle: 0.5, ..default() };
        moving = [rig.spawn_bundle((light, Transform::default())), rig.spawn_bundle((spot, Transform::default()))];
    }) else {
        return;
    };
    check("moving lights", &mut rig, 0.015, 56, &ALL, |rig, step| {
        let step = step as f32;
        rig.get_mut::<Transform>(moving[0]).translation = Vec3::new(0.9 - 0.5 * step, 0.6, 0.8);
        let eye = Transform::from_xyz(-0.8 + 0.3 * step, 0.8, 1.5);
        *rig.get_mut::<Transform>(moving[1]) = eye.looking_at(Vec3::new(0.4 * step - 0.8, -0.5, -0.5), Vec3::Y);
    });
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn lights_that_come_and_go_do_not_change_the_light_of_emitters() {
    let Some(mut rig) = scene(64, passing) else { return };
    check("passing lights", &mut rig, 0.015, 32, &["both", "balance"], pose_passing);
}
