//! Cameras of every kind: several at once, on layers, on devices with low limits, and beside Bevy's own rendering.

use crate::support::{
    app::*,
    log,
    stats::{tost, welch},
};
use bevy::{
    camera::{ImageRenderTarget, RenderTarget, ScalingMode, Viewport, visibility::RenderLayers},
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    light::GlobalAmbientLight,
    prelude::*,
    render::settings::WgpuLimits,
    window::{WindowRef, WindowResolution},
};
use bevy_restir::{DebugView, Jitter, Mis, RadianceCapture, Restir, RestirEnvironment, Technique};
use core::f32::consts::PI;

/// The number of cuts after which a first frame is compared.
const CUTS: u32 = 60;

/// Objects of every kind: surfaces, a lamp, a point light, a sun and a sky.
fn crowd(rig: &mut Rig) {
    rig.spawn(square(20.0), lambert(0.7), Transform::from_xyz(0.0, 0.0, -1.5));
    rig.spawn(Sphere::new(0.6).mesh().uv(18, 12), lambert(0.5), Transform::from_xyz(-0.9, 0.4, 0.0));
    let metal =
        StandardMaterial { metallic: 1.0, perceptual_roughness: 0.3, ..Color::linear_rgb(0.9, 0.7, 0.4).into() };
    let place = Transform::from_xyz(0.8, -0.4, 0.2).with_rotation(Quat::from_rotation_y(0.6));
    rig.spawn(Cuboid::from_length(0.9), metal, place);
    rig.spawn(square(0.8), lamp(9.0, 8.0, 6.0), Transform::from_xyz(0.0, 2.5, 1.0).looking_at(Vec3::Y * 9.0, Vec3::Z));
    rig.spawn_bundle((PointLight { intensity: 60.0, ..default() }, Transform::from_xyz(2.0, 1.0, 2.0)));
    let sun = Transform::from_xyz(1.0, 2.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
    rig.spawn_bundle((DirectionalLight { illuminance: 2.0, ..default() }, sun));
}

/// The pose and the settings of a camera.
struct Eye {
    transform: Transform,
    projection: Projection,
    settings: Restir,
}

fn eyes() -> [Eye; 2] {
    let settings = Restir { bounces: 3, jitter: Jitter::Always, ..plain() };
    [
        Eye {
            transform: Transform::from_xyz(0.0, 0.0, 5.0),
            projection: Projection::Perspective(PerspectiveProjection::default()),
            settings: Restir { technique: Technique::Pt, ..settings.clone() },
        },
        Eye {
            transform: Transform::from_xyz(1.5, 1.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y),
            projection: orthographic(4.0, 4.0),
            settings: Restir { technique: Technique::Di, bounces: 1, ..settings },
        },
    ]
}

/// The pictures of all cameras, `frames` frames after all were reset.
fn pictures(rig: &mut Rig, cameras: &[(Entity, RadianceCapture)], frames: u32) -> Vec<Picture> {
    rig.until_ready();
    for (camera, _) in cameras {
        rig.get_mut::<Restir>(*camera).reset = true;
    }
    rig.frames(frames);
    for (_, capture) in cameras {
        capture.request();
    }
    rig.frame();
    let captured = cameras.iter().map(|(_, capture)| capture.take().expect("every camera renders"));
    captured.map(|c| Picture { size: c.size, pixels: c.mean().collect(), samples: c.samples() }).collect()
}

/// Adds a second camera.
fn second(rig: &mut Rig, order: isize, target: &Handle<Image>, bundle: impl Bundle) -> (Entity, RadianceCapture) {
    let capture = RadianceCapture::default();
    let camera = rig.spawn_bundle((
        Camera3d::default(),
        RenderTarget::Image(ImageRenderTarget::from(target.clone())),
        unit_exposure(),
        capture.clone(),
        bundle,
    ));
    rig.get_mut::<Camera>(camera).order = order;
    (camera, capture)
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn two_cameras_side_by_side_equal_two_single_ones() {
    const SIDE: u32 = 24;
    let mut singles = Vec::new();
    for eye in eyes() {
        let Some(mut rig) = Rig::new(SIDE, SIDE) else { return };
        crowd(&mut rig);
        rig.insert(rig.camera, (eye.transform, eye.projection, eye.settings, sky(0.3)));
        let cameras = [(rig.camera, rig.capture.clone())];
        let picture = pictures(&mut rig, &cameras, 3).remove(0);
        rig.set(|restir| (restir.debug_view, restir.jitter) = (DebugView::Normals, Jitter::Never));
        rig.insert(rig.camera, DebandDither::Disabled);
        rig.until_ready();
        let target = rig.target.clone();
        singles.push((picture, rig.drawn(&target)));
    }

    let [left, right] = eyes();
    let mut rig = Rig::new(2 * SIDE, SIDE).expect("there is an adapter");
    crowd(&mut rig);
    let half =
        |x| Some(Viewport { physical_position: UVec2::new(x, 0), physical_size: UVec2::splat(SIDE), ..default() });
    rig.insert(rig.camera, (left.transform, left.projection, left.settings, sky(0.3)));
    rig.get_mut::<Camera>(rig.camera).viewport = half(0);
    let target = rig.target.clone();
    let other = second(&mut rig, 1, &target, (right.transform, right.projection, right.settings, sky(0.3)));
    rig.get_mut::<Camera>(other.0).viewport = half(SIDE);
    let cameras = [(rig.camera, rig.capture.clone()), other];
    let both = pictures(&mut rig, &cameras, 3);
    for (i, name) in ["left, perspective", "right, orthographic"].into_iter().enumerate() {
        let differing = both[i].iter().zip(singles[i].0.iter()).filter(|(a, b)| a != b).count();
        assert_eq!(differing, 0, "{name}: {differing} of {} pixels", SIDE * SIDE);
        assert!(both[i].mean() > 0.1, "{name}: {}", both[i].mean());
    }
    // The target holds the same picture.
    for (camera, _) in &cameras {
        let mut restir = rig.get_mut::<Restir>(*camera);
        (restir.debug_view, restir.jitter) = (DebugView::Normals, Jitter::Never);
        rig.insert(*camera, DebandDither::Disabled);
    }
    rig.until_ready();
    let drawn = rig.drawn(&target);
    for y in 0..SIDE {
        for x in 0..2 * SIDE {
            let single = &singles[(x / SIDE) as usize].1;
            assert_eq!(drawn[(y * 2 * SIDE + x) as usize], single[(y * SIDE + x % SIDE) as usize], "at {x}, {y}");
        }
    }
    rig.assert_sound();
}

/// The form factor of a square of this side that faces the point, with its center at this distance and 45° above the horizon.
fn share_of_square(side: f64, distance: f64) -> f64 {
    const N: usize = 64;
    let cell = side / N as f64;
    let center = |i: usize| (i as f64 + 0.5) * cell - 0.5 * side;
    let mut sum = 0.0;
    for (i, j) in (0..N).flat_map(|i| (0..N).map(move |j| (i, j))) {
        let (u, v) = (center(i), center(j));
        let square = distance * distance + u * u + v * v;
        // Heights over the floor: of the center, and along the side, which is tilted by 45°.
        let height = (distance + v) * 0.5f64.sqrt();
        sum += height * distance / (square * square) * cell * cell;
    }
    sum / core::f64::consts::PI
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn cameras_see_and_are_lit_by_objects_on_their_own_layers() {
    let Some(mut rig) = Rig::new(48, 48) else { return };
    let looks = |technique| Restir { technique, bounces: 2, accumulate: true, ..plain() };
    rig.insert(rig.camera, orthographic(0.1, 0.1));
    let target = rig.add::<Image>(target_image(UVec2::splat(48)));
    let bundle = (Transform::from_xyz(0.0, 0.0, 5.0), orthographic(0.1, 0.1), RenderLayers::layer(1), plain());
    let other = second(&mut rig, 1, &target, bundle);
    let cameras = [(rig.camera, rig.capture.clone()), other];

    let both = RenderLayers::from_layers(&[0, 1]);
    let floor = rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.insert(floor, both.clone());
    // One sun for each layer: radiance 1 and 3.
    let suns = [(0, 2.0), (1, 6.0)].map(|(layer, power)| {
        let sun = DirectionalLight { illuminance: power * PI, ..default() };
        rig.spawn_bundle((sun, Transform::default(), RenderLayers::layer(layer)))
    });
    let lamp_of = StandardMaterial { double_sided: true, cull_mode: None, ..lamp(40.0, 40.0, 40.0) };
    let side = rig.spawn(square(1.0), lamp_of, Transform::from_xyz(1.0, 0.0, 1.0).looking_at(Vec3::ZERO, Vec3::Y));
    rig.insert(side, RenderLayers::layer(1));
    let from_lamp = 0.5 * 40.0 * share_of_square(1.0, 2f64.sqrt());

    for technique in [Technique::Reference, Technique::Pt] {
        for (camera, _) in &cameras {
            rig.insert(*camera, looks(technique));
        }
        let check = |rig: &mut Rig, what: &str, expected: [f64; 2]| {
            let means: Vec<f64> = pictures(rig, &cameras, 6).iter().map(Picture::mean).collect();
            println!("{technique:?}, {what}: {means:?} for {expected:?}");
            for (mean, expected) in means.iter().zip(expected) {
                assert!((mean - expected).abs() <= 0.06 * expected, "{technique:?}, {what}: {means:?}, not {expected}");
            }
        };
        check(&mut rig, "lamp on layer 1", [1.0, 3.0 + from_lamp]);
        rig.insert(side, RenderLayers::layer(0));
        check(&mut rig, "lamp on layer 0", [1.0 + from_lamp, 3.0]);
        rig.insert(side, RenderLayers::layer(2));
        check(&mut rig, "lamp on neither", [1.0, 3.0]);
        rig.insert(side, both.clone());
        check(&mut rig, "lamp on both", [1.0 + from_lamp, 3.0 + from_lamp]);
        // Only the layers of a sun change here.
        rig.insert(suns[0], both.clone());
        check(&mut rig, "the first sun on both layers", [1.0 + from_lamp, 4.0 + from_lamp]);
        rig.insert(suns[0], RenderLayers::layer(0));
        check(&mut rig, "the first sun on layer 0 again", [1.0 + from_lamp, 3.0 + from_lamp]);
        rig.insert(side, RenderLayers::layer(1));
    }
    rig.assert_sound();
}

#[test]
fn a_camera_without_a_clear_color_draws_over_the_previous_camera() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, orthographic(4.0, 4.0));
    let target = rig.target.clone();
    rig.spawn(square(8.0), lamp(0.25, 0.25, 0.25), Transform::default());
    // A tool in the player's hand, on its own layer as in first-person games: farther away than the world, but drawn over it.
    let tool = rig.spawn(square(2.0), lamp(1.0, 1.0, 1.0), Transform::from_xyz(1.1, 0.0, -3.0));
    rig.insert(tool, RenderLayers::layer(1));
    let over = second(
        &mut rig,
        1,
        &target,
        (
            Transform::from_xyz(0.0, 0.0, 5.0),
            orthographic(4.0, 4.0),
            RenderLayers::layer(1),
            Restir { jitter: Jitter::Auto, ..plain() },
        ),
    );
    for camera in [rig.camera, over.0] {
        rig.insert(camera, Tonemapping::None);
    }
    rig.get_mut::<Camera>(over.0).clear_color = ClearColorConfig::None;
    rig.until_ready();
    let drawn = rig.drawn(&target);
    let at = |x: usize, y: usize| drawn[16 * y + x][0];
    assert!(at(2, 8).abs_diff(137) <= 2, "the world: {}", at(2, 8));
    assert_eq!(at(12, 8), 255, "the tool");
    assert!(at(12, 1).abs_diff(137) <= 2, "the world above the tool: {}", at(12, 1));
    // The tool covers 0.6 of this pixel.  Its camera averages frames, which are not jittered, so that the edge does not flicker.
    for (frame, resolution_scale) in [1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5].into_iter().enumerate() {
        rig.get_mut::<Restir>(over.0).resolution_scale = resolution_scale;
        let edge = rig.drawn(&target)[16 * 8 + 8][0];
        assert_eq!(edge, 255, "the edge of the tool in frame {frame}, resolution scale {resolution_scale}");
    }
    // A light from all around that is no backdrop.
    let map = rig.add::<Image>(cube_texture(255));
    rig.insert(over.0, EnvironmentMapLight { diffuse_map: map.clone(), specular_map: map, ..default() });
    rig.until_ready();
    let drawn = rig.drawn(&target);
    let beside = drawn[16 * 8 + 2][0];
    assert!(beside.abs_diff(137) <= 2, "the world, beside a tool that a map lights: {beside}");
    rig.app.world_mut().entity_mut(over.0).remove::<EnvironmentMapLight>();
    // With a clear color the camera replaces the whole picture.
    rig.get_mut::<Camera>(over.0).clear_color = ClearColorConfig::Custom(Color::BLACK);
    rig.until_ready();
    let drawn = rig.drawn(&target);
    assert_eq!([drawn[16 * 8 + 2][0], drawn[16 * 8 + 12][0]], [0, 255]);
}

/// The picture of an orthographic camera does not depend on how far away it is, and neither do the places where paths reconnect and the
/// neighbors that pixels accept.
#[test]
#[ignore = "second tier: ./run test --more"]
fn the_distance_of_an_orthographic_camera_changes_no_samples() {
    let mut rays = Vec::new();
    for distance in [5.0, 640.0] {
        let Some(mut rig) = Rig::new(32, 32) else { return };
        crowd(&mut rig);
        let place = Transform::from_xyz(0.0, 0.0, distance);
        let projection = Projection::Orthographic(OrthographicProjection {
            near: distance - 5.0,
            far: distance + 5.0,
            scaling_mode: ScalingMode::Fixed { width: 4.0, height: 4.0 },
            ..OrthographicProjection::default_3d()
        });
        rig.insert(rig.camera, (place, projection, sky(0.3)));
        rig.set(|restir| *restir = Restir { technique: Technique::Pt, bounces: 3, ..plain() });
        rig.picture(6);
        rays.push(rig.report().rays as f64);
    }
    // Rounding decides a few of them.
    assert!((rays[1] / rays[0] - 1.0).abs() < 0.002, "{rays:?}");
}

/// Changes that restart a history, and changes that do not.
#[test]
#[ignore = "second tier: ./run test --more"]
fn restarts_of_a_history_are_counted_by_reason() {
    let Some(mut rig) = Rig::new(20, 16) else { return };
    crowd(&mut rig);
    let map = |value| texture(4, 2, |_, _| [value, value, value, 255]);
    let image = rig.add(map(60));
    rig.insert(rig.camera, RestirEnvironment { image: Some(image.clone()), ..sky(0.3) });
    rig.set(|restir| *restir = Restir { technique: Technique::Pt, bounces: 2, ..plain() });
    rig.until_ready();
    rig.frames(2);
    let mut before = rig.report().history_resets;
    let mut begun = |rig: &mut Rig| {
        rig.until_ready();
        rig.frames(2);
        let now = rig.report().history_resets;
        let new = now.iter().zip(&before).filter(|(now, before)| now.1 > before.1);
        let reasons: Vec<_> = new.map(|(&(name, now), &(_, before))| (name, now - before)).collect();
        before = now;
        reasons
    };
    assert_eq!(begun(&mut rig), [], "a still scene");
    rig.insert(rig.camera, RestirEnvironment { image: Some(image), ..sky(0.1) });
    rig.insert(rig.camera, Transform::from_xyz(0.1, 0.0, 5.0));
    let cube = rig.spawn(Cuboid::from_length(0.3), lambert(0.6), Transform::default());
    assert_eq!(begun(&mut rig), [], "a dimmed sky, a moved camera, a new object");
    rig.app.world_mut().despawn(cube);
    assert_eq!(begun(&mut rig), [], "an object that is gone");
    rig.set(|restir| restir.reset = true);
    assert_eq!(begun(&mut rig), [("requested", 1)]);
    for samples in [5, 0] {
        rig.set(|restir| {
            let reuse = &mut restir.paths.reuse;
            (reuse.spatial_samples, reuse.spatial_iterations) = (samples, 1 + samples % 2);
            reuse.paired = samples > 3;
            (reuse.confidence_cap, reuse.mis) =
                (10.0 + samples as f32, [Mis::Pairwise, Mis::DefensivePairwise][samples as usize % 2]);
        });
        assert_eq!(begun(&mut rig), [], "{samples} neighbors");
    }
    rig.set(|restir| restir.paths.candidates = 4);
    assert_eq!(begun(&mut rig), [("settings", 1)]);
    rig.insert(rig.camera, orthographic(4.0, 3.2));
    assert_eq!(begun(&mut rig), [("projection", 1)]);
    let target = rig.target.clone();
    rig.edit(&target, |image| *image = target_image(UVec2::new(24, 18)));
    // Bevy reports the new size of a target to its camera in the next frame.
    rig.frames(2);
    assert_eq!(begun(&mut rig), [("size", 1)]);
    let image = rig.add(map(90));
    rig.insert(rig.camera, RestirEnvironment { image: Some(image), ..sky(0.1) });
    assert_eq!(begun(&mut rig), [], "another image of the sky");
    // Techniques without a history count nothing.
    rig.set(|restir| restir.technique = Technique::Reference);
    assert_eq!(begun(&mut rig), []);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_reset_after_a_cut_is_a_fresh_start() {
    let make = || {
        let mut rig = Rig::new(20, 16)?;
        crowd(&mut rig);
        rig.insert(rig.camera, sky(0.3));
        rig.set(|restir| *restir = Restir { technique: Technique::Pt, bounces: 2, ..plain() });
        Some(rig)
    };
    let (Some(mut cut), Some(mut fresh)) = (make(), make()) else { return };
    let there = Transform::from_xyz(-3.0, 1.0, 2.0).looking_at(Vec3::new(0.0, 0.0, -1.0), Vec3::Y);
    cut.until_ready();
    cut.frames(5);
    fresh.insert(fresh.camera, there);
    fresh.until_ready();
    fresh.set(|restir| restir.reset = true);
    cut.insert(cut.camera, there);
    cut.set(|restir| restir.reset = true);
    for i in 0..3 {
        assert_eq!(cut.next(), fresh.next(), "frame {i}");
    }
    // Without a reset, temporal reuse rejects the history, and the picture is not worse.
    let (mut at_rest, mut after_cuts) = (Vec::new(), Vec::new());
    for seed in 0..CUTS {
        fresh.set(|r| r.seed = seed);
        at_rest.push(fresh.next().mean());
        cut.set(|r| r.seed = CUTS + seed);
        cut.insert(cut.camera, Transform::from_xyz(0.0, 0.0, 5.0));
        cut.frames(2);
        cut.insert(cut.camera, there);
        after_cuts.push(cut.next().mean());
    }
    let difference = welch(&after_cuts, &at_rest);
    let mean = at_rest.iter().sum::<f64>() / f64::from(CUTS);
    let (off, error) = (difference.difference / mean, difference.error / mean);
    eprintln!("first frames after cuts: off by {:+.2} % ± {:.2}", 100.0 * off, 100.0 * error);
    assert!(tost(&after_cuts, &at_rest, 0.03 * mean) < 0.01, "off by {off} ± {error}");
}

#[test]
fn a_minimized_window_renders_nothing_until_it_is_restored() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(20.0), lamp(1.0, 1.0, 1.0), Transform::default());
    // Without an event loop the window has no surface, like a window that the system has minimized.
    let resolution = |size: u32| WindowResolution::new(size, size);
    let window = rig.spawn_bundle(Window { resolution: resolution(0), ..default() });
    let camera = rig.spawn_bundle((
        Camera3d::default(),
        RenderTarget::Window(WindowRef::Entity(window)),
        Transform::from_xyz(0.0, 0.0, 5.0),
        plain(),
    ));
    for size in [0, 8, 0, 1, 0] {
        rig.get_mut::<Window>(window).resolution = resolution(size);
        rig.frames(3);
        assert_eq!(rig.next().center().x, 1.0, "the other camera renders beside a window of {size} x {size}");
    }
    // A window without pixels delays nothing.
    rig.until_ready();
    rig.app.world_mut().despawn(camera);
    rig.app.world_mut().despawn(window);
    rig.until_ready();
    rig.assert_sound();
}

#[test]
fn on_a_device_below_the_limits_the_plugin_warns_and_bevy_lights_the_scene() {
    log::listen();
    // These limits are too low for us and sufficient for Bevy, whose materials with all optional textures need more sampled textures
    // than WebGPU guarantees.
    let limits = WgpuLimits {
        max_storage_buffer_binding_size: (1 << 20) - 4096,
        max_sampled_textures_per_shader_stage: 64,
        max_samplers_per_shader_stage: 64,
        ..default()
    };
    let Some(mut rig) = Rig::limited(limits, 16, 16) else { return };
    rig.app.insert_resource(GlobalAmbientLight { brightness: 1e4, ..default() });
    rig.spawn(square(8.0), lambert(1.0), Transform::default());
    rig.frames(5);
    let target = rig.target.clone();
    assert!(rig.drawn(&target)[8 * 16 + 8][0] > 100, "Bevy lights the scene");
    assert!(rig.next_if_any().is_none(), "the plugin is off");
    let warnings = log::warnings("bindings of 1 MiB");
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains("stays on"), "{warnings:?}");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_picture_larger_than_a_binding_is_traced_at_lower_resolution() {
    log::listen();
    // Radiance takes 16 bytes per pixel, reservoirs of paths take 64.
    let Some(mut rig) = Rig::binding_at_most(1 << 20, 160, 160) else { return };
    rig.insert(rig.camera, orthographic(8.0, 8.0));
    rig.spawn(square(4.0), lamp(1.0, 1.0, 1.0), Transform::from_xyz(2.0, 2.0, 0.0));
    for (technique, largest) in [(Technique::Reference, 160), (Technique::Pt, 128)] {
        rig.set(|restir| restir.technique = technique);
        let picture = rig.picture(1);
        assert_eq!(picture.size, UVec2::splat(largest), "{technique:?}");
        for (at, color) in picture.iter() {
            let inside = at.x >= largest / 2 && at.y < largest / 2;
            assert_eq!(color.x, f32::from(inside), "{technique:?} at {at}");
        }
        let target = rig.target.clone();
        let drawn = rig.drawn(&target);
        for (i, pixel) in drawn.iter().enumerate() {
            assert_eq!(pixel[0] > 100, i % 160 >= 80 && i / 160 < 80, "{technique:?}: pixel {i} of the target");
        }
    }
    assert_eq!(log::own_warnings("128 x 128 pixels instead of 160 x 160").len(), 1);
    assert_eq!(log::own_warnings("subsets of").len(), 1);
    // With the optional texture slots, Bevy's own shaders exceed this device, too.
    // The tests turn on `material_textures`.
    assert!(!log::warnings("own shaders need").is_empty());
    rig.assert_sound();
}

/// Few traced pixels: edges of objects, parallel or not, stay in their places, and light between them is interpolated.
#[test]
fn a_picture_of_half_the_resolution_has_sharp_edges_and_smooth_light() {
    let Some(mut rig) = Rig::new(64, 64) else { return };
    rig.insert(rig.camera, (orthographic(4.0, 4.0), Tonemapping::None));
    rig.spawn(square(8.0), lambert(0.8), Transform::from_xyz(0.0, 0.0, -0.5));
    let light = PointLight { intensity: 80.0, ..default() };
    rig.spawn_bundle((light, Transform::from_xyz(0.3, 0.4, 1.5)));
    // A red square in the plane of the wall, whose edges do not lie on the borders of traced pixels.
    let red = Color::linear_rgb(0.9, 0.05, 0.05);
    let place = Transform::from_xyz(-0.52, 0.33, -0.499).with_rotation(Quat::from_rotation_z(0.3));
    rig.spawn(square(1.0), StandardMaterial { reflectance: 0.0, ..red.into() }, place);
    let turned = Transform::from_xyz(0.9, -0.7, 0.3).with_rotation(Quat::from_euler(EulerRot::XYZ, 0.6, 0.5, 0.2));
    rig.spawn(Cuboid::from_length(0.9), lambert(0.5), turned);
    let target = rig.target.clone();
    let [full, half] = [1.0, 0.5].map(|resolution_scale| {
        rig.set(|restir| *restir = Restir { technique: Technique::Di, resolution_scale, ..plain() });
        assert_eq!(rig.picture(2).size.as_vec2(), 64.0 * Vec2::splat(resolution_scale));
        rig.drawn(&target)
    });
    let far = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 12);
    let different = full.iter().zip(&half).filter(|&pair| far(pair)).count();
    println!("{different} of {} pixels differ", full.len());
    // The rims of shadows are interpolated, so that their pixels differ.  Without the surfaces, 282 pixels would differ.
    assert!(different < 100, "{different} pixels differ");
    rig.assert_sound();
}

#[test]
fn a_camera_without_camera_3d_is_named_in_a_warning() {
    log::listen();
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(4.0), lamp(1.0, 1.0, 1.0), Transform::IDENTITY);
    let flat = rig.spawn_bundle((Camera2d, plain()));
    let name = format!("camera {flat} has no `Camera3d`");
    assert!((rig.picture(4).center() - Vec3::ONE).length() < 1e-5);
    assert_eq!(log::warnings(&name).len(), 1);
}
