//! Instances that move: the top-level tree follows them, and frames in which few of many move send few bytes.

use crate::support::app::*;
use bevy::prelude::*;
use bevy_restir::testing::geometry::top_level::{TopLevels, read_top_levels};

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
        let TopLevels { current, previous, expected } = read_top_levels(&rig.app).expect("the plugin runs");
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
    // The first two write the whole tree: it has two copies.
    let later = sent[2..].iter().max().expect("eight frames");
    assert!(sent[0] > 30_000 && *later < 10_000, "{sent:?}");
    rig.frames(2);
    assert_eq!(rig.report().uploaded_bytes, 0);
}
