//! A frame of a moving scene by ReSTIR PT equals on average the reference of the still scene at that moment.  The mean is over seeds of
//! the last frame of a scripted motion of four, at 64 x 64 pixels and three bounces; margin 1.5 or 2 % at α = 0.01.

use crate::support::{
    app::*,
    proof::{AllLight, Proof},
    reuse_settings::{di, paths},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{Direct, Paths, Reuse, SuffixRetrace};

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_in_a_moving_frame_equal_those_of_the_still_scene() {
    let Some(mut rig) = shared(64, "moving") else { return };
    let proof = Proof { bounces: 3, margin: 0.02, pose: Some(&pose_moving), ..Proof::of((52, 1), (14, 24)) };
    proof.check("moving", &mut rig, &[("both", paths::all_reuse())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_of_the_last_moving_frame_alone_equal_those_of_the_still_scene() {
    let Some(mut rig) = shared(64, "moving") else { return };
    let proof = Proof { bounces: 3, margin: 0.015, pose: Some(&pose_moving), ..Proof::of((52, 1), (12, 32)) };
    proof.check("moving", &mut rig, &[("temporal", paths::temporal())]);
}

/// The other proofs accept any neighbors, without pairs.  The defaults seek similar surfaces, also by dual motion vectors, and pair pixels.
#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_with_default_settings_in_a_moving_frame_equal_those_of_the_still_scene() {
    let Some(mut rig) = shared(64, "moving") else { return };
    let proof = Proof { bounces: 3, margin: 0.02, pose: Some(&pose_moving), ..Proof::of((60, 1), (14, 24)) };
    let all = [
        ("PT, defaults", AllLight::Pt(Paths::default())),
        ("DI + GI, defaults", AllLight::Gi(Direct::default(), Paths::default())),
    ];
    proof.check("moving", &mut rig, &all);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_to_emitters_are_unchanged_while_other_lights_come_and_go() {
    let Some(mut rig) = shared(64, "passing") else { return };
    let proof = Proof { bounces: 3, margin: 0.015, pose: Some(&pose_passing), ..Proof::of((60, 1), (16, 32)) };
    let paths = paths::temporal();
    let both = [("paths", AllLight::Pt(paths.clone())), ("indirect", AllLight::Gi(di::all_reuse(), paths))];
    proof.check("passing lights", &mut rig, &both);
}

/// The last frame's targets hold only while lights keep their probabilities.
#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_to_emitters_are_unchanged_while_a_hidden_light_flickers() {
    let Some(mut rig) = scene(64, flickering) else { return };
    let proof = Proof { bounces: 2, margin: 0.02, pose: Some(&pose_flickering), ..Proof::of((80, 1), (8, 32)) };
    proof.check("flickering light", &mut rig, &[("temporal", paths::temporal())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn suffixes_that_are_not_traced_both_ways_are_biased_with_their_documented_sign() {
    let Some(mut rig) = shared(64, "moving") else { return };
    let proof = Proof { bounces: 3, margin: 0.015, pose: Some(&pose_moving), ..Proof::of((60, 1), (16, 32)) };
    let truth = proof.truth(&mut rig, 1000);
    let mut found = |suffix| {
        let found = proof
            .resampled(
                &mut rig,
                &Paths {
                    reuse: Reuse { spatial_samples: 0, ..paths::all_reuse().reuse },
                    suffix_retrace: suffix,
                    ..paths::all_reuse()
                },
                5000,
            )
            .compare(&truth, 0.01);
        eprintln!("{suffix:?}: {found}");
        found
    };
    assert!(found(SuffixRetrace::ForwardOnly).sigma() < -4.0);
    // The light lags behind: too bright where it was, and too dark where it arrives.
    assert!(found(SuffixRetrace::Off).tiles < 1e-6);
}

/// A reflecting surface, an emitter that rays hit and a sphere light all shrink or grow, so that a stored point covers another area in
/// each frame.
#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_by_growing_and_shrinking_objects_equal_those_of_the_still_scene() {
    let mut walls = [Entity::PLACEHOLDER; 3];
    let mut ball = Entity::PLACEHOLDER;
    let Some(mut rig) = scene(64, |rig| {
        let turned = |axis, angle| Quat::from_axis_angle(axis, angle);
        let quarter = core::f32::consts::FRAC_PI_2;
        let floor = Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(turned(Vec3::X, -quarter));
        let side = Transform::from_xyz(-1.7, 0.0, 0.0).with_rotation(turned(Vec3::Y, quarter));
        let ceiling = Transform::from_xyz(0.0, 1.6, 0.0).with_rotation(turned(Vec3::X, quarter));
        walls = [
            rig.spawn(square(4.0), lambert(0.7), floor),
            rig.spawn(square(4.0), lambert(0.8), side),
            rig.spawn(square(1.0), lamp(3.0, 3.0, 3.0), ceiling),
        ];
        rig.spawn(square(4.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -1.2));
        let light = PointLight { intensity: 30.0, radius: 0.2, ..default() };
        ball = rig.spawn_bundle((light, Transform::from_xyz(0.9, -0.4, 0.4)));
    }) else {
        return;
    };
    let pose = |rig: &mut Rig, step: u32| {
        let ago = (STEPS - step) as f32;
        for (wall, x, y) in [(walls[0], 0.75, 1.2), (walls[1], 1.3, 1.1), (walls[2], 0.8, 0.8)] {
            rig.get_mut::<Transform>(wall).scale = Vec3::new(f32::powf(x, -ago), f32::powf(y, -ago), 1.0);
        }
        rig.get_mut::<PointLight>(ball).radius = 0.2 * f32::powf(1.3, -ago);
    };
    let proof = Proof { bounces: 3, margin: 0.02, pose: Some(&pose), ..Proof::of((40, 1), (16, 16)) };
    let temporal = paths::temporal();
    let all = [("PT", AllLight::Pt(temporal.clone())), ("DI + GI", AllLight::Gi(di::all_reuse(), temporal))];
    proof.check("growing", &mut rig, &all);
}
