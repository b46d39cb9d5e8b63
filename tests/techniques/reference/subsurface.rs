//! Subsurface scattering by the reference tracer: closed forms, surface integrals in f64, and planted errors.

use crate::support::{
    app::*,
    oracle::subsurface::{REACH, cdf, exact_cdf, length_of, mean_transmission, over_triangle, profile},
};
use bevy::{
    light::{RectLight, SunDisk},
    mesh::{Indices, VertexAttributeValues},
    prelude::*,
};
use bevy_restir::{RestirEnvironment, Subsurface, testing::plant_shader_defs};
use core::f64::consts::PI;
use glam::DVec3;

const ALBEDO: f64 = 0.8;

/// A component whose profile has these lengths for an albedo.
fn of_lengths(d: DVec3, albedo: f64) -> Subsurface {
    Subsurface { mean_free_path: (d / length_of(1.0, albedo)).as_vec3(), weight: 1.0 }
}

/// The camera looks down -Z at a window of this side, in meters.
fn window(side: f32, pixels: u32) -> Option<Rig> {
    let mut rig = Rig::new(pixels, pixels)?;
    rig.insert(rig.camera, orthographic(side, side));
    Some(rig)
}

fn ball(radius: f32) -> Mesh {
    Sphere::new(radius).mesh().ico(40).expect("few enough triangles")
}

/// The mean of the picture and its standard error, by channel.
fn means(rig: &mut Rig, frames: u32) -> [(f64, f64); 3] {
    let picture = rig.picture(frames);
    rig.assert_sound();
    [0, 1, 2].map(|c| mean_and_error(picture.iter().map(|(_, color)| f64::from(color[c]))))
}

/// The same from independent restarts, for pictures whose pixels differ by more than their noise.
fn means_of_restarts(rig: &mut Rig, frames: u32) -> [(f64, f64); 3] {
    let pictures: Vec<Picture> = (0..8)
        .map(|seed| {
            rig.set(|r| r.seed = seed);
            rig.picture(frames)
        })
        .collect();
    rig.assert_sound();
    [0, 1, 2].map(|c| {
        mean_and_error(pictures.iter().map(|picture| {
            let (sum, count) = picture.iter().fold((0.0, 0), |(sum, n), (_, color)| (sum + f64::from(color[c]), n + 1));
            sum / f64::from(count)
        }))
    })
}

/// Asserts that all channels agree with the expectation, within 0.2 % and noise, which must be below 0.2 %.
fn check(rig: &mut Rig, frames: u32, name: &str, expected: DVec3) {
    check_within(0.002, rig, frames, name, expected);
}

fn check_within(limit: f64, rig: &mut Rig, frames: u32, name: &str, expected: DVec3) {
    check_means(limit, means(rig, frames), name, expected);
}

fn check_means(limit: f64, means: [(f64, f64); 3], name: &str, expected: DVec3) {
    for (c, (mean, error)) in means.into_iter().enumerate() {
        let off = mean / expected[c] - 1.0;
        println!("{name}, channel {c}: {mean:.5} +- {error:.5} for {:.5}: {off:+.5}", expected[c]);
        assert!(error < limit * expected[c], "{name}: the test has no power: {error}");
        assert!(off.abs() < limit + 3.0 * error / expected[c], "{name}, channel {c}: {off:+.5}");
    }
}

/// A plane that fills the window, and a sun at normal incidence: its irradiance is uniform, too.
fn plane_under_a_sun(illuminance: f32) -> Option<(Rig, Entity)> {
    let mut rig = window(0.5, 64)?;
    let plane = rig.spawn(square(40.0), lambert(ALBEDO as f32), Transform::default());
    rig.insert(plane, of_lengths(DVec3::new(0.05, 0.02, 0.004), ALBEDO));
    let sun = DirectionalLight { illuminance, ..default() };
    let sun = rig.spawn_bundle((sun, Transform::default()));
    Some((rig, sun))
}

#[test]
fn an_infinite_plane_under_uniform_light_is_as_bright_as_a_diffuse_one() {
    let Some((mut rig, _)) = plane_under_a_sun(3.0) else { return };
    rig.insert(rig.camera, sky(2.0));
    // Out of sight.  Where light enters the plane, no lobe is anisotropic.
    let brushed = StandardMaterial { anisotropy_strength: 0.5, ..lambert(ALBEDO as f32) };
    rig.spawn(square(1.0), brushed, Transform::from_xyz(0.0, 0.0, -10.0));
    check(&mut rig, 384, "sky and sun", DVec3::splat((2.0 + 3.0 / PI) * ALBEDO));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_an_infinite_plane_is_as_bright_as_a_diffuse_one_under_each_uniform_light() {
    let Some((mut rig, sun)) = plane_under_a_sun(0.0) else { return };
    rig.insert(rig.camera, sky(2.0));
    check(&mut rig, 512, "sky", DVec3::splat(2.0 * ALBEDO));
    rig.insert(rig.camera, sky(0.0));
    rig.get_mut::<DirectionalLight>(sun).illuminance = 3.0;
    check(&mut rig, 512, "sun", DVec3::splat(3.0 * ALBEDO / PI));
    rig.insert(sun, SunDisk { angular_size: 0.05, intensity: 1.0 });
    check(&mut rig, 512, "sun with a disk", DVec3::splat(3.0 * ALBEDO / PI));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_from_below_lacks_the_share_that_the_interface_reflects() {
    let Some(mut rig) = window(0.1, 64) else { return };
    rig.insert(rig.camera, sky(1.0));
    let tilt = Transform::from_rotation(Quat::from_rotation_y(60f32.to_radians()));
    let glossy = |albedo: f32| StandardMaterial { reflectance: 0.5, ..lambert(albedo) };
    let plane = rig.spawn(square(40.0), glossy(ALBEDO as f32), tilt);
    rig.insert(plane, of_lengths(DVec3::splat(0.02), ALBEDO));
    let both = means(&mut rig, 512)[1];
    let black = rig.add::<StandardMaterial>(glossy(0.0));
    rig.insert(plane, MeshMaterial3d(black));
    let reflected = means(&mut rig, 128)[1];
    let below = both.0 - reflected.0;
    let error = both.1.hypot(reflected.1);
    let expected = ALBEDO * (1.0 - (0.04 + 0.96 * 0.5f64.powi(5)));
    println!("{below:.5} +- {error:.5} for {expected:.5}; mean transmission {:.5}", mean_transmission(0.04));
    assert!(
        error < 2e-3 && (below - expected).abs() < 0.002 * expected + 3.0 * error,
        "{below} +- {error}, not {expected}"
    );
}

/// A plane moves light and loses none, except beyond the end of the profile: its mean is that of a diffuse plane.  Lights that the camera
/// would see are beside the picture.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_plane_is_as_bright_as_a_diffuse_one_under_lights_of_every_shape() {
    let Some(mut rig) = window(4.0, 48) else { return };
    let plane = rig.spawn(square(40.0), lambert(ALBEDO as f32), Transform::default());
    // Out of sight, so that both pictures have the same shaders.
    let other = rig.spawn(square(1.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -10.0));
    let lengths = DVec3::new(0.03, 0.02, 0.015);
    rig.insert(other, of_lengths(lengths, ALBEDO));
    let towards = |x: f32, y: f32, z: f32| Transform::from_xyz(x, y, z).looking_at(Vec3::new(0.2, -0.1, 0.0), Vec3::Y);
    let sphere = PointLight { intensity: 300.0, radius: 0.4, ..default() };
    let rectangle = RectLight { intensity: 300.0, width: 0.8, height: 0.5, ..default() };
    let spot = SpotLight { intensity: 300.0, outer_angle: 0.4, inner_angle: 0.2, ..default() };
    let lights = [
        ("sphere", rig.spawn_bundle((sphere, towards(3.0, 1.0, 1.5), Visibility::Hidden))),
        ("rectangle", rig.spawn_bundle((rectangle, towards(-2.8, -1.0, 1.2), Visibility::Hidden))),
        ("spot", rig.spawn_bundle((spot, towards(0.8, 0.5, 2.0), Visibility::Hidden))),
    ];
    let expected = lengths.to_array().map(|d| cdf(REACH * lengths.x / d));
    let compare = |rig: &mut Rig, name: &str| {
        rig.app.world_mut().entity_mut(plane).remove::<Subsurface>();
        let diffuse = means_of_restarts(rig, 48);
        rig.insert(plane, of_lengths(lengths, ALBEDO));
        let truth = DVec3::from_array([0, 1, 2].map(|c| expected[c] * diffuse[c].0));
        assert!(diffuse.iter().all(|(mean, error)| *mean > 0.01 && *error < 0.005 * mean), "{name}: {diffuse:?}");
        check_means(0.01, means_of_restarts(rig, 96), name, truth);
    };
    for (name, light) in lights {
        *rig.get_mut::<Visibility>(light) = Visibility::Inherited;
        compare(&mut rig, name);
        *rig.get_mut::<Visibility>(light) = Visibility::Hidden;
    }
    let map = texture(8, 4, |x, y| if (x, y) == (2, 1) { [255; 4] } else { [20 + 10 * x as u8, 40, 90, 255] });
    let image = Some(rig.add::<Image>(map));
    rig.insert(rig.camera, RestirEnvironment { image, rotation: Quat::from_rotation_y(0.7), ..sky(2.0) });
    compare(&mut rig, "image");
}

/// A plate of this thickness, turned by an angle, that a sun lights from behind: the camera sees the light that crosses it.
fn backlit(side: f32, pixels: u32, thickness: f32, angle: f32) -> Option<(Rig, Entity)> {
    let mut rig = window(side, pixels)?;
    let turn = Quat::from_rotation_y(angle);
    let mesh = Cuboid::new(10.0 * side, 10.0 * side, thickness);
    let plate = rig.spawn(mesh, lambert(ALBEDO as f32), Transform::from_rotation(turn));
    let back = Transform::from_rotation(turn * Quat::from_rotation_y(core::f32::consts::PI));
    rig.spawn_bundle((DirectionalLight { illuminance: ILLUMINANCE, ..default() }, back));
    Some((rig, plate))
}

const ILLUMINANCE: f32 = 3.0;

/// The light that crosses a plate of a thickness of h lengths d, for a black interface, if light scatters over `reach` lengths.
fn crossing(h: f64, reach: f64) -> f64 {
    ALBEDO * f64::from(ILLUMINANCE) / PI * (exact_cdf(reach) - exact_cdf(h))
}

/// From one hundredth of a pixel on, the share of light that scatters below the surface grows with the length, up to two hundredths: a body
/// that moves away from the camera does not change at once.
#[test]
fn short_lengths_turn_diffuse_without_a_jump() {
    let (pixel, thickness) = (2.0, 0.004);
    let Some((mut rig, plate)) = backlit(32.0 * pixel, 32, thickness, 0.0) else { return };
    let smallest = 0.01 * f64::from(pixel);
    for step in 0..7 {
        let d = DVec3::new(1.0, 1.25, 1.6) * (0.6 + 0.25 * f64::from(step)) * smallest;
        rig.insert(plate, of_lengths(d, ALBEDO));
        for (c, (mean, error)) in means(&mut rig, 64).into_iter().enumerate() {
            let share = (d[c] / smallest - 1.0).clamp(0.0, 1.0);
            let expected = share * crossing(f64::from(thickness) / d[c], REACH * d.z / d[c]);
            println!("{:.3} pixels: {mean:.4} +- {error:.4} for {expected:.4}", d[c] / f64::from(pixel));
            assert!(error < 0.015, "the test has no power: {error}");
            assert!((mean - expected).abs() < 0.005 + 4.0 * error, "{} m: {mean} +- {error}, not {expected}", d[c]);
        }
    }
}

/// Light that leaves a body crosses all layers of its material: the interface, the coat, and what metal and transmission leave of the
/// diffuse base.
#[test]
#[ignore = "second tier: ./run test --more"]
fn light_that_leaves_a_body_has_the_factors_of_all_layers() {
    let d = 0.02;
    let angle = 65f64.to_radians();
    let Some((mut rig, plate)) = backlit(0.2, 48, 0.1 * d as f32, angle as f32) else { return };
    let fresnel = |f0: f64| f0 + (1.0 - f0) * (1.0 - angle.cos()).powi(5);
    // Light enters at normal incidence.
    let interface = (1.0 - fresnel(0.04)) * (1.0 - 0.04) / mean_transmission(0.04);
    let base = || lambert(ALBEDO as f32);
    let rows = [
        ("diffuse", 1.0, 1.0, base()),
        ("weight", 0.6, 0.6, base()),
        ("interface", 1.0, interface, StandardMaterial { reflectance: 0.5, ..base() }),
        ("metal", 1.0, 0.5, StandardMaterial { metallic: 0.5, ..base() }),
        ("diffuse transmission", 1.0, 0.7, StandardMaterial { diffuse_transmission: 0.3, ..base() }),
        (
            "specular transmission",
            1.0,
            0.6,
            StandardMaterial { specular_transmission: 0.4, thickness: 0.01, ior: 1.0, ..base() },
        ),
        ("coat", 1.0, 1.0 - 0.8 * fresnel(0.04), StandardMaterial { clearcoat: 0.8, ..base() }),
    ];
    for (name, weight, factor, material) in rows {
        let material = rig.add::<StandardMaterial>(material);
        rig.insert(plate, (MeshMaterial3d(material), Subsurface { weight, ..of_lengths(DVec3::splat(d), ALBEDO) }));
        let expected = factor * crossing(0.1, REACH);
        check_within(0.008, &mut rig, 384, name, DVec3::splat(expected));
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_ball_under_uniform_light_has_its_closed_form() {
    let Some(mut rig) = window(0.2, 64) else { return };
    rig.insert(rig.camera, sky(1.0));
    // A disk of chord r around a point of a sphere has the area πr².
    let lengths = DVec3::new(0.8, 0.3, 0.05);
    let expected = |radius: f64| {
        DVec3::from_array(lengths.to_array().map(|d| ALBEDO * cdf((2.0 * radius / d).min(REACH * lengths.x / d))))
    };
    let unit = rig.spawn(ball(1.0), lambert(ALBEDO as f32), Transform::default());
    rig.insert(unit, of_lengths(lengths, ALBEDO));
    check(&mut rig, 320, "ball", expected(1.0));
    // Lengths are those of the world, whatever scales and mirrors the mesh.
    let half = rig.add::<Mesh>(ball(0.5));
    rig.insert(unit, (Mesh3d(half), Transform::from_scale(Vec3::new(-2.0, 2.0, 2.0))));
    check(&mut rig, 320, "scaled and mirrored", expected(1.0));
    rig.insert(unit, Transform::from_scale(Vec3::splat(0.8)));
    check(&mut rig, 320, "smaller", expected(0.4));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_slab_gains_the_light_that_crosses_it() {
    let Some(mut rig) = window(0.1, 64) else { return };
    rig.insert(rig.camera, sky(1.0));
    let d = 0.05;
    for (h, frames) in [(0.3, 256), (1.0, 256), (5.0, 256)] {
        let slab = Cuboid::new(10.0, 10.0, (h * d) as f32);
        let slab = rig.spawn(slab, lambert(ALBEDO as f32), Transform::default());
        rig.insert(slab, of_lengths(DVec3::splat(d), ALBEDO));
        let expected = ALBEDO * (cdf(REACH) + exact_cdf(REACH) - exact_cdf(h));
        check(&mut rig, frames, &format!("slab of {h} d"), DVec3::splat(expected));
        rig.app.world_mut().despawn(slab);
    }
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_closed_furnace_with_translucent_walls_has_its_closed_form() {
    let Some(mut rig) = Rig::new(48, 48) else { return };
    rig.set(|restir| restir.bounces = 48);
    // A ball from inside, without normals, so that its faces are flat.
    let mut inside = ball(2.0).with_inverted_winding().expect("a triangle list");
    inside.remove_attribute(Mesh::ATTRIBUTE_NORMAL);
    let walls = StandardMaterial { emissive: LinearRgba::rgb(0.5, 0.5, 0.5), ..lambert(0.6) };
    let walls = rig.spawn(inside, walls, Transform::from_xyz(0.0, 0.0, 5.0));
    // A channel with a much shorter length would be noisier.
    let lengths = DVec3::new(1.0, 0.75, 0.6);
    rig.insert(walls, of_lengths(lengths, 0.6));
    let gain = DVec3::from_array(lengths.to_array().map(|d| 0.6 * cdf((4.0 / d).min(REACH * lengths.x / d))));
    check(&mut rig, 1200, "furnace", 0.5 / (DVec3::ONE - gain));
}

/// Triangles of a mesh in world space, with their geometric normals.
fn triangles(mesh: &Mesh, place: &Transform) -> Vec<([DVec3; 3], DVec3)> {
    let Some(VertexAttributeValues::Float32x3(positions)) = mesh.attribute(Mesh::ATTRIBUTE_POSITION) else {
        panic!("a mesh has positions")
    };
    let Some(Indices::U32(indices)) = mesh.indices() else { panic!("a mesh has indices") };
    let world = |i: &u32| place.transform_point(positions[*i as usize].into()).as_dvec3();
    let of = |i: &[u32]| {
        let corners = [world(&i[0]), world(&i[1]), world(&i[2])];
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        (corners, normal)
    };
    indices.chunks_exact(3).map(of).collect()
}

/// A translucent convex body by its triangles in world space.
struct Body {
    triangles: Vec<([DVec3; 3], DVec3)>,
    albedo: f64,
    /// Lengths of the profile, by channel.
    lengths: DVec3,
}

impl Body {
    fn new(mesh: &Mesh, place: &Transform, albedo: f64, lengths: DVec3) -> Self {
        Self { triangles: triangles(mesh, place), albedo, lengths }
    }

    /// The point that a camera on the axis of z sees.
    fn seen(&self) -> DVec3 {
        let depth = self.triangles.iter().filter_map(|([a, b, c], n)| {
            // The point of the triangle's plane on the axis.
            let z = n.dot(*a) / n.z;
            let p = DVec3::new(0.0, 0.0, z);
            let inside = |a: DVec3, b: DVec3| (b - a).cross(p - a).dot(*n) >= 0.0;
            (n.z > 0.0 && inside(*a, *b) && inside(*b, *c) && inside(*c, *a)).then_some(z)
        });
        DVec3::new(0.0, 0.0, depth.fold(f64::MIN, f64::max))
    }

    /// The light that leaves the body at `exit`, by channel: an integral of the irradiance at a point with a normal over the surface.  Each
    /// triangle is divided at least `least_depth` times.
    fn light_at(&self, exit: DVec3, least_depth: u32, irradiance: &dyn Fn(DVec3, DVec3) -> f64) -> DVec3 {
        let reach = REACH * self.lengths.x;
        DVec3::from_array(self.lengths.to_array().map(|d| {
            let entering = |p: DVec3, n: DVec3| {
                let r = (p - exit).length();
                if r > reach { 0.0 } else { profile(r / d) / (d * d) * irradiance(p, n) }
            };
            let integral = |(corners, n): &([DVec3; 3], DVec3)| {
                over_triangle(&|p| entering(p, *n), *corners, 1e-9, 12 + least_depth)
            };
            self.triangles.iter().map(integral).sum::<f64>() * self.albedo / PI
        }))
    }
}

/// The irradiance by a point light, in cd.
fn irradiance_by(light: DVec3, intensity: f64, p: DVec3, n: DVec3) -> f64 {
    let to = light - p;
    intensity * n.dot(to).max(0.0) / to.length().powi(3)
}

/// A material with a base color texture of one texel, and its albedo.  All lengths belong to the point where light leaves.
fn textured(rig: &mut Rig) -> (StandardMaterial, f64) {
    let image = rig.add::<Image>(texture(1, 1, |_, _| [188, 188, 188, 255]));
    let albedo = f64::from(Color::srgb_u8(188, 188, 188).to_linear().red);
    (StandardMaterial { base_color_texture: Some(image), ..lambert(1.0) }, albedo)
}

/// A box that is scaled, turned and textured, seen through a small window: light enters it by a surface integral.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_turned_scaled_and_textured_box_agrees_with_a_surface_integral() {
    let Some(mut rig) = window(0.02, 32) else { return };
    let place =
        Transform::from_rotation(Quat::from_euler(EulerRot::XYZ, 0.5, 0.7, 0.2)).with_scale(Vec3::new(0.8, 0.5, 1.1));
    let mesh = Mesh::from(Cuboid::from_length(1.0));
    let (material, albedo) = textured(&mut rig);
    let body = Body::new(&mesh, &place, albedo, DVec3::new(0.4, 0.15, 0.05));
    let entity = rig.spawn(mesh, material, place);
    rig.insert(entity, of_lengths(body.lengths, albedo));
    let (light, power) = (Vec3::new(1.5, 1.0, 2.0), 100.0);
    rig.spawn_bundle((PointLight { intensity: power, ..default() }, Transform::from_translation(light)));
    let intensity = f64::from(power) / (4.0 * PI);
    let expected = body.light_at(body.seen(), 2, &|p, n| irradiance_by(light.as_dvec3(), intensity, p, n));
    check(&mut rig, 2000, "box", expected);
}

/// Light that bounces off a wall enters an ellipsoid, too: a surface integral whose irradiance is an integral over the wall.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_turned_ellipsoid_beside_a_wall_agrees_with_a_surface_integral_of_two_bounces() {
    const WALL_ALBEDO: f64 = 0.9;
    /// Side of the wall, in meters.
    const SIDE: f64 = 1.2;
    /// Parts of a side of the wall for its integral.
    const PARTS: u32 = 24;
    let Some(mut rig) = window(0.02, 32) else { return };
    rig.set(|restir| restir.bounces = 2);
    let place =
        Transform::from_rotation(Quat::from_euler(EulerRot::XYZ, 0.5, 0.7, 0.2)).with_scale(Vec3::new(0.6, 0.35, 0.5));
    // Without normals faces are flat, as in the integral.
    let mut mesh = Sphere::new(1.0).mesh().ico(7).expect("few enough triangles");
    mesh.remove_attribute(Mesh::ATTRIBUTE_NORMAL);
    let (material, albedo) = textured(&mut rig);
    let body = Body::new(&mesh, &place, albedo, DVec3::new(0.4, 0.15, 0.1));
    let entity = rig.spawn(mesh, material, place);
    rig.insert(entity, of_lengths(body.lengths, albedo));
    // It faces the point that the camera sees, which the light hardly reaches.
    let wall = Transform::from_xyz(-0.9, 0.0, 1.0).with_rotation(Quat::from_rotation_y(2.4));
    rig.spawn(square(SIDE as f32), lambert(WALL_ALBEDO as f32), wall);
    let (light, power) = (Vec3::new(-0.2, 1.6, 0.0), 100.0);
    rig.spawn_bundle((PointLight { intensity: power, ..default() }, Transform::from_translation(light)));

    let (light, intensity) = (light.as_dvec3(), f64::from(power) / (4.0 * PI));
    let side = SIDE / f64::from(PARTS);
    let at = |i: u32| (f64::from(i) + 0.5) * side - 0.5 * SIDE;
    let facing = wall.rotation.mul_vec3(Vec3::Z).as_dvec3();
    // Points of the wall, with the light that each sends along its normal into a unit solid angle.
    let sources: Vec<(DVec3, f64)> = (0..PARTS * PARTS)
        .map(|i| {
            let q = wall.transform_point(Vec3::new(at(i % PARTS) as f32, at(i / PARTS) as f32, 0.0)).as_dvec3();
            (q, WALL_ALBEDO / PI * side * side * irradiance_by(light, intensity, q, facing))
        })
        .collect();
    for (q, _) in &sources {
        // The body lies in a ball of this radius.
        let nearest = (light - q) * (-q.dot(light - q) / (light - q).length_squared()).clamp(0.0, 1.0) + q;
        assert!(nearest.length() > 0.6, "the body's shadow falls on the wall at {q}");
    }
    let irradiance = |p: DVec3, n: DVec3| {
        let reflected = |(q, source): &(DVec3, f64)| {
            source * facing.dot(p - q).max(0.0) / (p - q).length() * irradiance_by(*q, 1.0, p, n)
        };
        irradiance_by(light, intensity, p, n) + sources.iter().map(reflected).sum::<f64>()
    };
    let exit = body.seen();
    let direct = body.light_at(exit, 0, &|p, n| irradiance_by(light, intensity, p, n));
    let expected = body.light_at(exit, 0, &irradiance);
    println!("the wall adds {:.3}", expected / direct - 1.0);
    assert!((expected / direct).min_element() > 1.1, "the wall adds too little light to be tested");
    check_within(0.004, &mut rig, 2400, "ellipsoid beside a wall", expected);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_planted_errors_are_found() {
    let Some(mut rig) = window(0.1, 64) else { return };
    rig.insert(rig.camera, sky(1.0));
    let entity = rig.spawn(ball(1.0), lambert(ALBEDO as f32), Transform::default());
    rig.insert(entity, of_lengths(DVec3::new(0.05, 0.01, 0.005), ALBEDO));
    let right = means(&mut rig, 256)[0];
    for (planted, least) in [("PLANT_NO_REACH", 0.01), ("PLANT_ONE_AXIS", 0.1)] {
        plant_shader_defs(&mut rig.app, &[planted]);
        let wrong = means(&mut rig, 256)[0];
        let lost = 1.0 - wrong.0 / right.0;
        println!("{planted}: {lost:+.4}, errors {:.5} and {:.5}", right.1, wrong.1);
        assert!(lost.abs() > least && lost.abs() > 6.0 * right.1.hypot(wrong.1), "{planted}: {lost}");
    }
}
