//! Meshes that change faster than their trees are built, that lose and regain their triangles, and the warnings about them.

use crate::support::{app::*, log};
use bevy::{
    asset::{RenderAssetUsages, uuid::Uuid},
    mesh::PrimitiveTopology,
    prelude::*,
};
use bevy_restir::{DebugView, testing::lengths::table_lengths};
use std::time::{Duration, Instant};

/// A square of 126 000 triangles that faces +Z: building its tree takes many frames.
fn heavy(side: f32) -> Mesh {
    Plane3d::new(Vec3::Z, Vec2::splat(0.5 * side)).mesh().subdivisions(250).build()
}

/// A camera that a square of side 2 fills, with albedo shown.
fn rig() -> Option<Rig> {
    let mut rig = Rig::new(32, 32)?;
    rig.insert(rig.camera, orthographic(2.0, 2.0));
    rig.set(|restir| restir.debug_view = DebugView::Albedo);
    Some(rig)
}

fn covered(picture: &Picture) -> usize {
    picture.iter().filter(|(_, color)| color.x > 0.0).count()
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_mesh_that_changes_in_every_frame_is_shown_while_it_changes() {
    let Some(mut rig) = rig() else { return };
    let mesh = rig.add::<Mesh>(heavy(0.2));
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    let entity = rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material), Transform::default()));
    let mut shapes = vec![0];
    for i in 1..400 {
        rig.edit(&mesh, |mesh| *mesh = heavy(0.2 + 0.004 * i as f32));
        let Some(picture) = rig.next_if_any() else { continue };
        let count = covered(&picture);
        let last = *shapes.last().expect("there is one");
        assert!(count >= last, "frame {i}: {count} pixels after {last}, but the mesh only grows");
        if count > last {
            shapes.push(count);
        }
        if shapes.len() > 4 {
            break;
        }
    }
    assert!(shapes.len() > 4, "only these sizes were seen: {shapes:?} pixels");
    // The last of several edits in a row stays.
    for side in [1.4, 0.3, 1.9, 1.0] {
        rig.edit(&mesh, |mesh| *mesh = heavy(side));
        rig.frame();
    }
    rig.until_ready();
    let last = rig.next();
    let fresh = rig.add::<Mesh>(heavy(1.0));
    rig.insert(entity, Mesh3d(fresh));
    rig.until_ready();
    assert_eq!(covered(&last), 16 * 16);
    assert_eq!(last.pixels, rig.next().pixels);
    rig.assert_sound();
}

/// Terrain and the like get a new mesh, not an edited one, and the handle of the old mesh is dropped.
#[test]
fn an_object_with_a_new_mesh_shows_the_old_one_until_the_new_one_is_built() {
    let Some(mut rig) = rig() else { return };
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    let old = rig.add::<Mesh>(square(1.0));
    let entity = rig.spawn_bundle((Mesh3d(old), MeshMaterial3d(material), Transform::default()));
    rig.until_ready();
    let count = |rig: &Rig, wanted| table_lengths(&rig.app).into_iter().find(|(name, _)| *name == wanted);
    let meshes = count(&rig, "meshes");
    let mut sizes = Vec::new();
    for side in [2.0, 0.5] {
        let new = rig.add::<Mesh>(heavy(side));
        rig.insert(entity, Mesh3d(new));
        let expected = if side == 2.0 { 32 * 32 } else { 8 * 8 };
        let picture = (0..2000).map(|_| covered(&rig.next())).find(|count| {
            sizes.push(*count);
            *count == expected
        });
        assert!(picture.is_some(), "the new mesh of side {side} is never shown");
    }
    assert!(sizes.iter().all(|count| [16 * 16, 32 * 32, 8 * 8].contains(count)), "{sizes:?}");
    assert!(sizes.len() > 3, "the meshes were built at once: {sizes:?}");
    rig.until_ready();
    rig.frames(4);
    assert_eq!(count(&rig, "meshes"), meshes, "the old meshes are gone");
    assert_eq!(count(&rig, "meshes without an asset"), Some(("meshes without an asset", 0)));
    rig.assert_sound();
}

#[test]
fn a_mesh_that_was_empty_does_not_show_its_old_shape_again() {
    let Some(mut rig) = rig() else { return };
    let mesh = rig.add::<Mesh>(square(1.0));
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material), Transform::default()));
    rig.until_ready();
    assert_eq!(covered(&rig.next()), 16 * 16);
    rig.edit(&mesh, |mesh| *mesh = square(0.0));
    rig.until_ready();
    assert_eq!(covered(&rig.next()), 0, "the mesh has no triangles");
    rig.edit(&mesh, |mesh| *mesh = heavy(2.0));
    let seen = (0..2000).map(|_| covered(&rig.next())).find(|&count| count > 0);
    assert_eq!(seen, Some(32 * 32), "something other than the new shape");
    rig.until_ready();
    assert_eq!(rig.report().triangles, 251 * 251 * 2);
    rig.assert_sound();
}

/// Renders frames until all meshes are built, those that nothing shows, too.
fn until_built(rig: &mut Rig) {
    let start = Instant::now();
    rig.frame();
    while table_lengths(&rig.app).iter().any(|(name, count)| *name == "meshes that are built" && *count > 0) {
        assert!(start.elapsed() < Duration::from_secs(120), "the meshes are not built");
        rig.frame();
    }
}

#[test]
fn a_mesh_that_loses_its_triangles_before_anything_shows_it_is_not_shown() {
    let Some(mut rig) = rig() else { return };
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    rig.spawn(square(0.2), lambert(0.5), Transform::from_xyz(0.9, 0.9, 0.0));
    let mesh = rig.add::<Mesh>(square(1.0));
    rig.until_ready();
    until_built(&mut rig);
    let before = covered(&rig.next());
    rig.edit(&mesh, |mesh| *mesh = square(0.0));
    until_built(&mut rig);
    rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material), Transform::default()));
    rig.until_ready();
    assert_eq!(covered(&rig.next()), before, "the mesh has no triangles");
    rig.edit(&mesh, |mesh| *mesh = square(1.0));
    rig.until_ready();
    assert_eq!(covered(&rig.next()), before + 16 * 16);
    rig.assert_sound();
}

/// Four triangles; the first `broken` of them have a coordinate that is not finite.
fn partly_broken(broken: usize) -> Mesh {
    let points =
        (0..4).flat_map(|i| [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, if i < broken { f32::NAN } else { 0.0 }]]);
    with_positions(PrimitiveTopology::TriangleList, points.collect())
}

fn with_positions(topology: PrimitiveTopology, points: Vec<[f32; 3]>) -> Mesh {
    Mesh::new(topology, RenderAssetUsages::all()).with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, points)
}

/// A mesh with an id of its own: tests run in parallel and share one log.
fn add_named(rig: &mut Rig, name: u128, mesh: Mesh) -> Handle<Mesh> {
    let handle = Handle::from(Uuid::from_u128(name));
    rig.app.world_mut().resource_mut::<Assets<Mesh>>().insert(&handle, mesh).expect("it was never there");
    handle
}

#[test]
fn a_mesh_gets_one_warning_however_often_it_changes() {
    let Some(mut rig) = rig() else { return };
    log::listen();
    let mesh = add_named(&mut rig, 0xf1a7_0001, partly_broken(1));
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    let entity = rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material), Transform::default()));
    for i in 0..10 {
        rig.until_ready();
        rig.edit(&mesh, |mesh| *mesh = partly_broken(1 + i % 4));
    }
    rig.until_ready();
    let warning_count = |rig: &Rig, of: &Handle<Mesh>| {
        assert!(rig.report().ready);
        let lines = log::warnings(&of.id().to_string());
        ["left out", "no usable triangle"].map(|text| lines.iter().filter(|line| line.contains(text)).count())
    };
    // A mesh without any sound triangle is rejected as a whole.
    assert_eq!(warning_count(&rig, &mesh), [2, 1]);
    // Another asset gets its own warning.
    let other = add_named(&mut rig, 0xf1a7_0002, partly_broken(2));
    rig.insert(entity, Mesh3d(other.clone()));
    rig.until_ready();
    assert_eq!((warning_count(&rig, &mesh), warning_count(&rig, &other)), ([2, 1], [1, 0]));
}

#[test]
fn line_meshes_are_warned_about_only_with_a_standard_material() {
    let Some(mut rig) = rig() else { return };
    log::listen();
    let lines = || with_positions(PrimitiveTopology::LineList, vec![[0.0; 3], [1.0, 0.0, 0.0]]);
    let [elsewhere, ours] = [0x11e5_0001, 0x11e5_0002].map(|name| add_named(&mut rig, name, lines()));
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    let entity = rig.spawn_bundle((Mesh3d(elsewhere.clone()), Transform::default()));
    rig.until_ready();
    let warning_count = |of: &Handle<Mesh>| log::warnings(&of.id().to_string()).len();
    assert_eq!([&elsewhere, &ours].map(warning_count), [0, 0], "a line mesh without a standard material");
    rig.insert(entity, (Mesh3d(ours.clone()), MeshMaterial3d(material)));
    rig.frames(4);
    rig.edit(&ours, |mesh| *mesh = lines());
    rig.until_ready();
    assert_eq!([&elsewhere, &ours].map(warning_count), [0, 1]);
}

/// Meshes of a pack of models of which few are spawned, or of other materials.
#[test]
fn meshes_that_nothing_shows_take_no_room_and_keep_nobody_waiting() {
    let Some(mut rig) = rig() else { return };
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    rig.spawn(square(0.2), lambert(0.5), Transform::from_xyz(0.9, 0.9, 0.0));
    rig.until_ready();
    let bytes =
        |rig: &Rig| rig.report().memory.iter().filter(|(name, _)| *name == "triangles").map(|m| m.1).sum::<u64>();
    let before = bytes(&rig);
    let unused = rig.add::<Mesh>(heavy(1.0));
    for frame in 0..60 {
        // The camera's picture does not depend on it, however often it changes.
        rig.edit(&unused, |mesh| *mesh = heavy(1.0));
        rig.frame();
        assert!(rig.report().ready, "frame {frame}");
    }
    until_built(&mut rig);
    assert_eq!(bytes(&rig), before, "an unused mesh is on the GPU");
    rig.spawn_bundle((Mesh3d(unused), MeshMaterial3d(material), Transform::default()));
    rig.frame();
    let shown = covered(&rig.next());
    assert!(shown >= 16 * 16, "it is built already, so that it is shown at once: {shown} pixels");
    assert!(bytes(&rig) > before);
}

/// Triangles of [`separate_triangles`].
const SEPARATE: u32 = 10_000;

/// Triangles that share no vertex: about a megabyte on the GPU.
fn separate_triangles() -> Mesh {
    let corners = |i: u32| {
        let [x, y] = [i % 100, i / 100].map(|n| 0.01 * n as f32);
        [[x, y, 0.0], [x + 0.008, y, 0.0], [x, y + 0.008, 0.0]]
    };
    with_positions(PrimitiveTopology::TriangleList, (0..SEPARATE).flat_map(corners).collect())
}

/// Renders frames until this many instances are shown.  Returns the bytes that each frame sent.
fn sent_until_shown(rig: &mut Rig, instances: u64) -> Vec<u64> {
    let mut sent = Vec::new();
    while rig.report().instances < instances {
        assert!(sent.len() < 100, "{} of {instances} instances are shown after {sent:?} bytes", rig.report().instances);
        rig.frame();
        let report = rig.report();
        let is_complete = report.instances == instances;
        assert!(is_complete || report.uploaded_bytes == 0 || !report.ready, "nothing waits for the rest: {sent:?}");
        sent.push(report.uploaded_bytes);
    }
    sent
}

/// A level that loads does not stall a frame.
#[test]
fn meshes_that_arrive_together_are_sent_over_several_frames() {
    let Some(mut rig) = rig() else { return };
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    rig.spawn(square(0.2), lambert(0.5), Transform::from_xyz(-0.9, -0.9, 0.0));
    let meshes: Vec<_> = (0..=40).map(|_| rig.add::<Mesh>(separate_triangles())).collect();
    rig.until_ready();
    // All are built before an instance shows them, so that only the limit spreads their uploads over frames.
    until_built(&mut rig);
    let show = |rig: &mut Rig, mesh: &Handle<Mesh>| {
        rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), Transform::default()));
    };
    show(&mut rig, &meshes[0]);
    let one: u64 = sent_until_shown(&mut rig, 2).iter().sum();
    meshes[1..].iter().for_each(|mesh| show(&mut rig, mesh));
    let sent = sent_until_shown(&mut rig, 42);
    assert!(sent.iter().sum::<u64>() > 40 << 20, "{sent:?}");
    // Records and the tree over the instances are small.
    let most = (16 << 20) + one + (64 << 10);
    assert!(sent.iter().all(|bytes| *bytes <= most), "a frame sent more than {most} bytes: {sent:?}");
    let report = rig.until_ready();
    assert_eq!(report.triangles, 2 + 41 * u64::from(SEPARATE));
    rig.assert_sound();
}
