//! The `Subsurface` component: its mirror on the GPU, values out of range, meshes of any kind, and materials of glTF files.

use crate::support::{app::*, log};
use bevy::{light::NotShadowCaster, prelude::*};
use bevy_restir::{SceneFeatures, Subsurface, Technique, testing::lengths::table_lengths};
use bevy_restir_support::subsurface::from_extras;

fn soft(length: f32) -> Subsurface {
    Subsurface { mean_free_path: Vec3::splat(length), weight: 1.0 }
}

/// A lit ball.
fn ball(rig: &mut Rig) -> Entity {
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(1.0, 1.0, 3.0)));
    rig.spawn(Sphere::new(1.0).mesh().ico(8).expect("few triangles"), lambert(0.8), Transform::default())
}

fn bytes_of_records(rig: &Rig) -> u64 {
    rig.report().memory.iter().filter(|(name, _)| *name == "subsurface").map(|(_, bytes)| *bytes).sum()
}

#[test]
fn scenes_without_subsurface_have_no_buffer_and_no_shader_code_for_it() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    let entity = ball(&mut rig);
    let diffuse = rig.picture(1);
    let code = |rig: &Rig| rig.report().pipelines.iter().any(|p| p.defs.contains(&"SUBSURFACE"));
    assert!(!code(&rig) && bytes_of_records(&rig) == 0);
    rig.insert(entity, soft(0.2));
    let translucent = rig.picture(1);
    assert!(code(&rig) && rig.report().features.contains(SceneFeatures::SUBSURFACE));
    assert!(bytes_of_records(&rig) > 0 && translucent != diffuse);
    // A still scene uploads nothing; a change is shown.
    rig.frames(3);
    assert_eq!(rig.report().uploaded_bytes, 0);
    rig.insert(entity, soft(0.02));
    assert!(rig.picture(1) != translucent, "another length");
    rig.app.world_mut().entity_mut(entity).remove::<Subsurface>();
    assert_eq!(rig.picture(1), diffuse, "without the component");
    assert_eq!(bytes_of_records(&rig), 0);
    rig.assert_sound();
}

/// Objects with values out of range come and go for as long as an app runs.
#[test]
fn warnings_of_objects_that_are_gone_are_forgotten() {
    let Some(mut rig) = Rig::new(4, 4) else { return };
    // Without a camera nothing is compiled.
    rig.app.world_mut().despawn(rig.camera);
    let remembered = |rig: &Rig| {
        let lengths = table_lengths(&rig.app);
        lengths.iter().find(|(name, _)| *name == "warnings of subsurface").map(|(_, length)| *length)
    };
    for _ in 0..2 {
        let entity = ball(&mut rig);
        rig.insert(entity, Subsurface { weight: 5.0, ..soft(0.2) });
        let warned = (0..500).any(|_| {
            rig.frame();
            remembered(&rig) == Some(1)
        });
        assert!(warned, "{:?}", remembered(&rig));
        rig.app.world_mut().despawn(entity);
        rig.frames(3);
        assert_eq!(remembered(&rig), Some(0));
    }
}

#[test]
fn objects_with_different_values_have_different_records() {
    let Some(mut rig) = Rig::new(32, 16) else { return };
    rig.insert(rig.camera, orthographic(4.0, 2.0));
    rig.insert(rig.camera, sky(1.0));
    for (x, length) in [(-1.0, 0.5), (1.0, 0.05)] {
        let mesh = Sphere::new(0.8).mesh().ico(16).expect("few triangles");
        let entity = rig.spawn(mesh, lambert(0.8), Transform::from_xyz(x, 0.0, 0.0));
        rig.insert(entity, soft(length));
    }
    let picture = rig.picture(64);
    let mean = |x: u32| (0..16).map(|i| picture.at(x + i % 4, 6 + i / 4).x).sum::<f32>() / 16.0;
    let (long, short) = (mean(6), mean(22));
    assert!(long < 0.7 && short > 0.74, "the long paths lose light: {long}, {short}");
}

/// Each object has a record of its own or shares that of its equals, so that its changes affect no other object.
#[test]
fn objects_with_subsurface_come_go_and_change_without_a_restart() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, orthographic(4.0, 4.0));
    rig.insert(rig.camera, sky(1.0));
    let mesh = rig.add::<Mesh>(Sphere::new(0.4).mesh().ico(8).expect("few triangles"));
    let paint = rig.add::<StandardMaterial>(lambert(0.8));
    let spawn = |rig: &mut Rig, x: f32, length: f32| {
        let place = Transform::from_xyz(x, 0.0, 0.0);
        rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(paint.clone()), place, soft(length)))
    };
    let objects: Vec<Entity> =
        [0.3, 0.1, 0.3, 0.05].iter().zip(0..).map(|(l, i)| spawn(&mut rig, i as f32 - 1.5, *l)).collect();
    let length_of = |rig: &Rig, wanted: &str| {
        let lengths = table_lengths(&rig.app);
        lengths.iter().find(|(name, _)| *name == wanted).map(|(_, length)| *length)
    };
    let visited = |rig: &Rig| {
        let visited = rig.report().visited;
        visited.iter().find(|(name, _)| *name == "instances").map(|(_, count)| *count)
    };
    rig.until_ready();
    rig.frames(3);
    let resets = rig.report().history_resets;
    assert_eq!((length_of(&rig, "records of subsurface"), visited(&rig)), (Some(3), Some(0)));
    rig.get_mut::<Transform>(objects[3]).translation.y = 0.1;
    rig.frame();
    assert_eq!(visited(&rig), Some(1), "one object moves");
    rig.get_mut::<Transform>(objects[3]).translation.y = 0.0;
    // The first one goes, and its equal stays.
    rig.app.world_mut().despawn(objects[0]);
    rig.frames(3);
    rig.app.world_mut().despawn(objects[1]);
    rig.frames(3);
    // A value that changes in each frame needs one record for this frame and one for the last.
    for i in 0..20 {
        rig.insert(objects[2], soft(0.02 * (20 - i) as f32));
        rig.frame();
        assert_eq!(visited(&rig), Some(1), "one object changes");
    }
    spawn(&mut rig, -1.5, 0.3);
    spawn(&mut rig, -0.5, 0.1);
    rig.insert(objects[2], soft(0.3));
    rig.frames(3);
    assert!(length_of(&rig, "records of subsurface") <= Some(4), "{:?}", length_of(&rig, "records of subsurface"));
    assert_eq!(rig.report().history_resets, resets);
    // The changed objects look like new ones with the same settings.
    let picture = rig.picture(8);
    let Some(mut fresh) = Rig::new(16, 16) else { return };
    fresh.insert(fresh.camera, orthographic(4.0, 4.0));
    fresh.insert(fresh.camera, sky(1.0));
    for (length, i) in [0.3, 0.1, 0.3, 0.05].into_iter().zip(0..) {
        let mesh = Sphere::new(0.4).mesh().ico(8).expect("few triangles");
        let object = fresh.spawn(mesh, lambert(0.8), Transform::from_xyz(i as f32 - 1.5, 0.0, 0.0));
        fresh.insert(object, soft(length));
    }
    assert_eq!(picture, fresh.picture(8));
    rig.assert_sound();
}

/// An object with values out of range in a technique.  `negative` is one of its weights.
fn check_values(technique: Technique, negative: f32) -> Option<Entity> {
    let mut rig = Rig::new(16, 16)?;
    let entity = ball(&mut rig);
    rig.set(|r| r.technique = technique);
    let diffuse = rig.picture(2);
    let values = [0.0, -1.0, f32::NAN, f32::INFINITY, f32::MAX, 1e-30, 1e-9, 1e6, 1e-3];
    for length in values {
        for weight in [1.0, 0.0, negative, 2.0, f32::NAN, f32::INFINITY] {
            rig.insert(entity, Subsurface { weight, ..soft(length) });
            let picture = rig.picture(2);
            assert!(picture.is_finite(), "{technique:?}: {length}, {weight}");
            rig.assert_sound();
            // A path of a millimeter is below a hundredth of these pixels.
            let is_diffuse = !(length > 2e-3 && weight > 0.0);
            match technique {
                Technique::Reference => assert_eq!(picture == diffuse, is_diffuse, "{length} m with weight {weight}"),
                // Another technique may draw other random numbers, and few light paths reach so small a picture.
                _ => {
                    let limit = if technique == Technique::Bdpt { 0.3 } else { 0.1 };
                    let off = picture.mean() / diffuse.mean() - 1.0;
                    assert!(
                        !is_diffuse || off.abs() < limit,
                        "{technique:?}: {length} m with weight {weight}: {off:+}"
                    );
                }
            }
        }
        rig.insert(entity, Subsurface { mean_free_path: Vec3::new(0.1, length, 0.0), weight: 0.5 });
        assert!(rig.picture(2).is_finite(), "{technique:?}: one channel of {length}");
        rig.assert_sound();
    }
    Some(entity)
}

#[test]
fn values_out_of_range_give_one_warning_and_a_sound_picture() {
    log::listen();
    let Some(entity) = check_values(Technique::Reference, -1.0) else { return };
    // The log is that of the process, and an entity of another test may have the same id.
    let named = log::warnings(&format!("entity {entity} has a Subsurface with values out of range"));
    let first = named.iter().filter(|line| line.contains("its weight is -1")).count();
    assert_eq!(first, 1, "{named:?}");
}

fn check_materials(technique: Technique) {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, sky(1.0));
    rig.set(|r| (r.technique, r.bounces) = (technique, 4));
    let entity = ball(&mut rig);
    let kinds = [
        lambert(0.0),
        lambert(1.0),
        StandardMaterial { reflectance: 1.0, clearcoat: 1.0, ..lambert(0.8) },
        StandardMaterial { metallic: 1.0, ..lambert(0.8) },
        StandardMaterial { metallic: 0.5, diffuse_transmission: 0.5, ..lambert(0.8) },
        StandardMaterial { diffuse_transmission: 1.0, ..lambert(0.8) },
        StandardMaterial { specular_transmission: 0.7, thickness: 1.0, ..lambert(0.8) },
        StandardMaterial { unlit: true, ..lambert(0.8) },
        StandardMaterial { cull_mode: None, double_sided: true, ..lambert(0.8) },
        StandardMaterial { alpha_mode: AlphaMode::Mask(0.5), ..lambert(0.8) },
        StandardMaterial { alpha_mode: AlphaMode::Blend, base_color: Color::srgba(0.5, 0.5, 0.5, 0.5), ..lambert(0.8) },
    ];
    rig.insert(entity, soft(0.1));
    // Objects out of sight, because each new feature of the scene compiles all passes.
    let unseen = |kind: &StandardMaterial| rig.spawn(square(0.1), kind.clone(), Transform::from_xyz(0.0, 0.0, 50.0));
    let unseen: Vec<Entity> =
        if technique == Technique::Reference { Vec::new() } else { kinds.iter().map(unseen).collect() };
    for material in kinds {
        let material = rig.add::<StandardMaterial>(material);
        rig.insert(entity, MeshMaterial3d(material.clone()));
        let picture = rig.picture(8);
        let is_dim = picture.iter().all(|(_, c)| c.max_element() < 100.0);
        assert!(picture.is_finite() && (is_dim || technique != Technique::Reference), "{technique:?}: {material:?}");
        rig.assert_sound();
    }
    unseen.into_iter().for_each(|entity| assert!(rig.app.world_mut().despawn(entity)));
    let plain = rig.add::<StandardMaterial>(lambert(0.8));
    rig.insert(entity, MeshMaterial3d(plain));
    for scale in [1e-4, 1e-2, 1e3, 1e5] {
        for length in [1e-6, 0.1, 1e4] {
            rig.insert(entity, (Transform::from_scale(Vec3::splat(scale)), soft(length * scale)));
            rig.insert(
                rig.camera,
                (orthographic(3.0 * scale, 3.0 * scale), Transform::from_xyz(0.0, 0.0, 5.0 * scale)),
            );
            assert!(rig.picture(4).is_finite(), "{technique:?}: scale {scale}, length {length}");
            rig.assert_sound();
        }
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn albedos_scales_and_materials_of_all_kinds_stay_finite() {
    check_materials(Technique::Reference);
}

fn check_meshes(technique: Technique) {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, sky(1.0));
    rig.set(|r| (r.technique, r.bounces) = (technique, 3));
    let ball = || Sphere::new(1.0).mesh().ico(6).expect("few triangles");
    let mut without_normals = ball();
    without_normals.remove_attribute(Mesh::ATTRIBUTE_NORMAL);
    let inverted = ball().with_inverted_winding().expect("a triangle list");
    let open = Mesh::from(Circle::new(1.0));
    let meshes =
        [square(2.0), open, inverted, without_normals, Triangle2d::default().into(), Capsule3d::new(0.3, 1.0).into()];
    for (i, mesh) in meshes.into_iter().enumerate() {
        for cull_mode in [None, Some(bevy::render::render_resource::Face::Back)] {
            let material = StandardMaterial { cull_mode, ..lambert(0.8) };
            let entity = rig.spawn(mesh.clone(), material, Transform::from_scale(Vec3::new(-1.0, 1.5, 0.7)));
            rig.insert(entity, soft(0.2));
            assert!(rig.picture(8).is_finite(), "{technique:?}: mesh {i}");
            rig.assert_sound();
            rig.app.world_mut().despawn(entity);
        }
    }
}

#[test]
fn meshes_of_all_kinds_stay_finite() {
    check_meshes(Technique::Reference);
}

/// The passes of ReSTIR SSS.
#[test]
#[ignore = "second tier: ./run test --more"]
fn bad_values_and_meshes_stay_finite_where_direct_light_is_resampled() {
    check_values(Technique::Di, OTHER_WEIGHT);
    check_meshes(Technique::Di);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_bad_values_materials_and_meshes_stay_finite_where_direct_light_is_resampled() {
    check_all(Technique::Di);
}

/// The passes of ReSTIR SSS, beside paths of ReSTIR GI through bodies.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_bad_values_materials_and_meshes_stay_finite_where_indirect_light_is_resampled() {
    check_all(Technique::Gi);
}

/// The shifts of paths through bodies.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_bad_values_materials_and_meshes_stay_finite_where_paths_are_resampled() {
    check_all(Technique::Pt);
}

/// Light paths, which end where they enter a body.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_bad_values_materials_and_meshes_stay_finite_where_light_paths_are_resampled() {
    check_all(Technique::Bdpt);
}

/// A warning is logged once for each value, and a test of the first tier counts the warnings of -1.
const OTHER_WEIGHT: f32 = -2.0;

fn check_all(technique: Technique) {
    check_values(technique, OTHER_WEIGHT);
    check_materials(technique);
    check_meshes(technique);
}

#[test]
fn an_object_that_rays_do_not_find_and_a_back_are_diffuse() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    let entity = ball(&mut rig);
    rig.insert(entity, NotShadowCaster);
    let diffuse = rig.picture(2);
    rig.insert(entity, soft(0.2));
    assert_eq!(rig.picture(2), diffuse, "without shadows");
    rig.app.world_mut().despawn(entity);
    let open = StandardMaterial { cull_mode: None, ..lambert(0.8) };
    let back = rig.spawn(square(8.0), open, Transform::from_rotation(Quat::from_rotation_y(core::f32::consts::PI)));
    let diffuse = rig.picture(2);
    rig.insert(back, soft(0.2));
    assert_eq!(rig.picture(2), diffuse, "from behind");
}

#[test]
fn extras_of_a_material_describe_the_component() {
    let full = r#"{"subsurface": {"mean_free_path": [0.1, 2, 3e-2], "weight": 0.5}, "other": [1]}"#;
    let expected = Subsurface { mean_free_path: Vec3::new(0.1, 2.0, 0.03), weight: 0.5 };
    assert_eq!(from_extras(full), Ok(Some(expected)));
    let without_weight = from_extras(r#"{"subsurface": {"mean_free_path": [1, 1, 1]}}"#);
    assert_eq!(without_weight, Ok(Some(Subsurface { mean_free_path: Vec3::ONE, weight: 1.0 })));
    for none in ["{}", "[]", "1", r#"{"other": {}}"#] {
        assert_eq!(from_extras(none), Ok(None), "{none}");
    }
    for bad in [
        "",
        "{",
        r#"{"subsurface": 1}"#,
        r#"{"subsurface": {}}"#,
        r#"{"subsurface": {"mean_free_path": [1, 1]}}"#,
        r#"{"subsurface": {"mean_free_path": [1, 1, "1"]}}"#,
        r#"{"subsurface": {"mean_free_path": [1, 1, 1], "weight": "full"}}"#,
    ] {
        assert!(from_extras(bad).is_err(), "{bad}");
    }
}
