//! Pictures beside those of Bevy's rasterizer, where both should show the same.

use crate::support::app::{Rig, cube_texture, lambert, lamp, orthographic, plain, sky, square, texture};
use bevy::{
    camera::Exposure,
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    light::{Skybox, cluster::ClusterConfig},
    mesh::{UvChannel, VertexAttributeValues},
    pbr::ShadowView,
    prelude::*,
    render::RenderApp,
};
use bevy_restir::{DebugView, EmissiveLuminance, Restir, RestirEnvironment, RestirIgnore, Technique};

/// A camera whose target holds exposed radiance without further effects, at Bevy's default exposure, and the defaults of the plugin.
fn rig() -> Option<Rig> {
    let mut rig = Rig::new(64, 48)?;
    rig.app.insert_resource(EmissiveLuminance::default());
    let bare = (Tonemapping::None, DebandDither::Disabled, Msaa::Off, Exposure::default(), ClusterConfig::Single);
    rig.insert(rig.camera, bare);
    Some(rig)
}

/// Numbers of the pixels whose colors or alpha differ by more than 2/255 from those of Bevy, and the range of all values.
fn compare(rig: &mut Rig) -> (usize, u8) {
    let [ours, bevys] = rig.beside_bevy();
    let differ = |(a, b): &(&[u8; 4], &[u8; 4])| (0..4).any(|i| a[i].abs_diff(b[i]) > 2);
    let values = || bevys.iter().flatten();
    let range = values().max().zip(values().min()).map_or(0, |(high, low)| high - low);
    (ours.iter().zip(&bevys).filter(differ).count(), range)
}

/// A square with a color of its own at each corner.
fn colored(side: f32, colors: [[f32; 4]; 4]) -> Mesh {
    square(side).with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, VertexAttributeValues::Float32x4(colors.to_vec()))
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn unlit_and_emissive_materials_and_vertex_colors_look_as_in_bevy() {
    let Some(mut rig) = rig() else { return };
    let unlit = |r: f32, g: f32, b: f32| StandardMaterial { unlit: true, ..Color::linear_rgb(r, g, b).into() };
    let red_to_blue = [[1.0, 0.0, 0.0, 1.0], [1.0, 0.5, 0.0, 1.0], [0.0, 0.2, 1.0, 0.0], [0.0, 0.9, 0.5, 0.2]];
    let mask = AlphaMode::Mask(0.5);
    let weighted = |emissive: f32, emissive_exposure_weight: f32| StandardMaterial {
        emissive_exposure_weight,
        ..lamp(emissive, 0.5 * emissive, 0.25 * emissive)
    };
    let at = |column: f32, row: f32| Transform::from_xyz(1.1 * (column - 1.5), 1.1 * (row - 1.0), 0.0);
    rig.spawn(square(1.0), unlit(0.7, 0.2, 0.4), at(0.0, 0.0));
    rig.spawn(colored(1.0, red_to_blue), unlit(0.8, 1.0, 1.0), at(1.0, 0.0));
    rig.spawn(colored(1.0, red_to_blue), StandardMaterial { alpha_mode: mask, ..unlit(1.0, 1.0, 1.0) }, at(2.0, 0.0));
    rig.spawn(colored(1.0, [[1.0; 4]; 4]), unlit(0.3, 0.6, 0.9), at(3.0, 0.0));
    rig.spawn(square(1.0), weighted(0.8, 0.0), at(0.0, 1.0));
    rig.spawn(square(1.0), weighted(1.5, 0.5), at(1.0, 1.0));
    rig.spawn(square(1.0), weighted(500.0, 1.0), at(2.0, 1.0));
    // The mask is in a texture with the second coordinates, which show a part of it.
    let half = rig.add::<Image>(texture(2, 1, |x, _| [90, 200, 60, 255 * x as u8]));
    let turned = VertexAttributeValues::Float32x2(vec![[0.0, 0.0], [0.0, 0.0], [0.8, 0.0], [0.8, 0.0]]);
    let textured = StandardMaterial {
        base_color_texture: Some(half),
        base_color_channel: UvChannel::Uv1,
        alpha_mode: mask,
        ..unlit(1.0, 1.0, 1.0)
    };
    rig.spawn(square(1.0).with_inserted_attribute(Mesh::ATTRIBUTE_UV_1, turned), textured, at(3.0, 1.0));
    rig.get_mut::<Camera>(rig.camera).clear_color = ClearColorConfig::Custom(Color::srgba(0.2, 0.3, 0.4, 0.25));
    for technique in [Technique::Reference, Technique::Pt] {
        rig.set(|restir| *restir = Restir { technique, ..plain() });
        let (different, range) = compare(&mut rig);
        assert!(range > 150, "{range}");
        // A few pixels at edges.
        assert!(different <= 12, "{technique:?}: {different} pixels differ");
    }
    rig.assert_sound();
}

/// Also where the exposure of an app is not that of Bevy's default camera.
#[test]
fn lamps_look_as_bright_as_bevy_draws_them_at_the_exposure_of_their_luminance() {
    let Some(mut rig) = rig() else { return };
    rig.spawn(square(2.0), lamp(0.8, 0.4, 0.2), Transform::default());
    for ev100 in [2.0, 9.7, 15.0] {
        let exposure = Exposure { ev100 };
        rig.app.insert_resource(EmissiveLuminance::for_exposure(&exposure));
        rig.insert(rig.camera, exposure);
        let (different, range) = compare(&mut rig);
        assert!(range > 150 && different <= 4, "EV {ev100}: {different} pixels differ, range {range}");
        let luminance = rig.picture(1).center().x * exposure.exposure();
        assert!((luminance - 0.8).abs() < 1e-3, "EV {ev100}: {luminance}");
    }
    assert_eq!(EmissiveLuminance::for_exposure(&Exposure::default()), EmissiveLuminance::default());
    rig.assert_sound();
}

/// Bevy does not clamp them, so that lasers and signs glow.
#[test]
fn unlit_colors_above_one_keep_their_brightness_and_hue() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, orthographic(1.0, 1.0));
    let glow = StandardMaterial { unlit: true, ..Color::linear_rgb(14.0, 5.0, 0.5).into() };
    let glowing = rig.spawn(square(2.0), glow, Transform::default());
    let check = |rig: &mut Rig, colors: &str| {
        for technique in [Technique::Reference, Technique::Di] {
            rig.set(|restir| *restir = Restir { technique, ..plain() });
            let seen = rig.picture(2).center();
            let wanted = Vec3::new(14.0, 5.0, 0.5);
            assert!((seen / wanted - 1.0).abs().max_element() < 0.01, "{colors}, {technique:?}: {seen}, not {wanted}");
        }
    };
    check(&mut rig, "of the material");
    let mesh = rig.add::<Mesh>(colored(2.0, [[7.0, 5.0, 1.0, 1.0]; 4]));
    let half = rig.add::<StandardMaterial>(StandardMaterial { unlit: true, ..Color::linear_rgb(2.0, 1.0, 0.5).into() });
    rig.insert(glowing, (Mesh3d(mesh), MeshMaterial3d(half)));
    check(&mut rig, "of vertices");
}

/// A floor reflects light by its vertex colors.
#[test]
fn vertex_colors_color_the_reflected_light() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, (orthographic(1.0, 1.0), sky(1.0)));
    let floor = rig.spawn(colored(2.0, [[0.25, 0.5, 1.0, 1.0]; 4]), lambert(0.8), Transform::default());
    let seen = rig.picture(64).center();
    let wanted = 0.8 * Vec3::new(0.25, 0.5, 1.0);
    assert!((seen - wanted).abs().max_element() < 0.01, "{seen}, not {wanted}");
    // The texture of vertex colors disappears with the last such mesh.
    let bytes =
        |rig: &Rig| rig.report().memory.iter().filter(|(name, _)| *name == "vertex colors").map(|m| m.1).sum::<u64>();
    assert!(bytes(&rig) > 0);
    let plain_mesh = rig.add::<Mesh>(square(2.0));
    rig.insert(floor, Mesh3d(plain_mesh));
    let seen = rig.picture(64).center();
    assert!((seen - 0.8).abs().max_element() < 0.01, "{seen}, not 0.8");
    rig.frames(4);
    assert_eq!(bytes(&rig), 0);
}

#[test]
fn a_camera_that_inverts_culling_sees_the_back_faces() {
    let Some(mut rig) = rig() else { return };
    let unlit = |r: f32, g: f32, b: f32| StandardMaterial { unlit: true, ..Color::linear_rgb(r, g, b).into() };
    // Only the far walls of the box face the camera with their back sides.
    let turned = Transform::from_rotation(Quat::from_euler(EulerRot::XYZ, 0.4, 0.6, 0.0));
    rig.spawn(colored(1.0, [[0.5, 0.9, 0.1, 1.0]; 4]), unlit(1.0, 1.0, 1.0), Transform::from_xyz(0.0, 0.0, 2.0));
    rig.spawn(Cuboid::from_length(2.0), unlit(0.6, 0.3, 0.2), turned);
    let both = StandardMaterial { cull_mode: None, ..unlit(0.1, 0.2, 0.9) };
    rig.spawn(square(1.0), both, Transform::from_xyz(-1.5, 0.5, 0.5));
    let mut pictures = Vec::new();
    for inverted in [false, true] {
        rig.get_mut::<Camera>(rig.camera).invert_culling = inverted;
        let (different, _) = compare(&mut rig);
        assert!(different <= 12, "inverted: {inverted}: {different} pixels differ");
        pictures.push(rig.picture(1));
    }
    assert_ne!(pictures[0].center(), pictures[1].center());
    // The mean starts again.
    assert_eq!(rig.next().samples, 2);
    rig.get_mut::<Camera>(rig.camera).invert_culling = false;
    let picture = rig.next();
    assert_eq!((picture.samples, picture.center()), (1, pictures[0].center()));
}

#[test]
fn the_cameras_environment_and_debug_views_cover_its_skybox() {
    let Some(mut rig) = rig() else { return };
    let image = rig.add::<Image>(cube_texture(255));
    rig.insert(rig.camera, Skybox { image: Some(image), brightness: 1000.0, ..default() });
    let target = rig.target.clone();
    let shown = |rig: &mut Rig| {
        rig.picture(1);
        rig.drawn(&target)[0][0]
    };
    let skybox = shown(&mut rig);
    assert!(skybox > 200, "the skybox: {skybox}");
    rig.set(|restir| restir.debug_view = DebugView::Normals);
    assert_eq!(shown(&mut rig), 0, "a debug view");
    rig.set(|restir| restir.debug_view = DebugView::Off);
    rig.insert(rig.camera, sky(50.0));
    let own = shown(&mut rig);
    assert!((10..skybox - 20).contains(&own), "the camera's environment: {own}");
    rig.app.world_mut().entity_mut(rig.camera).remove::<RestirEnvironment>();
    assert_eq!(shown(&mut rig), skybox, "the skybox again");
}

/// Bevy's shadow maps cost time and memory, and only meshes that Bevy lights read them.
#[test]
fn bevy_draws_shadow_maps_only_for_meshes_that_it_lights() {
    let Some(mut rig) = rig() else { return };
    rig.spawn(square(3.0), lambert(0.5), Transform::default());
    let front = Transform::from_xyz(0.0, 0.0, 3.0);
    rig.spawn_bundle((PointLight { shadow_maps_enabled: true, ..default() }, front));
    rig.spawn_bundle((SpotLight { shadow_maps_enabled: true, ..default() }, front.looking_at(Vec3::ZERO, Vec3::Y)));
    rig.spawn_bundle((DirectionalLight { shadow_maps_enabled: true, ..default() }, front));
    let maps = |rig: &mut Rig| {
        rig.until_ready();
        rig.frames(3);
        let world = rig.app.sub_app_mut(RenderApp).world_mut();
        world.query::<&ShadowView>().iter(world).count()
    };
    assert_eq!(maps(&mut rig), 0);
    // Six sides of a cube, one map, and four cascades.
    let custom = rig.spawn(square(0.5), lambert(0.5), Transform::from_xyz(0.0, 0.0, 0.5));
    rig.insert(custom, RestirIgnore);
    assert_eq!(maps(&mut rig), 11, "beside a mesh that Bevy draws");
    rig.app.world_mut().despawn(custom);
    assert_eq!(maps(&mut rig), 0, "without it");
    let settings = rig.app.world_mut().entity_mut(rig.camera).take::<Restir>().expect("it has some");
    rig.frames(4);
    let world = rig.app.sub_app_mut(RenderApp).world_mut();
    assert_eq!(world.query::<&ShadowView>().iter(world).count(), 11, "without Restir");
    rig.insert(rig.camera, settings);
    assert_eq!(maps(&mut rig), 0, "with Restir again");
    rig.assert_sound();
}
