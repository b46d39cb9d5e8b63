//! Many lights, also more than a device can bind: a picture, a warning that says what is missing, and no panic.

use crate::support::{app::*, log};
use bevy::{
    asset::RenderAssetUsages,
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
};
use bevy_restir::{
    Direct, Restir, Technique,
    testing::{gpu_layout::*, lengths::table_lengths},
};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The size of a binding in tests of the limits, in bytes: it holds 8192 lights, with those of the last frame.
const SMALL: u64 = 1 << 20;
const FEW: u64 = SMALL / 2 / size_of::<GpuLight>() as u64;

/// A square sheet of `columns` x `rows` cells, two triangles each, that faces +Z.
fn sheet(side: f32, columns: u32, rows: u32) -> Mesh {
    let corner = |i: u32, n: u32| side * (i as f32 / n as f32 - 0.5);
    let points: Vec<[f32; 3]> =
        (0..=rows).flat_map(|y| (0..=columns).map(move |x| [corner(x, columns), corner(y, rows), 0.0])).collect();
    let cells = (0..rows).flat_map(|y| (0..columns).map(move |x| y * (columns + 1) + x));
    let indices = cells.flat_map(|a| {
        let b = a + columns + 1;
        [a, a + 1, b, a + 1, b + 1, b]
    });
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::RENDER_WORLD)
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, points)
        .with_inserted_indices(Indices::U32(indices.collect()))
}

/// A wall, and `n` x `n` instances of a lamp mesh that tile a square of side 2 and shine at the wall.  They stand between the wall and
/// the camera, which sees them neither edge-on nor from behind.
fn tiled_lamp(rig: &mut Rig, n: u32, tile: Mesh) {
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    let (mesh, material) = (rig.add::<Mesh>(tile), rig.add::<StandardMaterial>(lamp(3.0, 2.0, 1.0)));
    let place = |i: u32| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
    for (x, y) in (0..n * n).map(|i| (i % n, i / n)) {
        let transform = Transform::from_xyz(place(x), place(y), 1.5)
            .with_rotation(Quat::from_rotation_y(core::f32::consts::PI))
            .with_scale(Vec3::splat(2.0 / n as f32));
        rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), transform));
    }
}

/// The light subsets fit the smallest binding.
fn settings(technique: Technique) -> Restir {
    let direct = Direct { subset_count: 8, ..default() };
    Restir { technique, direct, accumulate: true, ..plain() }
}

/// The mean of the picture and its standard error.
fn mean(rig: &mut Rig, technique: Technique) -> (f64, f64) {
    rig.set(|r| *r = settings(technique));
    rig.until_ready();
    let restarts = (1..=12).map(|seed| {
        rig.set(|r| r.seed = seed);
        rig.frames(3);
        let picture = rig.next();
        assert!(picture.is_finite(), "{technique:?}");
        picture.mean()
    });
    mean_and_error(restarts.collect::<Vec<_>>())
}

/// Asserts that both techniques show the lamps with the mean of an equivalent light.
fn assert_shown(rig: &mut Rig, truth: (f64, f64), name: &str) {
    for technique in [Technique::Reference, Technique::Di] {
        let (ours, error) = mean(rig, technique);
        let error = error.hypot(truth.1);
        eprintln!("{name}, {technique:?}: {:+.2} % ± {:.2}", 100.0 * (ours / truth.0 - 1.0), 100.0 * error / truth.0);
        assert!(error < 0.03 * truth.0, "{name}, {technique:?}: {error} of {} is too noisy", truth.0);
        assert!((ours - truth.0).abs() < 4.0 * error, "{name}, {technique:?}: {ours} ± {error}, not {}", truth.0);
        rig.assert_sound();
    }
}

/// The mean picture of one lamp of two triangles.
fn mean_of_one_lamp() -> Option<(f64, f64)> {
    let mut rig = Rig::new(32, 32)?;
    tiled_lamp(&mut rig, 1, square(1.0));
    let mean = mean(&mut rig, Technique::Reference);
    assert_eq!(rig.report().lights, 2);
    assert!(mean.0 > 0.1);
    Some(mean)
}

/// Serializes the tests that count warnings.
fn listen() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    log::listen();
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_million_emissive_triangles_shine_as_one_lamp() {
    let Some(truth) = mean_of_one_lamp() else { return };
    for (name, n, tile) in [("one mesh", 1, sheet(1.0, 1000, 500)), ("a hundred instances", 10, sheet(1.0, 100, 50))] {
        let Some(mut rig) = Rig::new(32, 32) else { return };
        tiled_lamp(&mut rig, n, tile);
        rig.until_ready();
        assert_eq!(rig.report().lights, 1_000_000, "{name}");
        assert_shown(&mut rig, truth, name);
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn emissive_triangles_beyond_the_light_table_still_light_the_scene() {
    let _guard = listen();
    let Some(truth) = mean_of_one_lamp() else { return };
    // 4 x 2000 of the 9 x 2000 lights fit; of 1 x 20000, none.
    for (name, n, tile, lights) in
        [("nine lamps", 3, sheet(1.0, 50, 20), 8000), ("one lamp", 1, sheet(1.0, 100, 100), 0)]
    {
        let before = log::warnings("emissive triangles").len();
        let Some(mut rig) = Rig::binding_at_most(SMALL, 32, 32) else { return };
        tiled_lamp(&mut rig, n, tile);
        rig.until_ready();
        assert_eq!(rig.report().lights, lights, "{name}");
        assert_shown(&mut rig, truth, name);
        let warnings = log::warnings("emissive triangles");
        assert_eq!(warnings.len(), before + 1, "{name}: one warning: {warnings:?}");
        let lost = rig.report().triangles - 2 - lights;
        assert!(warnings[before].contains(&format!("{FEW} lights at most: {lost} emissive triangles")), "{warnings:?}");
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn point_lights_beyond_the_light_table_are_dropped() {
    let _guard = listen();
    let Some(mut rig) = Rig::binding_at_most(SMALL, 17, 13) else { return };
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    // They stand behind the camera, out of reach of Bevy's own light lists, whose buffers would not fit either.
    for i in 0..FEW as u32 + 100 {
        let place = Transform::from_xyz((i % 97) as f32, (i / 97) as f32, 60.0);
        rig.spawn_bundle((PointLight { intensity: 100.0, range: 20.0, ..default() }, place));
    }
    for technique in [Technique::Reference, Technique::Di] {
        rig.set(|r| *r = settings(technique));
        let picture = rig.picture(4);
        assert!(picture.is_finite() && picture.mean() > 0.0, "{technique:?}: {}", picture.mean());
        rig.assert_sound();
        assert_eq!(rig.report().lights, FEW);
    }
    let warnings = log::warnings("100 other lights are left out");
    assert_eq!(warnings.len(), 1, "{warnings:?}");
}

/// Two emissive sheets that nearly fill the table.  The mesh of one is replaced by a larger one, for which the buffer has no free range.
#[test]
fn lights_for_which_no_free_range_is_long_enough_get_other_places() {
    const SHAPES: [(u32, u32); 3] = [(50, 50), (50, 30), (57, 45)];
    let scene = |first: usize| {
        let mut rig = Rig::binding_at_most(SMALL, 24, 16)?;
        rig.set(|r| *r = settings(Technique::Di));
        rig.spawn(square(4.0), lambert(0.5), Transform::default());
        let meshes = SHAPES.map(|(columns, rows)| rig.add::<Mesh>(sheet(1.0, columns, rows)));
        let dark = rig.add::<StandardMaterial>(lambert(0.0));
        for mesh in &meshes {
            let place = Transform::from_xyz(0.0, 0.0, 40.0);
            rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(dark.clone()), place));
        }
        let sheets = [first, 1].map(|shape| {
            let glow = rig.add::<StandardMaterial>(lamp(3.0, 2.0, 1.0));
            let place = Transform::from_xyz(shape as f32 - 1.0, 0.0, 1.5).looking_to(Vec3::Z, Vec3::Y);
            rig.spawn_bundle((Mesh3d(meshes[shape].clone()), MeshMaterial3d(glow), place))
        });
        rig.until_ready();
        Some((rig, meshes, sheets))
    };
    let Some((mut rig, meshes, [sheet, _])) = scene(0) else { return };
    let records =
        |rig: &Rig| table_lengths(&rig.app).into_iter().find(|(name, _)| *name == "lights").map(|(_, count)| count);
    // The edited sheet has its records behind the others, and those of the last frame are free in the next one.
    let glow = rig.material_of(sheet);
    rig.edit(&glow, |m| m.emissive = LinearRgba::rgb(2.0, 2.0, 1.0));
    rig.frames(2);
    assert!(records(&rig) > Some(2 * 5001 + 3001), "{:?}", records(&rig));
    rig.insert(sheet, (Mesh3d(meshes[2].clone()), Transform::from_xyz(1.0, 0.0, 1.5).looking_to(Vec3::Z, Vec3::Y)));
    rig.frames(2);
    assert_eq!((rig.report().lights, records(&rig)), (5130 + 3000, Some(64 + 5131 + 3001)));
    let (mut fresh, _, [sheet, _]) = scene(2).expect("there is an adapter");
    let glow = fresh.material_of(sheet);
    fresh.edit(&glow, |m| m.emissive = LinearRgba::rgb(2.0, 2.0, 1.0));
    assert_eq!(rig.picture(4), fresh.picture(4));
}

#[test]
fn meshes_after_one_that_does_not_fit_are_shown() {
    let _guard = listen();
    let before = log::warnings("does not fit the buffers of this device").len();
    let Some(mut rig) = Rig::binding_at_most(SMALL, 24, 16) else { return };
    rig.insert(rig.camera, orthographic(3.0, 2.0));
    rig.set(|r| r.debug_view = bevy_restir::DebugView::Albedo);
    // 90000 triangles take 1.1 MB.
    rig.spawn(sheet(1.0, 300, 150), lambert(0.5), Transform::from_xyz(-0.75, 0.0, 0.0));
    rig.picture(1);
    rig.spawn(square(1.0), lambert(0.5), Transform::from_xyz(0.75, 0.0, 0.0));
    let picture = rig.picture(1);
    assert_eq!((rig.report().triangles, rig.report().instances), (2, 1));
    assert!(picture.at(18, 8).x > 0.4 && picture.at(6, 8).x == 0.0);
    assert_eq!(log::warnings("does not fit the buffers of this device").len(), before + 1);
}

#[test]
fn a_mesh_that_did_not_fit_is_shown_once_another_one_is_gone() {
    let _guard = listen();
    let Some(mut rig) = Rig::binding_at_most(SMALL, 24, 16) else { return };
    rig.insert(rig.camera, orthographic(3.0, 2.0));
    rig.set(|r| r.debug_view = bevy_restir::DebugView::Albedo);
    // 50000 triangles take 0.6 MB, and their vertices 0.7 MB.
    let first = rig.spawn(sheet(1.0, 200, 125), lambert(0.5), Transform::from_xyz(-0.75, 0.0, 0.0));
    rig.picture(1);
    rig.spawn(sheet(1.0, 200, 125), lambert(0.5), Transform::from_xyz(0.75, 0.0, 0.0));
    let picture = rig.picture(1);
    assert!(picture.at(18, 8).x == 0.0 && picture.at(6, 8).x > 0.4);
    rig.app.world_mut().despawn(first);
    rig.frames(3);
    let picture = rig.picture(1);
    assert!(picture.at(18, 8).x > 0.4 && picture.at(6, 8).x == 0.0);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn instances_beyond_the_limit_are_dropped() {
    let _guard = listen();
    let Some(mut rig) = Rig::binding_at_most(SMALL, 24, 16) else { return };
    let limit = SMALL / size_of::<GpuInstance>() as u64;
    let (mesh, material) = (rig.add::<Mesh>(square(0.1)), rig.add::<StandardMaterial>(lamp(1.0, 1.0, 1.0)));
    let spawn = |rig: &mut Rig, i: u64| {
        let place = Transform::from_xyz((i % 80) as f32 * 0.1 - 4.0, (i / 80) as f32 * 0.1 - 4.0, 0.0);
        rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), place))
    };
    let all: Vec<Entity> = (0..limit + 50).map(|i| spawn(&mut rig, i)).collect();
    let picture = rig.picture(2);
    assert!(picture.is_finite() && picture.mean() > 0.1, "{}", picture.mean());
    assert_eq!(rig.report().instances, limit);
    rig.assert_sound();
    assert_eq!(log::warnings("50 objects are left out").len(), 1);
    // Removing other instances makes room for them.
    for entity in &all[..100] {
        rig.app.world_mut().despawn(*entity);
    }
    rig.picture(1);
    assert_eq!(rig.report().instances, limit - 50);
}
