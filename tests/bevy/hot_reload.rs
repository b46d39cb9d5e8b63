//! Files that change on disk and are loaded again while their scene is rendered: the picture becomes that of an app that loads the new file.

use crate::support::{app::*, cli::Folder, gltf::Scene};
use bevy::{
    gltf::{Gltf, GltfAssetLabel},
    mesh::VertexAttributeValues,
    prelude::*,
};
use bevy_restir::{Restir, Technique};
use std::path::Path;

/// A picture of the reference tracer and one of direct light, and the numbers of instances, triangles and lights.
fn pictures(rig: &mut Rig) -> ([Picture; 2], [u64; 3]) {
    let pictures = [Technique::Reference, Technique::Di].map(|technique| {
        rig.set(|restir| *restir = Restir { technique, bounces: 2, ..plain() });
        rig.picture(4)
    });
    rig.assert_sound();
    let report = rig.report();
    (pictures, [report.instances, report.triangles, report.lights])
}

/// Loads a file of an app again.
fn reload(rig: &Rig, path: &Path) {
    rig.app.world().resource::<AssetServer>().reload(path.to_path_buf());
}

/// Writes an image of one color.
fn write_image(path: &Path, size: u32, color: [u8; 3]) {
    image::RgbImage::from_pixel(size, size, image::Rgb(color)).save(path).expect("the folder can be written");
}

/// A wall that has the image as its color, and a lamp that has it as its emission.
fn textured_scene(path: &Path) -> Option<(Rig, Handle<Image>)> {
    let mut rig = Rig::new(16, 12)?;
    let image: Handle<Image> = rig.app.world().resource::<AssetServer>().load(path.to_path_buf());
    let painted = StandardMaterial { base_color_texture: Some(image.clone()), ..lambert(1.0) };
    rig.spawn(square(3.0), painted, Transform::from_xyz(-1.5, 0.0, 0.0));
    rig.spawn(square(3.0), lambert(0.8), Transform::from_xyz(1.5, 0.0, 0.0));
    let glowing = StandardMaterial { emissive_texture: Some(image.clone()), ..lamp(4.0, 4.0, 4.0) };
    rig.spawn(square(1.0), glowing, Transform::from_xyz(0.3, 0.5, 1.5).looking_to(Vec3::Z, Vec3::Y));
    Some((rig, image))
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn an_image_that_is_loaded_again_shows_and_emits_its_new_color() {
    let Some(folder) = Folder::new("reloaded_image") else { return };
    let path = folder.path("color.png");
    write_image(&path, 8, [230, 60, 20]);
    let Some((mut rig, image)) = textured_scene(&path) else { return };
    let has_size = |world: &World, size| {
        world.resource::<Assets<Image>>().get(&image).is_some_and(|image| image.size() == UVec2::splat(size))
    };
    rig.wait_for("the image", |world| has_size(world, 8));
    let (before, _) = pictures(&mut rig);
    write_image(&path, 20, [20, 90, 250]);
    reload(&rig, &path);
    rig.wait_for("the new image", |world| has_size(world, 20));
    let after = pictures(&mut rig);
    drop(rig);
    let (mut fresh, image) = textured_scene(&path).expect("there is an adapter");
    fresh.wait_for("the image", |world| world.resource::<Assets<Image>>().contains(&image));
    assert_eq!(after, pictures(&mut fresh));
    for (before, after) in before.iter().zip(&after.0) {
        // The wall on the left, and the light that the lamp casts on the gray wall.
        for (x, y) in [(4, 3), (12, 6)] {
            let (before, after) = (before.at(x, y), after.at(x, y));
            assert!(before.x > 3.0 * before.z && after.z > 3.0 * after.x, "at {x}, {y}: {before}, then {after}");
        }
    }
}

/// The scene of a file above a gray floor.  The file can be loaded again as long as its handle lives.
fn scene_of_file(path: &Path) -> Option<(Rig, Handle<Gltf>)> {
    let mut rig = Rig::new(16, 12)?;
    rig.spawn(square(8.0), lambert(0.8), Transform::from_xyz(0.0, -1.2, 0.0).looking_to(Vec3::NEG_Y, Vec3::Z));
    rig.insert(rig.camera, Transform::from_xyz(0.0, 1.5, 5.0).looking_at(Vec3::ZERO, Vec3::Y));
    let server = rig.app.world().resource::<AssetServer>().clone();
    let scene = server.load(GltfAssetLabel::Scene(0).from_asset(path.to_path_buf()));
    rig.spawn_bundle(WorldAssetRoot(scene));
    Some((rig, server.load(path.to_path_buf())))
}

/// Waits until the scene of the file is spawned with its upper right corner at this place.
fn wait_for_corner(rig: &mut Rig, corner: [f32; 3]) {
    let has_corner = |mesh: &Mesh| match mesh.attribute(Mesh::ATTRIBUTE_POSITION) {
        Some(VertexAttributeValues::Float32x3(positions)) => positions[2] == corner,
        _ => false,
    };
    let is_spawned = |world: &World| {
        let meshes = world.resource::<Assets<Mesh>>();
        let mut spawned = world.iter_entities().filter_map(|entity| entity.get::<Mesh3d>());
        spawned.any(|mesh| meshes.get(mesh).is_some_and(has_corner))
    };
    rig.wait_for("the scene", is_spawned);
    // The entities of the old file are gone, and transforms are propagated, one frame later.
    rig.frames(2);
}

#[test]
fn a_scene_that_is_loaded_again_has_its_new_shape_and_light() {
    let Some(folder) = Folder::new("reloaded_scene") else { return };
    let old = Scene { camera: false, ..default() };
    let path = folder.gltf("square.gltf", &old);
    let Some((mut rig, _file)) = scene_of_file(&path) else { return };
    wait_for_corner(&mut rig, [1.0, 1.0, 0.0]);
    let (before, counts) = pictures(&mut rig);
    // The square becomes a kite of another color.
    let move_corner: fn(&mut [u8]) = |bytes| {
        bytes[24..36].copy_from_slice(bytemuck::cast_slice(&[0.2f32, 0.3, 0.5]));
    };
    folder.gltf("square.gltf", &Scene { emissive: [0.9, 0.3, 0.1], edit_bytes: move_corner, ..old });
    reload(&rig, &path);
    wait_for_corner(&mut rig, [0.2, 0.3, 0.5]);
    let after = pictures(&mut rig);
    drop(rig);
    let (mut fresh, _file) = scene_of_file(&path).expect("there is an adapter");
    wait_for_corner(&mut fresh, [0.2, 0.3, 0.5]);
    assert_eq!(after, pictures(&mut fresh));
    assert_eq!(counts, after.1, "instances, triangles and lights");
    for (before, after) in before.iter().zip(&after.0) {
        let [before, after] = [before, after].map(|picture| picture.iter().map(|(_, c)| c).sum::<Vec3>());
        assert!(before.z > 2.0 * before.x && after.x > 2.0 * after.z, "{before}, then {after}");
    }
}
