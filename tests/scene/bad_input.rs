//! Invalid scene content in a whole app: no panic, no NaN, and the rest of the picture is unchanged.

use crate::support::{app::*, log};
use bevy::{
    asset::{Asset, RenderAssetUsages},
    camera::{Viewport, primitives::CubemapLayout},
    core_pipeline::prepass::{DeferredPrepass, NormalPrepass},
    light::{DirectionalLightTexture, PointLightTexture, SpotLightTexture, VolumetricFog},
    mesh::{Indices, PrimitiveTopology},
    pbr::{AtmosphereSettings, ContactShadows, DistanceFog, Lightmap},
    prelude::*,
    render::render_resource::TextureFormat,
};
use bevy_restir::{DebugView, EmissiveLuminance, RestirEnvironment};

/// A lit wall in the left half of the image, which must stay the same whatever stands in the right half.
struct Scene {
    rig: Rig,
    alone: Picture,
}

fn scene() -> Option<Scene> {
    let mut rig = Rig::new(24, 16)?;
    rig.insert(rig.camera, orthographic(3.0, 2.0));
    rig.spawn(square(1.4), lambert(0.5), Transform::from_xyz(-0.75, 0.0, 0.0));
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(-0.75, 0.0, 2.0)));
    let alone = rig.picture(2);
    assert!(alone.at(6, 8).x > 0.1);
    Some(Scene { rig, alone })
}

impl Scene {
    /// Asserts that the wall is lit as before.
    fn check(&mut self, name: &str) {
        let picture = self.rig.picture(2);
        assert!(picture.is_finite(), "{name}");
        for (at, color) in picture.iter().filter(|(at, _)| at.x < 12) {
            let wanted = self.alone.at(at.x, at.y);
            assert!(
                (color - wanted).abs().max_element() <= 1e-3 * wanted.max_element() + 1e-6,
                "{name}: {color} at {at}"
            );
        }
        self.rig.assert_sound();
    }

    /// Spawns an object in the right half, checks the wall (also with indirect light), and removes the object.
    fn with(&mut self, name: &str, mesh: Mesh, material: StandardMaterial, transform: Transform) {
        let entity = self.rig.spawn(mesh, material, transform);
        self.check(name);
        self.rig.set(|restir| restir.bounces = 4);
        assert!(self.rig.picture(2).is_finite(), "{name}, bounced");
        self.rig.assert_sound();
        self.rig.set(|restir| restir.bounces = 1);
        self.rig.app.world_mut().despawn(entity);
    }
}

fn right() -> Transform {
    Transform::from_xyz(0.75, 0.0, 0.0)
}

fn positions(topology: PrimitiveTopology, points: Vec<[f32; 3]>) -> Mesh {
    Mesh::new(topology, RenderAssetUsages::all()).with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, points)
}

#[test]
fn broken_meshes_are_rejected() {
    let Some(mut scene) = scene() else { return };
    let (a, b, c) = ([-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.0, 0.5, 0.0]);
    let list = |points| positions(PrimitiveTopology::TriangleList, points);
    let (nan, infinite) = (f32::NAN, f32::INFINITY);
    let half = [a, b, c];
    let meshes = [
        ("NaN", list(vec![a, b, [nan, 0.0, 0.0]])),
        ("infinity", list(vec![a, b, [0.0, infinite, 0.0]])),
        ("greatest float", list(vec![a, b, [0.0, f32::MAX, 0.0]])),
        ("no area", list(vec![a, a, b, b, b, b])),
        ("denormal size", list(half.map(|p| p.map(|x| x * 1e-40)).to_vec())),
        ("empty", list(vec![])),
        ("two vertices", list(vec![a, b])),
        (
            "indices out of range",
            list(half.to_vec()).with_inserted_indices(Indices::U32(vec![0, 1, 9, 0, 1, u32::MAX])),
        ),
        ("no index", list(half.to_vec()).with_inserted_indices(Indices::U16(vec![]))),
        ("lines", positions(PrimitiveTopology::LineList, vec![a, b])),
        ("points", positions(PrimitiveTopology::PointList, vec![a, b, c])),
        ("no positions", Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::all())),
        (
            "normals that are not finite",
            list(half.to_vec()).with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[nan; 3]; 3]),
        ),
        (
            "uvs that are not finite",
            list(half.to_vec()).with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, vec![[infinite; 2]; 3]),
        ),
    ];
    for (name, mesh) in meshes {
        scene.with(name, mesh, lambert(0.5), right());
    }
    // The sound triangles of a mesh with one bad triangle are shown.
    let mixed = list(vec![a, b, c, a, [nan; 3], c, a, b, [0.0, infinite, 0.0]]);
    let entity = scene.rig.spawn(mixed, lambert(0.5), right());
    scene.check("one sound triangle of three");
    assert!(scene.rig.debug(DebugView::Albedo).at(18, 8).x > 0.4, "the sound triangle is visible");
    scene.rig.app.world_mut().despawn(entity);
    // An emissive mesh: rejected triangles emit no light.
    scene.with("emissive, NaN", list(vec![a, b, [nan; 3]]), lamp(1.0, 1.0, 1.0), right());
    scene.with("emissive, no area", list(vec![a, a, b]), lamp(1.0, 1.0, 1.0), right());
}

#[test]
fn transforms_without_an_inverse_are_rejected() {
    let Some(mut scene) = scene() else { return };
    let scaled = |s: Vec3| right().with_scale(s);
    let transforms = [
        ("flat", scaled(Vec3::new(1.0, 1.0, 0.0))),
        ("nothing", scaled(Vec3::ZERO)),
        ("NaN scale", scaled(Vec3::NAN)),
        ("infinite scale", scaled(Vec3::INFINITY)),
        ("NaN place", Transform::from_translation(Vec3::NAN)),
        ("infinite translation", Transform::from_translation(Vec3::new(f32::INFINITY, 0.0, 0.0))),
        ("NaN turn", right().with_rotation(Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0))),
        ("zero quaternion", right().with_rotation(Quat::from_xyzw(0.0, 0.0, 0.0, 0.0))),
        ("huge", Transform::from_xyz(3e30, 0.0, 0.0).with_scale(Vec3::splat(1e25))),
        ("tiny", scaled(Vec3::splat(1e-30))),
    ];
    for (name, transform) in transforms {
        scene.with(name, square(1.0), lambert(0.5), transform);
        scene.with(name, Sphere::new(0.5).into(), lamp(0.0, 0.0, 0.0), transform);
    }
    // From a valid transform to an invalid one and back.
    let entity = scene.rig.spawn(square(1.0), lambert(0.5), right());
    scene.check("sound");
    scene.rig.get_mut::<Transform>(entity).translation.x = f32::NAN;
    scene.check("lost");
    scene.rig.get_mut::<Transform>(entity).translation.x = 0.75;
    scene.check("back");
    assert!(scene.rig.debug(DebugView::Albedo).at(18, 8).x > 0.4);
}

#[test]
fn materials_with_invalid_numbers_make_no_nan() {
    let Some(mut scene) = scene() else { return };
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, f32::MAX] {
        let color = Color::linear_rgba(bad, bad, bad, bad);
        let material = StandardMaterial {
            base_color: color,
            metallic: bad,
            perceptual_roughness: bad,
            reflectance: bad,
            specular_tint: color,
            clearcoat: bad,
            clearcoat_perceptual_roughness: bad,
            anisotropy_strength: bad,
            anisotropy_rotation: bad,
            diffuse_transmission: bad,
            ..default()
        };
        scene.with(&format!("surface of {bad}"), square(1.0), material.clone(), right());
        let glass = StandardMaterial {
            specular_transmission: if bad.is_nan() { bad } else { bad.abs().min(1.0) },
            thickness: bad,
            ior: bad,
            attenuation_color: color,
            attenuation_distance: bad,
            ..material
        };
        scene.with(&format!("glass of {bad}"), Sphere::new(0.5).into(), glass, right());
        let masked = StandardMaterial { alpha_mode: AlphaMode::Mask(bad), ..lambert(0.5) };
        scene.with(&format!("mask of {bad}"), square(1.0), masked, right());
    }
    // NaN emission counts as zero.
    for bad in [f32::NAN, f32::NEG_INFINITY, -5.0] {
        scene.with(&format!("emission of {bad}"), square(1.0), lamp(bad, bad, bad), right());
    }
    scene.rig.app.world_mut().resource_mut::<EmissiveLuminance>().0 = f32::NAN;
    scene.with("luminance of NaN", square(1.0), lamp(1.0, 1.0, 1.0), right());
}

#[test]
fn lights_with_invalid_power_or_position_are_rejected() {
    let Some(mut scene) = scene() else { return };
    for bad in [0.0, -100.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let entities = [
            scene.rig.spawn_bundle((PointLight { intensity: bad, ..default() }, Transform::from_xyz(0.0, 0.0, 1.0))),
            scene.rig.spawn_bundle((SpotLight { intensity: bad, ..default() }, Transform::from_xyz(0.0, 0.0, 1.0))),
            scene.rig.spawn_bundle(DirectionalLight { illuminance: bad, ..default() }),
        ];
        scene.check(&format!("power {bad}"));
        assert_eq!(scene.rig.report().lights, 1);
        for entity in entities {
            scene.rig.app.world_mut().despawn(entity);
        }
    }
    // A sun with a NaN rotation would fail an assertion in Bevy's own shadow code.
    let nowhere = Transform::from_translation(Vec3::NAN);
    let color = Color::linear_rgb(f32::NAN, 1.0, 1.0);
    let entities = [
        scene.rig.spawn_bundle((PointLight::default(), nowhere)),
        scene.rig.spawn_bundle((SpotLight::default(), nowhere)),
        scene.rig.spawn_bundle((PointLight { color, ..default() }, Transform::from_xyz(0.0, 0.0, 1.0))),
        scene.rig.spawn_bundle((SpotLight { outer_angle: f32::NAN, ..default() }, Transform::from_xyz(0.0, 0.0, 1.0))),
    ];
    scene.check("lights at invalid positions");
    for entity in entities {
        scene.rig.app.world_mut().despawn(entity);
    }
    // Lights in the surface itself and at the camera: no division by zero.
    for place in [Vec3::new(0.75, 0.0, 0.0), Vec3::new(0.75, 0.0, 5.0)] {
        let wall = scene.rig.spawn(square(1.0), lambert(0.5), right());
        let light =
            scene.rig.spawn_bundle((PointLight { intensity: 1.0, ..default() }, Transform::from_translation(place)));
        assert!(scene.rig.picture(4).is_finite());
        scene.rig.assert_sound();
        scene.rig.app.world_mut().despawn(wall);
        scene.rig.app.world_mut().despawn(light);
    }
}

/// A handle whose asset will never exist.
fn absent<A: Asset>(rig: &mut Rig) -> Handle<A> {
    rig.app.world().resource::<Assets<A>>().reserve_handle()
}

#[test]
fn absent_assets_leave_the_rest_ready() {
    let Some(mut scene) = scene() else { return };
    let image = absent::<Image>(&mut scene.rig);
    let missing: Handle<Image> = scene.rig.app.world().resource::<AssetServer>().load("no/such/file.png");
    for image in [image.clone(), missing] {
        let material = StandardMaterial {
            base_color_texture: Some(image.clone()),
            normal_map_texture: Some(image),
            ..lambert(0.5)
        };
        scene.with("a missing texture", square(1.0), material, right());
    }
    let mesh = absent::<Mesh>(&mut scene.rig);
    let material = scene.rig.add::<StandardMaterial>(lambert(0.5));
    let entity = scene.rig.spawn_bundle((Mesh3d(mesh), MeshMaterial3d(material), right()));
    scene.check("a missing mesh");
    let (mesh, material) = (scene.rig.add::<Mesh>(square(1.0)), absent::<StandardMaterial>(&mut scene.rig));
    scene.rig.insert(entity, (Mesh3d(mesh), MeshMaterial3d(material)));
    scene.check("a missing material");
    // An environment whose image is missing or unusable has its uniform color.
    scene.rig.app.world_mut().despawn(entity);
    scene.rig.insert(scene.rig.camera, RestirEnvironment { image: Some(image), ..sky(1.0) });
    let picture = scene.rig.picture(2);
    assert!(picture.is_finite() && picture.at(18, 8).x == 1.0, "{}", picture.at(18, 8));
    for (intensity, rotation) in
        [(f32::NAN, Quat::IDENTITY), (-1.0, Quat::IDENTITY), (1.0, Quat::from_xyzw(0.0, 0.0, 0.0, 0.0))]
    {
        scene.rig.insert(scene.rig.camera, RestirEnvironment { intensity, rotation, ..sky(1.0) });
        assert!(scene.rig.picture(2).is_finite());
    }
    scene.rig.assert_sound();
}

/// Converters write the sun of a half-precision file as infinity.
#[test]
fn environment_texels_that_are_not_finite_are_replaced() {
    let Some(mut scene) = scene() else { return };
    let mut lit_by = |sun: [f32; 4]| {
        let texels: Vec<u8> =
            (0..8).flat_map(|i| if i == 2 { sun } else { [0.2; 4] }).flat_map(f32::to_le_bytes).collect();
        let image = scene.rig.add(image_with_levels(TextureFormat::Rgba32Float, 4, 2, &[texels]));
        scene.rig.insert(scene.rig.camera, RestirEnvironment { image: Some(image), ..sky(1.0) });
        scene.rig.picture(2)
    };
    assert_eq!(lit_by([f32::INFINITY, f32::NAN, -1.0, 1.0]), lit_by([65504.0, 0.0, 0.0, 1.0]));
    assert_eq!(lit_by([f32::NEG_INFINITY, 2.0, 1.0, f32::NAN]), lit_by([0.0, 2.0, 1.0, 1.0]));
    scene.rig.assert_sound();
}

#[test]
fn settings_out_of_range_are_clamped() {
    let Some(mut scene) = scene() else { return };
    scene.rig.set(|restir| restir.bounces = u32::MAX);
    scene.check("bounces");
    scene.rig.set(|restir| (restir.bounces, restir.seed) = (64, u32::MAX));
    assert!(scene.rig.picture(2).is_finite());
}

#[test]
fn cameras_come_go_and_change() {
    let Some(mut scene) = scene() else { return };
    let camera = scene.rig.camera;
    // A multisampled camera is reset to one sample.
    scene.rig.insert(camera, Msaa::Sample4);
    scene.check("msaa");
    assert_eq!(scene.rig.app.world().get::<Msaa>(camera), Some(&Msaa::Off));
    // Remove, add, remove and add the settings.
    for _ in 0..2 {
        scene.rig.app.world_mut().entity_mut(camera).remove::<bevy_restir::Restir>();
        scene.rig.frames(2);
        assert!(scene.rig.next_if_any().is_none(), "without `Restir` there is no radiance");
        scene.rig.insert(camera, plain());
        scene.check("with `Restir` again");
    }
    // A viewport over the left half.  An empty viewport would make Bevy's light clustering quit.
    let half = Viewport { physical_position: UVec2::ZERO, physical_size: UVec2::new(12, 16), ..default() };
    scene.rig.get_mut::<Camera>(camera).viewport = Some(half);
    let half = scene.rig.picture(2);
    assert_eq!(half.size, UVec2::new(12, 16));
    scene.rig.get_mut::<Camera>(camera).viewport = None;
    scene.check("without a viewport again");
    // Deactivate and activate the camera.
    scene.rig.get_mut::<Camera>(camera).is_active = false;
    scene.rig.frames(2);
    assert!(scene.rig.next_if_any().is_none(), "an inactive camera");
    scene.rig.get_mut::<Camera>(camera).is_active = true;
    scene.check("active again");
    // Move the camera to NaN and back.
    scene.rig.get_mut::<Transform>(camera).translation.x = f32::NAN;
    scene.rig.frames(3);
    scene.rig.get_mut::<Transform>(camera).translation.x = 0.0;
    scene.check("camera back from NaN");
    // A second camera with another size and its own settings.
    let target = scene.rig.add::<Image>(target_image(UVec2::new(7, 9)));
    let second = scene.rig.spawn_bundle((
        Camera3d::default(),
        Camera { order: 1, ..default() },
        bevy::camera::RenderTarget::Image(bevy::camera::ImageRenderTarget::from(target)),
        Transform::from_xyz(0.0, 0.0, 5.0),
        bevy_restir::Restir { debug_view: DebugView::Depth, ..plain() },
    ));
    scene.check("two cameras");
    scene.rig.app.world_mut().despawn(second);
    scene.check("one camera again");
    // No camera.
    scene.rig.app.world_mut().despawn(camera);
    scene.rig.frames(3);
}

#[test]
fn a_camera_at_nan_shows_a_finite_picture() {
    let Some(mut scene) = scene() else { return };
    scene.rig.insert(scene.rig.camera, sky(1.0));
    // A NaN rotation or a scale of 0 would fail an assertion in Bevy's own frustum code.
    for transform in [Transform::from_translation(Vec3::NAN), Transform::from_xyz(f32::INFINITY, 0.0, 0.0)] {
        scene.rig.insert(scene.rig.camera, transform);
        scene.rig.frames(2);
        if let Some(picture) = scene.rig.next_if_any() {
            assert!(picture.is_finite(), "{transform:?}");
        }
    }
}

#[test]
fn each_unsupported_lighting_feature_is_warned_about_once() {
    log::listen();
    let Some(mut rig) = Rig::new(8, 8) else { return };
    let image = rig.add::<Image>(texture(2, 2, |_, _| [255; 4]));
    let shape = rig.spawn(square(4.0), lambert(0.5), Transform::default());
    let mut lights = Vec::new();
    for _ in 0..2 {
        let cubemap_layout = CubemapLayout::CrossVertical;
        let texture = PointLightTexture { image: image.clone(), cubemap_layout };
        lights.push(rig.spawn_bundle((PointLight::default(), texture, Transform::from_xyz(0.0, 0.0, 2.0))));
        let texture = SpotLightTexture { image: image.clone() };
        lights.push(rig.spawn_bundle((SpotLight::default(), texture, Transform::from_xyz(0.0, 0.0, 2.0))));
        let texture = DirectionalLightTexture { image: image.clone(), tiled: true };
        lights.push(rig.spawn_bundle((DirectionalLight::default(), texture)));
    }
    rig.insert(shape, Lightmap { image, ..default() });
    let drawn_over = (VolumetricFog::default(), AtmosphereSettings::default());
    rig.insert(rig.camera, (DistanceFog::default(), drawn_over, AmbientLight::default(), ContactShadows::default()));
    rig.insert(rig.camera, (NormalPrepass, DeferredPrepass));
    let picture = rig.picture(4);
    assert!(picture.is_finite() && picture.center().x > 0.0, "the picture is finite and lit");
    assert_eq!(rig.report().lights, 6);
    let named =
        [("PointLightTexture", lights[0]), ("SpotLightTexture", lights[1]), ("DirectionalLightTexture", lights[2])];
    for (what, entity) in named.into_iter().chain([("Lightmap", shape)]) {
        let warnings = log::own_warnings(&format!("restir: {what} of entity {entity}"));
        assert_eq!(warnings.len(), 1, "{what}, {entity}: {warnings:?}");
    }
    let fogs = ["DistanceFog", "VolumetricFog", "AtmosphereSettings"];
    for effect in fogs.into_iter().chain(["AmbientLight", "ContactShadows", "NormalPrepass", "DeferredPrepass"]) {
        let warnings = log::own_warnings(&format!("restir: {effect} of entity {}", rig.camera));
        assert_eq!(warnings.len(), 1, "{effect}: {warnings:?}");
    }
}
