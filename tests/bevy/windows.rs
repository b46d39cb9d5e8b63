//! Cameras that draw to windows.  A process has one event loop, and windows need a display, such as that of `xvfb-run`: the test runs in a
//! process of its own, and only where `DISPLAY` names one.

use super::lost_devices::is_alone;
use crate::support::{app::*, gpu, start::silence_mesa};
use bevy::{
    camera::RenderTarget,
    log::LogPlugin,
    prelude::*,
    render::{
        RenderPlugin,
        pipelined_rendering::PipelinedRenderingPlugin,
        settings::{Backends, WgpuSettings},
    },
    window::{ExitCondition, PresentMode, PrimaryWindow, WindowRef, WindowResolution},
    winit::{WinitPlugin, WinitSettings},
};
use bevy_restir::{EmissiveLuminance, RadianceCapture, Restir, RestirPlugin, Technique};
use std::time::{Duration, Instant};

const MODES: [PresentMode; 6] = [
    PresentMode::AutoVsync,
    PresentMode::AutoNoVsync,
    PresentMode::Fifo,
    PresentMode::FifoRelaxed,
    PresentMode::Mailbox,
    PresentMode::Immediate,
];
/// Frames after a change before pictures count.
const SETTLING: u32 = 4;
/// Time after a change within which all windows must show their pictures.
const PATIENCE: Duration = Duration::from_secs(200);

/// A camera, its window, and the light that it sees.
struct Eye {
    camera: Entity,
    window: Entity,
    capture: RadianceCapture,
    light: Vec3,
}

impl Eye {
    /// Requests a picture of the next frame.  Fails unless that of the last frame has the size of the window and the right light.
    fn look(&self, world: &World) -> Result<(), String> {
        let captured = self.capture.take();
        self.capture.request();
        let wanted = world.get::<Window>(self.window).map(Window::physical_size).ok_or("the window is gone")?;
        let captured = captured.ok_or("it has no picture")?;
        let UVec2 { x, y } = captured.size;
        let middle = captured.mean().nth((y / 2 * x + x / 2) as usize).map(Vec3::from_array).unwrap_or(Vec3::NAN);
        let is_right = captured.size == wanted && (middle - self.light).length() < 1e-3;
        is_right.then_some(()).ok_or(format!("{x} x {y} pixels for {wanted}, {middle} for {}", self.light))
    }
}

/// The changes, and the cameras that must show their pictures after each of them.
#[derive(Resource)]
struct Script {
    eyes: Vec<Eye>,
    /// Number of changes that were made.
    made: usize,
    frames: u32,
    since: Instant,
}

impl Script {
    /// Makes the next change once all windows show their pictures.
    fn advance(&mut self, world: &mut World) {
        let looks: Vec<_> = self.eyes.iter().map(|eye| eye.look(world)).collect();
        self.frames += 1;
        let is_right = looks.iter().all(Result::is_ok);
        assert!(is_right || self.since.elapsed() < PATIENCE, "after {} changes: {looks:?}", self.made);
        if !is_right || self.frames < SETTLING {
            return;
        }
        if self.made < MODES.len() {
            for (i, eye) in self.eyes.iter().enumerate() {
                let mut window = world.get_mut::<Window>(eye.window).expect("the window is open");
                window.present_mode = MODES[(self.made + i) % MODES.len()];
            }
        } else if self.eyes.len() > 1
            && let Some(last) = self.eyes.pop()
        {
            world.despawn(last.camera);
            world.despawn(last.window);
        } else {
            world.write_message(AppExit::Success);
        }
        (self.made, self.frames, self.since) = (self.made + 1, 0, Instant::now());
    }
}

fn window(width: u32, height: u32) -> Window {
    Window { title: "bevy_restir".into(), resolution: WindowResolution::new(width, height), ..default() }
}

/// An app with a window and the event loop of the system.
fn app() -> App {
    let renderer = RenderPlugin {
        synchronous_pipeline_compilation: true,
        render_creation: WgpuSettings { backends: Some(Backends::PRIMARY), ..default() }.into(),
        ..default()
    };
    let first = Some(window(96, 64));
    let mut app = App::new();
    app.add_plugins(
        DefaultPlugins
            .set(renderer)
            .set(WindowPlugin { primary_window: first, exit_condition: ExitCondition::DontExit, ..default() })
            .set(WinitPlugin { run_on_any_thread: true })
            .disable::<LogPlugin>()
            .disable::<PipelinedRenderingPlugin>(),
    )
    .add_plugins(RestirPlugin::default())
    .insert_resource(EmissiveLuminance(1.0))
    .insert_resource(WinitSettings::continuous());
    app
}

/// A glowing wall at this place, and a camera in front of it that draws to the window.
fn spawn_eye(world: &mut World, window: Entity, at: Vec3, light: Vec3, technique: Technique) -> Eye {
    let mesh = world.resource_mut::<Assets<Mesh>>().add(square(20.0));
    let glowing = lamp(light.x, light.y, light.z);
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(glowing);
    world.spawn((Mesh3d(mesh), MeshMaterial3d(material), Transform::from_translation(at)));
    let capture = RadianceCapture::default();
    let camera = world.spawn((
        Camera3d::default(),
        RenderTarget::Window(WindowRef::Entity(window)),
        Transform::from_translation(at + 5.0 * Vec3::Z),
        unit_exposure(),
        Restir { technique, ..plain() },
        capture.clone(),
    ));
    Eye { camera: camera.id(), window, capture, light }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn two_windows_show_their_cameras_in_all_present_modes() {
    if std::env::var_os("DISPLAY").is_none() {
        eprintln!("skipped: there is no display (DISPLAY is not set)");
        return;
    }
    if gpu::gpu().is_none() || !is_alone("bevy::windows", "two_windows_show_their_cameras_in_all_present_modes") {
        return;
    }
    silence_mesa();
    let mut app = app();
    let world = app.world_mut();
    let first = world.query_filtered::<Entity, With<PrimaryWindow>>().single(world).expect("there is a window");
    let second = world.spawn(window(48, 80)).id();
    let eyes = vec![
        spawn_eye(world, first, Vec3::ZERO, Vec3::new(1.0, 0.5, 0.25), Technique::Reference),
        spawn_eye(world, second, 200.0 * Vec3::X, Vec3::new(0.25, 0.5, 1.0), Technique::Di),
    ];
    world.insert_resource(Script { eyes, made: 0, frames: 0, since: Instant::now() });
    app.add_systems(Update, |world: &mut World| {
        world.resource_scope(|world, mut script: Mut<Script>| script.advance(world));
    });
    assert!(app.run().is_success(), "an error of the renderer");
}
