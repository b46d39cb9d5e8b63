//! Small scenes that the tests build from code, and the camera that looks at them.

use super::app::*;
use bevy::{
    light::{RectLight, SunDisk},
    prelude::*,
};
use bevy_restir::{RestirEnvironment, Subsurface};

/// Scenes for tests of the shift: diffuse, glossy, with mirrors, in an environment, and with area lights.
pub const PATH_SCENES: [(&str, fn(&mut Rig)); 5] = [
    ("room", |rig| {
        room(rig);
    }),
    ("glossy", glossy),
    ("mirrors", mirrors),
    ("surrounded", |rig| surrounded(rig, true)),
    ("shapes", shapes),
];

/// A metal or a plastic material.
pub fn shiny(color: Color, roughness: f32, metallic: f32) -> StandardMaterial {
    StandardMaterial { base_color: color, perceptual_roughness: roughness, metallic, ..default() }
}

pub fn facing(from: Vec3, to: Vec3) -> Transform {
    // A square faces +Z.
    Transform::from_translation(from)
        .looking_to(from - to, if (to - from).normalize().y.abs() > 0.9 { Vec3::X } else { Vec3::Y })
}

/// An asymmetric room: walls, blocks that cast shadows, and one area light.
pub fn room(rig: &mut Rig) -> Entity {
    let floor = Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(4.0), lambert(0.7), floor);
    rig.spawn(square(4.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -1.2));
    let red = StandardMaterial { base_color: Color::linear_rgb(0.8, 0.1, 0.1), ..lambert(0.0) };
    rig.spawn(
        square(4.0),
        red,
        Transform::from_xyz(-1.7, 0.0, 0.0).with_rotation(Quat::from_rotation_y(core::f32::consts::FRAC_PI_2)),
    );
    rig.spawn(square(0.8), lamp(6.0, 5.0, 4.0), facing(Vec3::new(0.5, 1.4, 0.3), Vec3::new(0.2, -1.0, 0.0)));
    rig.spawn(Cuboid::new(0.7, 0.7, 0.7), lambert(0.6), Transform::from_xyz(-0.6, -0.8, 0.2));
    rig.spawn(
        Cuboid::new(0.9, 0.1, 0.9),
        lambert(0.4),
        Transform::from_xyz(0.6, 0.1, 0.0).with_rotation(Quat::from_rotation_z(0.3)),
    )
}

/// Translucent bodies: a textured slab with the edge of a shadow, a polished ball, and a thin plate that is lit from behind.  Returns the
/// ball and the lamp above.
pub fn translucent(rig: &mut Rig) -> [Entity; 2] {
    let body =
        |reflectance| StandardMaterial { base_color: Color::linear_rgb(0.83, 0.79, 0.75), reflectance, ..lambert(0.8) };
    let soft = |r: f32, g: f32, b: f32| Subsurface { mean_free_path: Vec3::new(r, g, b), weight: 1.0 };
    // The base color decides how far light scatters.
    let stained = texture(4, 4, |x, y| if (x + y) % 2 == 0 { [250, 220, 180, 255] } else { [150, 230, 255, 255] });
    let stained = StandardMaterial { base_color_texture: Some(rig.add(stained)), ..body(0.0) };
    let slab = rig.spawn(Cuboid::new(3.0, 0.5, 1.8), stained, Transform::from_xyz(0.0, -1.1, 0.2));
    rig.insert(slab, soft(0.15, 0.06, 0.03));
    rig.spawn(Cuboid::new(1.4, 0.05, 1.8), lambert(0.3), Transform::from_xyz(-0.8, -0.35, 0.2));
    let ball = Sphere::new(0.55).mesh().ico(12).expect("few triangles");
    let ball = rig.spawn(ball, body(0.5), Transform::from_xyz(0.75, 0.1, 0.2));
    rig.insert(ball, Subsurface { weight: 0.7, ..soft(0.1, 0.05, 0.02) });
    let plate = rig.spawn(Cuboid::new(1.2, 1.0, 0.06), body(0.0), Transform::from_xyz(-0.7, 0.6, -0.3));
    rig.insert(plate, soft(0.06, 0.04, 0.02));
    rig.spawn(square(1.0), lamp(4.0, 3.0, 2.0), facing(Vec3::new(-0.7, 0.6, -1.4), Vec3::new(-0.7, 0.6, 0.0)));
    let above =
        rig.spawn(square(1.0), lamp(8.0, 8.0, 8.0), facing(Vec3::new(0.5, 2.1, 0.9), Vec3::new(0.3, -1.0, 0.0)));
    [ball, above]
}

/// A room whose walls and objects are translucent, so that paths go below several surfaces.
pub fn translucent_room(rig: &mut Rig) {
    room(rig);
    let world = rig.app.world_mut();
    let bodies: Vec<Entity> = world.query_filtered::<Entity, With<Mesh3d>>().iter(world).collect();
    for body in bodies {
        rig.insert(body, Subsurface { mean_free_path: Vec3::new(0.2, 0.1, 0.05), weight: 0.8 });
    }
}

/// A glossy floor with an emitter that almost touches it, a smooth ball and a rough one: BSDF samples find light that light samples miss.
pub fn glossy(rig: &mut Rig) {
    let floor = Transform::from_xyz(0.0, -1.0, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(5.0), shiny(Color::linear_rgb(0.5, 0.6, 0.7), 0.45, 0.8), floor);
    let up = Transform::from_xyz(0.0, -0.6, -1.0);
    let both_sides = StandardMaterial { double_sided: true, cull_mode: None, ..lamp(0.6, 0.8, 1.2) };
    rig.spawn(square(0.7), both_sides, up);
    rig.spawn(
        Sphere::new(0.4).mesh().uv(16, 10),
        shiny(Color::linear_rgb(0.9, 0.7, 0.3), 0.3, 1.0),
        Transform::from_xyz(-0.9, -0.5, 0.3),
    );
    rig.spawn(
        Sphere::new(0.4).mesh().uv(16, 10),
        shiny(Color::linear_rgb(0.3, 0.7, 0.3), 0.5, 0.0),
        Transform::from_xyz(0.9, -0.5, 0.3),
    );
    rig.spawn(square(1.0), lamp(8.0, 8.0, 8.0), facing(Vec3::new(1.0, 1.5, 1.0), Vec3::ZERO));
}

/// Point, directional and spot lights with shadows.
pub fn punctual(rig: &mut Rig) {
    room_without_lamp(rig);
    let point = |intensity| PointLight { intensity, ..default() };
    rig.spawn_bundle((point(40.0), Transform::from_xyz(0.9, 1.0, 0.9)));
    rig.spawn_bundle((point(10.0), Transform::from_xyz(-1.0, 0.6, 1.0)));
    let sun = Quat::from_euler(EulerRot::YXZ, 0.6, -0.8, 0.0);
    rig.spawn_bundle((DirectionalLight { illuminance: 2.0, ..default() }, Transform::from_rotation(sun)));
    let spot = SpotLight { intensity: 60.0, outer_angle: 0.6, inner_angle: 0.2, ..default() };
    rig.spawn_bundle((spot, Transform::from_xyz(0.0, 1.8, 1.0).looking_at(Vec3::new(-0.3, -1.0, 0.0), Vec3::Z)));
}

/// A sphere light, a rectangle light and a sun with a disk over a glossy wall, one behind the other, and a mirror that shows them.
pub fn shapes(rig: &mut Rig) {
    room_without_lamp(rig);
    let ball = PointLight { intensity: 25.0, radius: 0.25, color: Color::linear_rgb(1.0, 0.7, 0.4), ..default() };
    rig.spawn_bundle((Name::new("ball"), ball, Transform::from_xyz(0.7, 0.6, 0.4)));
    let rect = RectLight { intensity: 20.0, width: 0.9, height: 0.5, ..default() };
    let place = Transform::from_xyz(0.9, 0.9, 1.0).looking_at(Vec3::new(-0.2, -0.6, -0.4), Vec3::Y);
    rig.spawn_bundle((Name::new("rectangle"), rect, place));
    let sun = Quat::from_euler(EulerRot::YXZ, 0.6, -0.8, 0.0);
    let disk = SunDisk { angular_size: 0.3, intensity: 1.0 };
    let light = DirectionalLight { illuminance: 2.0, ..default() };
    rig.spawn_bundle((Name::new("sun"), light, disk, Transform::from_rotation(sun)));
    let mirror = shiny(Color::linear_rgb(0.9, 0.9, 0.9), 0.0, 1.0);
    let turn = Quat::from_euler(EulerRot::YXZ, 0.5, -0.3, 0.0);
    rig.spawn(square(0.8), mirror, Transform::from_xyz(-1.2, 0.3, -0.6).with_rotation(turn));
}

fn room_without_lamp(rig: &mut Rig) {
    let floor = Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(4.0), lambert(0.7), floor);
    rig.spawn(square(4.0), shiny(Color::linear_rgb(0.5, 0.5, 0.5), 0.4, 0.3), Transform::from_xyz(0.0, 0.0, -1.2));
    rig.spawn(Cuboid::new(0.7, 0.7, 0.7), lambert(0.6), Transform::from_xyz(-0.6, -0.8, 0.2));
    rig.spawn(Cuboid::new(0.6, 0.1, 0.6), lambert(0.4), Transform::from_xyz(0.6, 0.1, 0.0));
}

/// A lamp, and an environment.
pub fn surrounded_by(rig: &mut Rig, environment: impl FnOnce(&mut Rig)) {
    room_without_lamp(rig);
    rig.spawn(square(0.5), lamp(2.0, 2.0, 2.0), facing(Vec3::new(0.9, 1.0, 0.9), Vec3::ZERO));
    environment(rig);
}

/// A lamp, and an environment of one color or with a map that has a sun.
pub fn surrounded(rig: &mut Rig, with_map: bool) {
    surrounded_by(rig, |rig| environment_of(rig, with_map));
}

/// Gives the camera an environment of one color, or with a map that has a sun.
pub fn environment_of(rig: &mut Rig, with_map: bool) {
    let mut environment = sky(0.4);
    if with_map {
        let mut map =
            texture(
                16,
                8,
                |x, y| if (x, y) == (11, 1) { [255; 4] } else { [20 + 4 * x as u8, 30, 60 - 5 * y as u8, 255] },
            );
        map.texture_descriptor.format = bevy::render::render_resource::TextureFormat::Rgba8Unorm;
        let image = Some(rig.add::<Image>(map));
        environment = RestirEnvironment { image, rotation: Quat::from_rotation_y(0.7), ..sky(3.0) };
    }
    rig.insert(rig.camera, environment);
}

/// A mirror, a lacquer (a delta lobe over a diffuse body), a lamp that the mirror shows, and an unlit square.
pub fn mirrors(rig: &mut Rig) {
    room(rig);
    let mirror = shiny(Color::linear_rgb(0.9, 0.9, 0.9), 0.0, 1.0);
    rig.spawn(
        square(1.2),
        mirror,
        Transform::from_xyz(0.8, -0.3, -0.8).with_rotation(Quat::from_euler(EulerRot::YXZ, -0.5, -0.5, 0.0)),
    );
    rig.spawn(
        Sphere::new(0.4).mesh().uv(16, 10),
        shiny(Color::linear_rgb(0.2, 0.5, 0.8), 0.0, 0.0),
        Transform::from_xyz(-0.2, -0.8, 0.8),
    );
    let unlit = StandardMaterial { unlit: true, ..Color::linear_rgb(0.2, 0.1, 0.3).into() };
    rig.spawn(square(0.4), unlit, Transform::from_xyz(-1.0, 0.7, 0.0));
}

/// An emissive ceiling that rays often hit, a mirror that shows it, and half-metallic objects.
pub fn shining(rig: &mut Rig) {
    room(rig);
    let ceiling = Transform::from_xyz(0.0, 1.9, 0.0).with_rotation(Quat::from_rotation_x(core::f32::consts::FRAC_PI_2));
    rig.spawn(square(12.0), lamp(0.8, 0.9, 1.0), ceiling);
    let mirror = Transform::from_xyz(0.7, 0.0, -0.9).with_rotation(Quat::from_rotation_x(-0.4));
    rig.spawn(square(2.0), shiny(Color::linear_rgb(0.9, 0.9, 0.9), 0.0, 1.0), mirror);
    let floor =
        Transform::from_xyz(0.0, -1.19, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(4.0), shiny(Color::WHITE, 0.5, 0.5), floor);
    rig.spawn(square(4.0), shiny(Color::WHITE, 0.5, 0.5), Transform::from_xyz(0.0, 0.0, -1.19));
    rig.spawn(Cuboid::new(0.9, 0.9, 0.9), shiny(Color::WHITE, 0.5, 0.5), Transform::from_xyz(-0.9, -0.74, 0.3));
    rig.spawn(Sphere::new(0.4).mesh().uv(16, 10), shiny(Color::WHITE, 0.3, 1.0), Transform::from_xyz(0.1, -0.8, 0.8));
}

/// Fine textures on a floor, an emitter and an alpha mask, rotated and repeated, and a mirror that shows them.
pub fn textured(rig: &mut Rig) {
    mirrors(rig);
    let mut checks =
        texture(16, 16, |x, y| if (x / 2 + y / 2) % 2 == 0 { [250, 240, 200, 255] } else { [30, 60, 90, 60] });
    checks.sampler = bevy::image::ImageSampler::Descriptor(bevy::image::ImageSamplerDescriptor {
        address_mode_u: bevy::image::ImageAddressMode::Repeat,
        address_mode_v: bevy::image::ImageAddressMode::MirrorRepeat,
        ..bevy::image::ImageSamplerDescriptor::linear()
    });
    let image = Some(rig.add::<Image>(checks));
    let uv_transform = bevy::math::Affine2::from_scale_angle_translation(Vec2::new(6.0, 4.0), 0.4, Vec2::new(0.1, 0.7));
    let floor =
        Transform::from_xyz(0.0, -1.19, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(4.0), StandardMaterial { base_color_texture: image.clone(), uv_transform, ..lambert(0.9) }, floor);
    let glows = StandardMaterial { emissive_texture: image.clone(), uv_transform, ..lamp(3.0, 4.0, 5.0) };
    rig.spawn(square(0.9), glows, facing(Vec3::new(-1.2, 0.9, 0.6), Vec3::ZERO));
    let pane = StandardMaterial {
        base_color_texture: image,
        alpha_mode: AlphaMode::Mask(0.5),
        double_sided: true,
        cull_mode: None,
        uv_transform,
        ..lambert(0.8)
    };
    rig.spawn(square(0.8), pane, facing(Vec3::new(0.3, 0.4, 0.5), Vec3::new(0.1, -1.0, 0.0)));
}

/// The less common lobes: smooth and rough varnish, brushed metal, a leaf with a lamp behind it, a frosted pane, frosted glass.
pub fn every_lobe(rig: &mut Rig) {
    let floor = Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    let varnish = StandardMaterial {
        clearcoat: 1.0,
        clearcoat_perceptual_roughness: 0.4,
        ..shiny(Color::linear_rgb(0.6, 0.4, 0.3), 0.8, 0.0)
    };
    rig.spawn(square(4.0), varnish, floor);
    rig.spawn(square(4.0), lambert(0.6), Transform::from_xyz(0.0, 0.0, -1.2));
    let ball = || Sphere::new(0.4).mesh().uv(16, 10);
    let brushed = StandardMaterial {
        anisotropy_strength: 0.8,
        anisotropy_rotation: 0.4,
        ..shiny(Color::linear_rgb(0.9, 0.8, 0.6), 0.45, 1.0)
    };
    rig.spawn(ball(), brushed, Transform::from_xyz(-0.9, -0.8, 0.2));
    let lacquer = StandardMaterial {
        clearcoat: 0.7,
        clearcoat_perceptual_roughness: 0.0,
        ..shiny(Color::linear_rgb(0.2, 0.3, 0.7), 0.6, 0.5)
    };
    rig.spawn(ball(), lacquer, Transform::from_xyz(0.0, -0.8, 0.6));
    let frosted = StandardMaterial {
        specular_transmission: 1.0,
        thickness: 0.8,
        attenuation_color: Color::linear_rgb(0.5, 0.9, 0.7),
        attenuation_distance: 0.5,
        ..shiny(Color::WHITE, 0.5, 0.0)
    };
    rig.spawn(ball(), frosted, Transform::from_xyz(0.9, -0.8, 0.2));
    let sheet = |color, material: StandardMaterial| StandardMaterial {
        base_color: color,
        double_sided: true,
        cull_mode: None,
        ..material
    };
    let leaf = StandardMaterial { diffuse_transmission: 0.6, ..lambert(0.0) };
    let leaf = sheet(Color::linear_rgb(0.4, 0.8, 0.2), leaf);
    rig.spawn(square(0.9), leaf, facing(Vec3::new(-0.6, 0.7, 0.1), Vec3::new(-0.9, -0.5, 1.0)));
    let pane = StandardMaterial { specular_transmission: 0.8, ..shiny(Color::WHITE, 0.5, 0.0) };
    let pane = sheet(Color::linear_rgb(0.8, 0.9, 1.0), pane);
    rig.spawn(square(1.0), pane, Transform::from_xyz(0.8, 0.4, -0.2).with_rotation(Quat::from_rotation_y(-0.4)));
    rig.spawn(square(0.8), lamp(8.0, 7.0, 6.0), facing(Vec3::new(-0.3, 1.5, -0.5), Vec3::new(0.1, -0.8, 0.4)));
    rig.spawn(square(0.5), lamp(4.0, 5.0, 6.0), facing(Vec3::new(1.4, 1.0, 1.2), Vec3::ZERO));
}

/// Shadows of blended panes, and an emitter that is itself partly transparent, beside a glossy wall.
pub fn blended(rig: &mut Rig) {
    glossy(rig);
    let pane = |alpha| StandardMaterial {
        base_color: Color::linear_rgba(0.2, 0.2, 0.2, alpha),
        alpha_mode: AlphaMode::Blend,
        double_sided: true,
        cull_mode: None,
        ..lambert(0.0)
    };
    rig.spawn(square(1.4), pane(0.5), facing(Vec3::new(0.4, 0.5, 0.4), Vec3::ZERO));
    let lamp = StandardMaterial {
        emissive: LinearRgba::rgb(2.0, 1.5, 1.0),
        base_color: Color::linear_rgba(0.0, 0.0, 0.0, 0.4),
        ..pane(0.4)
    };
    rig.spawn(square(0.8), lamp, Transform::from_xyz(-0.5, -0.5, -0.4).with_rotation(Quat::from_rotation_y(0.6)));
}

/// The number of steps of a motion before the frame that is compared.
pub const STEPS: u32 = 3;

/// A room in which an occluder, an emitter, a light and the camera move: [`pose_moving`].
pub fn moving(rig: &mut Rig) {
    let block = room(rig);
    rig.insert(block, Name::new("occluder"));
    let emitter = rig.spawn(Cuboid::new(0.3, 0.3, 0.3), lamp(4.0, 8.0, 8.0), Transform::default());
    rig.insert(emitter, Name::new("emitter"));
    rig.spawn_bundle((Name::new("light"), PointLight { intensity: 30.0, ..default() }, Transform::default()));
}

/// Poses the room at a step, 0 to [`STEPS`].
pub fn pose_moving(rig: &mut Rig, step: u32) {
    pose_moving_at(rig, step as f32);
}

/// Poses the room between steps.
pub fn pose_moving_at(rig: &mut Rig, step: f32) {
    let mut place = |name: &str, place: Transform| {
        let entity = rig.named(name);
        *rig.get_mut::<Transform>(entity) = place;
    };
    place("occluder", Transform::from_xyz(0.9 - 0.3 * step, 0.1, 0.0).with_rotation(Quat::from_rotation_z(0.3)));
    let turn = Quat::from_rotation_y(0.3 * step);
    place("emitter", Transform::from_xyz(-0.9 + 0.3 * step, 0.4, 0.5).with_rotation(turn));
    place("light", Transform::from_xyz(0.9 - 0.3 * step, 0.6, 0.8));
    let eye = Vec3::new(0.9 - 0.2 * step, 0.2 + 0.1 * step, 4.0 - 0.1 * step);
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_translation(eye).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
}

/// A room with an emitter whose index in the light table changes in the last frames, because lights come and go: [`pose_passing`].
pub fn passing(rig: &mut Rig) {
    room(rig);
    for (name, x) in [("late", 1.0), ("early", -1.0), ("steady", 0.0)] {
        let light = PointLight { intensity: 30.0, ..default() };
        rig.spawn_bundle((Name::new(name), light, Transform::from_xyz(x, 0.2, 1.2)));
    }
}

/// Shows the lights of a step, 0 to [`STEPS`].
pub fn pose_passing(rig: &mut Rig, step: u32) {
    for (name, there) in [("late", step >= STEPS), ("early", step < STEPS - 1)] {
        let entity = rig.named(name);
        *rig.get_mut::<Visibility>(entity) = if there { Visibility::Inherited } else { Visibility::Hidden };
    }
}

/// A room with an emitter whose probability in the light table changes twentyfold between frames, because a light behind a wall flickers:
/// [`pose_flickering`].
pub fn flickering(rig: &mut Rig) {
    room(rig);
    rig.spawn_bundle((Name::new("flickering"), PointLight::default(), Transform::from_xyz(0.0, 0.0, -20.0)));
}

/// Sets the light of a step, 0 to [`STEPS`].
pub fn pose_flickering(rig: &mut Rig, step: u32) {
    let entity = rig.named("flickering");
    rig.get_mut::<PointLight>(entity).intensity = if step % 2 == STEPS % 2 { 1.0 } else { 200.0 };
}

/// A camera that looks at a scene.
pub fn scene(size: u32, make: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = Rig::new(size, size)?;
    make(&mut rig);
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3, 0.2, 4.0).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
    Some(rig)
}

/// A camera that looks at [`room`].
pub fn room_scene(size: u32) -> Option<Rig> {
    scene(size, |rig| {
        room(rig);
    })
}

/// Scenes that several tests compare with one reference, by name.
const SHARED: [(&str, fn(&mut Rig)); 7] = [
    ("room", |rig| {
        room(rig);
    }),
    ("glossy", glossy),
    ("mirrors", mirrors),
    ("punctual", punctual),
    ("surrounded by an image", |rig| surrounded(rig, true)),
    ("moving", moving),
    ("passing", passing),
];

/// A scene of [`SHARED`].  Tests in one process render its references once, so a test must not change the scene, except by the pose that
/// belongs to it.
pub fn shared(size: u32, name: &'static str) -> Option<Rig> {
    let (_, make) = SHARED.iter().find(|(shared, _)| *shared == name).expect("the scene is in the table");
    let mut rig = scene(size, make)?;
    rig.shared = Some(name.into());
    Some(rig)
}
