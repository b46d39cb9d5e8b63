//! Motion vectors equal projections in f64 on the CPU.

use crate::support::app::*;
use bevy::{
    camera::visibility::RenderLayers,
    math::{DMat4, DVec2, DVec3},
    prelude::*,
};
use bevy_restir::{DebugView, Jitter};

const SIZE: (u32, u32) = (48, 32);
const SIDE: f32 = 2.0;
/// Pixels: the error of f32 matrices.
const TOLERANCE: f64 = 2e-3;

/// A camera with Bevy's default perspective, in f64.
#[derive(Clone, Copy)]
struct Camera(DMat4);

fn matrix(t: &Transform) -> DMat4 {
    DMat4::from_scale_rotation_translation(
        t.scale.as_dvec3(),
        t.rotation.as_dquat().normalize(),
        t.translation.as_dvec3(),
    )
}

impl Camera {
    fn new(transform: &Transform) -> Self {
        Self(matrix(transform))
    }

    fn size() -> DVec2 {
        DVec2::new(SIZE.0.into(), SIZE.1.into())
    }

    /// Tangents of half the field of view.
    fn extent() -> DVec2 {
        let tangent = (0.5 * f64::from(PerspectiveProjection::default().fov)).tan();
        DVec2::new(tangent * Self::size().x / Self::size().y, tangent)
    }

    /// In pixels, y down.
    fn project(&self, p: DVec3) -> DVec2 {
        let v = self.0.inverse().transform_point3(p);
        let ndc = DVec2::new(v.x, v.y) / -v.z / Self::extent();
        DVec2::new(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y) * Self::size()
    }

    fn direction(&self, pixel: DVec2) -> DVec3 {
        let ndc = pixel / Self::size() * DVec2::new(2.0, -2.0) + DVec2::new(-1.0, 1.0);
        self.0.transform_vector3((ndc * Self::extent()).extend(-1.0))
    }

    fn origin(&self) -> DVec3 {
        self.0.w_axis.truncate()
    }
}

/// Moves the square and the camera between two frames, and compares every pixel of the second frame with the projections.
fn check(case: &str, square_moves: [Transform; 2], camera_moves: [Transform; 2]) {
    check_edited(case, square_moves, camera_moves, |_, _| ());
}

/// Like [`check`], where the square is also edited in the frame of its motion.
fn check_edited(
    case: &str,
    square_moves: [Transform; 2],
    camera_moves: [Transform; 2],
    edit: impl FnOnce(&mut Rig, Entity),
) {
    let Some(mut rig) = Rig::new(SIZE.0, SIZE.1) else {
        return;
    };
    let object = rig.spawn(square(SIDE), lambert(0.5), square_moves[0]);
    rig.insert(rig.camera, camera_moves[0]);
    rig.set(|restir| restir.debug_view = DebugView::Motion);
    rig.until_ready();
    rig.insert(object, square_moves[1]);
    rig.insert(rig.camera, camera_moves[1]);
    edit(&mut rig, object);
    let moved = rig.next();
    let still = rig.next();

    let [before, now] = camera_moves.each_ref().map(Camera::new);
    let [object_before, object_now] = square_moves.each_ref().map(matrix);
    let (mut on_object, mut on_sky) = (0, 0);
    for (at, value) in moved.iter() {
        let pixel = at.as_dvec2() + 0.5;
        let direction = now.direction(pixel);
        let normal = object_now.transform_vector3(DVec3::Z);
        let distance = normal.dot(object_now.w_axis.truncate() - now.origin()) / normal.dot(direction);
        let local = object_now.inverse().transform_point3(now.origin() + distance * direction);
        let reach = local.x.abs().max(local.y.abs()) / (0.5 * f64::from(SIDE));
        // A pixel near the outline may show either surface.
        if distance > 0.0 && (0.9..1.1).contains(&reach) {
            continue;
        }
        let expected = if distance > 0.0 && reach < 1.0 {
            on_object += 1;
            before.project(object_before.transform_point3(local)) - pixel
        } else {
            on_sky += 1;
            before.project(before.origin() + direction) - pixel
        };
        let got = value.truncate().as_dvec2();
        assert!((got - expected).length() < TOLERANCE, "{case}: {got} at {at}, {expected} expected");
    }
    assert!(on_object > 100 && on_sky > 100, "{case}: {on_object} pixels of the square, {on_sky} of the sky");
    let rest = still.iter().map(|(_, m)| m.length()).fold(0.0, f32::max);
    assert!(f64::from(rest) < TOLERANCE, "{case}: after the motion stopped, pixels move by {rest}");
}

fn eye() -> Transform {
    Transform::from_xyz(0.2, 0.3, 5.0)
}

#[test]
fn a_moving_object_has_the_motion_of_its_projection() {
    let from = Transform::from_xyz(0.1, -0.2, 0.0);
    check("along x and y", [from, Transform::from_xyz(0.35, 0.1, 0.0)], [eye(); 2]);
    check("toward the camera", [from, Transform::from_xyz(0.1, -0.2, 0.8)], [eye(); 2]);
}

#[test]
fn an_object_that_changes_while_it_moves_has_the_motion_of_its_projection() {
    let moves = [Transform::from_xyz(0.1, -0.2, 0.0), Transform::from_xyz(0.35, 0.1, 0.4)];
    check_edited("another color", moves, [eye(); 2], |rig, object| {
        let paint = rig.material_of(object);
        rig.edit(&paint, |material| material.base_color = Color::linear_rgb(0.9, 0.1, 0.1));
    });
    check_edited("other layers", moves, [eye(); 2], |rig, object| {
        rig.insert(object, RenderLayers::from_layers(&[0, 1]))
    });
}

#[test]
fn a_rotating_and_growing_object_has_a_motion_at_each_point() {
    let from = Transform::from_rotation(Quat::from_euler(EulerRot::XYZ, 0.2, -0.5, 0.1));
    let to =
        Transform::from_rotation(Quat::from_euler(EulerRot::XYZ, 0.3, -0.2, 0.5)).with_scale(Vec3::new(1.2, 0.9, 1.1));
    check("rotation and growth", [from, to], [eye(); 2]);
    let mirrored = to.with_scale(Vec3::new(-1.2, 0.9, 1.1));
    check("mirrored", [from.with_scale(Vec3::new(-1.0, 1.0, 1.0)), mirrored], [eye(); 2]);
}

#[test]
fn camera_motion_moves_everything_and_the_sky_by_rotation_alone() {
    let square = Transform::from_rotation(Quat::from_rotation_y(0.3));
    check("camera slides", [square; 2], [eye(), Transform::from_xyz(0.0, 0.5, 4.6)]);
    check(
        "camera turns",
        [square; 2],
        [eye(), eye().with_rotation(Quat::from_euler(EulerRot::XYZ, 0.03, 0.05, -0.04))],
    );
    let both = Transform::from_xyz(-0.1, 0.2, 5.3).with_rotation(Quat::from_rotation_y(-0.04));
    check("the camera and the object move", [square, Transform::from_xyz(0.2, 0.2, 0.1)], [eye(), both]);
}

#[test]
fn the_sky_far_from_the_origin_does_not_move_with_the_position_of_the_camera() {
    let Some(mut rig) = Rig::new(SIZE.0, SIZE.1) else {
        return;
    };
    let place = |x| Transform::from_xyz(x, 2e4, -7e4).with_rotation(Quat::from_rotation_y(0.7));
    rig.spawn(square(SIDE), lambert(0.5), Transform::default());
    rig.insert(rig.camera, place(1e5));
    rig.set(|restir| restir.debug_view = DebugView::Motion);
    rig.until_ready();
    rig.insert(rig.camera, place(1e5 + 0.4));
    let motion = rig.next().iter().map(|(_, m)| m.length()).fold(0.0, f32::max);
    assert!(f64::from(motion) < TOLERANCE, "{motion}");
}

#[test]
fn jitter_does_not_change_motion_vectors() {
    let Some(mut rig) = Rig::new(SIZE.0, SIZE.1) else {
        return;
    };
    // The square moves parallel to the image: all its points have the same motion, wherever the ray passes within the pixel.
    let object = rig.spawn(square(8.0), lambert(0.5), Transform::default());
    rig.set(|restir| (restir.jitter, restir.debug_view) = (Jitter::Always, DebugView::Motion));
    rig.until_ready();
    for _ in 0..4 {
        let still = rig.next();
        assert!(still.iter().all(|(_, m)| f64::from(m.length()) < TOLERANCE), "a still scene");
    }
    rig.insert(object, Transform::from_xyz(0.3, -0.1, 0.0));
    let moved = rig.next();
    let camera = Camera::new(&Transform::from_xyz(0.0, 0.0, 5.0));
    let expected = camera.project(DVec3::ZERO) - camera.project(DVec3::new(0.3, -0.1, 0.0));
    for (at, value) in moved.iter() {
        let got = value.truncate().as_dvec2();
        assert!((got - expected).length() < TOLERANCE, "{got} at {at}, {expected} expected");
    }
}

/// Bevy's effects keep their history of a camera whose traced resolution changes, or that renders every second frame.
#[test]
fn the_first_frame_of_a_new_view_has_the_motion_of_the_camera() {
    let Some(mut rig) = Rig::new(SIZE.0, SIZE.1) else {
        return;
    };
    let place = |x| Transform::from_xyz(x, 0.0, 5.0);
    rig.spawn(square(8.0), lambert(0.5), Transform::default());
    rig.insert(rig.camera, place(0.0));
    rig.set(|restir| restir.debug_view = DebugView::Motion);
    rig.until_ready();
    // All points of the square have the same motion.
    let [before, now] = [0.0, 0.3].map(|x| Camera::new(&place(x)).project(DVec3::ZERO));
    let has_motion = |picture: Picture, expected: DVec2| {
        for (at, value) in picture.iter() {
            let got = value.truncate().as_dvec2();
            assert!((got - expected).length() < TOLERANCE, "{got} at {at}, {expected} expected");
        }
    };
    rig.insert(rig.camera, place(0.3));
    rig.set(|restir| restir.resolution_scale = 0.5);
    has_motion(rig.next(), 0.5 * (before - now));
    rig.get_mut::<bevy::camera::Camera>(rig.camera).is_active = false;
    rig.frame();
    rig.get_mut::<bevy::camera::Camera>(rig.camera).is_active = true;
    rig.insert(rig.camera, place(0.0));
    has_motion(rig.next(), -0.5 * (before - now));
}
