//! Frames accumulate while nothing visible changes, and the random numbers depend on the seed and the frame alone.

use crate::support::app::*;
use bevy::{
    camera::Exposure,
    light::RectLight,
    prelude::*,
    render::{
        diagnostic::RenderDiagnosticsPlugin, render_resource::TextureFormat, renderer::RenderDevice,
        settings::WgpuFeatures,
    },
};
use bevy_restir::{
    DebugView, EmissiveLuminance, Jitter, RestirBudget, RestirEnvironment, Technique,
    testing::shader_library::ShaderEdit,
};

/// A lit plane with a texture, and handles to what the tests change.
struct Scene {
    rig: Rig,
    plane: Entity,
    light: Entity,
    texture: Handle<Image>,
    environment: Handle<Image>,
}

/// An equirectangular image of one color.
fn uniform_map(value: u8) -> Image {
    let mut image = texture(4, 2, |_, _| [value, value, value, 255]);
    image.texture_descriptor.format = TextureFormat::Rgba8Unorm;
    image
}

fn scene() -> Option<Scene> {
    let mut rig = Rig::new(24, 16)?;
    let texture = rig.add::<Image>(texture(2, 2, |x, _| [200, 100, 50 + 100 * x as u8, 255]));
    let material = StandardMaterial {
        base_color_texture: Some(texture.clone()),
        emissive: LinearRgba::rgb(0.01, 0.02, 0.03),
        ..lambert(1.0)
    };
    let plane = rig.spawn(square(4.0), material, Transform::default());
    let light = rig.spawn_bundle((PointLight { intensity: 50.0, ..default() }, Transform::from_xyz(1.0, 1.0, 2.0)));
    let environment = rig.add::<Image>(uniform_map(100));
    let map = RestirEnvironment { image: Some(environment.clone()), ..sky(0.5) };
    rig.insert(rig.camera, map);
    rig.set(|restir| (restir.bounces, restir.jitter) = (2, Jitter::Always));
    Some(Scene { rig, plane, light, texture, environment })
}

/// f32 counts no further than 2^24, so that colors alone would grow.  Here a sum is full after four frames.
#[test]
fn a_full_sum_stays_as_it_is() {
    let Some(Scene { mut rig, .. }) = scene() else { return };
    let small = ShaderEdit {
        module: "view/pixel_light.wgsl",
        from: "MAX_ACCUMULATED: f32 = 16777216.0",
        to: "MAX_ACCUMULATED: f32 = 4.0",
    };
    plant_edits(&mut rig.app, &[small]);
    for technique in [Technique::Reference, Technique::Di] {
        rig.set(|restir| (restir.technique, restir.accumulate) = (technique, true));
        let full = rig.picture(4);
        let later = rig.next();
        assert_eq!(full.pixels, later.pixels, "{technique:?}");
    }
}

#[test]
fn samples_add_up_while_nothing_changes() {
    let Some(Scene { mut rig, .. }) = scene() else { return };
    rig.until_ready();
    rig.set(|restir| restir.reset = true);
    for n in 1..=5 {
        let picture = rig.next();
        assert_eq!((picture.samples, rig.report().samples), (n, n));
    }
    // `reset` holds for one frame and clears itself.
    rig.set(|restir| restir.reset = true);
    assert_eq!(rig.next().samples, 1);
    assert_eq!(rig.next().samples, 2);
    // Views of surfaces show one frame, whatever its number.
    rig.set(|restir| restir.debug_view = DebugView::Normals);
    rig.frames(3);
    let picture = rig.next();
    assert_eq!((picture.samples, rig.report().samples), (1, 1));
}

#[test]
fn the_exposure_restarts_a_mean_only_where_the_clear_color_is_visible() {
    let Some(Scene { mut rig, .. }) = scene() else { return };
    let samples_after = |rig: &mut Rig, ev100| {
        rig.until_ready();
        rig.frames(2);
        rig.insert(rig.camera, Exposure { ev100 });
        rig.next().samples
    };
    rig.app.insert_resource(ClearColor(Color::linear_rgb(0.1, 0.1, 0.1)));
    assert!(samples_after(&mut rig, 12.0) > 2);
    rig.app.world_mut().entity_mut(rig.camera).remove::<RestirEnvironment>();
    assert_eq!(samples_after(&mut rig, 9.0), 1);
}

/// Its edges must not hold a part of the clear color.
#[test]
fn a_mean_restarts_where_the_camera_begins_to_show_an_earlier_picture() {
    let Some(Scene { mut rig, .. }) = scene() else { return };
    rig.app.world_mut().entity_mut(rig.camera).remove::<RestirEnvironment>();
    // All of these have the same color.
    for clear_color in [ClearColorConfig::None, ClearColorConfig::Default, ClearColorConfig::Custom(Color::NONE)] {
        rig.until_ready();
        rig.frames(2);
        assert!(rig.next().samples > 2);
        rig.get_mut::<Camera>(rig.camera).clear_color = clear_color;
        assert_eq!(rig.next().samples, 1, "{clear_color:?}");
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn changes_of_rejected_lights_do_not_reset_the_history() {
    let Some(Scene { mut rig, .. }) = scene() else { return };
    let at = Transform::from_xyz(-1.0, 1.0, 2.0);
    let light = |intensity| PointLight { intensity, ..default() };
    let nowhere = Transform::from_translation(Vec3::NAN);
    let beside = rig.spawn_bundle((light(0.0), at));
    let half_nowhere = rig.spawn_bundle((light(50.0), Transform::from_xyz(f32::NAN, 0.0, 0.0)));
    rig.spawn_bundle((light(50.0), nowhere));
    rig.spawn_bundle((light(f32::NAN), at));
    rig.spawn_bundle((PointLight { color: Color::linear_rgb(f32::NAN, 1.0, 1.0), ..light(50.0) }, at));
    rig.spawn_bundle((SpotLight { outer_angle: f32::NAN, ..default() }, at));
    rig.spawn_bundle((RectLight { width: f32::NAN, ..default() }, at));
    for technique in [Technique::Reference, Technique::Di] {
        rig.set(|restir| (restir.technique, restir.accumulate) = (technique, true));
        rig.until_ready();
        rig.set(|restir| restir.reset = true);
        for n in 1..=5 {
            // A black light and a light at NaN: their motion is not visible.
            rig.get_mut::<Transform>(beside).translation.x += 0.1;
            rig.get_mut::<Transform>(half_nowhere).translation.y += 0.1;
            assert_eq!(rig.next().samples, n, "{technique:?}");
            assert_eq!(rig.report().uploaded_bytes, 0);
        }
    }
    rig.get_mut::<PointLight>(beside).intensity = 50.0;
    assert_eq!(rig.next().samples, 1, "the light was turned on");
    rig.assert_sound();
}

#[test]
fn every_visible_change_resets_the_history() {
    type Change = fn(&mut Scene);
    let changes: [(&str, Change); 18] = [
        ("transform", |s| s.rig.get_mut::<Transform>(s.plane).translation.x += 0.1),
        ("material", |s| {
            let material = s.rig.material_of(s.plane);
            s.rig.edit(&material, |m| m.base_color = Color::linear_rgb(0.3, 0.3, 0.3));
        }),
        ("light power", |s| s.rig.get_mut::<PointLight>(s.light).intensity *= 1.1),
        ("light position", |s| s.rig.get_mut::<Transform>(s.light).translation.z += 0.1),
        ("light removed", |s| {
            s.rig.app.world_mut().despawn(s.light);
        }),
        ("camera", |s| s.rig.get_mut::<Transform>(s.rig.camera).translation.z += 0.1),
        ("field of view", |s| {
            let projection = PerspectiveProjection { fov: 0.9, ..default() };
            s.rig.insert(s.rig.camera, Projection::Perspective(projection));
        }),
        ("environment", |s| s.rig.get_mut::<RestirEnvironment>(s.rig.camera).intensity *= 1.5),
        ("rotation of the environment", |s| {
            s.rig.get_mut::<RestirEnvironment>(s.rig.camera).rotation = Quat::from_rotation_y(0.5);
        }),
        ("bounces", |s| s.rig.set(|restir| restir.bounces = 3)),
        ("seed", |s| s.rig.set(|restir| restir.seed = 9)),
        ("emissive luminance", |s| s.rig.app.world_mut().resource_mut::<EmissiveLuminance>().0 = 2.0),
        ("hidden", |s| s.rig.insert(s.plane, Visibility::Hidden)),
        ("shown again", |s| s.rig.insert(s.plane, Visibility::Visible)),
        ("texels of a texture", |s| {
            let texture = s.texture.clone();
            s.rig.edit(&texture, |image| image.data.as_mut().expect("kept on the CPU").fill(180));
        }),
        ("transform of texture coordinates", |s| {
            let material = s.rig.material_of(s.plane);
            s.rig.edit(&material, |m| m.uv_transform = bevy::math::Affine2::from_translation(Vec2::new(0.5, 0.0)));
        }),
        ("texture coordinates", |s| {
            let material = s.rig.material_of(s.plane);
            s.rig.edit(&material, |m| m.base_color_channel = bevy::mesh::UvChannel::Uv1);
        }),
        ("texels of the environment", |s| {
            let environment = s.environment.clone();
            s.rig.edit(&environment, |image| image.data.as_mut().expect("kept on the CPU").fill(20));
        }),
    ];
    let Some(mut scene) = scene() else { return };
    for (name, change) in changes {
        scene.rig.until_ready();
        scene.rig.frames(2);
        let before = scene.rig.next();
        assert!(before.samples >= 3, "{name}: only {} samples before the change", before.samples);
        change(&mut scene);
        let after = scene.rig.next();
        assert_eq!(after.samples, 1, "{name} changed");
    }
    // An environment of another kind is shown when its pipelines are compiled.
    scene.rig.insert(scene.rig.camera, sky(0.1));
    let samples: Vec<_> = (0..4).map(|_| scene.rig.next().samples).collect();
    assert!(samples.contains(&1), "new environment: {samples:?}");
    // Without an environment the clear color is visible.
    scene.rig.app.world_mut().entity_mut(scene.rig.camera).remove::<RestirEnvironment>();
    scene.rig.until_ready();
    scene.rig.frames(2);
    scene.rig.app.world_mut().resource_mut::<ClearColor>().0 = Color::linear_rgb(0.1, 0.2, 0.3);
    assert_eq!(scene.rig.next().samples, 1, "clear color");

    // A changed mesh is rebuilt in a background task; the history restarts when the new triangles arrive.
    let mesh = scene.rig.app.world().get::<Mesh3d>(scene.plane).expect("the plane has a mesh").0.clone();
    scene.rig.edit(&mesh, |mesh| *mesh = square(3.0));
    scene.rig.frame();
    scene.rig.until_ready();
    let after = scene.rig.next();
    scene.rig.set(|restir| restir.reset = true);
    scene.rig.frames(after.samples - 1);
    let alone = scene.rig.next();
    let sky = alone.at(0, 0);
    let clear: Vec<_> = alone.iter().filter(|(at, c)| *c == sky && alone.is_flat_around(*at)).collect();
    assert!(clear.len() > 100, "{} pixels see only the sky", clear.len());
    assert!(clear.iter().all(|(at, c)| after.at(at.x, at.y) == *c), "the old mesh is still visible");
}

#[test]
fn scene_changes_keep_the_random_sequence_and_a_reset_restarts_it() {
    let Some(Scene { mut rig, .. }) = scene() else { return };
    let lamp = rig.spawn(square(1.0), lamp(5.0, 4.0, 3.0), Transform::from_xyz(0.0, 3.0, 1.0));
    // Too far away to be seen: it changes and moves without a visible effect.
    let far = rig.spawn(square(0.01), lambert(0.5), Transform::from_xyz(0.0, 0.0, 500.0));
    let material = rig.material_of(far);
    let begin = |rig: &mut Rig| {
        rig.set(|restir| restir.reset = true);
        rig.next()
    };
    rig.until_ready();
    let first = begin(&mut rig);
    let mut seen = vec![first.clone()];
    for i in 0..4 {
        rig.edit(&material, |m| m.metallic = 0.1 + 0.1 * i as f32);
        let next = rig.next();
        assert_eq!(next.samples, 1, "the history restarts");
        assert!(seen.iter().all(|before| *before != next), "frame {i} repeats the noise of an earlier frame");
        seen.push(next);
        rig.get_mut::<Transform>(lamp).translation.z += 1e-4;
    }
    assert_eq!(begin(&mut rig).samples, 1);
    rig.get_mut::<Transform>(lamp).translation.z = 1.0;
    rig.edit(&material, |m| m.metallic = 0.0);
    rig.frames(2);
    assert_eq!(begin(&mut rig), first, "after a reset");
    rig.frames(3);
    rig.set(|restir| restir.seed = 1);
    assert_ne!(rig.next(), first);
    rig.set(|restir| restir.seed = 0);
    assert_eq!(rig.next(), first, "after a change of the seed and back");
}

/// A camera that renders every second frame, or whose target gets another size in each frame, has new noise in each of its pictures.
#[test]
fn a_camera_that_pauses_or_is_resized_does_not_repeat_its_noise() {
    let Some(Scene { mut rig, .. }) = scene() else { return };
    rig.until_ready();
    let mut seen = vec![rig.next()];
    for i in 0..3 {
        rig.get_mut::<Camera>(rig.camera).is_active = false;
        rig.frames(2);
        rig.get_mut::<Camera>(rig.camera).is_active = true;
        let next = rig.next();
        assert_eq!(next.samples, 1, "the history restarts");
        assert!(seen.iter().all(|before| *before != next), "pause {i} repeats the noise of an earlier frame");
        seen.push(next);
    }
    let target = rig.target.clone();
    for i in 0..2 {
        for size in [UVec2::new(23, 16), UVec2::new(24, 16)] {
            rig.edit(&target, |image| *image = target_image(size));
            rig.frames(2);
        }
        let next = rig.next();
        assert!(seen.iter().all(|before| *before != next), "resize {i} repeats the noise of an earlier frame");
        seen.push(next);
    }
}

#[test]
fn a_resize_restarts_the_history() {
    let Some(Scene { mut rig, .. }) = scene() else { return };
    rig.until_ready();
    rig.frames(3);
    for size in [UVec2::new(31, 17), UVec2::new(1, 1), UVec2::new(40, 24)] {
        let target = rig.target.clone();
        rig.edit(&target, |image| *image = target_image(size));
        // Bevy reports the new size of a target to its camera in the next frame.
        rig.frame();
        let picture = rig.picture(1);
        assert_eq!((picture.size, picture.samples), (size, 1));
        assert!(picture.mean() > 0.0);
        assert_eq!(rig.next().samples, 2);
    }
}

#[test]
fn equal_seeds_give_equal_pictures_and_different_seeds_equal_means() {
    let Some(Scene { mut rig, .. }) = scene() else { return };
    let first = rig.picture(8);
    assert_eq!(rig.picture(8), first, "the same app, rendered again");
    let Some(mut other) = scene() else { return };
    assert_eq!(other.rig.picture(8), first, "a second app");

    let means = |rig: &mut Rig, seeds: core::ops::Range<u32>| -> Vec<f64> {
        seeds
            .map(|seed| {
                rig.set(|restir| restir.seed = seed);
                let picture = rig.picture(8);
                assert_ne!(picture, first, "seed {seed}");
                picture.mean()
            })
            .collect()
    };
    let (a, error_a) = mean_and_error(means(&mut rig, 100..112));
    let (b, error_b) = mean_and_error(means(&mut rig, 200..212));
    let error = error_a.hypot(error_b);
    assert!(error < 0.01 * a, "the test has no power: standard error {error}, mean {a}");
    assert!((a - b).abs() < 5.0 * error, "{a} and {b}, standard error {error}");
}

#[test]
fn direct_light_accumulates_when_enabled() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.spawn(square(1.0), lamp(3.0, 3.0, 3.0), Transform::from_xyz(3.0, 0.0, 2.0).looking_to(Vec3::X, Vec3::Y));
    rig.set(|restir| restir.technique = Technique::Di);
    rig.until_ready();
    assert_eq!(rig.next().samples, 1, "frames do not accumulate");
    rig.set(|restir| restir.accumulate = true);
    let one = rig.next();
    rig.frames(6);
    let eight = rig.next();
    assert_eq!((one.samples, eight.samples), (1, 8));
    // Moving objects are shown without delay.
    rig.get_mut::<Transform>(rig.camera).translation.x += 0.1;
    assert_eq!(rig.next().samples, 1);
}

/// A scene of 16 x 12 pixels whose GPU times Bevy measures; `None` if the device measures none.
fn measured_scene() -> Option<Rig> {
    let mut rig = Rig::beside(|app| _ = app.add_plugins(RenderDiagnosticsPlugin), 16, 12)?;
    let times = WgpuFeatures::TIMESTAMP_QUERY | WgpuFeatures::TIMESTAMP_QUERY_INSIDE_PASSES;
    if !rig.app.world().resource::<RenderDevice>().features().contains(times) {
        println!("skipped: the device does not measure times");
        return None;
    }
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.spawn(square(1.0), lamp(3.0, 3.0, 3.0), Transform::from_xyz(3.0, 0.0, 2.0).looking_to(Vec3::X, Vec3::Y));
    Some(rig)
}

#[test]
fn a_budget_may_lower_the_traced_resolution_and_raises_it_again() {
    let Some(mut rig) = measured_scene() else { return };
    rig.set(|restir| restir.technique = Technique::Di);
    rig.until_ready();
    for (gpu_ms, size) in [(1e-4, UVec2::new(8, 6)), (1e6, UVec2::new(16, 12))] {
        rig.app.insert_resource(RestirBudget { gpu_ms, least_resolution_scale: 0.5 });
        let is_reached = (0..400).any(|_| {
            rig.frame();
            rig.next().size == size
        });
        assert!(is_reached, "{gpu_ms} ms: {} instead of {size}", rig.next().size);
    }
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_budget_that_is_no_time_changes_nothing_and_a_bad_least_resolution_is_clamped() {
    let Some(mut rig) = measured_scene() else { return };
    rig.set(|restir| restir.technique = Technique::Di);
    rig.until_ready();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 0.0, 1e30] {
        rig.app.insert_resource(RestirBudget { gpu_ms: bad, least_resolution_scale: bad });
        // Enough frames for a decision.
        rig.frames(20);
        assert_eq!((rig.report().budget_step, rig.next().size), (0, UVec2::new(16, 12)), "{bad} ms");
    }
    for (least_resolution_scale, size) in [
        (f32::NAN, UVec2::new(16, 12)),
        (f32::INFINITY, UVec2::new(16, 12)),
        (-1.0, UVec2::new(4, 3)),
        (f32::NEG_INFINITY, UVec2::new(4, 3)),
    ] {
        rig.app.insert_resource(RestirBudget { gpu_ms: 1e-4, least_resolution_scale });
        // Until nothing is left to reduce.
        let mut step = None;
        while step != Some(rig.report().budget_step) {
            step = Some(rig.report().budget_step);
            rig.frames(40);
        }
        assert_eq!(rig.next().size, size, "least scale {least_resolution_scale}");
    }
    rig.assert_sound();
}

/// A budget takes samples away, and gives them back; the expected image stays.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_budget_does_not_restart_the_accumulation() {
    let Some(mut rig) = measured_scene() else { return };
    rig.set(|restir| {
        (restir.technique, restir.accumulate) = (Technique::Di, true);
        // More neighbors than the pipelines of reduced settings have room for.
        restir.direct.reuse.spatial_samples = 5;
    });
    rig.until_ready();
    rig.frames(3);
    let frame = |rig: &mut Rig| {
        let before = rig.report().samples;
        rig.frame();
        let report = rig.report();
        assert_eq!(report.samples, before + 1, "at step {}", report.budget_step);
        report.budget_step > 0
    };
    for (gpu_ms, is_reduced) in [(1e-4, true), (1e6, false)] {
        rig.app.insert_resource(RestirBudget { gpu_ms, ..Default::default() });
        assert!(
            (0..400).any(|_| frame(&mut rig) == is_reduced),
            "a budget of {gpu_ms} ms does not change the settings"
        );
        // Pipelines of the new settings are compiled first.
        (0..6).for_each(|_| _ = frame(&mut rig));
    }
    rig.assert_sound();
}
