//! A diffuse plane under Bevy's lights has the brightness that Bevy's own renderer gives it: units, cones and colors of
//! lights are read as Bevy means them.

use crate::support::app::*;
use bevy::{
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    light::RectLight,
    math::DVec3,
    prelude::*,
};
use core::f64::consts::PI;

const SIZE: u32 = 24;
/// Pictures under each light, and the samples of each.
const SEEDS: u32 = 8;
const FRAMES: u32 = 16;

type Light = fn(&mut Rig) -> Entity;

/// Lights near the axis of the plane: there the diffuse term of Bevy, Burley's, equals Lambert's.  Rectangles are compared with a closed
/// form, because Bevy draws them only with its feature `area_light_luts`, for which most of its renderer would be compiled anew.
const LIGHTS: [(&str, Light); 6] = [
    ("point", |rig| {
        let light = PointLight { intensity: 240.0, range: 1e4, color: Color::linear_rgb(1.0, 0.7, 0.4), ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(0.4, 0.2, 4.0)))
    }),
    ("sphere", |rig| {
        let light = PointLight { intensity: 500.0, range: 1e4, radius: 0.3, ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(-0.3, 0.4, 6.0)))
    }),
    ("spot", |rig| {
        let light = SpotLight { intensity: 240.0, range: 1e4, inner_angle: 0.05, outer_angle: 0.3, ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(0.3, 0.0, 4.0).looking_at(Vec3::new(0.1, 0.1, 0.0), Vec3::Y)))
    }),
    ("wide spot", |rig| {
        let light = SpotLight { intensity: 240.0, range: 1e4, inner_angle: 1.2, outer_angle: 1.5, ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(0.3, 0.0, 4.0).looking_at(Vec3::new(0.1, 0.1, 0.0), Vec3::Y)))
    }),
    // Bevy limits it to a hemisphere, whose edge crosses the picture.
    ("spot beyond a hemisphere", |rig| {
        let light = SpotLight { intensity: 60.0, range: 1e4, inner_angle: 2.0, outer_angle: 2.5, ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(0.0, 0.0, 2.0).looking_to(Vec3::X, Vec3::Y)))
    }),
    ("directional", |rig| {
        let light = DirectionalLight { illuminance: 3.0, color: Color::linear_rgb(0.4, 1.0, 0.7), ..default() };
        rig.spawn_bundle((light, Transform::default().looking_to(Vec3::new(0.3, -0.2, -1.0), Vec3::Y)))
    }),
];

/// A white plane, and a camera that sees four square meters of it.
fn plane() -> Option<Rig> {
    let mut rig = Rig::new(SIZE, SIZE)?;
    rig.app.insert_resource(GlobalAmbientLight { brightness: 0.0, ..default() });
    rig.insert(rig.camera, (orthographic(2.0, 2.0), Tonemapping::None, DebandDither::Disabled, Msaa::Off));
    rig.spawn(square(20.0), lambert(1.0), Transform::default());
    let target = rig.target.clone();
    rig.edit(&target, |image| *image = float_target(UVec2::splat(SIZE)));
    Some(rig)
}

/// Mean of all channels.
fn mean(colors: &[Vec3]) -> f64 {
    colors.iter().map(|color| f64::from(color.element_sum()) / 3.0).sum::<f64>() / colors.len() as f64
}

/// Compares our pictures with the expected one.
fn check(rig: &mut Rig, name: &str, expected: &[Vec3]) {
    let pictures: Vec<Picture> = (0..SEEDS)
        .map(|seed| {
            rig.set(|restir| restir.seed = seed);
            rig.picture(FRAMES)
        })
        .collect();
    let (difference, error) = mean_and_error(pictures.iter().map(|picture| picture.mean() / mean(expected) - 1.0));
    // Each pixel has its own random numbers.
    let noise = error * f64::from(SIZE);
    let brightest = expected.iter().map(|color| color.max_element()).fold(0.0, f32::max);
    let off = |((_, ours), expected): ((UVec2, Vec3), &Vec3)| (ours - expected).abs().max_element() / brightest;
    let worst = f64::from(Picture::mean_of(pictures).iter().zip(expected).map(off).fold(0.0, f32::max));
    eprintln!(
        "{name}: mean off by {:+.3} % ± {:.3}, a pixel by {:.2} % of the brightest, which is {brightest:.2}",
        100.0 * difference,
        100.0 * error,
        100.0 * worst
    );
    assert!(brightest > 0.3, "{name}: {brightest}");
    assert!(error < 0.001, "{name}: the test has no power: standard error {error}");
    assert!(difference.abs() < 0.005 && worst < 0.01 + 5.0 * noise, "{name}: {difference}, {worst}");
    rig.assert_sound();
}

#[test]
fn a_diffuse_plane_is_as_bright_as_bevy_draws_it_under_its_lights() {
    let Some(mut rig) = plane() else { return };
    for (name, make) in LIGHTS {
        let light = make(&mut rig);
        let bevys = rig.without_restir(Rig::drawn_light);
        check(&mut rig, name, &bevys);
        rig.app.world_mut().despawn(light);
    }
}

/// The irradiance that a polygon of radiance 1 gives to a point with this normal, which all its corners are above (Lambert's formula).
fn irradiance_of_polygon(corners: &[DVec3], point: DVec3, normal: DVec3) -> f64 {
    let directions: Vec<DVec3> = corners.iter().map(|corner| (corner - point).normalize()).collect();
    let next = directions.iter().cycle().skip(1);
    let edges = directions.iter().zip(next).map(|(a, b)| a.angle_between(*b) * a.cross(*b).normalize().dot(normal));
    (0.5 * edges.sum::<f64>()).abs()
}

#[test]
fn a_diffuse_plane_has_the_irradiance_of_a_slanted_rectangle() {
    let Some(mut rig) = plane() else { return };
    let (width, height) = (1.6f32, 0.9);
    let color = Vec3::new(0.8, 0.9, 1.0);
    let light =
        RectLight { intensity: 80.0, width, height, color: Color::linear_rgb(color.x, color.y, color.z), ..default() };
    let place = Transform::from_xyz(0.8, 0.3, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
    rig.spawn_bundle((light, place));
    // As in Bevy: the luminous flux, divided by π and the area.
    let radiance = 80.0 / (PI * f64::from(width * height));
    let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        .map(|(x, y)| place.transform_point(Vec3::new(x * width, y * height, 0.0)).as_dvec3());
    let cell = 2.0 / f64::from(SIZE);
    let pixels = (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (f64::from(x) + 0.5, f64::from(y) + 0.5)));
    let expected: Vec<Vec3> = pixels
        .map(|(x, y)| {
            let point = DVec3::new(cell * x - 1.0, 1.0 - cell * y, 0.0);
            color * (radiance * irradiance_of_polygon(&corners, point, DVec3::Z) / PI) as f32
        })
        .collect();
    check(&mut rig, "rectangle", &expected);
}
