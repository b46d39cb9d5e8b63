//! The CPU keeps the corners of emissive meshes only, and of small ones within a limit.  A mesh that becomes emissive is read back.

use crate::support::{app::*, small_scenes::facing};
use bevy::prelude::*;
use bevy_restir::testing::{
    geometry::{hold_corner_copies, limit_corner_copies},
    lengths::table_lengths,
};

/// Triangles of the ball in [`scene`].
const BALL: u64 = 320;

fn length(rig: &Rig, table: &str) -> usize {
    table_lengths(&rig.app).into_iter().find(|(name, _)| *name == table).expect("it is in the list").1
}

fn copies(rig: &Rig) -> usize {
    length(rig, "meshes with copies of corners")
}

/// A floor, a lamp, and a ball that does not emit, with copies of this many triangles.
fn scene(limit: Option<usize>) -> Option<(Rig, Handle<StandardMaterial>)> {
    let mut rig = Rig::new(32, 32)?;
    if let Some(limit) = limit {
        limit_corner_copies(&mut rig.app, limit);
    }
    rig.set(|restir| restir.bounces = 1);
    rig.spawn(square(8.0), lambert(0.7), Transform::from_xyz(0.0, 0.0, -1.0));
    rig.spawn(square(1.0), lamp(5.0, 4.0, 3.0), facing(Vec3::new(2.0, 2.0, 3.0), Vec3::ZERO));
    let ball = Sphere::new(0.4).mesh().ico(3).expect("few enough vertices");
    let ball = rig.spawn(ball, lambert(0.5), Transform::from_xyz(0.2, 0.1, 0.0).with_scale(Vec3::new(1.0, 0.5, 1.5)));
    let material = rig.material_of(ball);
    rig.until_ready();
    Some((rig, material))
}

#[test]
fn a_mesh_that_becomes_emissive_is_read_back() {
    let (Some((mut usual, usual_ball)), Some((mut limited, limited_ball))) = (scene(None), scene(Some(0))) else {
        return;
    };
    assert_eq!([&usual, &limited].map(copies), [3, 1], "only the lamp has a copy");
    let mut pictures = Vec::new();
    for (rig, ball) in [(&mut usual, &usual_ball), (&mut limited, &limited_ball)] {
        assert_eq!(rig.report().lights, 2);
        rig.edit(ball, |material| material.emissive = LinearRgba::rgb(2.0, 3.0, 4.0));
        // As many frames for both, so that their random numbers are equal.
        rig.frames(12);
        assert_eq!(rig.report().lights, 2 + BALL);
        pictures.push(rig.picture(4));
    }
    assert_eq!([&usual, &limited].map(copies), [3, 2]);
    assert_eq!(length(&limited, "meshes that are read back"), 0);
    assert!(pictures[0].mean() > 0.05);
    for ((at, a), (_, b)) in pictures[0].iter().zip(pictures[1].iter()) {
        assert_eq!(a, b, "{at}: lights of a mesh that was read back are chosen as those of any other");
    }
    // A mesh that emits no more has no copy.
    limited.edit(&limited_ball, |material| material.emissive = LinearRgba::BLACK);
    limited.frames(3);
    assert_eq!((limited.report().lights, copies(&limited)), (2, 1));
}

/// The device answers when nothing else changes any more.
#[test]
fn a_copy_that_comes_late_adds_its_lights() {
    let Some((mut rig, ball)) = scene(Some(0)) else { return };
    hold_corner_copies(&mut rig.app, true);
    rig.edit(&ball, |material| material.emissive = LinearRgba::rgb(2.0, 3.0, 4.0));
    rig.frames(6);
    assert_eq!((rig.report().lights, length(&rig, "meshes that are read back")), (2, 1));
    hold_corner_copies(&mut rig.app, false);
    rig.frames(2);
    assert_eq!((rig.report().lights, copies(&rig)), (2 + BALL, 2));
    rig.frames(2);
    let visited = rig.report().visited;
    assert!(visited.iter().all(|(_, count)| *count == 0), "nothing changes any more: {visited:?}");
}

#[test]
fn the_largest_meshes_have_no_copies() {
    // The lamp emits; the floor and the ball have 2 and 320 triangles.
    for (limit, expected) in [(322, 3), (321, 2), (2, 2), (1, 1)] {
        let Some((rig, _)) = scene(Some(limit)) else { return };
        assert_eq!(copies(&rig), expected, "{limit} triangles");
    }
}

#[test]
fn meshes_without_copies_are_traced_as_single_instances() {
    let Some((mut rig, _)) = scene(Some(0)) else { return };
    rig.share_a_tree_at_rest();
    rig.frames(150);
    assert_eq!(length(&rig, "instances at rest"), 0, "one copy is too few for a tree");
}
