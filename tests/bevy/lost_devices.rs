//! Devices that are lost, and devices whose memory is full: no panic, one message, and Bevy's lighting where ours is missing.

use crate::support::{app::*, log};
use bevy::{
    prelude::*,
    render::{
        error_handler::{RenderErrorHandler, RenderErrorPolicy},
        render_resource::PollType,
        renderer::RenderDevice,
        settings::{Backends, WgpuSettings},
    },
};
use bevy_restir::{RestirStatus, Technique, testing::storage::allocation::plant_failed_allocations};
use std::{process::Command, time::Duration};

/// A wall that both renderers light.
fn lit_wall() -> Option<Rig> {
    let mut rig = Rig::new(16, 12)?;
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 500.0, ..default() }, Transform::from_xyz(0.0, 0.0, 2.0)));
    Some(rig)
}

/// Brightness that Bevy wrote to the middle of the target.
fn shown(rig: &mut Rig) -> u8 {
    let target = rig.target.clone();
    let size = rig.size();
    rig.drawn(&target)[(size.y / 2 * size.x + size.x / 2) as usize][0]
}

#[test]
fn bevy_lights_a_camera_that_the_device_has_no_memory_for() {
    log::listen();
    let Some(mut rig) = lit_wall() else { return };
    let camera = rig.camera;
    let alone = rig.picture(2);
    for (name, technique) in [("view", Technique::Reference), ("history", Technique::Di)] {
        let told = || log::warnings(&format!("Bevy lights camera {camera}")).len();
        let before = told();
        plant_failed_allocations(&rig.app, &[name]);
        let target = rig.target.clone();
        rig.edit(&target, |image| *image = target_image(UVec2::new(20, 12)));
        rig.set(|restir| restir.technique = technique);
        rig.frames(6);
        assert!(rig.next_if_any().is_none(), "{name}: we render nothing");
        assert!(shown(&mut rig) > 20, "{name}: Bevy lights the wall");
        assert_eq!(told(), before + 1, "{name}: {:?}", log::warnings("restir"));
        plant_failed_allocations(&rig.app, &[]);
        rig.edit(&target, |image| *image = target_image(UVec2::new(16, 12)));
        rig.set(|restir| *restir = plain());
        assert_eq!(rig.picture(2), alone, "{name}: with memory the picture is ours again");
        rig.assert_sound();
    }
}

#[test]
fn bevy_lights_a_scene_that_the_device_has_no_memory_for() {
    let Some(mut rig) = lit_wall() else { return };
    plant_failed_allocations(&rig.app, &["instances", "lights"]);
    rig.frames(6);
    assert!(rig.next_if_any().is_none(), "we render nothing");
    assert!(shown(&mut rig) > 20, "Bevy lights the wall");
    plant_failed_allocations(&rig.app, &[]);
    assert!(rig.picture(2).mean() > 0.0, "with memory the picture is ours");
    rig.assert_sound();
}

/// Whether this process runs a test alone; otherwise it runs that test in another process.  A lost device may leave the driver's registry,
/// which all tests of a process share, in a state that no further test can use.
fn is_alone(test: &str) -> bool {
    if std::env::var("ALONE").is_ok_and(|alone| alone == test) {
        return true;
    }
    let program = std::env::current_exe().expect("this program has a path");
    let name = format!("bevy::lost_devices::{test}");
    let output = Command::new(program).args([&name, "--exact", "--nocapture"]).env("ALONE", test).output();
    let output = output.expect("this program can be run");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    false
}

/// Destroys the device, and waits until Bevy has been notified, as it is of the loss of a real device before its next frame.
fn destroy_device(rig: &Rig) {
    let device = rig.app.world().resource::<RenderDevice>();
    device.wgpu_device().destroy();
    let _ = device.poll(PollType::wait_indefinitely());
}

#[test]
fn a_lost_device_that_bevy_replaces_shows_the_same_picture() {
    if !is_alone("a_lost_device_that_bevy_replaces_shows_the_same_picture") {
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
    let lost = rig.app.world().resource::<RenderDevice>().wgpu_device().clone();
    destroy_device(&rig);
    for _ in 0..500 {
        rig.app.update();
        if *rig.app.world().resource::<RenderDevice>().wgpu_device() != lost {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(rig.picture(2), before);
    rig.assert_sound();
    assert_eq!(*rig.app.world().resource::<RestirStatus>(), RestirStatus::On);
    assert_eq!(log::warnings("there is a new device").len(), 1);
}

#[test]
fn without_another_device_bevy_stops_rendering_and_nothing_panics() {
    if !is_alone("without_another_device_bevy_stops_rendering_and_nothing_panics") {
        return;
    }
    let Some(mut rig) = lit_wall() else { return };
    rig.until_ready();
    rig.capture.request();
    destroy_device(&rig);
    (0..3).for_each(|_| rig.app.update());
    assert!(rig.app.should_exit().is_some_and(|exit| exit.is_error()), "Bevy's default");
}
