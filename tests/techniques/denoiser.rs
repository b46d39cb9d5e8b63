//! The denoiser: less error than the frames that it filters, the same light, sharp textures, and histories as without it.

use crate::support::{app::*, small_scenes::*};
use bevy::prelude::*;
use bevy_restir::{Denoiser, Direct, Paths, Restir, Technique, testing::shader_library::ShaderEdit};

const SIZE: u32 = 48;
const BOUNCES: u32 = 3;
/// Frames before the one that is compared.
const FRAMES: u32 = 24;

/// Direct light as users have it, and paths in few passes, which compile quickly.
fn settings(technique: Technique, denoiser: Denoiser) -> Restir {
    Restir { technique, bounces: BOUNCES, firefly_limit: 2.5, denoiser, direct: Direct::default(), ..plain() }
}

/// With all reuse as users have it.
fn shipped(technique: Technique, denoiser: Denoiser) -> Restir {
    Restir { paths: Paths::default(), ..settings(technique, denoiser) }
}

fn truth(rig: &mut Rig, bounces: u32) -> Picture {
    rig.set(|restir| *restir = Restir { bounces, ..plain() });
    rig.picture(400)
}

/// Mean over pixels of the squared error relative to the truth, without the worst percent.
fn error(picture: &Picture, truth: &Picture) -> f64 {
    let floor = 0.01 * truth.mean() * truth.mean();
    let of_pixel = |(a, b): (&[f32; 3], &[f32; 3])| {
        let of_channel = |i: usize| {
            let (a, b) = (f64::from(a[i]), f64::from(b[i]));
            (a - b) * (a - b) / (b * b + floor)
        };
        (0..3).map(of_channel).sum::<f64>() / 3.0
    };
    let mut errors: Vec<f64> = picture.pixels.iter().zip(&truth.pixels).map(of_pixel).collect();
    errors.sort_by(f64::total_cmp);
    errors.truncate(errors.len() * 99 / 100);
    errors.iter().sum::<f64>() / errors.len() as f64
}

/// Errors of a frame without and with the denoiser, and the relative difference of their means.
fn compare(
    rig: &mut Rig,
    technique: Technique,
    truth: &Picture,
    settings: fn(Technique, Denoiser) -> Restir,
) -> [f64; 3] {
    let [plain, denoised] = [Denoiser::OFF, Denoiser::ON].map(|denoiser| {
        rig.set(|restir| *restir = settings(technique, denoiser));
        rig.picture(FRAMES)
    });
    [error(&plain, truth), error(&denoised, truth), denoised.mean() / plain.mean() - 1.0]
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn denoised_frames_have_a_fraction_of_the_error() {
    have_a_fraction_of_the_error(&[Technique::Di, Technique::Pt]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_denoised_frames_of_the_other_techniques_have_a_fraction_of_the_error() {
    have_a_fraction_of_the_error(&[Technique::Gi, Technique::Bdpt]);
}

fn have_a_fraction_of_the_error(techniques: &[Technique]) {
    let Some(mut rig) = room_scene(SIZE) else { return };
    for &technique in techniques {
        let truth = truth(&mut rig, if technique == Technique::Di { 1 } else { BOUNCES });
        let [plain, denoised, light] = compare(&mut rig, technique, &truth, shipped);
        println!("{technique:?}: {plain:.4}, denoised {denoised:.4}, light {light:+.4}");
        assert!(denoised < 0.3 * plain, "{technique:?}: {plain} and {denoised}");
        assert!(light.abs() < 0.03, "{technique:?}: {light}");
    }
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn histories_do_not_depend_on_the_denoiser() {
    let Some(mut rig) = room_scene(SIZE) else { return };
    rig.set(|restir| *restir = shipped(Technique::Pt, Denoiser::ON));
    let _compiled = rig.picture(2);
    rig.set(|restir| restir.denoiser = Denoiser::OFF);
    let without = rig.picture(8);
    rig.set(|restir| restir.reset = true);
    rig.frames(3);
    let resets = rig.report().history_resets;
    rig.set(|restir| restir.denoiser = Denoiser::ON);
    rig.frames(3);
    let memory = rig.report().memory.len();
    rig.set(|restir| restir.denoiser = Denoiser::OFF);
    rig.frame();
    let after = rig.next();
    // Shaders that know the diffuse part round otherwise.
    let is_rounded = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-4 * b.abs();
    let rounded = |(a, b): (&[f32; 3], &[f32; 3])| a.iter().zip(b).all(is_rounded);
    let equal = after.pixels.iter().zip(&without.pixels).filter(|&(a, b)| rounded((a, b))).count();
    assert!(equal >= without.pixels.len() * 99 / 100, "{equal} pixels are equal");
    assert_eq!(rig.report().history_resets, resets);
    assert_eq!(rig.report().memory.len() + 4, memory, "its textures and uniforms are gone");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_that_the_camera_sees_directly_is_not_filtered() {
    let Some(mut rig) = room_scene(SIZE) else { return };
    rig.insert(rig.camera, sky(0.7));
    let unlit = StandardMaterial { unlit: true, ..Color::linear_rgb(0.2, 0.1, 0.3).into() };
    rig.spawn(square(0.5), unlit, Transform::from_xyz(0.8, -0.4, 1.0));
    rig.set(|restir| *restir = Restir { bounces: 0, ..settings(Technique::Pt, Denoiser::OFF) });
    let emitted = rig.picture(1);
    rig.set(|restir| restir.denoiser = Denoiser::ON);
    assert_eq!(rig.picture(4), emitted);
    // With bounces, pixels of surfaces that only emit keep their values.
    rig.set(|restir| restir.bounces = BOUNCES);
    let lit = rig.picture(4);
    let black = |c: &[f32; 3]| c.iter().all(|&c| c == 0.0);
    let kept = emitted.pixels.iter().zip(&lit.pixels).filter(|(emitted, lit)| !black(emitted) && emitted == lit);
    let kept = kept.count();
    let emitting = emitted.pixels.iter().filter(|emitted| !black(emitted)).count();
    assert!(emitting > 90 && kept >= emitting * 9 / 10, "{kept} of {emitting} pixels");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn textures_stay_sharp() {
    let Some(mut rig) = scene(SIZE, |rig| {
        let checks = texture(16, 16, |x, y| if (x + y) % 2 == 0 { [250, 60, 200, 255] } else { [40, 200, 0, 255] });
        let image = Some(rig.add::<Image>(checks));
        rig.spawn(
            square(4.0),
            StandardMaterial { base_color_texture: image, ..lambert(1.0) },
            Transform::from_xyz(0.0, 0.0, -0.5),
        );
        rig.spawn(square(0.8), lamp(6.0, 5.0, 4.0), facing(Vec3::new(1.5, 1.6, 2.0), Vec3::ZERO));
        rig.spawn(square(0.8), lamp(4.0, 5.0, 6.0), facing(Vec3::new(-2.5, 0.6, 1.0), Vec3::ZERO));
    }) else {
        return;
    };
    let truth = truth(&mut rig, 1);
    let [plain, denoised, _] = compare(&mut rig, Technique::Di, &truth, settings);
    println!("{plain:.6}, denoised {denoised:.6}");
    assert!(denoised < 0.5 * plain && denoised < 2e-3, "{plain} and {denoised}");
}

/// The filter alone, without means over frames.
const FILTER: Denoiser = Denoiser { history: 1, ..Denoiser::ON };

/// Errors of a part of the last of some frames, with each of the denoisers.  `pose`: sets the scene up for a share of the motion, from 0
/// to 1.
fn errors_in_motion<const N: usize>(
    rig: &mut Rig,
    (bounces, denoisers): (u32, [Denoiser; N]),
    part: fn(&Picture) -> Picture,
    pose: impl Fn(&mut Rig, f32),
) -> [f64; N] {
    let pictures = denoisers.map(|denoiser| {
        rig.set(|restir| *restir = Restir { bounces, ..settings(Technique::Pt, denoiser) });
        pose(rig, 0.0);
        rig.until_ready();
        rig.set(|restir| restir.reset = true);
        for frame in 0..FRAMES {
            pose(rig, frame as f32 / FRAMES as f32);
            rig.frame();
        }
        pose(rig, 1.0);
        rig.next()
    });
    let truth = part(&truth(rig, bounces));
    pictures.map(|picture| error(&part(&picture), &truth))
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn means_over_frames_follow_the_camera() {
    let Some(mut rig) = room_scene(SIZE) else { return };
    let denoisers = [Denoiser::OFF, FILTER, Denoiser::ON];
    let [plain, filtered, both] = errors_in_motion(&mut rig, (BOUNCES, denoisers), Picture::clone, |rig, t| {
        *rig.get_mut::<Transform>(rig.camera) =
            Transform::from_xyz(1.3 - 2.2 * t, 0.2, 4.0 - 0.5 * t).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
    });
    println!("camera: {plain:.4}, filtered {filtered:.4}, and over frames {both:.4}");
    assert!(both < 0.9 * filtered && both < 0.65 * plain, "{plain}, {filtered}, {both}");
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn means_over_frames_follow_objects_and_lights() {
    let Some(mut rig) = scene(SIZE, moving) else { return };
    let denoisers = [Denoiser::OFF, FILTER, Denoiser::ON];
    let [plain, filtered, both] = errors_in_motion(&mut rig, (BOUNCES, denoisers), Picture::clone, |rig, t| {
        pose_moving_at(rig, STEPS as f32 * t)
    });
    println!("everything: {plain:.4}, filtered {filtered:.4}, and over frames {both:.4}");
    assert!(filtered < 0.8 * plain && both < 0.9 * plain && both < 1.4 * filtered, "{plain}, {filtered}, {both}");
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn an_orthographic_camera_denoises_slanted_surfaces() {
    let Some(mut rig) = room_scene(SIZE) else { return };
    rig.insert(rig.camera, orthographic(3.6, 3.6));
    let truth = truth(&mut rig, 1);
    let [plain, denoised, light] = compare(&mut rig, Technique::Di, &truth, settings);
    println!("{plain:.4}, denoised {denoised:.4}, light {light:+.4}");
    assert!(denoised < 0.4 * plain && light.abs() < 0.01, "{plain}, {denoised}, {light}");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_that_dims_does_not_linger() {
    let Some(mut rig) = scene(SIZE, punctual) else { return };
    rig.set(|restir| *restir = settings(Technique::Di, Denoiser::ON));
    rig.picture(FRAMES);
    let mut lights = rig.app.world_mut().query::<&mut PointLight>();
    for mut light in lights.iter_mut(rig.app.world_mut()) {
        light.intensity *= 0.1;
    }
    rig.frames(9);
    let after = rig.next().mean();
    let truth = truth(&mut rig, 1).mean();
    println!("ten frames after: {after:.4} of {truth:.4}");
    assert!((after / truth - 1.0).abs() < 0.05, "{after} of {truth}");
}

/// A mirror of this roughness.
fn mirror(roughness: f32) -> StandardMaterial {
    shiny(Color::linear_rgb(0.9, 0.9, 0.9), roughness, 1.0)
}

/// The first smooth material brings a pass and textures of its own; the means over frames stay.
#[test]
#[ignore = "second tier: ./run test --more"]
fn means_outlive_the_first_smooth_material() {
    let Some(mut rig) = room_scene(SIZE) else { return };
    let truth = truth(&mut rig, BOUNCES);
    rig.set(|restir| {
        *restir = settings(Technique::Pt, Denoiser::ON);
        // The means alone remember earlier frames.
        (restir.paths.reuse.temporal, restir.direct.reuse.temporal) = (false, false);
    });
    let first = error(&rig.picture(1), &truth);
    let before = error(&rig.picture(FRAMES), &truth);
    let memory = rig.report().memory.len();
    rig.spawn(square(0.01), mirror(0.02), Transform::from_xyz(0.0, 0.0, 50.0));
    // Its mesh is built, and its shaders are compiled, in the meantime.
    let mut worst: f64 = 0.0;
    for _ in 0..40 {
        worst = worst.max(error(&rig.next(), &truth));
    }
    eprintln!("{first} in the first frame, {before} before the change, and at most {worst} after it");
    assert!(first > 2.0 * before, "the test has no power");
    assert!(worst < 2.0 * before);
    assert!(rig.report().memory.len() > memory, "the textures for mirrors are there");
}

/// A striped wall behind the camera, in a mirror of this material.
fn mirrored(rig: &mut Rig, mirror: StandardMaterial) {
    let stripes = texture(24, 1, |x, _| if x % 2 == 0 { [250, 240, 200, 255] } else { [20, 30, 60, 255] });
    let image = Some(rig.add::<Image>(stripes));
    let striped = StandardMaterial { base_color_texture: image, ..lambert(1.0) };
    rig.spawn(square(4.0), mirror, Transform::from_xyz(0.0, 0.0, -1.2));
    rig.spawn(square(8.0), striped, Transform::from_xyz(0.0, 0.0, 6.0).looking_to(Vec3::Z, Vec3::Y));
    rig.spawn(square(1.5), lamp(6.0, 5.0, 4.0), facing(Vec3::new(0.5, 3.0, 2.0), Vec3::new(0.0, 0.0, 6.0)));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn reflections_stay_sharp() {
    for roughness in [0.05, 0.0] {
        let Some(mut rig) = scene(SIZE, |rig| mirrored(rig, mirror(roughness))) else { return };
        let truth = truth(&mut rig, BOUNCES);
        let [plain, denoised, light] = compare(&mut rig, Technique::Pt, &truth, shipped);
        // The filter alone, on a picture with few bounces and little noise: all of its change would be blur.
        rig.set(|restir| *restir = Restir { bounces: 2, ..shipped(Technique::Pt, FILTER) });
        let filtered = rig.picture(1);
        rig.set(|restir| restir.denoiser = Denoiser::OFF);
        let unfiltered = rig.picture(1);
        let change = error(&filtered, &unfiltered);
        println!("{roughness}: {plain:.5}, denoised {denoised:.5}, light {light:+.4}; the filter changes {change:.6}");
        assert!(denoised < plain && light.abs() < 0.02 && change < 1e-3, "{plain}, {denoised}, {light}, {change}");
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn reflections_do_not_trail() {
    // The denoiser does not follow the rays of coated surfaces.
    let coated = StandardMaterial { clearcoat: 1.0, clearcoat_perceptual_roughness: 0.05, ..mirror(0.05) };
    let Some(mut rig) = scene(SIZE, |rig| mirrored(rig, coated)) else { return };
    let denoisers = [FILTER, Denoiser::ON];
    let [filtered, both] = errors_in_motion(&mut rig, (BOUNCES, denoisers), Picture::clone, move_sideways);
    println!("mirror in motion: filtered {filtered:.4}, and over frames {both:.4}");
    assert!(both < 1.2 * filtered, "{filtered}, {both}");
}

/// A ball that turns looks like one at rest.
#[test]
#[ignore = "second tier: ./run test --more"]
fn reflections_on_objects_that_turn_do_not_trail() {
    let make = |rig: &mut Rig| {
        // The texture is there so that the shaders are those of the test above.
        let white = Some(rig.add::<Image>(texture(1, 1, |_, _| [255; 4])));
        let coat = StandardMaterial { clearcoat: 1.0, clearcoat_perceptual_roughness: 0.25, ..lambert(0.0) };
        let varnished = StandardMaterial { base_color_texture: white, ..coat };
        let ball = rig.spawn(Sphere::new(1.2), varnished, Transform::from_xyz(0.0, 0.0, 0.5));
        rig.insert(ball, Name::new("ball"));
        rig.spawn(square(0.6), lamp(60.0, 50.0, 40.0), facing(Vec3::new(-2.0, 2.0, 4.0), Vec3::ZERO));
    };
    let Some(mut rig) = scene(SIZE, make) else { return };
    let denoisers = [FILTER, Denoiser::ON];
    let [filtered, both] = errors_in_motion(&mut rig, (BOUNCES, denoisers), Picture::clone, |rig, t| {
        let ball = rig.named("ball");
        rig.get_mut::<Transform>(ball).rotation = Quat::from_rotation_y(0.5 * t);
    });
    println!("a ball that turns: filtered {filtered:.4}, and over frames {both:.4}");
    assert!(both < 1.1 * filtered, "{filtered}, {both}");
}

fn move_sideways(rig: &mut Rig, t: f32) {
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3 - 0.8 * t, 0.2, 4.0).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
}

/// With fewer bounces, mirrors in mirrors would show dark spots.
const IN_MIRRORS: u32 = 8;

/// The part of a picture of `mirror_room` that shows its mirror wall.
fn mirror_wall(picture: &Picture) -> Picture {
    let is_left = |i: usize| i % (SIZE as usize) < SIZE as usize / 6;
    let pixels = picture.pixels.iter().enumerate().filter(|&(i, _)| is_left(i)).map(|(_, p)| *p).collect();
    Picture { pixels, ..picture.clone() }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn smooth_mirrors_and_glass_show_denoised_surfaces() {
    let Some(mut rig) = Rig::load("mirror_room", SIZE) else { return };
    let truth = truth(&mut rig, IN_MIRRORS);
    let [plain, denoised] = [Denoiser::OFF, Denoiser::ON].map(|denoiser| {
        rig.set(|restir| *restir = Restir { bounces: IN_MIRRORS, ..settings(Technique::Pt, denoiser) });
        rig.picture(FRAMES)
    });
    let light = denoised.mean() / plain.mean() - 1.0;
    let [all, wall] =
        [Picture::clone, mirror_wall].map(|part| [&plain, &denoised].map(|p| error(&part(p), &part(&truth))));
    println!("whole picture {all:.4?}, mirror {wall:.4?}, light {light:+.4}");
    assert!(all[1] < 0.55 * all[0] && wall[1] < 0.75 * wall[0] && light.abs() < 0.03, "{all:?}, {wall:?}, {light}");
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn means_of_mirrors_follow_the_camera() {
    let Some(mut rig) = Rig::load("mirror_room", SIZE) else { return };
    let from = *rig.get_mut::<Transform>(rig.camera);
    let denoisers = [Denoiser::OFF, FILTER, Denoiser::ON].map(|on| Denoiser { iterations: on.iterations.min(1), ..on });
    let [plain, filtered, both] = errors_in_motion(&mut rig, (IN_MIRRORS, denoisers), mirror_wall, |rig, t| {
        *rig.get_mut::<Transform>(rig.camera) = from * Transform::from_xyz(0.4 * t - 0.2, 0.0, 0.0);
    });
    println!("mirror in motion: {plain:.4}, filtered {filtered:.4}, and over frames {both:.4}");
    assert!(filtered < 0.6 * plain && both < 0.75 * filtered, "{plain}, {filtered}, {both}");
}

#[test]
fn denoised_objects_keep_their_edges() {
    // Parallel walls at two distances, in different light.
    let Some(mut rig) = scene(SIZE, |rig| {
        rig.spawn(square(4.0), lambert(0.7), Transform::from_xyz(0.0, 0.0, -1.2));
        for i in 0..6 {
            let at = Vec3::new(0.6 * i as f32 - 1.5, -0.2, 0.5);
            rig.spawn(Rectangle::new(0.2, 3.0), lambert(0.7), Transform::from_translation(at));
        }
        rig.spawn(square(0.6), lamp(6.0, 5.0, 4.0), facing(Vec3::new(-1.5, 1.0, -0.2), Vec3::new(0.0, 0.0, -1.2)));
        rig.spawn(square(0.6), lamp(1.0, 2.0, 4.0), facing(Vec3::new(1.5, 2.0, 3.0), Vec3::ZERO));
    }) else {
        return;
    };
    let truth = truth(&mut rig, 1);
    let [plain, denoised, light] = compare(&mut rig, Technique::Di, &truth, settings);
    println!("slats: {plain:.4}, denoised {denoised:.4}, light {light:+.4}");
    assert!(denoised < 0.35 * plain && light.abs() < 0.01, "{plain}, {denoised}, {light}");
}

/// A denoised frame of a wall whose light is multiplied by a factor, and the same without the factor.
fn noisy_and_plain(factor: &'static str) -> Option<[Picture; 2]> {
    let to = format!("scattered_light(pixel) * ({factor})").leak();
    let edit = ShaderEdit { module: "pass/resolve.wgsl", from: "limited(scattered_light(pixel), pixel, ids.x)", to };
    let frame = |edits: &[ShaderEdit]| {
        let mut rig = scene(SIZE, |rig| {
            rig.spawn(square(4.0), lambert(0.7), Transform::from_xyz(0.0, 0.0, -1.2));
            rig.spawn(square(0.8), lamp(6.0, 5.0, 4.0), facing(Vec3::new(0.5, 2.4, 1.3), Vec3::ZERO));
        })?;
        plant_edits(&mut rig.app, edits);
        rig.set(|restir| *restir = settings(Technique::Di, Denoiser::ON));
        Some(rig.picture(FRAMES))
    };
    Some([frame(&[edit])?, frame(&[])?])
}

/// Reuse keeps samples for many frames, so that noise does not show in the variance between frames.
#[test]
#[ignore = "second tier: ./run test --more"]
fn noise_that_frames_have_in_common_is_filtered() {
    let factor = "0.5 + fract(sin(dot(vec2<f32>(pixel), vec2<f32>(12.9898, 78.233))) * 43758.547)";
    let Some([noisy, plain]) = noisy_and_plain(factor) else { return };
    let error = error(&noisy, &plain);
    println!("noise in all frames: {error:.5}");
    // The factor has the variance 1/12.
    assert!(error < 0.25 / 12.0, "{error}");
    assert!((noisy.mean() / plain.mean() - 1.0).abs() < 0.02, "{} and {}", noisy.mean(), plain.mean());
}

#[test]
fn single_bright_pixels_are_shared_with_the_pixels_around() {
    let Some([bright, plain]) = noisy_and_plain("select(1.0, 50.0, all(pixel % 16u == vec2<u32>(8u)))") else {
        return;
    };
    let ratios = plain.pixels.iter().zip(&bright.pixels).map(|(a, b)| b[0] / a[0].max(1e-3));
    let brightest = ratios.fold(0.0, f32::max);
    // Nine pixels of 48 x 48 have 49 times their light in addition.  The pixels around them have hardly any noise: with few similar
    // neighbors, they take more than the bright pixels give.
    let added = (bright.mean() / plain.mean() - 1.0) / (9.0 * 49.0 / f64::from(SIZE * SIZE));
    println!("bright pixels: {brightest:.2} times as bright, with {added:.3} of the added light");
    assert!(brightest < 6.0, "{brightest}");
    assert!((0.7..2.5).contains(&added), "{added}");
}

#[test]
fn very_bright_light_leaves_a_finite_picture() {
    let Some(mut rig) = scene(SIZE, |rig| {
        rig.spawn(square(4.0), lambert(0.7), Transform::from_xyz(0.0, 0.0, -1.2));
        rig.spawn(square(0.8), lamp(1e27, 1e10, 1e-20), facing(Vec3::new(0.5, 1.4, 0.3), Vec3::ZERO));
    }) else {
        return;
    };
    rig.set(|restir| *restir = settings(Technique::Pt, Denoiser::ON));
    let picture = rig.picture(4);
    assert!(picture.is_finite() && picture.mean() > 1e20, "{}", picture.mean());
    rig.assert_sound();
}
