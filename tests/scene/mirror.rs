//! Our copy of the scene follows the ECS: every change is shown, and only changes are uploaded.

use crate::support::{
    app::*,
    expected_radiance::{both_sides, open},
    reuse_settings::paths,
};
use bevy::{
    asset::RenderAssetUsages,
    camera::{ImageRenderTarget, RenderTarget},
    core_pipeline::tonemapping::Tonemapping,
    light::GlobalAmbientLight,
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
};
use bevy_restir::{DebugView, Paths, Restir, RestirEnvironment, Reuse, SceneFeatures, Technique};

/// The upload of one moved instance in a small scene: its record twice (the previous transform follows a frame later), the top-level
/// tree, and the uniforms.
const MOVE_BYTES: u64 = 1024;

#[test]
fn a_still_scene_uploads_nothing_and_a_moved_instance_little() {
    let Some(mut rig) = Rig::new(32, 32) else { return };
    let image = rig.add::<Image>(texture(4, 4, |x, _| [60 * x as u8, 200, 100, 255]));
    let textured = StandardMaterial { base_color_texture: Some(image), ..lambert(1.0) };
    rig.spawn(square(6.0), textured, Transform::from_xyz(0.0, 0.0, -1.0));
    let ball =
        rig.spawn(Sphere::new(0.5).mesh().ico(20).expect("few enough triangles"), lambert(0.5), Transform::default());
    rig.spawn(square(1.0), lamp(1.0, 1.0, 1.0), Transform::from_xyz(2.0, 0.0, 1.0));
    rig.spawn_bundle((PointLight::default(), Transform::from_xyz(1.0, 2.0, 2.0)));
    let report = rig.until_ready();
    assert_eq!((report.instances, report.lights), (3, 3));
    assert!(
        report.triangles > 5000,
        "only {} triangles: an upload of the geometry would not be noticed",
        report.triangles
    );
    rig.frames(2);
    for _ in 0..4 {
        rig.frame();
        assert_eq!(rig.report().uploaded_bytes, 0, "a still scene");
    }
    let mut sent = 0;
    for i in 0..4 {
        rig.get_mut::<Transform>(ball).translation.x = 0.1 * i as f32 + 0.05;
        rig.frame();
        let bytes = rig.report().uploaded_bytes;
        assert!(bytes > 0 && bytes <= MOVE_BYTES, "{bytes} bytes for one moved instance");
        sent += bytes;
    }
    rig.frames(2);
    rig.frame();
    assert_eq!(rig.report().uploaded_bytes, 0, "the instance stopped, after {sent} bytes");
    // A camera motion is not a change of the scene.
    rig.get_mut::<Transform>(rig.camera).translation.z = 4.5;
    rig.frame();
    assert_eq!(rig.report().uploaded_bytes, 0, "the camera moved");
}

#[test]
fn moving_lights_upload_themselves_and_no_emissive_triangles() {
    let make = |x: f32| {
        let mut rig = Rig::new(16, 16)?;
        rig.spawn(square(6.0), lambert(0.8), Transform::from_xyz(0.0, 0.0, -1.0));
        let ball = Sphere::new(0.5).mesh().ico(20).expect("few enough triangles");
        let ball = rig.spawn(ball, lamp(1.0, 1.0, 1.0), Transform::from_xyz(-2.0, 0.0, 0.0));
        let spot = SpotLight { intensity: 300.0, ..default() };
        rig.spawn_bundle((spot, Transform::from_xyz(1.0, 0.0, 2.0)));
        let light = |power| PointLight { intensity: power, ..default() };
        // The black light is not in the table at first.
        let black = rig.spawn_bundle((light(0.0), Transform::from_xyz(0.0, -1.0, 1.0)));
        let point = rig.spawn_bundle((light(200.0), Transform::from_xyz(x, 1.0, 1.0)));
        rig.until_ready();
        Some((rig, black, point, ball))
    };
    let Some((mut rig, black, point, ball)) = make(0.0) else { return };
    assert!(rig.report().lights > 8000);
    for i in 1..=6 {
        rig.get_mut::<Transform>(point).translation.x = 0.2 * i as f32;
        rig.get_mut::<Transform>(black).translation.x = 0.1 * i as f32;
        rig.frame();
        // From the second frame on, the previous table exists and can be written to.
        let bytes = rig.report().uploaded_bytes;
        assert!(i <= 2 || (1..=512).contains(&bytes), "{bytes} bytes for one moved light");
    }
    rig.frames(2);
    assert_eq!(rig.report().uploaded_bytes, 0, "the light stopped");
    // The lamp is edited, which gives its triangles other records.  The table of the last frame follows with the first move.
    let glow = rig.material_of(ball);
    for brightness in [3.0, 1.0] {
        rig.edit(&glow, |m| m.emissive = LinearRgba::rgb(brightness, 1.0, 1.0));
        rig.frames(3);
        for i in 1..=3 {
            rig.get_mut::<Transform>(point).translation.x = 1.2 + 0.1 * (i % 3) as f32;
            rig.frame();
            let bytes = rig.report().uploaded_bytes;
            assert!(i == 1 || (1..=512).contains(&bytes), "{bytes} bytes for one moved light");
        }
    }
    rig.frames(2);
    // No trace of the old position is left: with the same random numbers, the picture equals that of a fresh scene.
    let (mut fresh, fresh_black, ..) = make(1.2).expect("there is an adapter");
    assert_eq!(rig.picture(4), fresh.picture(4));
    // One more light: the ids of all others change.
    for (rig, black) in [(&mut rig, black), (&mut fresh, fresh_black)] {
        rig.get_mut::<Transform>(black).translation.x = 0.9;
        rig.get_mut::<PointLight>(black).intensity = 50.0;
    }
    assert_eq!(rig.picture(4), fresh.picture(4));
}

/// The base color in the middle of the image, or 0 where no surface is visible.
fn albedo(rig: &mut Rig) -> f32 {
    rig.debug(DebugView::Albedo).center().x
}

fn near(a: f32, b: f32) -> bool {
    (a - b).abs() < 1e-5
}

#[test]
fn added_removed_hidden_and_replaced_objects_are_so_in_the_picture() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    let far = rig.spawn(square(4.0), lambert(0.2), Transform::from_xyz(0.0, 0.0, -1.0));
    assert!(near(albedo(&mut rig), 0.2), "the first square");
    let close = rig.spawn(square(1.0), lambert(0.6), Transform::default());
    assert!(near(albedo(&mut rig), 0.6), "a second square in front");
    rig.get_mut::<Transform>(close).translation.x = 3.0;
    assert!(near(albedo(&mut rig), 0.2), "the second moved away");
    rig.get_mut::<Transform>(close).translation.x = 0.0;
    assert!(near(albedo(&mut rig), 0.6), "the second moved back");
    rig.insert(close, Visibility::Hidden);
    assert!(near(albedo(&mut rig), 0.2), "hidden");
    assert_eq!(rig.report().instances, 1);
    rig.insert(close, Visibility::Inherited);
    assert!(near(albedo(&mut rig), 0.6), "shown");
    let material = rig.add::<StandardMaterial>(lambert(0.8));
    rig.insert(close, MeshMaterial3d(material.clone()));
    assert!(near(albedo(&mut rig), 0.8), "another material");
    rig.edit(&material, |m| m.base_color = Color::linear_rgb(0.9, 0.9, 0.9));
    assert!(near(albedo(&mut rig), 0.9), "a changed material");
    let mesh = rig.add::<Mesh>(square(2.0));
    rig.insert(close, Mesh3d(mesh.clone()));
    let wide = rig.debug(DebugView::Albedo);
    rig.edit(&mesh, |m| *m = Sphere::new(0.05).into());
    rig.frame();
    let small = rig.debug(DebugView::Albedo);
    let count = |p: &Picture| p.iter().filter(|(_, c)| near(c.x, 0.9)).count();
    assert!(count(&wide) > 30 && count(&small) <= 4, "a changed mesh: {} pixels, then {}", count(&wide), count(&small));
    rig.app.world_mut().despawn(close);
    assert!(near(albedo(&mut rig), 0.2), "removed");
    rig.app.world_mut().despawn(far);
    assert_eq!(albedo(&mut rig), 0.0, "everything was removed");
    assert_eq!((rig.report().instances, rig.report().triangles), (0, 0));
    // Slots and ranges are freed and reused several times; nothing of the old content is left in them.
    for i in 0..6 {
        let albedo_wanted = 0.1 + 0.1 * i as f32;
        let again = rig.spawn(square(1.0 + i as f32), lambert(albedo_wanted), Transform::default());
        assert!(near(albedo(&mut rig), albedo_wanted), "added again, {i}");
        let report = rig.report();
        assert_eq!((report.instances, report.triangles), (1, 2));
        rig.app.world_mut().despawn(again);
        assert_eq!(albedo(&mut rig), 0.0);
    }
    // An entity loses only its mesh.
    let entity = rig.spawn(square(1.0), lambert(0.3), Transform::default());
    assert!(near(albedo(&mut rig), 0.3));
    rig.app.world_mut().entity_mut(entity).remove::<Mesh3d>();
    assert_eq!(albedo(&mut rig), 0.0);
    rig.assert_sound();
}

/// A square of side 1 in the plane z = 0, with the vertices of a strip.
fn bare(topology: PrimitiveTopology, usage: RenderAssetUsages) -> Mesh {
    let corners = [[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, 0.5, 0.0], [0.5, 0.5, 0.0]];
    let strip = matches!(topology, PrimitiveTopology::TriangleStrip);
    let order: &[usize] = if strip { &[0, 1, 2, 3] } else { &[0, 1, 2, 2, 1, 3] };
    let positions: Vec<[f32; 3]> = order.iter().map(|&i| corners[i]).collect();
    Mesh::new(topology, usage).with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
}

#[test]
fn meshes_of_any_layout_are_shown_and_lit() {
    let main = RenderAssetUsages::all();
    let list = || bare(PrimitiveTopology::TriangleList, main);
    let quad = |indices| {
        let corners = vec![[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, 0.5, 0.0], [0.5, 0.5, 0.0]];
        Mesh::new(PrimitiveTopology::TriangleList, main)
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, corners)
            .with_inserted_indices(indices)
    };
    let mut full = square(1.0).with_generated_tangents().expect("a square has tangents");
    full.insert_attribute(Mesh::ATTRIBUTE_COLOR, vec![[1.0f32; 4]; 4]);
    full.insert_attribute(Mesh::ATTRIBUTE_UV_1, vec![[0.0f32; 2]; 4]);
    let mut render_only = square(1.0);
    render_only.asset_usage = RenderAssetUsages::RENDER_WORLD;
    let meshes = [
        ("only positions", list()),
        ("a strip", bare(PrimitiveTopology::TriangleStrip, main)),
        ("u16 indices", quad(Indices::U16(vec![0, 1, 2, 2, 1, 3]))),
        ("u32 indices", quad(Indices::U32(vec![0, 1, 2, 2, 1, 3]))),
        ("every attribute", full),
        ("render world only", render_only),
        ("render world only, only positions", bare(PrimitiveTopology::TriangleList, RenderAssetUsages::RENDER_WORLD)),
        ("only normals", list().with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0, 0.0, 1.0]; 6])),
        ("zero normals", list().with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0, 0.0, 0.0]; 6])),
    ];
    let count = meshes.len();
    let Some(mut rig) = Rig::new(8 * count as u32, 8) else {
        return;
    };
    rig.insert(rig.camera, orthographic(count as f32, 1.0));
    // Light from the camera's side: E cosθ albedo/π = 1.
    rig.spawn_bundle((
        DirectionalLight { illuminance: 2.0 * core::f32::consts::PI, ..default() },
        Transform::default(),
    ));
    let names: Vec<_> = meshes.iter().map(|m| m.0).collect();
    for (i, (_, mesh)) in meshes.into_iter().enumerate() {
        let transform = Transform::from_xyz(i as f32 + 0.5 - 0.5 * count as f32, 0.0, 0.0).with_scale(Vec3::splat(0.9));
        rig.spawn(mesh, lambert(0.5), transform);
    }
    let picture = rig.picture(1);
    for (i, name) in names.into_iter().enumerate() {
        let lit = picture.at(8 * i as u32 + 4, 4).x;
        assert!((lit - 1.0).abs() < 1e-3, "{name}: {lit}");
    }
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn removed_materials_free_their_memory() {
    let Some(mut rig) = Rig::new(4, 4) else { return };
    rig.insert(rig.camera, orthographic(1.0, 1.0));
    let entity = rig.spawn(square(4.0), lamp(1.0, 1.0, 1.0), Transform::default());
    let still = rig.spawn(square(1.0), lamp(1.0, 1.0, 1.0), Transform::from_xyz(9.0, 0.0, 0.0));
    rig.until_ready();
    let bytes = |rig: &Rig| rig.report().memory.iter().filter(|(name, _)| name.contains("material")).map(|m| m.1).sum();
    let before: u64 = bytes(&rig);
    for i in 0..300 {
        let brightness = 1.0 + i as f32;
        let material = rig.add::<StandardMaterial>(lamp(brightness, 0.0, 0.5 * brightness));
        rig.insert(entity, MeshMaterial3d(material));
        if i % 50 == 49 {
            assert_eq!(rig.next().center(), Vec3::new(brightness, 0.0, 0.5 * brightness), "material {i}");
        } else {
            rig.frame();
        }
    }
    assert!(bytes(&rig) <= before + 4 * 128, "{} bytes of materials, {before} before", bytes(&rig));
    assert_eq!(rig.report().instances, 2);
    rig.app.world_mut().despawn(still);
    rig.frames(3);
    rig.assert_sound();
}

#[test]
fn bevy_draws_our_meshes_for_every_camera_but_ours() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    // Ambient light is Bevy's only: pictures of Bevy are bright, and our own are black.
    rig.app.insert_resource(GlobalAmbientLight { brightness: 1e4, ..default() });
    rig.spawn(square(2.0), lambert(1.0), Transform::default());
    let other = rig.add::<Image>(target_image(UVec2::new(16, 16)));
    let transform = Transform::from_xyz(0.0, 0.0, 5.0);
    let image = RenderTarget::Image(ImageRenderTarget::from(other.clone()));
    rig.spawn_bundle((Camera3d::default(), Camera { order: 1, ..default() }, image, transform, unit_exposure()));
    rig.until_ready();
    let ours = rig.target.clone();
    let center = |rig: &mut Rig, target: &Handle<Image>| rig.drawn(target)[8 * 16 + 8][0];
    assert!(center(&mut rig, &other) > 100, "a camera without `Restir`");
    assert!(center(&mut rig, &ours) < 10, "a camera with `Restir`");
    rig.app.world_mut().entity_mut(rig.camera).remove::<Restir>();
    rig.frames(2);
    assert!(center(&mut rig, &ours) > 100, "after `Restir` was removed");
    rig.insert(rig.camera, plain());
    rig.until_ready();
    assert!(center(&mut rig, &ours) < 10, "after `Restir` was added again");
    assert!(center(&mut rig, &other) > 100, "the other camera");
}

/// The name of a feature, its flags, and a function that spawns an object with it.
pub type Step = (&'static str, SceneFeatures, fn(&mut Rig) -> Option<Entity>);

/// Objects that each need a feature that the scene does not have yet.
pub fn feature_steps() -> [Step; 14] {
    fn aside(rig: &mut Rig, material: StandardMaterial) -> Option<Entity> {
        Some(rig.spawn(square(0.5), material, Transform::from_xyz(1.5, 0.0, 0.0)))
    }
    fn dots(rig: &mut Rig) -> Option<Handle<Image>> {
        Some(rig.add::<Image>(texture(2, 2, |x, _| [128, 128, 255, if x == 0 { 0 } else { 255 }])))
    }
    [
        ("emissive mesh", SceneFeatures::LIGHT_TRIANGLES, |rig| aside(rig, lamp(1.0, 1.0, 1.0))),
        ("point light", SceneFeatures::LIGHT_POINTS, |rig| {
            Some(rig.spawn_bundle((PointLight::default(), Transform::from_xyz(0.0, 0.0, 2.0))))
        }),
        ("sun", SceneFeatures::LIGHT_DIRECTIONAL, |rig| Some(rig.spawn_bundle(DirectionalLight::default()))),
        ("texture", SceneFeatures::TEXTURES, |rig| {
            let image = dots(rig);
            aside(rig, StandardMaterial { base_color_texture: image, ..lambert(1.0) })
        }),
        ("normal map", SceneFeatures::TEXTURES.union(SceneFeatures::NORMAL_MAPS), |rig| {
            let image = dots(rig);
            aside(rig, StandardMaterial { normal_map_texture: image, ..lambert(1.0) })
        }),
        ("mask", SceneFeatures::TEXTURES.union(SceneFeatures::ALPHA), |rig| {
            let image = dots(rig);
            let alpha_mode = AlphaMode::Mask(0.5);
            aside(rig, StandardMaterial { base_color_texture: image, alpha_mode, ..lambert(1.0) })
        }),
        ("vertex colors", SceneFeatures::VERTEX_COLORS, |rig| {
            let colors = vec![[1.0, 0.5, 0.25, 1.0]; 4];
            let mesh = square(0.5).with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, colors);
            Some(rig.spawn(mesh, lambert(1.0), Transform::from_xyz(1.5, 0.0, 0.0)))
        }),
        ("glass", SceneFeatures::TRANSMISSION, |rig| {
            aside(rig, StandardMaterial { specular_transmission: 1.0, thickness: 1.0, ..lambert(1.0) })
        }),
        ("tinted glass", SceneFeatures::TRANSMISSION.union(SceneFeatures::ATTENUATION), |rig| {
            let tint = Color::linear_rgb(0.5, 0.9, 0.5);
            let glass = StandardMaterial { specular_transmission: 1.0, thickness: 1.0, ..lambert(1.0) };
            aside(rig, StandardMaterial { attenuation_color: tint, attenuation_distance: 1.0, ..glass })
        }),
        ("pane", SceneFeatures::TRANSMISSION.union(SceneFeatures::THIN_WALL), |rig| {
            aside(rig, StandardMaterial { specular_transmission: 1.0, ..lambert(1.0) })
        }),
        ("leaf", SceneFeatures::DIFFUSE_TRANSMISSION.union(SceneFeatures::THIN_WALL), |rig| {
            aside(rig, StandardMaterial { diffuse_transmission: 0.5, ..lambert(1.0) })
        }),
        ("varnish", SceneFeatures::CLEARCOAT, |rig| aside(rig, StandardMaterial { clearcoat: 0.5, ..lambert(1.0) })),
        ("brushed metal", SceneFeatures::ANISOTROPY, |rig| {
            aside(rig, StandardMaterial { anisotropy_strength: 0.5, ..lambert(1.0) })
        }),
        ("environment map", SceneFeatures::ENVIRONMENT_MAP, |rig| {
            let image = Some(rig.add::<Image>(texture(4, 2, |_, _| [255; 4])));
            rig.get_mut::<RestirEnvironment>(rig.camera).image = image;
            None
        }),
    ]
}

/// The first textured object adds code to the shaders; the first masked or varnished one also adds paths.  These objects stand outside of a
/// closed room.
#[test]
#[ignore = "second tier: ./run test --more"]
fn histories_outlive_the_first_texture_and_restart_with_new_kinds_of_paths() {
    let add_outside = |rig: &mut Rig, kinds: &[&str]| {
        for (_, _, add) in feature_steps().into_iter().filter(|(name, ..)| kinds.contains(name)) {
            let object = add(rig).expect("it spawns an object");
            rig.insert(object, Transform::from_xyz(50.0, 0.0, 0.0));
        }
    };
    let closed_room = |seed| {
        let mut rig = Rig::new(32, 24)?;
        rig.spawn(Cuboid::from_length(14.0), open(lambert(0.7)), Transform::default());
        rig.spawn(Cuboid::from_length(1.0), lambert(0.5), Transform::from_xyz(0.5, -0.3, 0.0));
        rig.spawn(square(1.0), both_sides(20.0), Transform::from_xyz(-1.0, 1.5, 1.0));
        rig.set(|restir| *restir = Restir { technique: Technique::Pt, bounces: 3, seed, ..plain() });
        // More neighbors would make up for a part of a history that is lost.
        rig.set(|restir| restir.paths.reuse.disocclusion_samples = 0);
        Some(rig)
    };
    let (Some(a), Some(b)) = (closed_room(1), closed_room(2)) else { return };
    let mut rigs = [a, b];
    let late = rigs.each_mut().map(|rig| {
        let before = rig.until_ready();
        rig.frames(12);
        let resets = rig.report().history_resets;
        add_outside(rig, &["texture"]);
        let after = rig.until_ready();
        assert!(after.features != before.features);
        let picture = rig.next();
        assert_eq!(rig.report().history_resets, resets);
        picture
    });
    for kind in ["mask", "varnish"] {
        let resets = rigs[0].report().history_resets;
        add_outside(&mut rigs[0], &[kind]);
        rigs[0].until_ready();
        rigs[0].frame();
        assert_ne!(rigs[0].report().history_resets, resets, "{kind}");
    }
    let early = rigs.each_mut().map(|rig| {
        rig.set(|restir| restir.reset = true);
        rig.next()
    });
    let [late, early] = [late, early]
        .map(|[a, b]| a.iter().zip(b.iter()).map(|((_, a), (_, b))| f64::from(a.distance_squared(b))).sum::<f64>());
    assert!(late < 0.5 * early, "noise {late}, and {early} after a restart");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_scene_that_gains_and_loses_features_is_never_black() {
    // Pipelines compile in the background, so those of new features become ready frames later.
    let Some(mut rig) = Rig::compiling_in_background(16, 16) else {
        return;
    };
    rig.insert(rig.camera, sky(1.0));
    rig.set(|restir| restir.bounces = 3);
    rig.spawn(square(2.0), lambert(0.5), Transform::default());
    // The features of the camera are not remembered.
    let of_camera = SceneFeatures::ENVIRONMENT | SceneFeatures::COUNT_RAYS;
    assert_eq!(rig.until_ready().features, of_camera);

    let bright = |rig: &mut Rig, what: &str| {
        let picture = rig.next();
        assert!(picture.center().x > 0.05, "{what}: the square is black");
        assert!(picture.is_finite(), "{what}");
        assert_eq!(rig.report().raised_guards(), [], "{what}");
    };
    let mut remembered = of_camera;
    for (name, features, add) in feature_steps() {
        remembered |= features;
        let entity = add(&mut rig);
        for _ in 0..4 {
            bright(&mut rig, name);
        }
        let report = rig.until_ready();
        // Features are forgotten after a number of frames, and a slow machine needs many for new pipelines.
        let has_needed = report.features.contains(features | of_camera);
        assert!(has_needed && remembered.contains(report.features), "{name}: {:?}", report.features);
        bright(&mut rig, name);
        if let Some(entity) = entity {
            rig.app.world_mut().despawn(entity);
        }
        for _ in 0..4 {
            bright(&mut rig, name);
        }
    }
    rig.get_mut::<RestirEnvironment>(rig.camera).image = None;
    remembered.remove(SceneFeatures::ENVIRONMENT_MAP);
    let features = rig.until_ready().features;
    assert!(remembered.contains(features), "{features:?}");
    let settings: [(&str, fn(&mut Restir)); 8] = [
        ("direct light", |restir| restir.technique = Technique::Di),
        ("indirect light", |restir| restir.technique = Technique::Gi),
        ("rays of indirect light", |restir| restir.debug_view = DebugView::Rays),
        ("paths", |restir| (restir.technique, restir.debug_view) = (Technique::Pt, DebugView::Off)),
        ("more spatial samples", |restir| {
            restir.paths = Paths { reuse: Reuse { spatial_samples: 4, ..Reuse::PATHS }, ..paths::unified() }
        }),
        ("compensation", |restir| restir.energy_compensation = true),
        ("albedo", |restir| restir.debug_view = DebugView::Albedo),
        ("reference", |restir| (restir.technique, restir.debug_view) = (Technique::Reference, DebugView::Off)),
    ];
    for (name, change) in settings {
        rig.set(change);
        for _ in 0..4 {
            bright(&mut rig, name);
        }
        rig.until_ready();
        bright(&mut rig, name);
    }
    assert!(
        rig.report().features.contains(SceneFeatures::ENERGY_COMPENSATION),
        "the last settings are shown at the end"
    );
    // A resize keeps the pipelines.
    let target = rig.target.clone();
    rig.edit(&target, |image| *image = target_image(UVec2::new(20, 20)));
    for _ in 0..3 {
        bright(&mut rig, "resized");
    }
    rig.assert_sound();
}

#[test]
fn bevy_lights_a_camera_until_our_pipelines_are_there() {
    let Some(mut rig) = Rig::compiling_in_background(16, 16) else { return };
    // Bevy's picture is the brighter one.
    rig.app.insert_resource(GlobalAmbientLight { brightness: 1e4, ..default() });
    // One sample per pixel, as for our cameras; otherwise Bevy would have to recompile its own pipelines.
    rig.insert(rig.camera, (sky(0.1), Tonemapping::None, Msaa::Off));
    rig.spawn(square(2.0), lambert(1.0), Transform::default());
    let target = rig.target.clone();
    rig.app.world_mut().entity_mut(rig.camera).remove::<Restir>();
    let center = |rig: &mut Rig| rig.drawn(&target)[8 * 16 + 8][0];
    let mut frames = 0;
    while center(&mut rig) < 200 {
        frames += 1;
        assert!(frames < 1000, "Bevy's own picture never appeared");
    }
    rig.insert(rig.camera, plain());
    let mut lit_by_bevy = 0;
    loop {
        let seen = center(&mut rig);
        assert!(seen > 50, "dark after {lit_by_bevy} pictures by Bevy");
        if seen < 200 {
            break;
        }
        lit_by_bevy += 1;
        assert!(lit_by_bevy < 1000, "our picture never appeared");
    }
    assert!(lit_by_bevy > 0, "Bevy renders until our pipelines are ready");
    rig.until_ready();
    assert!((50..200).contains(&center(&mut rig)), "our picture stays");
}
