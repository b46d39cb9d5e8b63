//! Instances that reach 1e18 m: the trees over them are built, and an instance beyond that is left out with one warning.

use crate::support::{app::*, bad_numbers::assert_no_errors, log};
use bevy::prelude::*;
use bevy_restir::Technique;

/// Adds many boxes around the origin, of which a ray that starts in them sees nothing.
fn add_boxes(rig: &mut Rig, count: u32, half_extent: f32) -> Vec<Entity> {
    let (mesh, material) = (rig.add::<Mesh>(Cuboid::from_length(2.0)), rig.add::<StandardMaterial>(lambert(0.5)));
    let at = |i: u32| Transform {
        translation: Vec3::splat(1e-3 * half_extent * i as f32 / count as f32),
        scale: Vec3::splat(0.99 * half_extent),
        ..default()
    };
    (0..count).map(|i| rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), at(i)))).collect()
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn many_instances_of_nearly_1e18_m_do_not_stop_the_app() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.spawn(square(1.0), lambert(0.5), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 2.0)));
    for technique in [Technique::Reference, Technique::Pt] {
        rig.set(|restir| restir.technique = technique);
        for (count, half_extent) in [(120, 9e17), (1_000, 3e17)] {
            let boxes = add_boxes(&mut rig, count, half_extent);
            let picture = rig.picture(2);
            assert!(picture.is_finite() && picture.center().x > 0.1, "{technique:?}: {}", picture.center());
            assert_eq!(rig.report().instances, u64::from(count) + 1);
            assert_no_errors(&rig, "huge boxes");
            boxes.into_iter().for_each(|entity| _ = rig.app.world_mut().despawn(entity));
        }
    }
}

#[test]
fn an_instance_beyond_1e18_m_is_left_out_with_one_warning() {
    log::listen();
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.spawn(square(1.0), lamp(1.0, 1.0, 1.0), Transform::default());
    // The log is that of the whole process, so the entity gets a number that those of other tests do not have.
    let many = rig.app.world_mut().spawn_batch((0..5000).map(|_| Name::new("unused"))).count();
    assert_eq!(many, 5000);
    let far = rig.spawn(square(1.0), lambert(0.5), Transform::from_xyz(2e18, 0.0, 0.0));
    for _ in 0..3 {
        assert!(rig.picture(2).is_finite());
        assert_eq!(rig.report().instances, 1);
    }
    let warnings = log::warnings(&format!("entity {far} has a transform that is singular"));
    assert_eq!(warnings.len(), 1, "{warnings:?}");
}
