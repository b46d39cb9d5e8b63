//! Instances that rest are traced in one tree over all their triangles.  The picture is that of single instances, whatever changes, and the
//! tree serves only while its instances stay as they are.

use crate::support::{app::*, small_scenes::facing};
use bevy::{camera::visibility::RenderLayers, light::NotShadowCaster, prelude::*};
use bevy_restir::testing::lengths::table_lengths;

/// Frames after which instances at rest share a tree again, with time for its build.
const REST: u32 = 150;

/// Number of instances in the tree.
fn resting(rig: &Rig) -> usize {
    let lengths = table_lengths(&rig.app);
    lengths.into_iter().find(|(name, _)| *name == "instances at rest").expect("it is in the list").1
}

/// Turned, scaled and mirrored boxes below a lamp, of which the first one is returned.
fn boxes(apart: bool) -> Option<(Rig, Entity)> {
    let (mut rig, first) = new_boxes(apart)?;
    rig.until_ready();
    Some((rig, first))
}

/// The same before the first frame.
fn new_boxes(apart: bool) -> Option<(Rig, Entity)> {
    let mut rig = Rig::new(32, 32)?;
    if !apart {
        rig.share_a_tree_at_rest();
    }
    rig.set(|restir| restir.bounces = 2);
    rig.spawn(square(8.0), lambert(0.7), Transform::from_xyz(0.0, 0.0, -1.0));
    rig.spawn(square(2.0), lamp(5.0, 4.0, 3.0), facing(Vec3::new(2.0, 2.0, 3.0), Vec3::ZERO));
    let mesh = rig.add::<Mesh>(Cuboid::new(0.5, 0.7, 0.9));
    let mut first = None;
    for i in 0..5 {
        let turn = Quat::from_euler(EulerRot::XYZ, 0.3 * i as f32, 0.7, 0.2);
        let mirrored = if i % 2 == 0 { 1.0 } else { -1.0 };
        let place = Transform::from_xyz(0.6 * i as f32 - 1.2, 0.3 * (i % 3) as f32, 0.0)
            .with_rotation(turn)
            .with_scale(Vec3::new(mirrored, 0.6, 1.2));
        let material = rig.add::<StandardMaterial>(lambert(0.2 + 0.15 * i as f32));
        let entity = rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material), place));
        first.get_or_insert(entity);
    }
    Some((rig, first?))
}

/// Asserts that pictures with the same random numbers are equal up to rounding, which moves a ray past an edge here and there.
fn assert_same_picture(a: &mut Rig, b: &mut Rig, what: &str) {
    let (a, b) = (a.picture(1), b.picture(1));
    assert!(a.mean() > 0.05, "{what}: the picture is black");
    let differ = a.iter().zip(b.iter()).filter(|((_, a), (_, b))| a.distance(*b) > 1e-3 * (a.length() + b.length()));
    let differ = differ.count();
    assert!(differ <= 8, "{what}: {differ} of 1024 pixels differ");
}

/// An edit of the first box.
type Edit = (&'static str, fn(&mut Rig, Entity));

const EDITS: &[Edit] = &[
    ("it moves", |rig, entity| rig.get_mut::<Transform>(entity).translation.y += 0.4),
    ("it turns in place", |rig, entity| rig.get_mut::<Transform>(entity).rotate_z(1.0)),
    ("it disappears", |rig, entity| _ = rig.app.world_mut().despawn(entity)),
    ("it is hidden", |rig, entity| rig.insert(entity, Visibility::Hidden)),
    ("it is on another layer", |rig, entity| rig.insert(entity, RenderLayers::layer(3))),
    ("it casts no shadows", |rig, entity| rig.insert(entity, NotShadowCaster)),
    ("it has another mesh", |rig, entity| {
        let ball = rig.add::<Mesh>(Sphere::new(0.4).mesh().uv(12, 8));
        rig.insert(entity, Mesh3d(ball));
    }),
    ("its mesh changes", |rig, entity| {
        let mesh = rig.app.world().get::<Mesh3d>(entity).expect("it has a mesh").0.clone();
        rig.edit(&mesh, |mesh| *mesh = Cuboid::new(0.9, 0.4, 0.5).into());
    }),
    ("it lets some light through", |rig, entity| {
        let material = rig.material_of(entity);
        rig.edit(&material, |m| {
            m.alpha_mode = AlphaMode::Blend;
            m.base_color.set_alpha(0.5);
        });
    }),
];

/// Asserts that instances leave their tree within the frames that a new mesh may take, which are too few for another tree.
fn assert_tree_is_left(rig: &mut Rig, what: &str) {
    for _ in 0..REST / 5 {
        rig.frame();
        if resting(rig) == 0 {
            return;
        }
    }
    panic!("{what}: {} instances are in the tree", resting(rig));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn instances_at_rest_look_like_single_ones_and_leave_their_tree_when_they_change() {
    let Some((mut fresh, _)) = boxes(false) else { return };
    let (mut apart, _) = boxes(true).expect("there is an adapter");
    assert_eq!((resting(&fresh), resting(&apart)), (7, 0));
    assert_same_picture(&mut fresh, &mut apart, "at rest");
    for (what, edit) in EDITS {
        let (mut rig, entity) = boxes(false).expect("there is an adapter");
        let (mut apart, same) = boxes(true).expect("there is an adapter");
        edit(&mut rig, entity);
        edit(&mut apart, same);
        assert_tree_is_left(&mut rig, what);
        assert_same_picture(&mut rig, &mut apart, what);
        rig.assert_sound();
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_tree_is_built_again_after_a_rest_without_what_still_moves() {
    let Some((mut rig, mover)) = boxes(false) else { return };
    let move_it = |rig: &mut Rig, i: u32| rig.get_mut::<Transform>(mover).translation.y = 0.001 * (i % 7) as f32;
    for i in 0..REST {
        move_it(&mut rig, i);
        rig.frame();
    }
    assert_eq!(resting(&rig), 6, "all but the one that moves");
    rig.frames(2 * REST);
    assert_eq!(resting(&rig), 6, "twelve triangles are no reason for a new tree over 64");
    let ball = Sphere::new(0.2).mesh().uv(12, 8);
    rig.spawn(ball, lambert(0.5), Transform::from_xyz(0.0, 1.2, 0.0));
    rig.until_ready();
    rig.frames(2 * REST);
    assert_eq!(resting(&rig), 8, "a ball of 168 triangles is one, for the box as well");
    rig.assert_sound();
}

#[test]
fn the_others_get_a_tree_again_after_one_disappears() {
    let Some((mut rig, first)) = boxes(false) else { return };
    assert_eq!(resting(&rig), 7);
    rig.app.world_mut().despawn(first);
    rig.frame();
    assert_eq!(resting(&rig), 0, "the tree is left");
    rig.frames(2 * REST);
    assert_eq!(resting(&rig), 6, "nothing else has moved or appeared");
    rig.assert_sound();
}

/// The mesh of water and the like is built all the time.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_mesh_that_is_edited_in_each_frame_does_not_keep_others_from_their_tree() {
    let Some((mut rig, mover)) = new_boxes(false) else { return };
    let water = |i: u32| Plane3d::new(Vec3::Z, Vec2::splat(0.5)).mesh().subdivisions(20 + i % 2).build();
    let mesh = rig.add::<Mesh>(water(0));
    let material = rig.add::<StandardMaterial>(lambert(0.4));
    rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material), Transform::from_xyz(0.0, -1.5, 0.5)));
    let edit = |rig: &mut Rig, i: u32| {
        rig.edit(&mesh, |mesh| *mesh = water(i));
        rig.frame();
        resting(rig)
    };
    for when in ["at the start", "after one of them has moved"] {
        assert!((0..2000).any(|i| edit(&mut rig, i) == 7), "{when}: the others get no tree");
        assert!((0..REST).all(|i| edit(&mut rig, i) == 7), "{when}: the others leave their tree");
        rig.get_mut::<Transform>(mover).translation.y += 0.2;
        assert_eq!(edit(&mut rig, 0), 0, "{when}: one of them moves");
    }
    rig.assert_sound();
}

/// An object that stops shortly before members are chosen is looked at again later, although nothing else happens.
#[test]
#[ignore = "second tier: ./run test --more"]
fn an_object_that_comes_to_rest_enters_the_tree() {
    let Some((mut rig, mover)) = boxes(false) else { return };
    for i in 0..100 {
        rig.get_mut::<Transform>(mover).translation.y = 0.001 * (i % 7) as f32;
        rig.frame();
    }
    assert_eq!(resting(&rig), 6, "it moves");
    let ball = Sphere::new(0.2).mesh().uv(12, 8);
    let ball = rig.spawn(ball, lambert(0.5), Transform::from_xyz(0.0, 1.2, 0.0));
    for i in 0..REST {
        rig.get_mut::<Transform>(ball).translation.y = 1.2 + 0.001 * (i % 7) as f32;
        rig.frame();
    }
    assert_eq!(resting(&rig), 6, "the ball moves");
    rig.frames(2 * REST);
    assert_eq!(resting(&rig), 8, "both rest");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn old_trees_free_their_memory() {
    let Some((mut rig, entity)) = boxes(false) else { return };
    let nodes = |rig: &Rig| table_lengths(&rig.app).into_iter().find(|(name, _)| *name == "nodes").map(|(_, n)| n);
    let mut counts = Vec::new();
    for i in 1..4 {
        rig.get_mut::<Transform>(entity).translation.y = 0.1 * i as f32;
        // Enough frames for the shortest wait, which follows a tree that lived this long, and for the build.
        rig.frames(3 * REST);
        counts.push((resting(&rig), nodes(&rig)));
    }
    assert!(counts.iter().all(|(resting, _)| *resting == 7), "{counts:?}");
    assert!(counts[2].1 <= counts[0].1, "{counts:?}");
}

/// An accumulated picture goes on converging when the tree comes.
#[test]
fn a_new_tree_does_not_restart_an_average() {
    let Some((mut rig, entity)) = boxes(false) else { return };
    rig.set(|restir| restir.accumulate = true);
    rig.get_mut::<Transform>(entity).translation.y += 0.2;
    rig.frames(3);
    let before = rig.report().samples;
    assert_eq!((resting(&rig), before < 4), (0, true));
    rig.frames(REST);
    assert_eq!((resting(&rig), rig.report().samples), (7, before + REST));
}

/// Products of the lengths of their triangles would be infinite.
#[test]
fn huge_instances_stay_outside_of_the_tree() {
    let Some((mut rig, _)) = new_boxes(false) else { return };
    let size = Vec3::splat(1e13);
    rig.spawn(square(1.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -1e13).with_scale(size));
    rig.until_ready();
    rig.frames(REST);
    assert_eq!(resting(&rig), 7, "the floor, the lamp and five boxes");
    rig.assert_sound();
}
