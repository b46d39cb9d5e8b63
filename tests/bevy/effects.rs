//! Bevy's post-processing effects change our picture as they change the picture of Bevy's rasterizer for the same scene.

use crate::support::{app::*, small_scenes::*};
use bevy::{
    anti_alias::{contrast_adaptive_sharpening::ContrastAdaptiveSharpening, fxaa::Fxaa, taa::TemporalAntiAliasing},
    core_pipeline::{
        prepass::{DepthPrepass, MotionVectorPrepass},
        tonemapping::{DebandDither, Tonemapping},
    },
    diagnostic::FrameCount,
    light::GlobalAmbientLight,
    post_process::{
        auto_exposure::{AutoExposure, AutoExposurePlugin},
        bloom::Bloom,
        dof::DepthOfField,
        effect_stack::ChromaticAberration,
        motion_blur::MotionBlur,
    },
    prelude::*,
    render::camera::{MipBias, TemporalJitter},
};
use bevy_restir::{Denoiser, Jitter, Paths, Restir, Technique};

/// An effect with its name; `false` removes it.
type Effect = (&'static str, Box<dyn Fn(&mut EntityWorldMut, bool)>);

fn effect<C: Component + Clone>(name: &'static str, component: C) -> Effect {
    let change = move |camera: &mut EntityWorldMut, add: bool| {
        match add {
            true => camera.insert(component.clone()),
            false => camera.remove::<(C, TemporalJitter, MipBias, DepthPrepass, MotionVectorPrepass)>(),
        };
    };
    (name, Box::new(change))
}

fn temporal() -> Effect {
    effect("temporal anti-aliasing", TemporalAntiAliasing::default())
}

/// The transform of an object over time.
#[derive(Component)]
struct Path(fn(f32) -> Transform);

/// The number of elapsed frames, and whether time passes.
#[derive(Resource, Default)]
struct Clock(u32, bool);

fn ride(mut clock: ResMut<Clock>, mut riders: Query<(&Path, &mut Transform)>) {
    riders.iter_mut().for_each(|(path, mut place)| *place = path.0(clock.0 as f32));
    clock.0 += clock.1 as u32;
}

/// A noise-free scene, rendered by us or by Bevy's rasterizer, in which a ball slides and a board turns and disappears.
struct Stage(Rig);

impl Stage {
    fn new(restir: bool, wall: [f32; 3], spark: f32) -> Option<Self> {
        let mut rig = Rig::beside(|app| _ = app.add_plugins(AutoExposurePlugin), 64, 48)?;
        rig.app.insert_resource(GlobalAmbientLight { brightness: 0.0, ..default() });
        let [r, g, b] = wall;
        rig.spawn(square(30.0), lamp(r, g, b), Transform::from_xyz(0.0, 0.0, -3.0));
        let ball = rig.spawn(Sphere::new(0.6).mesh().uv(18, 12), lamp(0.4, 0.2, 0.1), Transform::default());
        rig.insert(ball, Path(|t| Transform::from_xyz(-1.6 + 0.2 * t, 0.1, 0.0)));
        let board = rig.spawn(square(1.2), lamp(0.1, 0.3, 0.2), Transform::default());
        let turning = |t: f32| {
            Transform::from_xyz(1.0, -0.5, 0.5 - 0.05 * t).with_rotation(Quat::from_rotation_z(0.3 + 0.15 * t))
        };
        rig.insert(board, Path(turning));
        rig.app.init_resource::<Clock>().add_systems(Update, ride);
        rig.spawn(square(0.3), lamp(spark, spark, spark), Transform::from_xyz(0.0, 1.2, 1.0));
        let camera = rig.camera;
        rig.insert(camera, (Tonemapping::Reinhard, DebandDither::Disabled));
        if restir {
            rig.set(|restir| *restir = Restir { technique: Technique::Di, ..plain() });
            rig.until_ready();
        } else {
            rig.app.world_mut().entity_mut(camera).remove::<Restir>();
            rig.insert(camera, Msaa::Off);
        }
        Some(Self(rig))
    }

    /// The picture after some frames with an effect, while objects move or rest.
    fn picture(&mut self, (_, change): &Effect, frames: u32, moves: bool) -> Vec<[u8; 4]> {
        let rig = &mut self.0;
        let camera = rig.camera;
        let set = |rig: &mut Rig, add| change(&mut rig.app.world_mut().entity_mut(camera), add);
        rig.app.insert_resource(Clock::default());
        // Wait until the shaders of the effect are loaded.
        set(rig, true);
        rig.frames(8);
        set(rig, false);
        rig.frame();
        // Bevy's jitter depends on the frame count.
        while !rig.app.world().resource::<FrameCount>().0.is_multiple_of(8) {
            rig.frame();
        }
        set(rig, true);
        rig.app.insert_resource(Clock(0, moves));
        rig.frames(frames);
        let target = rig.target.clone();
        let drawn = rig.drawn(&target);
        set(rig, false);
        drawn
    }
}

/// The largest difference between the channels of two pixels.
fn apart(a: &[u8; 4], b: &[u8; 4]) -> u8 {
    (0..3).map(|i| a[i].abs_diff(b[i])).max().unwrap_or(0)
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn effects_change_our_picture_as_they_change_bevys() {
    let stage = |restir| Stage::new(restir, [0.05, 0.06, 0.08], 30.0);
    let (Some(mut ours), Some(mut bevys)) = (stage(true), stage(false)) else { return };
    let none: Effect = ("none", Box::new(|_, _| ()));
    let adapts = AutoExposure { speed_brighten: 60.0, speed_darken: 60.0, ..default() };
    let lens = DepthOfField { focal_distance: 5.0, aperture_f_stops: 0.02, ..default() };
    let plain = ours.picture(&none, 12, true);
    for effect in [
        none,
        temporal(),
        effect("bloom", Bloom::NATURAL),
        effect("fast anti-aliasing", Fxaa::default()),
        effect("sharpening", ContrastAdaptiveSharpening { enabled: true, ..default() }),
        effect("depth of field", lens),
        effect("motion blur", MotionBlur { shutter_angle: 2.0, samples: 4 }),
        effect("chromatic aberration", ChromaticAberration { intensity: 0.2, ..default() }),
        // Bevy keeps adapting the exposure after the effect is removed.
        effect("automatic exposure", adapts),
    ] {
        let (a, b) = (ours.picture(&effect, 12, true), bevys.picture(&effect, 12, true));
        let other = a.iter().zip(&b).filter(|(a, b)| apart(a, b) > 3).count();
        let done = a.iter().zip(&plain).filter(|(a, b)| apart(a, b) > 3).count();
        let name = effect.0;
        println!("{name}: changes {done} pixels; {other} of {} differ from Bevy's", a.len());
        assert!(name == "none" || done > 20, "{name} changes only {done} pixels");
        // Where an edge falls on a pixel center, rounding decides.
        assert!(other * 100 <= a.len(), "{name}: {other} of {} pixels differ from Bevy's", a.len());
    }
    ours.0.assert_sound();
}

/// The linear green channel of a pixel in the target.
fn linear(pixel: &[u8; 4]) -> f64 {
    let v = f64::from(pixel[1]) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn temporal_anti_aliasing_smooths_edges_and_keeps_flat_areas() {
    let Some(mut stage) = Stage::new(true, [0.1; 3], 0.3) else { return };
    stage.0.insert(stage.0.camera, Tonemapping::None);
    let none: Effect = ("none", Box::new(|_, _| ()));
    let aliased = stage.picture(&none, 1, false);
    let smoothed = stage.picture(&temporal(), 64, false);
    // The expected value is the mean over whole pixels.
    stage.0.set(|restir| (restir.technique, restir.jitter) = (Technique::Reference, Jitter::Always));
    stage.0.until_ready();
    let truth = stage.picture(&none, 256, false);
    let error = |picture: &[[u8; 4]]| {
        let sum: f64 = picture.iter().zip(&truth).map(|(a, b)| (linear(a) - linear(b)).powi(2)).sum();
        sum / picture.len() as f64
    };
    let mean = |picture: &[[u8; 4]]| picture.iter().map(linear).sum::<f64>() / picture.len() as f64;
    let (before, after) = (error(&aliased), error(&smoothed));
    println!("error: {before:.3e} without, {after:.3e} with; mean {} for {}", mean(&smoothed), mean(&truth));
    assert!(after < 0.3 * before, "{after} with, {before} without");
    assert!((mean(&smoothed) / mean(&truth) - 1.0).abs() < 0.01, "{} for {}", mean(&smoothed), mean(&truth));
    let flat = |i: usize| {
        let near = [i.wrapping_sub(64), i.wrapping_sub(1), i + 1, i + 64];
        near.iter().all(|&j| truth.get(j).is_none_or(|p| apart(p, &truth[i]) == 0))
    };
    for i in (0..truth.len()).filter(|&i| flat(i)) {
        assert!(apart(&smoothed[i], &truth[i]) <= 1, "pixel {i}: {:?} for {:?}", smoothed[i], truth[i]);
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn temporal_anti_aliasing_leaves_no_trails_behind_moving_objects() {
    let Some(mut stage) = Stage::new(true, [0.1; 3], 0.3) else { return };
    stage.0.insert(stage.0.camera, Tonemapping::None);
    let sharp = stage.picture(&("none", Box::new(|_, _| ())), 16, true);
    let smoothed = stage.picture(&temporal(), 16, true);
    let at = |x: i32, y: i32| sharp[(y.clamp(0, 47) * 64 + x.clamp(0, 63)) as usize];
    let (mut trails, mut flat, mut edges) = (0, 0, 0);
    for (i, (a, b)) in smoothed.iter().zip(&sharp).enumerate() {
        let (x, y) = (i as i32 % 64, i as i32 / 64);
        // Pixels within two pixels of an edge may be smoothed.
        let near = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (dx, dy)));
        if near.into_iter().all(|(dx, dy)| apart(&at(x + dx, y + dy), b) == 0) {
            flat += 1;
            trails += (apart(a, b) > 2) as usize;
        } else {
            edges += (apart(a, b) > 2) as usize;
        }
    }
    println!("{trails} of {flat} pixels away from edges differ; {edges} at edges");
    assert!(flat > 1500 && edges > 30, "{flat} flat pixels, {edges} of edges");
    assert_eq!(trails, 0, "trails among {flat} pixels away from edges");
}

/// Mean squared errors of what the screen shows of noisy paths in motion, of all pixels and without the worst tenth, which are at edges.
fn screen_errors(rig: &mut Rig, settings: &Restir, smooths: bool, truth: &[[u8; 4]]) -> [f64; 2] {
    const FRAMES: u32 = 32;
    let (target, camera) = (rig.target.clone(), rig.camera);
    rig.set(|restir| *restir = settings.clone());
    (temporal().1)(&mut rig.app.world_mut().entity_mut(camera), smooths);
    rig.until_ready();
    rig.frames(8);
    // Bevy's jitter depends on the frame count.
    while !rig.app.world().resource::<FrameCount>().0.is_multiple_of(8) {
        rig.frame();
    }
    rig.set(|restir| restir.reset = true);
    for frame in 1..=FRAMES {
        pose_moving_at(rig, frame as f32 / FRAMES as f32);
        rig.frame();
    }
    let drawn = rig.drawn(&target);
    (temporal().1)(&mut rig.app.world_mut().entity_mut(camera), false);
    let error = |(a, b): (&[u8; 4], &[u8; 4])| (linear(a) - linear(b)).powi(2);
    let mut errors: Vec<f64> = drawn.iter().zip(truth).map(error).collect();
    errors.sort_by(f64::total_cmp);
    [errors.len(), errors.len() * 9 / 10].map(|count| errors[..count].iter().sum::<f64>() / count as f64)
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_denoised_frames_get_smoother_edges_by_temporal_anti_aliasing() {
    let Some(mut rig) = Rig::beside(|_| (), 64, 64) else { return };
    moving(&mut rig);
    rig.insert(rig.camera, (Tonemapping::Reinhard, DebandDither::Disabled));
    let noisy = Restir { technique: Technique::Pt, bounces: 3, firefly_limit: 2.5, paths: Paths::default(), ..plain() };
    rig.set(|restir| *restir = Restir { technique: Technique::Reference, jitter: Jitter::Always, ..noisy.clone() });
    pose_moving_at(&mut rig, 1.0);
    rig.picture(1000);
    let target = rig.target.clone();
    let truth = rig.drawn(&target);
    let denoised = Restir { denoiser: Denoiser::ON, ..noisy.clone() };
    let [smoothed, filtered, both] = [(&noisy, true), (&denoised, false), (&denoised, true)]
        .map(|(settings, smooths)| screen_errors(&mut rig, settings, smooths, &truth));
    println!("smoothed {smoothed:?}, denoised {filtered:?}, both {both:?}");
    assert!(both[0] < 0.85 * filtered[0], "edges: {both:?}, {filtered:?}");
    assert!(both[1] < smoothed[1] && both[1] < 1.4 * filtered[1], "elsewhere: {both:?}, {filtered:?}, {smoothed:?}");
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn bloom_spreads_light_without_loss_even_for_lamps_beyond_half_float_range() {
    let bloom = effect("bloom", Bloom::NATURAL);
    let none: Effect = ("none", Box::new(|_, _| ()));
    for spark in [0.9, 1e30] {
        let Some(mut stage) = Stage::new(true, [0.0; 3], spark) else { return };
        stage.0.insert(stage.0.camera, Tonemapping::None);
        let (sharp, glowing) = (stage.picture(&none, 1, false), stage.picture(&bloom, 1, false));
        if spark > 1.0 {
            let dark = glowing.iter().filter(|p| p[1] == 0).count();
            assert_eq!(dark, 0, "pixels that a lamp of {spark} does not reach or that are NaN");
        } else {
            let mean = |picture: &[[u8; 4]]| picture.iter().map(linear).sum::<f64>() / picture.len() as f64;
            println!("mean {} with bloom, {} without", mean(&glowing), mean(&sharp));
            assert!((mean(&glowing) / mean(&sharp) - 1.0).abs() < 0.05, "{} for {}", mean(&glowing), mean(&sharp));
            let lit = |picture: &[[u8; 4]]| picture.iter().filter(|p| p[1] > 0).count();
            assert!(lit(&glowing) > 2 * lit(&sharp), "{} pixels for {}", lit(&glowing), lit(&sharp));
        }
        stage.0.assert_sound();
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn automatic_exposure_brightens_a_dark_scene() {
    let Some(mut stage) = Stage::new(true, [0.004; 3], 0.01) else { return };
    let adapts = AutoExposure { speed_brighten: 60.0, speed_darken: 60.0, ..default() };
    let wall = |picture: &[[u8; 4]]| linear(&picture[0]);
    let before = wall(&stage.picture(&("none", Box::new(|_, _| ())), 1, false));
    let after = wall(&stage.picture(&effect("automatic exposure", adapts), 30, false));
    println!("{before} without, {after} with");
    assert!(before < 0.01 && after > 0.1, "{before} without, {after} with");
}
