//! Instances that move: the GPU has their records, the top-level tree follows them, and frames in which few of many move send few bytes.

use crate::support::app::*;
use bevy::prelude::*;
use bevy_restir::{
    DebugView,
    testing::{
        geometry::top_level::{TopLevels, read_top_levels},
        storage::allocation::plant_failed_allocations,
    },
};

/// A grid of small squares before the camera.
fn grid(count: usize) -> Option<(Rig, Vec<Entity>)> {
    let mut rig = Rig::new(16, 16)?;
    rig.spawn_bundle((DirectionalLight::default(), Transform::default()));
    let (mesh, material) = (rig.add::<Mesh>(square(0.05)), rig.add::<StandardMaterial>(lambert(0.5)));
    let columns = count.isqrt();
    let squares = (0..count)
        .map(|i| {
            let place = 0.1 * Vec3::new((i % columns) as f32, (i / columns) as f32, 0.0) - Vec3::new(1.0, 1.0, 0.0);
            let look = (Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()));
            rig.spawn_bundle((look, Transform::from_translation(place)))
        })
        .collect();
    rig.until_ready();
    rig.frames(3);
    Some((rig, squares))
}

/// Moves some of the squares a little; each frame moves others.
fn shake(rig: &mut Rig, squares: &[Entity], movers: usize, frame: usize) {
    for i in 0..movers {
        let entity = squares[(i * squares.len() / movers + 7 * frame) % squares.len()];
        rig.get_mut::<Transform>(entity).translation.z = 0.01 * ((frame + i) % 5) as f32 - 0.02;
    }
}

#[test]
fn the_gpu_has_the_top_levels_of_this_frame_and_of_the_last() {
    let Some((mut rig, mut squares)) = grid(600) else { return };
    let mut last = read_top_levels(&rig.app).expect("the plugin runs").current;
    // Few move, then none, then all; one moves far away, and one disappears.
    let movers = [3, 3, 5, 0, 1, 0, 0, 2, 600, 600, 4, 600, 1, 1, 1, 0, 3, 3, 3, 3, 0, 2];
    for (frame, movers) in movers.into_iter().enumerate() {
        shake(&mut rig, &squares, movers, frame);
        match frame {
            13 => rig.get_mut::<Transform>(squares[300]).translation.x = 100.0,
            18 => _ = rig.app.world_mut().despawn(squares.pop().expect("there are squares")),
            _ => {}
        }
        rig.frame();
        let TopLevels { current, previous, expected, .. } = read_top_levels(&rig.app).expect("the plugin runs");
        assert!(current == expected, "frame {frame}");
        assert!(previous == last, "frame {frame}: the last one");
        assert_eq!(current != previous, movers > 0, "frame {frame}");
        last = current;
    }
    rig.assert_sound();
}

#[test]
fn one_mover_among_many_sends_few_bytes() {
    let Some((mut rig, squares)) = grid(2000) else { return };
    let mut sent = Vec::new();
    for frame in 0..8 {
        shake(&mut rig, &squares[700..701], 1, frame);
        rig.frame();
        sent.push(rig.report().uploaded_bytes);
    }
    // The first one writes the second copy of the tree.
    let later = sent[1..].iter().max().expect("eight frames");
    assert!(sent[0] > 30_000 && *later < 10_000, "{sent:?}");
    rig.frames(2);
    assert_eq!(rig.report().uploaded_bytes, 0);
}

/// Their placements are computed in several threads.  In each frame the rig compares them with those of single visits.
#[test]
fn a_crowd_that_moves_at_once_is_where_it_went() {
    let Some((mut rig, squares)) = grid(1500) else { return };
    for frame in 0..3 {
        shake(&mut rig, &squares, 1500, frame);
        rig.frame();
        let TopLevels { current, expected, traced, .. } = read_top_levels(&rig.app).expect("the plugin runs");
        assert!(current == expected, "frame {frame}");
        current.assert_holds(&traced);
    }
    rig.assert_sound();
}

/// The number of squares in a wall.
const WALL: usize = 100;

/// A camera before a wall, the look of its squares, and those squares that are there already, in the plane z = 0.
fn wall(count: usize) -> Option<(Rig, (Mesh3d, MeshMaterial3d<StandardMaterial>), Vec<Entity>)> {
    let mut rig = Rig::new(32, 32)?;
    rig.insert(rig.camera, orthographic(2.0, 2.0));
    rig.spawn_bundle((DirectionalLight::default(), Transform::default()));
    let look = (Mesh3d(rig.add::<Mesh>(square(0.18))), MeshMaterial3d(rig.add::<StandardMaterial>(lambert(0.5))));
    let squares = (0..count).map(|i| rig.spawn_bundle((look.clone(), place(i, 0.0)))).collect();
    rig.until_ready();
    rig.frames(3);
    Some((rig, look, squares))
}

/// The place of a square in a wall of ten columns.
fn place(i: usize, z: f32) -> Transform {
    Transform::from_xyz(0.2 * (i % 10) as f32 - 0.9, 0.2 * (i / 10) as f32 - 0.9, z)
}

/// Asserts that a wall with these squares at this height looks like one that was built so.
fn assert_raised(rig: &mut Rig, raised: impl Iterator<Item = usize>, z: f32) {
    let (mut fresh, _, squares) = wall(WALL).expect("there is an adapter");
    let flat = fresh.debug(DebugView::Depth);
    for i in raised {
        // An object in another slot, which has never moved.
        fresh.app.world_mut().despawn(squares[i]);
        let (mesh, material) = (fresh.add::<Mesh>(square(0.18)), fresh.add::<StandardMaterial>(lambert(0.5)));
        fresh.spawn_bundle((Mesh3d(mesh), MeshMaterial3d(material), place(i, z)));
    }
    let expected = fresh.debug(DebugView::Depth);
    assert_ne!(expected, flat);
    assert_eq!(rig.debug(DebugView::Depth), expected);
    rig.assert_sound();
}

/// Their records are copied one by one.
#[test]
fn movers_that_lie_apart_are_where_they_went() {
    let Some((mut rig, _, squares)) = wall(WALL) else { return };
    let movers = || (0..WALL).step_by(20);
    for z in [0.1, 0.3] {
        for i in movers() {
            *rig.get_mut::<Transform>(squares[i]) = place(i, z);
        }
        rig.frame();
    }
    assert_raised(&mut rig, movers(), 0.3);
}

/// The records of instances that appeared or moved when there was no memory are sent later, although nothing changes then.
#[test]
fn records_that_did_not_fit_the_memory_are_right_once_they_fit() {
    let Some((mut rig, look, squares)) = wall(1) else { return };
    plant_failed_allocations(&rig.app, &["instances"]);
    for i in 1..WALL {
        rig.spawn_bundle((look.clone(), place(i, 0.0)));
    }
    *rig.get_mut::<Transform>(squares[0]) = place(0, 0.3);
    rig.frames(6);
    assert!(rig.next_if_any().is_none(), "the records do not fit");
    plant_failed_allocations(&rig.app, &[]);
    assert_raised(&mut rig, 0..1, 0.3);
}
