//! The data of the last frame, as shaders read them, equal the data that they read in that frame: camera and jitter, transforms, surfaces,
//! the top-level tree, and lights with their densities.  No statistics: each number is compared with itself a frame earlier.

use crate::support::{app::*, bodies::*, proof::emission, reuse_settings::paths, small_scenes::*};
use bevy::{
    light::{RectLight, SunDisk},
    prelude::*,
};
use bevy_restir::{
    Jitter, Paths, Restir, Reuse, ReuseOrder, Technique,
    testing::{replace_pass_shader, shader_library::ShaderEdit},
};

const SIZE: u32 = 64;

/// The moving room before a wall that fills the view, with a light of each kind, and a body that bends; all of them change.
pub fn changing(rig: &mut Rig) {
    moving(rig);
    let wall = rig.spawn(square(30.0), lambert(0.3), Transform::default());
    rig.insert(wall, Name::new("wall"));
    spawn_skinned(rig, "body", tube(), lambert(0.6));
    let ball = PointLight { intensity: 25.0, radius: 0.25, ..default() };
    rig.spawn_bundle((Name::new("ball"), ball, Transform::default()));
    let rect = RectLight { intensity: 20.0, width: 0.9, height: 0.5, ..default() };
    rig.spawn_bundle((Name::new("rectangle"), rect, Transform::default()));
    let disk = SunDisk { angular_size: 0.3, intensity: 1.0 };
    let sun = DirectionalLight { illuminance: 2.0, ..default() };
    rig.spawn_bundle((Name::new("sun"), sun, disk, Transform::default()));
    let spot = SpotLight { intensity: 60.0, outer_angle: 0.6, inner_angle: 0.2, ..default() };
    rig.spawn_bundle((Name::new("spot"), spot, Transform::default()));
}

/// Poses all of it at a step, 0 to [`STEPS`].
pub fn pose(rig: &mut Rig, step: u32) {
    pose_moving(rig, step);
    let s = step as f32;
    let body = rig.named("body");
    set_joints(rig, body, &swaying(Transform::from_xyz(-0.2, -1.1, 0.9), 0.5 * s, 1.0));
    let [wall, ball, rectangle, sun, spot] = ["wall", "ball", "rectangle", "sun", "spot"].map(|name| rig.named(name));
    *rig.get_mut::<Transform>(wall) = Transform::from_xyz(0.1 * s, 0.0, -1.0 + 0.03 * s)
        .with_rotation(Quat::from_rotation_y(0.05 * s))
        .with_scale(Vec3::splat(1.0 + 0.05 * s));
    rig.get_mut::<PointLight>(ball).radius = 0.2 + 0.05 * s;
    rig.get_mut::<PointLight>(ball).intensity = 20.0 + 7.0 * s;
    *rig.get_mut::<Transform>(ball) = Transform::from_xyz(0.7 - 0.2 * s, 0.6, 0.4);
    rig.get_mut::<RectLight>(rectangle).width = 0.9 + 0.1 * s;
    *rig.get_mut::<Transform>(rectangle) =
        Transform::from_xyz(0.9, 0.9 - 0.1 * s, 1.0).looking_at(Vec3::new(-0.2, -0.6, -0.4), Vec3::Y);
    rig.get_mut::<DirectionalLight>(sun).illuminance = 2.0 + s;
    *rig.get_mut::<Transform>(sun) =
        Transform::from_rotation(Quat::from_euler(EulerRot::YXZ, 0.6 + 0.1 * s, -0.8, 0.0));
    rig.get_mut::<SpotLight>(spot).outer_angle = 0.6 + 0.05 * s;
    *rig.get_mut::<Transform>(spot) =
        Transform::from_xyz(0.3 * s, 1.8, 1.0).looking_at(Vec3::new(-0.3, -1.0, 0.0), Vec3::Z);
}

/// A rig that shows what it reads, and for each step of the motion the emission that the camera sees.
fn start() -> Option<(Rig, Vec<Picture>)> {
    let mut rig = scene(SIZE, changing)?;
    let emitted = (0..=STEPS)
        .map(|step| {
            pose(&mut rig, step);
            emission(&mut rig)
        })
        .collect();
    replace_pass_shader(&mut rig.app, "pt_reuse", include_str!("../support/kernels/previous_frame.wgsl"));
    let reuse = Reuse { order: ReuseOrder::Spatiotemporal, spatial_samples: 1, ..Reuse::PATHS };
    let paths = Paths { reuse, ..paths::unified() };
    rig.set(|r| *r = Restir { technique: Technique::Pt, paths, jitter: Jitter::Always, bounces: 1, ..plain() });
    Some((rig, emitted))
}

/// For each quantity of the kernel, the number of places where a frame reads the last frame differently than that frame read itself; and
/// the number of all places.
fn differences(rig: &mut Rig, emitted: &[Picture]) -> ([u32; 8], u32) {
    pose(rig, 0);
    rig.until_ready();
    rig.frames(2);
    let (mut different, mut all) = ([0; 8], 0);
    let mut last = rig.next();
    for step in 1..=STEPS {
        pose(rig, step);
        let now = rig.next();
        let dark = [step as usize - 1, step as usize].map(|step| &emitted[step]);
        for (at, _) in now.iter().filter(|(at, _)| at.x % 2 == 0) {
            // Places beside a visible emitter are left out, because jitter moves edges by a pixel.
            let near = |p: &&Picture| {
                (0..3).all(|d| p.at((at.x + d).saturating_sub(1).min(SIZE - 1), at.y) == Vec3::ZERO)
                    && (0..3).all(|d| p.at(at.x + 1, (at.y + d).saturating_sub(1).min(SIZE - 1)) == Vec3::ZERO)
            };
            if !dark.iter().all(near) {
                continue;
            }
            let (before, read) = (last.at(at.x, at.y), now.at(at.x + 1, at.y));
            let is_near = (before - read).abs().max_element() <= 1e-4 * before.abs().max_element() + 1e-5;
            different[(at.y % 8) as usize] += u32::from(!is_near);
            all += 1;
        }
        last = now;
    }
    (different, all / 8)
}

/// The pictures hold coordinates, which may be negative: guards of light do not apply.
#[test]
fn reads_of_the_last_frame_equal_those_of_that_frame() {
    let Some((mut rig, emitted)) = start() else { return };
    let (different, all) = differences(&mut rig, &emitted);
    eprintln!("{different:?} of {all} each");
    assert!(all > 500, "{all}");
    // The inverse of the last frame's transform is rounded to f32, which may move a traced ray to the other side of an edge.
    assert!(
        (0..8).all(|row| different[row] <= if matches!(row, 4 | 5) { all / 100 } else { 0 }),
        "{different:?} of {all}"
    );
}

/// Edits that make a read of the last frame read this frame.
pub const WRONG: [(&str, &str, &str, &str); 10] = [
    (
        "transform",
        "scene/triangle.wgsl",
        "return instances[instance].previous_world_from_object;",
        "return instances[instance].world_from_object;",
    ),
    (
        "camera of the view ray",
        "view/camera.wgsl",
        "return camera_ray(view.previous, vec2",
        "return camera_ray(view.current, vec2",
    ),
    (
        "triangle of a body",
        "scene/triangle.wgsl",
        "let is_second = previous && (instances",
        "let is_second = false && (instances",
    ),
    (
        "offset of a ray's origin",
        "scene/offset.wgsl",
        "let world = instance_transform(instance, previous);",
        "let world = instance_transform(instance, false);",
    ),
    ("jitter", "view/camera.wgsl", "+ 0.5 + view.previous_jitter);", "+ 0.5 + view.jitter);"),
    (
        "eye of the footprint",
        "view/camera.wgsl",
        "view.previous.world_from_view[3].xyz, previous)",
        "view.current.world_from_view[3].xyz, previous)",
    ),
    (
        "instance of a ray",
        "trace/space.wgsl",
        "let world = instance_transform(instance, previous);",
        "let world = instance_transform(instance, false);",
    ),
    ("light", "light/remap.wgsl", "if !previous {", "if true {"),
    (
        "density of a light",
        "light/point_on_light.wgsl",
        "b.x + b.y), from_point, previous)",
        "b.x + b.y), from_point, false)",
    ),
    (
        "triangle of a reconnection",
        "restir/shift/reconnection.wgsl",
        "world_triangle(instance, triangle, previous)",
        "world_triangle(instance, triangle, false)",
    ),
];

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_wrong_reads_of_the_last_frame_are_found() {
    let Some((mut rig, emitted)) = start() else { return };
    for (name, module, from, to) in WRONG {
        plant_edits(&mut rig.app, &[ShaderEdit { module, from, to }]);
        let (different, all) = differences(&mut rig, &emitted);
        eprintln!("{name}: {different:?} of {all} each");
        assert!(different.iter().any(|count| *count > all / 100), "{name} is not found: {different:?}");
    }
}
