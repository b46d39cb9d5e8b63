//! Bad numbers in every field, and bad meshes, while an app runs, for every technique: the app survives, the picture stays finite, and
//! with the good value restored it equals the earlier picture bit for bit.

use crate::support::{
    app::*,
    bad_numbers::{BAD, Extent, Target, assert_no_errors, fresh, try_all},
    log,
};
use bevy::{
    camera::{Exposure, primitives::Aabb},
    light::SunDisk,
    math::Affine2,
    mesh::{Indices, VertexAttributeValues as Values},
    prelude::*,
};
use bevy_restir::{Direct, EmissiveLuminance, Restir, RestirEnvironment, Technique};

/// A component or an asset is checked before any technique sees it, so that all values are tried with one technique only.
fn extent(technique: Technique, whole: Technique) -> Extent {
    if technique == whole { Extent::Full } else { Extent::Sample }
}

/// The app, and the objects whose fields become bad.  Beside each of them stands another one of its kind that stays good, so that the
/// features of the scene stay, and no pipeline is compiled again.
struct Scene {
    rig: Rig,
    mesh: Handle<Mesh>,
    material: Handle<StandardMaterial>,
    object: Entity,
    lights: [Entity; 4],
}

/// A material with every lobe.
fn every_lobe(image: &Handle<Image>) -> StandardMaterial {
    StandardMaterial {
        base_color: Color::linear_rgba(0.8, 0.7, 0.6, 0.9),
        base_color_texture: Some(image.clone()),
        emissive: LinearRgba::rgb(0.3, 0.2, 0.1),
        metallic: 0.3,
        perceptual_roughness: 0.4,
        specular_transmission: 0.3,
        diffuse_transmission: 0.3,
        thickness: 0.2,
        attenuation_color: Color::linear_rgb(0.5, 0.9, 0.7),
        attenuation_distance: 0.5,
        clearcoat: 0.5,
        clearcoat_perceptual_roughness: 0.3,
        anisotropy_strength: 0.4,
        anisotropy_rotation: 0.5,
        alpha_mode: AlphaMode::Mask(0.5),
        uv_transform: Affine2::from_scale(Vec2::splat(2.0)),
        cull_mode: None,
        ..default()
    }
}

fn lights(rig: &mut Rig, x: f32) -> [Entity; 4] {
    let at = |x, z| Transform::from_xyz(x, 0.8, z).looking_at(Vec3::new(0.0, -0.5, -1.0), Vec3::Y);
    let sun = (DirectionalLight { illuminance: 1.0, ..default() }, SunDisk { angular_size: 0.3, intensity: 1.0 });
    [
        rig.spawn_bundle((PointLight { intensity: 20.0, radius: 0.1, ..default() }, at(x, 1.0))),
        rig.spawn_bundle((SpotLight { intensity: 30.0, outer_angle: 0.8, ..default() }, at(x, 1.5))),
        rig.spawn_bundle((sun, at(x, 2.0))),
        rig.spawn_bundle((RectLight { intensity: 10.0, width: 0.4, height: 0.3, ..default() }, at(x, 2.5))),
    ]
}

fn scene() -> Option<Scene> {
    let mut rig = Rig::new(8, 8)?;
    rig.spawn(square(6.0), lambert(0.6), Transform::from_xyz(0.0, 0.0, -1.0));
    let image = rig.add::<Image>(texture(4, 4, |x, y| [60 * x as u8, 60 * y as u8, 200, 255]));
    let thin = StandardMaterial { thickness: 0.0, ..every_lobe(&image) };
    rig.spawn(square(0.8), thin, Transform::from_xyz(-1.0, -0.6, 0.0));
    rig.spawn(
        square(0.5),
        StandardMaterial { unlit: true, ..Color::WHITE.into() },
        Transform::from_xyz(-1.6, 0.8, 0.0),
    );
    rig.spawn(Sphere::new(0.4).mesh().uv(12, 8), every_lobe(&image), Transform::from_xyz(-0.3, -0.6, 0.0));
    rig.spawn(square(0.5), lamp(3.0, 3.0, 2.0), Transform::from_xyz(0.0, 1.2, 0.5).looking_to(Vec3::Y, Vec3::X));
    let mesh = rig.add::<Mesh>(victim());
    let material = rig.add::<StandardMaterial>(every_lobe(&image));
    let place = Transform::from_xyz(0.7, -0.4, 0.2);
    let object = rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), place));
    lights(&mut rig, -1.0);
    rig.spawn_bundle((
        DirectionalLight { illuminance: 0.2, ..default() },
        Transform::from_rotation(Quat::from_rotation_x(-0.7)),
    ));
    let lights = lights(&mut rig, 1.0);
    rig.insert(rig.camera, sky(0.2));
    // Few light subsets, because a CPU fills them slowly.
    let direct = Direct { subset_count: 4, subset_size: 32, ..default() };
    rig.set(|restir| *restir = Restir { bounces: 2, seed: 5, direct, ..default() });
    Some(Scene { rig, mesh, material, object, lights })
}

/// A mesh with all vertex attributes and indices.
fn victim() -> Mesh {
    let mut mesh = Sphere::new(0.5).mesh().uv(8, 6).with_generated_tangents().expect("it has normals and coordinates");
    let uvs = mesh.attribute(Mesh::ATTRIBUTE_UV_0).expect("a sphere has texture coordinates").clone();
    mesh.insert_attribute(Mesh::ATTRIBUTE_UV_1, uvs);
    mesh.insert_attribute(Mesh::ATTRIBUTE_COLOR, vec![[1.0f32; 4]; mesh.count_vertices()]);
    mesh
}

impl Scene {
    /// Runs a check for every technique, with the picture of the good scene.
    fn with_every_technique(&mut self, check: impl FnMut(&mut Self, Technique, &Picture)) {
        self.with_techniques(&Technique::ALL, check);
    }

    fn with_techniques(&mut self, techniques: &[Technique], mut check: impl FnMut(&mut Self, Technique, &Picture)) {
        for &technique in techniques {
            self.rig.set(|restir| restir.technique = technique);
            self.rig.until_ready();
            let good = fresh(&mut self.rig);
            assert_eq!(fresh(&mut self.rig), good, "{technique:?} draws one picture for one seed");
            assert!(good.mean() > 0.05, "{technique:?}");
            check(self, technique, &good);
        }
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn bad_numbers_in_objects_and_materials_leave_no_trace_in_paths() {
    check_objects_and_materials(&[Technique::Pt]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_bad_numbers_in_objects_and_materials_leave_no_trace() {
    check_objects_and_materials(&Technique::ALL);
}

fn check_objects_and_materials(techniques: &[Technique]) {
    let Some(mut scene) = scene() else { return };
    scene.with_techniques(techniques, |scene, technique, good| {
        let targets =
            [Target::component::<Transform>("object", scene.object), Target::asset("material", scene.material.clone())];
        try_all(
            &mut scene.rig,
            &targets,
            good,
            &format!("{technique:?}"),
            extent(technique, Technique::Reference),
            |_, _, _| false,
        );
    });
}

/// Values that are not tried: mostly those on which an assertion in Bevy's own code for frusta fails, in builds with debug assertions, because
/// they leave a camera or a light without a direction.
fn is_skipped(target: &str, path: &str, value: f64) -> bool {
    let is_small = value.abs() <= 1.0;
    match target {
        "Projection" => !(value == -1.0),
        "camera" | "sun" | "spot" | "rect" => path.starts_with("scale") || path.starts_with("rotation") && !is_small,
        // Many neighbors need other pipelines, which take seconds to compile.
        "Restir" => path.ends_with("_samples") && value > 1.0,
        "PointLight" | "SpotLight" => path.starts_with("shadow") || path == "range",
        _ => false,
    }
}

/// Numbers of the settings that choose among pipelines, whose compilation takes minutes for some techniques.
fn chooses_pipelines(target: &str, path: &str) -> bool {
    target == "Restir" && (path.ends_with("_samples") || path.ends_with("iterations") || path == "bdpt.light_paths")
}

/// Both groups in one app, because the compilation takes most of the time.
#[test]
#[ignore = "second tier: ./run test --more"]
fn bad_numbers_in_lights_cameras_and_settings_leave_no_trace_in_resampled_light() {
    let Some(mut scene) = scene() else { return };
    scene.with_techniques(&[Technique::Di, Technique::Gi, Technique::Bdpt], |scene, technique, good| {
        check_lights(scene, technique, good);
        check_camera_and_settings(scene, technique, good, |target, path, value| {
            is_skipped(target, path, value) || chooses_pipelines(target, path)
        });
    });
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_bad_numbers_in_lights_leave_no_trace() {
    let Some(mut scene) = scene() else { return };
    scene.with_every_technique(check_lights);
}

fn check_lights(scene: &mut Scene, technique: Technique, good: &Picture) {
    let [point, spot, sun, rect] = scene.lights;
    let targets = [
        Target::component::<PointLight>("PointLight", point),
        Target::component::<SpotLight>("SpotLight", spot),
        Target::component::<DirectionalLight>("DirectionalLight", sun),
        Target::component::<RectLight>("RectLight", rect),
        Target::component::<Transform>("point", point),
        Target::component::<Transform>("spot", spot),
        Target::component::<Transform>("rect", rect),
        Target::component::<Transform>("sun", sun),
    ];
    let title = format!("{technique:?}");
    try_all(&mut scene.rig, &targets, good, &title, extent(technique, Technique::Reference), is_skipped);
    // `SunDisk` has no reflection.
    for bad in BAD {
        for disk in [SunDisk { angular_size: bad, intensity: 1.0 }, SunDisk { angular_size: 0.3, intensity: bad }] {
            scene.rig.insert(sun, disk);
            assert!(scene.rig.next().is_finite(), "{title}: SunDisk of {bad}");
            assert_no_errors(&scene.rig, &title);
        }
    }
    scene.rig.insert(sun, SunDisk { angular_size: 0.3, intensity: 1.0 });
    scene.rig.frame();
    assert_eq!(&fresh(&mut scene.rig), good, "{title}: SunDisk");
    assert_no_errors(&scene.rig, &title);
}

/// `is_skipped`: numbers and values that are not tried.
fn check_camera_and_settings(
    scene: &mut Scene,
    technique: Technique,
    good: &Picture,
    is_skipped: impl Fn(&str, &str, f64) -> bool,
) {
    let camera = scene.rig.camera;
    let mut targets = vec![
        Target::component::<Projection>("Projection", camera),
        Target::component::<Transform>("camera", camera),
        Target::component::<Exposure>("Exposure", camera),
        Target::component::<Restir>("Restir", camera),
    ];
    // Without an environment, or without emission, other pipelines are compiled, which takes seconds.
    if matches!(technique, Technique::Di | Technique::Pt) {
        targets.push(Target::component::<RestirEnvironment>("RestirEnvironment", camera));
        targets.push(Target::resource::<EmissiveLuminance>("EmissiveLuminance"));
    }
    let title = format!("{technique:?}");
    try_all(&mut scene.rig, &targets, good, &title, extent(technique, Technique::Pt), is_skipped);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_bad_numbers_in_cameras_and_settings_leave_no_trace() {
    log::listen();
    let Some(mut scene) = scene() else { return };
    let camera = scene.rig.camera;
    scene.with_every_technique(|scene, technique, good| check_camera_and_settings(scene, technique, good, is_skipped));
    scene.rig.insert(camera, orthographic(4.0, 3.0));
    scene.rig.set(|restir| restir.technique = Technique::Pt);
    scene.rig.until_ready();
    let good = fresh(&mut scene.rig);
    let targets = [Target::component::<Projection>("Projection", camera)];
    try_all(&mut scene.rig, &targets, &good, "orthographic", Extent::Full, is_skipped);
    // One warning for each number that has a range, whatever its values were.
    for field in ["bounces", "direct.reuse.radius", "paths.reuse.confidence_cap", "paths.footprint", "debug_scale"] {
        let warnings = log::warnings(&format!("camera {camera}: {field} = "));
        assert!(!warnings.is_empty(), "{field}");
    }
}

/// Ways to break the mesh of [`victim`].
fn broken_meshes() -> Vec<(String, Mesh)> {
    let mut meshes = Vec::new();
    let attributes = [
        Mesh::ATTRIBUTE_POSITION,
        Mesh::ATTRIBUTE_NORMAL,
        Mesh::ATTRIBUTE_TANGENT,
        Mesh::ATTRIBUTE_UV_0,
        Mesh::ATTRIBUTE_UV_1,
        Mesh::ATTRIBUTE_COLOR,
    ];
    for attribute in attributes {
        for bad in BAD {
            // In all vertices, and in one.
            for step in [1, usize::MAX] {
                let mut mesh = victim();
                match mesh.attribute_mut(attribute).expect("the mesh has every attribute") {
                    Values::Float32x2(v) => v.iter_mut().step_by(step).for_each(|x| *x = [bad; 2]),
                    Values::Float32x3(v) => v.iter_mut().step_by(step).for_each(|x| *x = [bad; 3]),
                    Values::Float32x4(v) => v.iter_mut().step_by(step).for_each(|x| *x = [bad; 4]),
                    other => panic!("{other:?}"),
                }
                meshes.push((format!("{} of {bad:e}, every {step}", attribute.name), mesh));
            }
        }
        if attribute.name != Mesh::ATTRIBUTE_POSITION.name {
            let mut mesh = victim();
            mesh.remove_attribute(attribute);
            meshes.push((format!("without {}", attribute.name), mesh));
        }
    }
    let count = victim().count_vertices() as u32;
    let with_indices = |indices| victim().with_inserted_indices(Indices::U32(indices));
    meshes.push(("indices out of range".into(), with_indices(vec![0, 1, count, 2, 3, u32::MAX, 4, 5, 6])));
    meshes.push(("an incomplete triangle".into(), with_indices(vec![0, 1, 9, 4, 5])));
    meshes.push(("no index".into(), with_indices(vec![])));
    meshes.push(("no vertex".into(), Mesh::new(victim().primitive_topology(), victim().asset_usage)));
    meshes
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn broken_meshes_leave_no_trace_in_paths() {
    check_broken_meshes(&[Technique::Pt], 11);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_broken_meshes_leave_no_trace() {
    check_broken_meshes(&[Technique::Pt], 1);
    // The handling of a mesh does not depend on the technique.
    check_broken_meshes(&Technique::ALL, 7);
}

/// Tries every `step`th mesh.
fn check_broken_meshes(techniques: &[Technique], step: usize) {
    let Some(mut scene) = scene() else { return };
    let handle = scene.mesh.clone();
    // Bevy computes the box of a mesh once.
    scene.rig.insert(scene.object, Aabb::default());
    scene.with_techniques(techniques, |scene, technique, good| {
        for (name, mesh) in broken_meshes().into_iter().step_by(step) {
            let name = format!("{technique:?}: {name}");
            scene.rig.edit(&handle, |old| *old = mesh);
            scene.rig.until_ready();
            assert!(scene.rig.next().is_finite(), "{name}");
            assert_no_errors(&scene.rig, &name);
            scene.rig.edit(&handle, |old| *old = victim());
            scene.rig.until_ready();
            assert_eq!(&fresh(&mut scene.rig), good, "{name}: good again");
            assert_no_errors(&scene.rig, &name);
        }
    });
}

#[test]
fn a_bad_setting_that_changes_in_every_frame_is_named_once() {
    log::listen();
    let Some(mut rig) = Rig::new(8, 8) else { return };
    for i in 0..99 {
        // No other test has numbers that begin with these digits.
        rig.set(|restir| restir.paths.reuse.depth_threshold = -73_100.0 - i as f32);
        rig.frame();
    }
    let warnings = log::warnings("paths.reuse.depth_threshold = -731");
    assert_eq!(warnings.len(), 1, "{warnings:?}");
}
