//! The lamps: small emissive bodies in three streams over the plaza, with point lights between them.

use bevy::{
    asset::RenderAssetUsages,
    camera::Exposure,
    mesh::{MeshBuilder, PrimitiveTopology},
    prelude::*,
};
use std::f32::consts::{PI, TAU};

use crate::Args;

/// Above this number several lamps share a mesh, a swarm.
const MOST_BODIES: u32 = 10_000;
/// Number of different swarm meshes.
const SWARMS: u32 = 16;
/// Number of hues per stream, and the range of hues of each stream in degrees.
const HUES: u32 = 8;
const STREAMS: [[f32; 2]; 3] = [[5.0, 48.0], [175.0, 225.0], [265.0, 335.0]];
/// Radius of each of 3000 lamps, m.
const RADIUS: f32 = 0.07;
/// Light of all lamps together, and of all point lights: radiance times exposure times projected area, m².
const LIGHT: f32 = 300.0;
const POINT_LIGHT: f32 = 600.0;

/// A closed path around the middle of the plaza.
#[derive(Component, Clone, Copy)]
pub struct Drift {
    phase: f32,
    /// Radians per second.
    speed: f32,
    radius: f32,
    height: f32,
    /// Amplitude of the deviation from a circle, outwards and upwards.
    stray: Vec2,
    /// Number of deviations per turn, outwards and upwards.
    waves: Vec2,
    spin: f32,
}

impl Drift {
    fn new(i: u32) -> Self {
        let random = |salt: u32| unit(i.wrapping_mul(8).wrapping_add(salt));
        let waves = Vec2::new((2.0 + 4.0 * random(0)).floor(), (2.0 + 6.0 * random(1)).floor());
        let (radius, height, stray) = match stream(i) {
            // Low above the floor.
            0 => (3.2 + 12.5 * random(2), 0.12 + 0.5 * random(3).powi(2), Vec2::new(0.6, 0.05)),
            // Around the ball in the middle.
            1 => (2.2 + 1.8 * random(2), 1.4 + 3.2 * random(3), Vec2::new(0.4, 0.5)),
            // Between the columns.
            _ => (11.0 + 1.6 * (random(2) - 0.5), 0.8 + 3.4 * random(3), Vec2::new(1.2, 0.5)),
        };
        let way = if i.is_multiple_of(3) { -1.0 } else { 1.0 };
        Self {
            phase: TAU * random(4),
            speed: way * (0.25 + 0.35 * random(5)) / radius.sqrt(),
            radius,
            height,
            stray,
            waves,
            spin: random(6),
        }
    }

    fn at(&self, seconds: f32) -> Transform {
        let angle = self.phase + self.speed * seconds;
        let radius = self.radius + self.stray.x * (angle * self.waves.x).sin();
        // Always above the floor.
        let height = (self.height + self.stray.y * (angle * self.waves.y + TAU * self.spin).sin()).max(0.1);
        let (sin, cos) = angle.sin_cos();
        Transform::from_xyz(radius * cos, height, radius * sin).with_rotation(Quat::from_euler(
            EulerRot::YXZ,
            seconds * self.spin,
            self.spin * TAU,
            0.0,
        ))
    }
}

/// The stream of a lamp.
fn stream(i: u32) -> u32 {
    match i % 20 {
        0..10 => 0,
        10..13 => 1,
        _ => 2,
    }
}

/// A color of a stream.
fn hue(stream: u32, i: u32) -> LinearRgba {
    let [from, to] = STREAMS[stream as usize];
    Color::hsl(from + (to - from) * i as f32 / (HUES - 1) as f32, 1.0, 0.58).into()
}

/// A pseudo-random number from 0 to 1, by a PCG hash.
fn unit(i: u32) -> f32 {
    let state = i.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    ((word >> 22) ^ word) as f32 / u32::MAX as f32
}

pub fn spawn(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    args: Res<Args>,
) {
    // Total light and total volume do not depend on the number of lamps.
    let count = args.lights.max(1) as f32;
    let radius = (RADIUS * (3000.0 / count).cbrt()).clamp(0.01, 0.3);
    let radiance = LIGHT / (count * PI * radius * radius);
    let lamps: Vec<_> = (0..3 * HUES)
        .map(|i| {
            let color = hue(i / HUES, i % HUES);
            materials.add(StandardMaterial { base_color: color.into(), emissive: color * radiance, ..default() })
        })
        .collect();

    let each = args.lights.div_ceil(MOST_BODIES).max(1);
    let shapes: Vec<Handle<Mesh>> = if each == 1 {
        let ball = Sphere::new(radius).mesh().ico(0).unwrap_or_else(|_| Sphere::new(radius).mesh().build());
        vec![meshes.add(ball), meshes.add(Cuboid::from_length(1.4 * radius))]
    } else {
        (0..SWARMS).map(|i| meshes.add(swarm(i, each, radius))).collect()
    };
    let rest = args.lights % each;
    for i in 0..args.lights / each {
        let material = &lamps[(stream(i) * HUES + (unit(i ^ 0x5bd1) * HUES as f32) as u32 % HUES) as usize];
        let drift = Drift::new(i);
        let shape = &shapes[(i as usize / 20) % shapes.len()];
        commands.spawn((Mesh3d(shape.clone()), MeshMaterial3d(material.clone()), drift.at(0.0), drift));
    }
    if rest > 0 {
        let drift = Drift::new(args.lights);
        let shape = meshes.add(swarm(SWARMS, rest, radius));
        commands.spawn((Mesh3d(shape), MeshMaterial3d(lamps[0].clone()), drift.at(0.0), drift));
    }

    // A point light of 1 cd has 4π lm, and the camera shows a radiance of 1/exposure as 1.
    let intensity = 4.0 * PI * POINT_LIGHT / args.points.max(1) as f32 / Exposure::default().exposure();
    for i in 0..args.points {
        let i = i.wrapping_add(0x9e37_79b9);
        let drift = Drift::new(i);
        let color = hue(stream(i), i % HUES).into();
        // A short range keeps Bevy's own light clusters cheap. Our lighting ignores it.
        commands.spawn((PointLight { color, intensity, range: 0.1, ..default() }, drift.at(0.0), drift));
    }
}

/// Tetrahedra scattered in a cube.
fn swarm(seed: u32, count: u32, radius: f32) -> Mesh {
    let corners =
        [Vec3::new(1.0, 1.0, 1.0), Vec3::new(1.0, -1.0, -1.0), Vec3::new(-1.0, 1.0, -1.0), Vec3::new(-1.0, -1.0, 1.0)];
    let reach = 1.5 * radius * 3.0 * (count as f32).cbrt();
    let mut points = Vec::new();
    for i in 0..count {
        let random = |salt: u32| 2.0 * unit((seed * 0x0100_0003) ^ i.wrapping_mul(3).wrapping_add(salt)) - 1.0;
        let middle = Vec3::new(random(0), random(1), random(2)) * reach;
        for face in [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]] {
            points.extend(face.map(|c: usize| (middle + radius * corners[c]).to_array()));
        }
    }
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::RENDER_WORLD)
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, points)
}

/// Moves all lamps along their paths.
pub fn drift(time: Res<Time>, mut bodies: Query<(&Drift, &mut Transform)>) {
    if time.delta_secs() > 0.0 {
        let seconds = time.elapsed_secs();
        bodies.par_iter_mut().for_each(|(drift, mut transform)| *transform = drift.at(seconds));
    }
}
