//! Devices that are lost, and devices whose memory is full: no panic, one message, and Bevy's lighting where ours is missing.

use crate::support::{app::*, bodies::*, log};
use bevy::{
    prelude::*,
    render::{
        error_handler::{ErrorType, RenderErrorHandler, RenderErrorPolicy},
        render_resource::PollType,
        renderer::RenderDevice,
        settings::{Backends, WgpuLimits, WgpuSettings},
    },
};
use bevy_restir::{
    DebugView, RestirEnvironment, RestirStatus, Reuse, Subsurface, Technique,
    testing::storage::allocation::plant_failed_allocations,
};
use std::{
    process::Command,
    time::{Duration, Instant},
};

/// A wall that both renderers light.
fn lit_wall() -> Option<Rig> {
    Some(with_lit_wall(Rig::new(16, 12)?))
}

fn with_lit_wall(mut rig: Rig) -> Rig {
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 500.0, ..default() }, Transform::from_xyz(0.0, 0.0, 2.0)));
    rig
}

/// Brightness that Bevy wrote to the middle of the target.
fn shown(rig: &mut Rig) -> u8 {
    let target = rig.target.clone();
    let size = rig.size();
    rig.drawn(&target)[(size.y / 2 * size.x + size.x / 2) as usize][0]
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn bevy_lights_a_camera_that_the_device_has_no_memory_for() {
    log::listen();
    let Some(mut rig) = lit_wall() else { return };
    let (camera, target) = (rig.camera, rig.target.clone());
    let sky_image = rig.add::<Image>(texture(4, 2, |_, _| [255; 4]));
    let alone = rig.picture(2);
    // Pairs belong to the history, which a warning has named before.
    for (name, technique, new_warnings) in [
        ("view", Technique::Reference, 1),
        ("history", Technique::Di, 1),
        ("pairs", Technique::Di, 0),
        ("environment importance", Technique::Reference, 1),
    ] {
        rig.set(|restir| {
            restir.technique = technique;
            restir.direct.reuse = Reuse { paired: false, ..Reuse::DIRECT };
        });
        rig.until_ready();
        let warnings = || log::own_warnings(&format!("Bevy lights camera {camera}")).len();
        let before = warnings();
        plant_failed_allocations(&rig.app, &[name]);
        match name {
            "pairs" => rig.set(|restir| restir.direct.reuse.paired = true),
            "environment importance" => {
                rig.insert(camera, RestirEnvironment { image: Some(sky_image.clone()), ..sky(0.3) });
            }
            _ => rig.edit(&target, |image| *image = target_image(UVec2::new(20, 12))),
        }
        rig.frames(6);
        assert!(rig.next_if_any().is_none(), "{name}: we render nothing");
        assert!(shown(&mut rig) > 20, "{name}: Bevy lights the wall");
        assert_eq!(warnings(), before + new_warnings, "{name}: {:?}", log::own_warnings("restir"));
        plant_failed_allocations(&rig.app, &[]);
        assert!(rig.picture(2).mean() > 0.0, "{name}: with memory the picture is ours");
        rig.app.world_mut().entity_mut(camera).remove::<RestirEnvironment>();
        rig.edit(&target, |image| *image = target_image(UVec2::new(16, 12)));
        rig.set(|restir| *restir = plain());
        assert_eq!(rig.picture(2), alone, "{name}: with memory the picture is ours again");
        rig.assert_sound();
    }
}

/// Asserts that Bevy lights the wall while the planted allocations fail, and that the picture is ours once they succeed.
fn assert_bevy_lights_until_there_is_memory(rig: &mut Rig) {
    rig.frames(6);
    assert!(rig.next_if_any().is_none(), "we render nothing");
    assert!(shown(rig) > 20, "Bevy lights the wall");
    plant_failed_allocations(&rig.app, &[]);
    assert!(rig.picture(2).mean() > 0.0, "with memory the picture is ours");
    rig.assert_sound();
}

#[test]
fn bevy_lights_a_scene_that_the_device_has_no_memory_for() {
    let Some(mut rig) = lit_wall() else { return };
    plant_failed_allocations(&rig.app, &["instances", "lights"]);
    assert_bevy_lights_until_there_is_memory(&mut rig);
}

/// Tables of the scene that have no memory to grow: Bevy lights the camera, and the picture is ours again once there is memory.
#[test]
fn bevy_lights_a_scene_that_outgrows_the_memory_of_the_device() {
    let Some(mut rig) = lit_wall() else { return };
    rig.until_ready();
    let (mesh, paint) = (rig.add::<Mesh>(square(0.1)), rig.add::<StandardMaterial>(lambert(0.3)));
    for name in ["instances", "materials", "lights", "subsurface", "poses"] {
        plant_failed_allocations(&rig.app, &[name]);
        let things: Vec<Entity> = (0..if name == "poses" { 1 } else { 20 })
            .map(|i| {
                let place = Transform::from_xyz(0.1 * i as f32, 9.0, 0.0);
                let object = |paint| (Mesh3d(mesh.clone()), MeshMaterial3d(paint), place);
                match name {
                    "materials" => {
                        let paint = rig.add::<StandardMaterial>(lambert(0.04 * i as f32));
                        rig.spawn_bundle(object(paint))
                    }
                    "lights" => rig.spawn_bundle((PointLight { intensity: 1.0, ..default() }, place)),
                    "subsurface" => {
                        let soft = Subsurface { mean_free_path: Vec3::splat(0.1), ..default() };
                        rig.spawn_bundle((object(paint.clone()), soft))
                    }
                    "poses" => spawn_skinned(&mut rig, "body", tube(), lambert(0.5)),
                    _ => rig.spawn_bundle(object(paint.clone())),
                }
            })
            .collect();
        let mut patience = 0..200;
        while rig.next_if_any().is_some() {
            assert!(patience.next().is_some(), "{name}: we render a scene that the device does not have");
        }
        rig.frames(3);
        assert!(rig.next_if_any().is_none(), "{name}: we render nothing");
        assert!(shown(&mut rig) > 20, "{name}: Bevy lights the wall");
        plant_failed_allocations(&rig.app, &[]);
        assert!(rig.picture(2).mean() > 0.0, "{name}: with memory the picture is ours");
        things.into_iter().for_each(|thing| rig.app.world_mut().entity_mut(thing).despawn());
        rig.until_ready();
    }
    rig.assert_sound();
}

#[test]
fn bevy_lights_a_scene_whose_trees_for_ray_queries_have_no_memory() {
    let Some(mut rig) = Rig::tracing_by_ray_queries(16, 12).map(with_lit_wall) else { return };
    let alone = rig.picture(2);
    plant_failed_allocations(&rig.app, &["ray-query structures"]);
    let cube = rig.spawn(Cuboid::from_length(0.5), lambert(0.5), Transform::from_xyz(0.0, 9.0, 0.0));
    let mut patience = 0..200;
    while rig.next_if_any().is_some() {
        assert!(patience.next().is_some(), "we render a scene that the device does not have");
    }
    rig.frames(3);
    assert!(rig.next_if_any().is_none(), "we render nothing");
    assert!(shown(&mut rig) > 20, "Bevy lights the wall");
    plant_failed_allocations(&rig.app, &[]);
    assert!(rig.picture(2).mean() > 0.0, "with memory the picture is ours");
    rig.app.world_mut().despawn(cube);
    assert_eq!(rig.picture(2), alone);
    rig.assert_sound();
}

#[test]
fn bevy_lights_a_scene_without_memory_for_the_table_of_energy_compensation() {
    let Some(mut rig) = lit_wall() else { return };
    rig.until_ready();
    plant_failed_allocations(&rig.app, &["specular albedo"]);
    rig.set(|restir| restir.energy_compensation = true);
    assert_bevy_lights_until_there_is_memory(&mut rig);
}

/// Trees that did not fit the device's memory are built once they fit, although nothing has changed since.
#[test]
fn trees_that_did_not_fit_the_memory_are_built_once_they_fit() {
    let pictures = |names: &'static [&'static str]| {
        let mut rig = lit_wall()?;
        let (mesh, paint) = (rig.add::<Mesh>(square(0.1)), rig.add::<StandardMaterial>(lambert(0.3)));
        let object = |place| (Mesh3d(mesh.clone()), MeshMaterial3d(paint.clone()), place);
        rig.spawn_bundle(object(Transform::from_xyz(0.0, 9.0, 0.0)));
        let white = square(0.5).with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, vec![[1.0f32; 4]; 4]);
        rig.spawn(white, lambert(0.5), Transform::from_xyz(0.0, 9.0, 0.0));
        rig.until_ready();
        rig.frames(3);
        plant_failed_allocations(&rig.app, names);
        for i in 0..60 {
            // More instances of a mesh, and lamps, need larger trees.
            let place = Transform::from_xyz(0.2 * (i % 10) as f32 - 1.0, 0.2 * (i / 10) as f32 - 0.6, 0.2);
            rig.spawn_bundle(object(place));
            rig.spawn_bundle((PointLight { intensity: 1.0, radius: 0.05, ..default() }, place));
        }
        rig.frames(4);
        plant_failed_allocations(&rig.app, &[]);
        let seen = rig.debug(DebugView::TracedInstances);
        Some([seen, rig.picture(4)])
    };
    let (Some(expected), Some(found)) = (pictures(&[]), pictures(&["acceleration structures"])) else { return };
    assert_eq!(found[0], expected[0], "the tree over instances");
    assert_eq!(found[1], expected[1], "the tree over lamps");
}

#[test]
fn vertex_colors_that_the_device_had_no_memory_for_come_later() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    let red = square(4.0).with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, vec![[1.0f32, 0.0, 0.0, 1.0]; 4]);
    plant_failed_allocations(&rig.app, &["vertex colors"]);
    rig.spawn(red, lambert(0.5), Transform::default());
    rig.until_ready();
    rig.frames(2);
    plant_failed_allocations(&rig.app, &[]);
    rig.frames(2);
    assert_eq!(rig.debug(DebugView::Albedo).center(), Vec3::new(0.5, 0.0, 0.0));
}

#[test]
fn textures_that_the_device_had_no_memory_for_come_later() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    let red = rig.add::<Image>(texture(4, 4, |_, _| [255, 0, 0, 255]));
    plant_failed_allocations(&rig.app, &["texture atlas"]);
    let painted = StandardMaterial { base_color_texture: Some(red), ..lambert(0.5) };
    rig.spawn(square(4.0), painted, Transform::default());
    assert_eq!(rig.debug(DebugView::Albedo).center(), Vec3::splat(0.5), "without its texture");
    plant_failed_allocations(&rig.app, &[]);
    rig.frames(70);
    assert_eq!(rig.debug(DebugView::Albedo).center(), Vec3::new(0.5, 0.0, 0.0));
    rig.assert_sound();
}

/// The new pixels go over those of the last frame, so that histories restart.
#[test]
fn an_edited_image_without_memory_for_a_second_place_keeps_its_place() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    let yellow = |green: u8| texture(250, 250, move |_, _| [255, green, 0, 255]);
    let image = rig.add::<Image>(yellow(0));
    let painted = StandardMaterial { base_color_texture: Some(image.clone()), ..lambert(0.5) };
    rig.spawn(square(4.0), painted, Transform::default());
    rig.spawn_bundle((PointLight { intensity: 500.0, ..default() }, Transform::from_xyz(0.0, 0.0, 2.0)));
    rig.set(|restir| restir.technique = Technique::Di);
    rig.until_ready();
    plant_failed_allocations(&rig.app, &["texture atlas"]);
    let atlas = |rig: &Rig| rig.report().memory.into_iter().find(|(name, _)| *name == "texture atlas");
    let before_edits = atlas(&rig);
    for green in [255, 0, 255] {
        rig.until_ready();
        rig.frames(3);
        let before = rig.report().history_resets;
        rig.edit(&image, |image| *image = yellow(green));
        rig.frames(2);
        assert_ne!(rig.report().history_resets, before, "the pixels of the last frame are lost");
        let expected = Vec3::new(0.5, f32::from(green) / 510.0, 0.0);
        assert_eq!(rig.debug(DebugView::Albedo).center(), expected);
    }
    assert_eq!(atlas(&rig), before_edits);
    rig.assert_sound();
}

/// The path of this module.
const HERE: &str = "bevy::lost_devices";

/// Whether this process runs a test of a module alone; otherwise it runs that test in another process.  A lost device may leave the driver's
/// registry, which all tests of a process share, in a state that no further test can use.
pub(super) fn is_alone(module: &str, test: &str) -> bool {
    if std::env::var("ALONE").is_ok_and(|alone| alone == test) {
        return true;
    }
    let program = std::env::current_exe().expect("this program has a path");
    let name = format!("{module}::{test}");
    let output =
        Command::new(program).args([&name, "--exact", "--nocapture", "--include-ignored"]).env("ALONE", test).output();
    let output = output.expect("this program can be run");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // A program that knows no test of this name succeeds, too.
    assert!(String::from_utf8_lossy(&output.stdout).contains("1 passed"), "{name} did not run");
    false
}

/// Destroys the device, and waits until Bevy has been notified, as it is of the loss of a real device before its next frame.
fn destroy_device(rig: &Rig) {
    let device = rig.app.world().resource::<RenderDevice>();
    device.wgpu_device().destroy();
    let _ = device.poll(PollType::wait_indefinitely());
}

/// Destroys the device, and renders frames until Bevy has another one.
fn replace_device(rig: &mut Rig) {
    let lost = rig.app.world().resource::<RenderDevice>().wgpu_device().clone();
    destroy_device(rig);
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(120) {
        rig.app.update();
        if *rig.app.world().resource::<RenderDevice>().wgpu_device() != lost {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_lost_device_that_bevy_replaces_shows_the_same_picture() {
    if !is_alone(HERE, "a_lost_device_that_bevy_replaces_shows_the_same_picture") {
        return;
    }
    log::listen();
    let Some(mut rig) = lit_wall() else { return };
    let texture = rig.add::<Image>(texture(4, 4, |x, y| [60 * x as u8, 60 * y as u8, 200, 255]));
    let painted = StandardMaterial { base_color_texture: Some(texture), ..lambert(0.8) };
    rig.spawn(square(1.0), painted, Transform::from_xyz(0.3, 0.2, 0.5));
    rig.set(|restir| (restir.technique, restir.seed) = (Technique::Di, 5));
    let before = rig.picture(2);
    rig.app.insert_resource(RenderErrorHandler(|_, _, _| {
        RenderErrorPolicy::Recover(WgpuSettings { backends: Some(Backends::PRIMARY), ..default() }.into())
    }));
    replace_device(&mut rig);
    assert_eq!(rig.picture(2), before);
    rig.assert_sound();
    assert_eq!(*rig.app.world().resource::<RestirStatus>(), RestirStatus::On);
    assert_eq!(log::warnings("there is a new device").len(), 1);
}

#[test]
fn a_new_device_below_the_limits_turns_the_plugin_off() {
    if !is_alone(HERE, "a_new_device_below_the_limits_turns_the_plugin_off") {
        return;
    }
    log::listen();
    let Some(mut rig) = lit_wall() else { return };
    rig.until_ready();
    rig.app.insert_resource(RenderErrorHandler(|error, main_world, _| {
        if error.ty != ErrorType::DeviceLost {
            return RenderErrorPolicy::Ignore;
        }
        let last = main_world.resource::<RenderDevice>().limits();
        let limits = WgpuLimits { max_storage_buffer_binding_size: (1 << 20) - 4096, ..last };
        let settings =
            WgpuSettings { backends: Some(Backends::PRIMARY), constrained_limits: Some(limits), ..default() };
        RenderErrorPolicy::Recover(settings.into())
    }));
    replace_device(&mut rig);
    rig.frames(3);
    let status = rig.app.world().resource::<RestirStatus>();
    assert!(matches!(status, RestirStatus::Off(reason) if reason.contains("1 MiB")), "{status:?}");
    assert_eq!(log::warnings("there is a new device, and").len(), 1);
    assert_eq!(log::warnings("Caught rendering error"), [""; 0], "nothing of ours runs there");
    assert!(shown(&mut rig) > 20, "Bevy lights the wall");
    assert!(rig.next_if_any().is_none(), "the plugin is off");
}

#[test]
fn without_another_device_bevy_stops_rendering_and_nothing_panics() {
    if !is_alone(HERE, "without_another_device_bevy_stops_rendering_and_nothing_panics") {
        return;
    }
    let Some(mut rig) = lit_wall() else { return };
    rig.until_ready();
    rig.capture.request();
    destroy_device(&rig);
    (0..3).for_each(|_| rig.app.update());
    assert!(rig.app.should_exit().is_some_and(|exit| exit.is_error()), "Bevy's default");
}
