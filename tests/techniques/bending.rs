//! Light on and from bodies that bend: a frame of a scene in which skinned and morphed bodies move equals on average the reference of that
//! frame, and histories outlive the motion.  The mean is over seeds of the last frame of a script of four, at 64 x 64 pixels; margin 1.5 %
//! (2 % for paths) at α = 0.01.

use crate::support::{
    app::*,
    bodies::*,
    proof::{AllLight, Proof},
    reuse_settings::{di, paths},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{DebugView, Direct, Reuse, Technique, testing::shader_library::ShaderEdit};

fn proof(restarts: u32) -> Proof<'static> {
    Proof { bounces: 3, margin: 0.015, pose: Some(&pose_bending), ..Proof::of((restarts, 1), (14, 32)) }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_among_bodies_that_bend_equals_the_reference() {
    let Some(mut rig) = scene(64, bending) else { return };
    // Both kinds of reuse have the temporal one.
    Proof { bounces: 1, ..proof(140) }.check("bending", &mut rig, &[("direct, both", di::all_reuse())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_among_bodies_that_bend_equal_the_reference() {
    let Some(mut rig) = scene(64, bending) else { return };
    let both = AllLight::Pt(paths::all_reuse());
    Proof { margin: 0.02, ..proof(75) }.check("bending", &mut rig, &[("paths, both", both)]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_indirect_light_among_bodies_that_bend_equals_the_reference() {
    let Some(mut rig) = scene(64, bending) else { return };
    let both = AllLight::Gi(di::all_reuse(), paths::all_reuse());
    Proof { margin: 0.02, ..proof(75) }.check("bending", &mut rig, &[("indirect, both", both)]);
}

/// Temporal reuse that takes the bodies of this frame for those of the last one.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_temporal_reuse_with_the_shapes_of_this_frame_is_found() {
    let Some(mut rig) = scene(64, bending) else { return };
    let proof = Proof { bounces: 1, ..proof(60) };
    let reference = proof.truth(&mut rig, 1000);
    let (from, to) = ("let is_second = previous && (instances", "let is_second = false && (instances");
    plant_edits(&mut rig.app, &[ShaderEdit { module: "scene/triangle.wgsl", from, to }]);
    let found = proof.resampled(&mut rig, &di::temporal(), 5000).compare(&reference, 0.01);
    eprintln!("{found}");
    assert!(found.is_different(), "not found: {found}");
}

/// A skinned body that fills most of the view; pictures show the confidence of ReSTIR DI with temporal reuse.
fn swaying_body() -> Option<Rig> {
    let mut rig = scene(64, |rig| {
        spawn_skinned(rig, "body", tube(), lambert(0.7));
        rig.spawn(square(0.8), lamp(6.0, 6.0, 6.0), facing(Vec3::new(0.5, 1.5, 2.0), Vec3::ZERO));
    })?;
    rig.set(|r| {
        r.technique = Technique::Di;
        r.direct = Direct { reuse: Reuse { confidence_cap: 30.0, ..di::temporal().reuse }, ..di::temporal() };
        r.debug_view = DebugView::ReservoirConfidence;
    });
    Some(rig)
}

/// The foot of a body that is as wide as the view.
fn wide_foot() -> Transform {
    Transform::from_xyz(-0.2, -1.5, 0.5).with_scale(Vec3::new(4.0, 1.7, 1.0))
}

/// Each frame of a motion is one frame of history more for the surfaces that stay visible, those of bodies among them.
#[test]
fn histories_follow_bodies_that_bend() {
    let Some(mut rig) = swaying_body() else { return };
    let body = rig.named("body");
    let pose = |rig: &mut Rig, frame: u32| set_joints(rig, body, &swaying(wide_foot(), 0.02 * frame as f32, 0.5));
    pose(&mut rig, 0);
    rig.until_ready();
    rig.set(|r| r.reset = true);
    rig.frame();
    for frame in 2..12u32 {
        pose(&mut rig, frame);
        let view = rig.next();
        let shown = view.iter().filter(|(_, c)| c.x > 0.0).count();
        let kept = view.iter().filter(|(_, c)| c.x == frame as f32).count();
        assert!(4 * kept > 3 * shown && shown > 600, "frame {frame}: {kept} of {shown} pixels kept their history");
    }
}

/// In a frame in which a body is edited and bends, the receivers of the last frame are where it was then.
#[test]
fn histories_follow_bodies_that_change_their_color_while_they_bend() {
    let kept = |is_painted: bool| {
        let mut rig = swaying_body()?;
        let body = rig.named("body");
        let paint = rig.material_of(body);
        // It turns by a quarter of a circle from frame to frame.
        let pose = |rig: &mut Rig, frame: u32| set_joints(rig, body, &swaying(wide_foot(), 0.4 * frame as f32, 2.0));
        pose(&mut rig, 0);
        rig.until_ready();
        rig.set(|r| r.reset = true);
        rig.frame();
        let mut kept = 0;
        for frame in 1..8 {
            pose(&mut rig, frame);
            if is_painted {
                rig.edit(&paint, |m| m.base_color = Color::linear_rgb(0.7, 0.1 * frame as f32, 0.5));
            }
            kept += rig.next().iter().filter(|(_, c)| c.x > 1.0).count();
        }
        Some(kept)
    };
    let (Some(plain), Some(painted)) = (kept(false), kept(true)) else { return };
    eprintln!("{plain} pixels kept their history; {painted} of a body that changed its color");
    assert!(plain > 2000 && 50 * plain.abs_diff(painted) < plain, "{plain} and {painted}");
}
