//! Skinned and morphed meshes: their triangles, their trees and their motion equal those of meshes that an f64 oracle has bent.

use crate::support::{app::*, bodies::*, log, small_scenes::*};
use bevy::{
    mesh::{
        VertexAttributeValues,
        morph::{MeshMorphWeights, MorphWeights},
        skinning::SkinnedMesh,
    },
    prelude::*,
};
use bevy_restir::{DebugView, testing::lengths::table_lengths};

const SIZE: u32 = 96;

fn foot(time: f32) -> Transform {
    Transform::from_xyz(0.2 * time.sin(), -1.0, 0.1 * time).with_rotation(Quat::from_rotation_y(0.3 * time))
}

/// A camera in front of a floor.
fn stage() -> Option<Rig> {
    let mut rig = Rig::new(SIZE, SIZE)?;
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3, 0.4, 3.6).looking_at(Vec3::new(0.1, -0.1, 0.0), Vec3::Y);
    let floor = Transform::from_xyz(0.0, -1.0, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(6.0), lambert(0.7), floor);
    rig.spawn(square(0.8), lamp(6.0, 5.0, 4.0), facing(Vec3::new(0.8, 1.9, 0.9), Vec3::new(0.0, -1.0, 0.0)));
    Some(rig)
}

/// The number of pixels that differ by more than `tolerance`, relative to 1 or to the value.
fn differing(a: &Picture, b: &Picture, tolerance: f32) -> usize {
    // NaN equals nothing.
    let is_equal = |x: Vec3, y: Vec3| (x - y).abs().max_element() <= tolerance * (1.0 + x.abs().max_element());
    a.iter().zip(b.iter()).filter(|((_, x), (_, y))| !is_equal(*x, *y)).count()
}

/// Shows a body that bends and then, in its place, the oracle's mesh: geometry as the camera and as rays see it, and the shaded picture.
fn assert_equal_pictures(name: &str, rig: &mut Rig, body: Entity, oracle: Mesh, material: &StandardMaterial) {
    let views = [DebugView::Depth, DebugView::Normals, DebugView::TracedInstances];
    let show = |rig: &mut Rig| {
        rig.until_ready();
        let mut pictures: Vec<Picture> = views.iter().map(|view| rig.debug(*view)).collect();
        pictures.push(rig.picture(16));
        rig.assert_sound();
        pictures
    };
    let bent = show(rig);
    *rig.get_mut::<Visibility>(body) = Visibility::Hidden;
    let still = rig.spawn(oracle, material.clone(), Transform::default());
    let expected = show(rig);
    rig.app.world_mut().entity_mut(still).despawn();
    *rig.get_mut::<Visibility>(body) = Visibility::Inherited;
    // Silhouettes may move by a pixel.  Traced instances have the color of their slot: only the background counts.
    let counts = [
        differing(&bent[0], &expected[0], 1e-3),
        differing(&bent[1], &expected[1], 1e-2),
        bent[2]
            .iter()
            .zip(expected[2].iter())
            .filter(|((_, a), (_, b))| (*a == Vec3::ZERO) != (*b == Vec3::ZERO))
            .count(),
    ];
    let means = [bent[3].mean(), expected[3].mean()];
    eprintln!("{name}: {counts:?} pixels differ; means {means:?}");
    assert!(counts.iter().all(|count| *count <= 12), "{name}: {counts:?}");
    assert!((means[0] / means[1] - 1.0).abs() < 5e-3, "{name}: {means:?}");
}

#[test]
fn a_skinned_body_equals_the_oracle_in_every_pose() {
    let Some(mut rig) = stage() else { return };
    let material =
        StandardMaterial { double_sided: true, cull_mode: None, ..shiny(Color::linear_rgb(0.8, 0.5, 0.3), 0.5, 0.0) };
    let body = spawn_skinned(&mut rig, "tube", tube(), material.clone());
    for (step, wild) in [(0.0, 0.0), (0.4, 1.0), (1.7, 1.0), (2.9, 2.5)] {
        let joints = swaying(foot(step).with_scale(Vec3::new(1.0 + 0.3 * step, 1.0, 1.0 - 0.2 * step)), step, wild);
        set_joints(&mut rig, body, &joints);
        // Where the mesh itself stands does not matter.
        *rig.get_mut::<Transform>(body) = Transform::from_xyz(step, -3.0, 0.5)
            .with_rotation(Quat::from_rotation_x(step))
            .with_scale(Vec3::new(0.5, 1.0 + step, 2.0));
        assert_equal_pictures(&format!("step {step}"), &mut rig, body, skinned_in_f64(&tube(), &joints), &material);
    }
}

#[test]
fn a_mirrored_body_equals_the_oracle() {
    let Some(mut rig) = stage() else { return };
    let material = StandardMaterial { double_sided: true, cull_mode: None, ..lambert(0.7) };
    let body = spawn_skinned(&mut rig, "tube", tube(), material.clone());
    let joints = swaying(foot(0.5).with_scale(Vec3::new(-1.0, 1.0, 1.0)), 0.5, 0.5);
    set_joints(&mut rig, body, &joints);
    assert_equal_pictures("mirrored joints", &mut rig, body, skinned_in_f64(&tube(), &joints), &material);
}

#[test]
fn a_body_without_normals_and_indices_equals_the_oracle() {
    let Some(mut rig) = stage() else { return };
    let material = StandardMaterial { double_sided: true, cull_mode: None, ..lambert(0.7) };
    let faceted = |mut mesh: Mesh| {
        mesh.remove_attribute(Mesh::ATTRIBUTE_NORMAL);
        mesh
    };
    let body = spawn_skinned(&mut rig, "tube", faceted(tube()).with_duplicated_vertices(), material.clone());
    let joints = swaying(foot(0.7), 0.7, 1.0);
    set_joints(&mut rig, body, &joints);
    assert_equal_pictures("facets", &mut rig, body, faceted(skinned_in_f64(&tube(), &joints)), &material);
}

#[test]
fn a_morphed_body_equals_the_oracle() {
    let Some(mut rig) = stage() else { return };
    let material = StandardMaterial { double_sided: true, cull_mode: None, ..lambert(0.7) };
    let body = rig.spawn(sheet(), material.clone(), Transform::default());
    for weights in [[0.0, 0.0], [1.0, 0.0], [0.6, -1.2]] {
        set_weights(&mut rig, body, &weights);
        assert_equal_pictures(&format!("{weights:?}"), &mut rig, body, morphed_in_f64(&sheet(), &weights), &material);
    }
    // Several meshes may share the weights of another entity.
    let shared = rig.spawn_bundle(MorphWeights::new(vec![0.3, 0.8], None).expect("two weights"));
    rig.insert(body, MeshMorphWeights::Reference(shared));
    assert_equal_pictures("shared weights", &mut rig, body, morphed_in_f64(&sheet(), &[0.3, 0.8]), &material);
}

/// Rays find a body wherever the camera sees it: the boxes of its refitted tree hold its triangles.
fn assert_trees_hold_their_triangles(poses: u32) {
    let Some(mut rig) = stage() else { return };
    let body = spawn_skinned(&mut rig, "tube", tube(), lambert(0.7));
    rig.set(|r| r.debug_view = DebugView::Instances);
    rig.until_ready();
    let (mut holes, mut seen) = (0, 0);
    for pose in 0..poses {
        let joints = swaying(foot(0.2), 1.7 * pose as f32, 1.0 + 0.2 * (pose % 20) as f32);
        set_joints(&mut rig, body, &joints);
        let rasterized = rig.debug(DebugView::Instances);
        let traced = rig.debug(DebugView::TracedInstances);
        holes += differing(&rasterized, &traced, 0.01);
        seen += rasterized.iter().filter(|(_, c)| *c != Vec3::ZERO).count();
    }
    eprintln!("{holes} of {seen} pixels differ between the rasterizer and rays");
    assert!(seen > 2000 * poses as usize && holes * 1000 < seen, "{holes} of {seen}");
}

#[test]
fn trees_hold_their_triangles_after_wild_poses() {
    assert_trees_hold_their_triangles(30);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_trees_hold_their_triangles_after_ten_thousand_poses() {
    assert_trees_hold_their_triangles(10_000);
}

/// A body uploads data only in frames where its pose changes.
#[test]
fn a_still_body_costs_no_upload() {
    let Some(mut rig) = stage() else { return };
    let body = spawn_skinned(&mut rig, "tube", tube(), lambert(0.7));
    rig.until_ready();
    rig.frames(3);
    assert_eq!(rig.report().uploaded_bytes, 0);
    set_joints(&mut rig, body, &swaying(foot(0.3), 0.3, 1.0));
    rig.frame();
    let moving = rig.report().uploaded_bytes;
    rig.frames(4);
    assert!(moving > 0 && rig.report().uploaded_bytes == 0, "{moving}");
}

#[test]
fn poses_that_make_no_sense_show_a_finite_picture() {
    log::listen();
    let Some(mut rig) = stage() else { return };
    let body = spawn_skinned(&mut rig, "tube", tube(), lambert(0.7));
    set_joints(&mut rig, body, &swaying(foot(0.0), 0.0, 0.5));
    rig.until_ready();
    let check = |rig: &mut Rig, what: &str| {
        rig.frames(2);
        assert!(rig.next().is_finite(), "{what}");
        rig.assert_sound();
    };
    // A joint at NaN: the body keeps its last pose, with one warning.
    let joints = swaying(foot(0.0), 0.0, 0.5);
    let before = log::warnings("a pose that is not finite").len();
    for bad in [Vec3::NAN, Vec3::INFINITY] {
        set_joints(&mut rig, body, &joints);
        let first = rig.app.world().get::<SkinnedMesh>(body).expect("it has a skin").joints[0];
        *rig.get_mut::<Transform>(first) = Transform::from_translation(bad);
        check(&mut rig, "a joint that is not finite");
    }
    assert_eq!(log::warnings("a pose that is not finite").len(), before + 1);
    for scale in [0.0, 1e-20, 1e20, -1.0] {
        set_joints(&mut rig, body, &swaying(foot(0.0).with_scale(Vec3::splat(scale)), 0.0, 0.5));
        check(&mut rig, &format!("scale {scale}"));
    }
    set_joints(&mut rig, body, &joints);
    // Fewer joints than the vertices name, joints that do not exist, and no joint at all.
    let all = rig.app.world().get::<SkinnedMesh>(body).expect("it has a skin").clone();
    let gone = rig.app.world_mut().spawn_empty().id();
    rig.app.world_mut().entity_mut(gone).despawn();
    for joints in [all.joints[..1].to_vec(), vec![gone; JOINTS], Vec::new()] {
        rig.insert(body, SkinnedMesh { joints, ..all.clone() });
        check(&mut rig, "missing joints");
    }
    rig.insert(body, SkinnedMesh { inverse_bindposes: Handle::default(), ..all.clone() });
    check(&mut rig, "no inverse bind poses");
    rig.insert(body, all);
    // Weights that do not add up to 1, and vertices without a joint.
    let mut odd = tube();
    let weights: Vec<[f32; 4]> = (0..odd.count_vertices())
        .map(|i| [[0.0; 4], [f32::NAN, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [9.0, 1.0, 1e30, 0.0]][i % 4])
        .collect();
    odd.insert_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, weights);
    odd.insert_attribute(
        Mesh::ATTRIBUTE_JOINT_INDEX,
        VertexAttributeValues::Uint16x4(vec![[0, 65535, 3, 1]; odd.count_vertices()]),
    );
    let mesh = rig.add::<Mesh>(odd);
    rig.insert(body, Mesh3d(mesh));
    rig.until_ready();
    check(&mut rig, "odd weights");
    // Weights of morph targets, also for a mesh that has none.
    let sheet = rig.spawn(sheet(), lambert(0.5), Transform::from_xyz(0.0, 0.0, 1.0));
    for weights in [vec![], vec![f32::NAN], vec![1e30, -1e30], vec![0.5; 300]] {
        set_weights(&mut rig, sheet, &weights);
        set_weights(&mut rig, body, &weights);
        check(&mut rig, &format!("weights {weights:?}"));
    }
    // Bodies come and go for as long as an app runs.
    let remembered = |rig: &Rig| {
        let lengths = table_lengths(&rig.app);
        lengths.iter().find(|(name, _)| *name == "warnings of bodies").map(|(_, length)| *length)
    };
    assert_eq!(remembered(&rig), Some(2));
    rig.app.world_mut().despawn(body);
    rig.frames(2);
    assert_eq!(remembered(&rig), Some(1));
}
