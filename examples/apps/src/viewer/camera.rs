//! Moves the camera: around the scene, flying, or with a camera of the file.

use bevy::{
    camera_controller::free_camera::{FreeCamera, FreeCameraPlugin, FreeCameraState},
    input::mouse::MouseScrollUnit,
    prelude::*,
    window::WindowEvent,
};
use bevy_egui::input::EguiWantsInput;
use bevy_restir_support::framing;

use super::load::{Arrived, Stage};

/// Radians per pixel.
const TURNING: f32 = 0.006;
/// Zoom per notch of the wheel.
const ZOOM: f32 = 0.1;
/// Largest pitch in radians.
const STEEPEST: f32 = 1.55;

/// How the camera is controlled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    Orbit,
    Fly,
    /// A camera of the file, by its index.
    File(usize),
}

/// The position of the camera around its target.
#[derive(Component, Clone, Debug)]
pub struct Eye {
    pub mode: Mode,
    target: Vec3,
    distance: f32,
    yaw: f32,
    pitch: f32,
    cursor: Option<Vec2>,
    /// The button of a drag that began on the picture.
    held: Option<MouseButton>,
    /// Whether to frame the whole scene in the next frame.
    pub frame_scene: bool,
}

/// The camera that shows the scene.
pub fn eye() -> impl Bundle {
    let eye = Eye {
        mode: Mode::Orbit,
        target: Vec3::ZERO,
        distance: 1.0,
        yaw: 0.0,
        pitch: 0.0,
        cursor: None,
        held: None,
        frame_scene: true,
    };
    (Camera3d::default(), eye, FreeCamera::default())
}

pub fn plugin(app: &mut App) {
    app.add_plugins(FreeCameraPlugin).add_systems(Update, (look_at_arrivals, frame, follow, orbit, fly).chain());
}

impl Eye {
    /// Continues from a transform; the target lies `distance` ahead.
    fn take(&mut self, place: &Transform, distance: f32) {
        let (yaw, pitch, _) = place.rotation.to_euler(EulerRot::YXZ);
        (self.yaw, self.pitch) = (yaw, pitch.clamp(-STEEPEST, STEEPEST));
        self.distance = distance.max(1e-6);
        self.target = place.translation + self.distance * *place.forward();
    }

    /// Turns or moves the camera, and leaves the camera of the file.
    fn drag(&mut self, by: Vec2, pans: bool, projection: &Projection, lines: f32) {
        self.mode = Mode::Orbit;
        if !pans {
            self.yaw -= by.x * TURNING;
            self.pitch = (self.pitch - by.y * TURNING).clamp(-STEEPEST, STEEPEST);
            return;
        }
        // A point at the distance of the target stays under the cursor.
        let height = match projection {
            Projection::Orthographic(lens) => lens.area.height(),
            Projection::Perspective(lens) => 2.0 * self.distance * (0.5 * lens.fov).tan(),
            Projection::Custom(_) => self.distance,
        };
        let shift = self.place().rotation * Vec3::new(-by.x, by.y, 0.0) * (height / lines.max(1.0));
        self.target += shift;
    }

    fn zoom(&mut self, by: f32, projection: &mut Projection) {
        self.mode = Mode::Orbit;
        self.distance = (self.distance * by).clamp(1e-6, 1e9);
        if let Projection::Orthographic(lens) = projection {
            lens.scale *= by;
        }
    }

    fn place(&self) -> Transform {
        let rotation = Quat::from_euler(EulerRot::YXZ, self.yaw, self.pitch, 0.0);
        Transform::from_translation(self.target + rotation * Vec3::new(0.0, 0.0, self.distance)).with_rotation(rotation)
    }
}

/// Shows a new scene through its first camera, if it has one.
fn look_at_arrivals(
    mut arrived: MessageReader<Arrived>,
    stage: Res<Stage>,
    mut eyes: Query<(&mut Eye, &mut FreeCamera)>,
) {
    if arrived.read().next().is_none() {
        return;
    }
    let Some(shown) = &stage.shown else { return };
    for (mut eye, mut fly) in &mut eyes {
        eye.frame_scene = true;
        eye.mode = if shown.cameras.is_empty() { Mode::Orbit } else { Mode::File(0) };
        // Flies across the scene in three seconds.
        (fly.walk_speed, fly.run_speed) = (0.7 * shown.radius, 2.8 * shown.radius);
    }
}

/// Frames the whole scene where `Eye::frame_scene` asks for it.
fn frame(stage: Res<Stage>, mut eyes: Query<(&mut Eye, &mut Transform, &mut Projection, &Camera)>) {
    let Some(shown) = &stage.shown else { return };
    for (mut eye, mut place, mut projection, camera) in &mut eyes {
        if !eye.frame_scene {
            continue;
        }
        eye.frame_scene = false;
        let aspect = camera.logical_viewport_size().map_or(1.0, |size| size.x / size.y.max(1.0));
        (*place, *projection) = framing::in_front(shown.center, shown.radius, aspect);
        let distance = place.translation.distance(shown.center);
        eye.take(&place, distance);
    }
}

/// Follows a camera of the file, which may move.
fn follow(
    stage: Res<Stage>,
    mut eyes: Query<(&mut Eye, &mut Transform, &mut Projection)>,
    cameras: Query<(&GlobalTransform, &Projection), Without<Eye>>,
) {
    for (mut eye, mut place, mut projection) in &mut eyes {
        let (Mode::File(index), Some(shown)) = (eye.mode, &stage.shown) else { continue };
        let Some((there, lens)) = shown.cameras.get(index).and_then(|camera| cameras.get(camera.1).ok()) else {
            eye.mode = Mode::Orbit;
            continue;
        };
        place.set_if_neq(there.compute_transform().with_scale(Vec3::ONE));
        *projection = lens.clone();
        // A later orbit goes around the depth of the scene's center.
        let ahead = (shown.center - place.translation).dot(*place.forward());
        let distance = if ahead > 0.05 * shown.radius { ahead } else { shown.radius };
        eye.take(&place, distance);
    }
}

/// Left drag turns, right or middle drag moves, the wheel zooms. Events are read in their order, because a slow frame has many.
pub fn orbit(
    mut events: MessageReader<WindowEvent>,
    keys: Res<ButtonInput<KeyCode>>,
    mut eyes: Query<(&mut Eye, &mut Transform, &mut Projection, &Camera)>,
) {
    let shifted = keys.any_pressed([KeyCode::ShiftLeft, KeyCode::ShiftRight]);
    for event in events.read() {
        for (mut eye, mut place, mut projection, camera) in &mut eyes {
            let Some(area) = camera.logical_viewport_rect() else { continue };
            let is_over = eye.cursor.is_some_and(|cursor| area.contains(cursor));
            match event {
                WindowEvent::MouseButtonInput(input) if input.state.is_pressed() => {
                    // A drag that begins on the panel does not move the camera.
                    eye.held = is_over.then_some(input.button).or(eye.held);
                }
                WindowEvent::MouseButtonInput(input) if eye.held == Some(input.button) => eye.held = None,
                WindowEvent::CursorMoved(moved) => {
                    let last = eye.cursor.replace(moved.position);
                    let (Some(last), Some(button)) = (last, eye.held) else { continue };
                    if eye.mode != Mode::Fly && moved.position != last {
                        let pans = button != MouseButton::Left || shifted;
                        eye.drag(moved.position - last, pans, &projection, area.height());
                        *place = eye.place();
                    }
                }
                WindowEvent::MouseWheel(wheel) if is_over && eye.mode != Mode::Fly => {
                    let lines = match wheel.unit {
                        MouseScrollUnit::Line => wheel.y,
                        MouseScrollUnit::Pixel => wheel.y / MouseScrollUnit::SCROLL_UNIT_CONVERSION_FACTOR,
                    };
                    eye.zoom((-ZOOM * lines).exp(), &mut projection);
                    *place = eye.place();
                }
                _ => {}
            }
        }
    }
}

/// Enables Bevy's flying camera in that mode, unless the panel uses the keys or the pointer.
fn fly(
    taken: Option<Res<EguiWantsInput>>,
    buttons: Res<ButtonInput<MouseButton>>,
    mut eyes: Query<(&mut Eye, &Transform, &mut FreeCameraState)>,
    mut flew: Local<bool>,
) {
    for (mut eye, place, mut state) in &mut eyes {
        let flies = eye.mode == Mode::Fly;
        if flies != *flew {
            // Orbiting and flying continue from the same place.
            let (yaw, pitch, _) = place.rotation.to_euler(EulerRot::YXZ);
            (state.yaw, state.pitch, state.velocity) = (yaw, pitch, Vec3::ZERO);
            *flew = flies;
        }
        if flies {
            let distance = eye.distance;
            eye.take(place, distance);
        }
        let busy = taken.as_ref().is_some_and(|taken| taken.wants_any_input());
        // A drag that began on the picture continues over the panel.
        let enabled = flies && (!busy || (state.enabled && buttons.get_pressed().next().is_some()));
        if state.enabled != enabled {
            state.enabled = enabled;
        }
    }
}
