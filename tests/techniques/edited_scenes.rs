//! Histories survive objects that appear, disappear or are edited, and the light stays right: a frame of a scene that changes equals on
//! average the reference of the scene as it then is.  The mean is over seeds of the last frame of a script of four, at 48 x 48 or 64 x 64
//! pixels; margin 1 to 2 % at α = 0.01.

use crate::support::{
    app::*,
    proof::{AllLight, Bidirectional, Proof, Subject},
    reuse_settings::{di, paths},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{
    DebugView, Direct, Jitter, LightTechniques, Mis, RestirEnvironment, Reuse,
    testing::{SharedPipelines, shader_library::ShaderEdit, share_pipelines},
};

const CONFIDENCE_CAP: f32 = 20.0;

/// The images of the poster and of the sign.
#[derive(Component)]
struct Pictures([Handle<Image>; 2]);

/// An image that is bright on one side.
fn half_bright(is_left: bool) -> Image {
    texture(8, 4, |x, _| if (x < 4) == is_left { [255, 240, 220, 255] } else { [30, 50, 60, 255] })
}

/// A room in which diffuse and emissive objects appear and disappear, and in which materials, images and a mesh are edited: [`pose_edited`].
fn edited(rig: &mut Rig) {
    room(rig);
    let pictures = [true, false].map(|is_left| rig.add::<Image>(half_bright(is_left)));
    rig.insert(rig.camera, Pictures(pictures.clone()));
    let [poster, sign] = pictures.map(Some);
    let mut named = |name: &'static str, mesh: Mesh, material: StandardMaterial, place: Transform| {
        let entity = rig.spawn(mesh, material, place);
        rig.insert(entity, Name::new(name));
    };
    let block = || Mesh::from(Cuboid::new(0.6, 0.6, 0.6));
    let lid = facing(Vec3::new(-0.9, 0.9, 0.6), Vec3::new(0.2, -1.0, 0.0));
    named("arriving", block(), lambert(0.9), Transform::from_xyz(1.1, -0.9, 0.5));
    named("leaving", block(), lambert(0.9), Transform::from_xyz(0.3, -0.9, 0.8));
    named("arriving lamp", square(0.4), lamp(3.0, 8.0, 8.0), lid);
    named(
        "leaving lamp",
        square(0.5),
        lamp(8.0, 3.0, 8.0),
        facing(Vec3::new(1.3, 0.8, 0.8), Vec3::new(-0.5, -1.0, 0.0)),
    );
    named(
        "pulsing lamp",
        square(0.3),
        lamp(4.0, 4.0, 4.0),
        facing(Vec3::new(0.0, 1.2, 0.9), Vec3::new(0.0, -1.0, -0.2)),
    );
    named(
        "poster",
        square(1.2),
        StandardMaterial { base_color_texture: poster, ..lambert(0.9) },
        facing(Vec3::new(1.5, -0.5, 0.2), Vec3::new(0.0, -0.5, 0.2)),
    );
    named(
        "sign",
        square(0.6),
        StandardMaterial { emissive_texture: sign, ..lamp(5.0, 5.0, 5.0) },
        facing(Vec3::new(-1.2, 0.9, -0.5), Vec3::new(0.0, -0.6, 0.2)),
    );
    named("painted", square(2.0), lambert(0.2), Transform::from_xyz(0.8, 0.2, -1.1));
    named("swapped", Cuboid::new(0.5, 0.5, 0.5).into(), lambert(0.7), Transform::from_xyz(-1.1, -0.2, 0.4));
    let shape = rig.add::<Mesh>(Sphere::new(0.35));
    rig.spawn_bundle((Name::new("other shape"), Mesh3d(shape)));
}

/// Edits the room for a step, 0 to [`STEPS`].  The images have other pixels in the last step, and equal ones in the steps before.
fn pose_edited(rig: &mut Rig, step: u32) {
    let is_last = step >= STEPS;
    let pictures = rig.get_mut::<Pictures>(rig.camera).0.clone();
    for (picture, is_left) in pictures.iter().zip([true, false]) {
        rig.edit(picture, |image| *image = half_bright(is_left != is_last));
    }
    for (name, there) in
        [("arriving", is_last), ("arriving lamp", is_last), ("leaving", !is_last), ("leaving lamp", !is_last)]
    {
        let entity = rig.named(name);
        *rig.get_mut::<Visibility>(entity) = if there { Visibility::Inherited } else { Visibility::Hidden };
    }
    let s = step as f32;
    let painted = rig.named("painted");
    let paint = rig.material_of(painted);
    rig.edit(&paint, |m| m.base_color = Color::linear_rgb(0.2 + 0.2 * s, 0.8 - 0.2 * s, 0.5));
    let pulsing = rig.named("pulsing lamp");
    let glow = rig.material_of(pulsing);
    rig.edit(&glow, |m| m.emissive = LinearRgba::rgb(4.0 + 3.0 * s, 4.0, 10.0 - 3.0 * s));
    // Two entities exchange their meshes, so that both shapes stay loaded.
    let [swapped, other] = ["swapped", "other shape"].map(|name| rig.named(name));
    let is_swapped = rig.app.world().get::<IsSwapped>(swapped).is_some();
    if is_last != is_swapped {
        let [a, b] =
            [swapped, other].map(|entity| rig.app.world().get::<Mesh3d>(entity).expect("it has a mesh").clone());
        rig.insert(swapped, b);
        rig.insert(other, a);
        if is_last {
            rig.insert(swapped, IsSwapped);
        } else {
            rig.app.world_mut().entity_mut(swapped).remove::<IsSwapped>();
        }
    }
}

#[derive(Component)]
struct IsSwapped;

fn proof(restarts: u32) -> Proof<'static> {
    Proof { bounces: 3, margin: 0.015, pose: Some(&pose_edited), ..Proof::of((restarts, 1), (14, 32)) }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_and_direct_light_in_an_edited_scene_equal_the_reference() {
    let Some(mut rig) = scene(64, edited) else { return };
    proof(42).check("edited", &mut rig, &[("both", paths::all_reuse())]);
    Proof { bounces: 1, ..proof(60) }.check("edited", &mut rig, &[("direct, both", di::all_reuse())]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_paths_and_direct_light_in_an_edited_scene_equal_the_reference_for_each_kind_of_reuse() {
    let Some(mut rig) = scene(64, edited) else { return };
    let gi = |paths| AllLight::Gi(di::all_reuse(), paths);
    let all = [
        ("paths, temporal", AllLight::Pt(paths::temporal())),
        ("indirect, temporal", gi(paths::temporal())),
        ("indirect, both", gi(paths::all_reuse())),
    ];
    proof(60).check("edited", &mut rig, &all);
    let direct = [("direct, temporal", di::temporal()), ("direct, both", di::all_reuse())];
    Proof { bounces: 1, ..proof(60) }.check("edited", &mut rig, &direct);
}

/// Turns, dims and colors the sky of a step, 0 to [`STEPS`].
fn pose_sky(rig: &mut Rig, step: u32) {
    let s = step as f32;
    let mut sky = rig.get_mut::<RestirEnvironment>(rig.camera);
    sky.rotation = Quat::from_rotation_y(0.6 * s);
    sky.intensity = 0.4 + 0.2 * s;
    sky.color = LinearRgba::rgb(1.0, 0.4 + 0.2 * s, 1.0 - 0.2 * s);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_under_a_sky_that_turns_and_changes_its_color_equal_the_reference() {
    let Some(mut rig) = scene(64, |rig| surrounded(rig, true)) else { return };
    check_sky("sky", &mut rig, 40, &pose_sky);
}

/// The sky shines only before the last step, or only in it.
fn pose_arrival(rig: &mut Rig, step: u32) {
    pose_presence(rig, step >= STEPS);
}

fn pose_departure(rig: &mut Rig, step: u32) {
    pose_presence(rig, step < STEPS);
}

fn pose_presence(rig: &mut Rig, shines: bool) {
    let mut camera = rig.app.world_mut().entity_mut(rig.camera);
    match shines {
        true => camera.insert(sky(0.6)),
        false => camera.remove::<RestirEnvironment>(),
    };
}

/// The images of the sky before the last step and in it.
#[derive(Component)]
struct Skies([Handle<Image>; 2]);

/// A room that another sky lights in the last step ([`pose_skies`]): the suns of the two stand elsewhere.
fn below_two_skies(rig: &mut Rig) {
    surrounded(rig, true);
    let evening =
        texture(16, 8, |x, y| if (x, y) == (4, 2) { [255; 4] } else { [60 - 3 * x as u8, 10 + 5 * y as u8, 20, 255] });
    let evening = rig.add::<Image>(evening);
    let day = rig.get_mut::<RestirEnvironment>(rig.camera).image.clone().expect("the sky has an image");
    rig.insert(rig.camera, Skies([day, evening]));
}

fn pose_skies(rig: &mut Rig, step: u32) {
    let sky = rig.get_mut::<Skies>(rig.camera).0[usize::from(step >= STEPS)].clone();
    rig.get_mut::<RestirEnvironment>(rig.camera).image = Some(sky);
}

/// Compares paths and indirect light in the last step of a room whose sky changes.
fn check_sky(name: &str, rig: &mut Rig, restarts: u32, pose: &dyn Fn(&mut Rig, u32)) {
    // The images of all steps are loaded before frames count.
    for step in [STEPS, 0] {
        pose(rig, step);
        rig.until_ready();
    }
    let proof = Proof { bounces: 3, margin: 0.02, pose: Some(pose), ..Proof::of((restarts, 1), (14, 32)) };
    let gi = AllLight::Gi(di::all_reuse(), paths::all_reuse());
    let all = [("paths, both", AllLight::Pt(paths::all_reuse())), ("indirect, both", gi)];
    proof.check(name, rig, &all);
}

/// The light of the old sky is left out of the history, and that of the new one has none.
#[test]
#[ignore = "second tier: ./run test --more"]
fn light_of_another_sky_equals_the_reference_at_once() {
    let Some(mut rig) = scene(64, below_two_skies) else { return };
    check_sky("two skies", &mut rig, 40, &pose_skies);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_of_skies_that_come_go_and_change_equals_the_reference() {
    type Scene = (&'static str, fn(&mut Rig), fn(&mut Rig, u32));
    let scenes: [Scene; 3] = [
        ("two skies", below_two_skies, pose_skies),
        ("a sky appears", |rig| surrounded(rig, false), pose_arrival),
        ("a sky disappears", |rig| surrounded(rig, false), pose_departure),
    ];
    for (name, make, pose) in scenes {
        let Some(mut rig) = scene(64, make) else { return };
        check_sky(name, &mut rig, 60, &pose);
        let direct = Proof { bounces: 1, margin: 0.02, pose: Some(&pose), ..Proof::of((60, 1), (14, 32)) };
        direct.check(name, &mut rig, &[("direct, both", di::all_reuse())]);
    }
}

/// Light sub-paths of the last frame are replayed among lights and objects that appear, disappear and change, and below a sky that turns.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_in_scenes_that_change_equal_the_reference() {
    type Scene = (&'static str, fn(&mut Rig), fn(&mut Rig, u32));
    let scenes: [Scene; 4] = [
        ("edited", edited, pose_edited),
        ("passing", passing, pose_passing),
        ("sky", |rig| surrounded(rig, true), pose_sky),
        ("two skies", below_two_skies, pose_skies),
    ];
    for (name, make, pose) in scenes {
        let Some(mut rig) = scene(48, make) else { return };
        // Light paths end anywhere in a pixel, so that each restart has its own emission.
        rig.set(|r| r.jitter = Jitter::Always);
        let length = Proof::of((160, 1), (20, 64));
        let proof = Proof { bounces: 3, blended: true, margin: 0.02, pose: Some(&pose), ..length };
        let both = |techniques| Bidirectional(techniques, paths::all_reuse());
        let all = [
            ("BDPT, both, lightweight", both(LightTechniques::Lightweight)),
            ("BDPT, both", both(LightTechniques::Full)),
        ];
        proof.check(name, &mut rig, &all);
    }
}

/// Other numbers and weights of samples in each step, 0 to [`STEPS`].
fn pose_settings(rig: &mut Rig, step: u32) {
    let spatial_samples = [5, 0, 1, 3][step as usize % 4];
    rig.set(|r| {
        r.direct.candidates = 1 + 5 * step;
        for reuse in [&mut r.paths.reuse, &mut r.direct.reuse] {
            *reuse = Reuse {
                spatial_samples,
                spatial_iterations: 1 + step % 2,
                paired: step % 3 == 1,
                radius: 3.0 + 2.0 * step as f32,
                confidence_cap: 4.0 + 3.0 * step as f32,
                mis: [Mis::Balance, Mis::DefensivePairwise][step as usize % 2],
                normal_threshold: 0.5 + 0.1 * step as f32,
                ..reuse.clone()
            };
        }
    });
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_whose_numbers_of_samples_change_in_every_frame_equals_the_reference() {
    let Some(mut rig) = shared(64, "room") else { return };
    let proof = Proof { bounces: 3, margin: 0.01, pose: Some(&pose_settings), ..Proof::of((60, 1), (14, 32)) };
    let both = AllLight::Gi(di::all_reuse(), paths::all_reuse());
    proof.check("other settings", &mut rig, &[("direct and indirect", both)]);
}

/// A planted error: every object counts as present in both frames.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_objects_that_count_in_the_wrong_frame_are_found() {
    let Some(mut rig) = scene(64, edited) else { return };
    let proof = proof(60);
    let reference = proof.truth(&mut rig, 1000);
    let from = "    return (instances[instance].flags & select(INSTANCE_GONE, INSTANCE_APPEARED, previous)) == 0u;";
    plant_edits(&mut rig.app, &[ShaderEdit { module: "scene/triangle.wgsl", from, to: "    return true;" }]);
    let found = proof.resampled(&mut rig, &paths::temporal(), 5000).compare(&reference, 0.01);
    eprintln!("{found}");
    assert!(found.is_different(), "not found: {found}");
}

/// A frame in which objects come, go and change is one frame of history more for all surfaces that they do not hide.
#[test]
#[ignore = "second tier: ./run test --more"]
fn histories_outlive_objects_that_come_and_go_and_change() {
    let Some(mut rig) = scene(32, edited) else { return };
    let reuse = Reuse { confidence_cap: CONFIDENCE_CAP, ..di::temporal().reuse };
    let direct = Direct { reuse, ..di::temporal() };
    rig.set(|r| {
        r.technique = bevy_restir::Technique::Di;
        r.direct = direct;
        r.debug_view = DebugView::ReservoirConfidence;
    });
    pose_edited(&mut rig, 0);
    rig.until_ready();
    pose_edited(&mut rig, STEPS);
    rig.until_ready();
    rig.set(|r| r.reset = true);
    rig.frame();
    for frame in 2..12u32 {
        pose_edited(&mut rig, if frame % 2 == 0 { 0 } else { STEPS });
        let view = rig.next();
        let shown = view.iter().filter(|(_, c)| c.x > 0.0).count();
        let kept = view.iter().filter(|(_, c)| c.x == frame as f32).count();
        assert!(4 * kept > 3 * shown && shown > 300, "frame {frame}: {kept} of {shown} pixels kept their history");
    }
    // The sky turns and dims.
    rig.insert(rig.camera, sky(0.3));
    rig.until_ready();
    rig.set(|r| r.reset = true);
    rig.frames(3);
    for frame in 4..8u32 {
        let mut sky = rig.get_mut::<RestirEnvironment>(rig.camera);
        sky.rotation = Quat::from_rotation_y(frame as f32);
        sky.intensity = (frame % 2) as f32;
        let view = rig.next();
        let kept = view.iter().filter(|(_, c)| c.x == frame as f32).count();
        assert!(kept > 500, "frame {frame} of a sky: {kept} pixels kept their history");
    }
    // A material and a mesh of its own, loaded while others are shown.
    let block = rig.spawn(Cuboid::new(0.2, 0.2, 0.2), lambert(0.5), Transform::from_xyz(0.0, 0.0, 1.0));
    rig.until_ready();
    rig.app.world_mut().despawn(block);
    let view = rig.next();
    let kept = view.iter().filter(|(_, c)| c.x >= 8.0).count();
    assert!(kept > 500, "{kept} pixels kept their history");
}

/// While the pipelines for it are compiled, no reservoir can hold the light.
#[test]
fn the_first_light_of_its_kind_has_its_full_brightness_at_once() {
    let Some(mut rig) = room_scene(32) else { return };
    // No other test has compiled these pipelines.
    share_pipelines(&mut rig.app, SharedPipelines::default());
    rig.set(|restir| di::temporal().apply_to(restir));
    rig.until_ready();
    rig.frames(25);
    rig.spawn_bundle((PointLight { intensity: 500.0, ..default() }, Transform::from_xyz(0.5, 0.8, 1.5)));
    let dark = rig.next().mean();
    rig.until_ready();
    let first = rig.next().mean();
    rig.frames(40);
    let later = rig.next().mean();
    assert!(later > 2.0 * dark, "the light is dim: {dark}, {later}");
    assert!((first / later - 1.0).abs() < 0.1, "{first}, later {later}");
}
