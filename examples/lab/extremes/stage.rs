//! Scenes at extremes: a room, a closed room whose walls glow, and a plane under a sun.

use bevy::prelude::*;

use crate::things::{Shape, Thing};

/// Something that grows or shrinks until precision ends.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Distance of a room from the origin.
    Distance,
    /// Scale of the room.
    Scale,
    /// Radiance of its lamp.
    Radiance,
    /// Roughness of a metal ball in it.
    Roughness,
    /// Scattering events of paths between glowing walls.
    Bounces,
    /// Height of a flat room with glowing walls.
    Gap,
    /// Elevation of a sun over a plane.
    Sun,
}

/// The light that is right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Truth {
    /// That of the same technique in the ordinary room, times this.
    Ordinary(f64),
    /// That of the reference tracer in the same scene.
    Reference,
    /// This mean radiance: with all bounces, and with one.
    Exact { paths: f64, direct: f64 },
}

/// A scene, its camera and its light.
pub struct Stage {
    pub things: Vec<Thing>,
    pub camera: (Transform, Projection),
    pub bounces: u32,
    pub truth: Truth,
}

/// Bounces where they are not the extreme.
const BOUNCES: u32 = 8;
/// Radiance of the lamp of the ordinary room.
const LAMP: f32 = 10.0;
/// Perceptual roughness of the metal of the ordinary room.
const ROUGHNESS: f32 = 0.3;
/// Radiance and albedo of glowing walls.
const GLOW: f32 = 0.25;
const ALBEDO: f32 = 0.8;
/// Illuminance of the sun on a surface that faces it, and the albedo of the plane.
const SUN: f32 = 10.0;
const PLANE: f32 = 0.5;
/// Direction in which the room moves away from the origin; its length is 1.
const AWAY: Vec3 = Vec3::new(0.6, 0.48, 0.64);
/// Center of the flat room: coordinates as large as the scene, so that they are rounded as those of other scenes are.
const CENTER: Vec3 = Vec3::new(0.3, 0.7, -0.2);

impl Axis {
    /// All axes.
    pub const ALL: [Self; 7] =
        [Self::Distance, Self::Scale, Self::Radiance, Self::Roughness, Self::Bounces, Self::Gap, Self::Sun];

    pub fn values(self) -> &'static [f64] {
        match self {
            Self::Distance => &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6],
            Self::Scale => &[1e-4, 1e-3, 1e-2, 0.1, 10.0, 100.0, 1e3, 1e4, 1e5],
            Self::Radiance => &[1e-10, 1e-8, 1e-6, 1e-3, 1e3, 1e6, 1e8, 1e10],
            Self::Roughness => &[1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 1e-3, 1e-4, 0.0],
            Self::Bounces => &[1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0],
            Self::Gap => &[0.1, 1e-2, 1e-3, 1e-4, 1e-5],
            Self::Sun => &[45.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1],
        }
    }

    /// The heading above its rows.
    pub fn section(self) -> &'static str {
        match self {
            Self::Distance => "Distance of a room of 4 m from the origin, relative to the room at the origin",
            Self::Scale => "Scale of the room, relative to a scale of 1",
            Self::Radiance => "Radiance of the lamp of the room, relative to 10 cd/m²",
            Self::Roughness => "Roughness of a metal ball in the room, relative to the reference tracer",
            Self::Bounces => "Bounces in a closed room with glowing walls, relative to the sum of the series",
            Self::Gap => "Height of such a room 1 m wide, 8 bounces, relative to the sum of the series",
            Self::Sun => "Elevation of a sun over a plane, relative to the closed form",
        }
    }

    /// The name of a row.
    pub fn label(self, value: f64) -> String {
        // Powers of ten beyond a thousand and a thousandth.
        let number = match value {
            v if v != 0.0 && !(1e-3..1e4).contains(&v) => format!("{v:e}"),
            v => v.to_string(),
        };
        match self {
            Self::Distance => format!("{number} m away"),
            Self::Scale => format!("scale {number}"),
            Self::Radiance => format!("{number} times the radiance"),
            Self::Roughness => format!("roughness {number}"),
            Self::Bounces if value == 1.0 => "1 bounce".into(),
            Self::Bounces => format!("{number} bounces"),
            Self::Gap => format!("room {number} m high"),
            Self::Sun => format!("sun at {number}°"),
        }
    }

    pub fn stage(self, value: f64) -> Stage {
        let number = value as f32;
        match self {
            Self::Distance => Stage { truth: Truth::Ordinary(1.0), ..room(number * AWAY, 1.0, LAMP, ROUGHNESS) },
            Self::Scale => Stage { truth: Truth::Ordinary(1.0), ..room(Vec3::ZERO, number, LAMP, ROUGHNESS) },
            Self::Radiance => {
                Stage { truth: Truth::Ordinary(value), ..room(Vec3::ZERO, 1.0, LAMP * number, ROUGHNESS) }
            }
            Self::Roughness => Stage { truth: Truth::Reference, ..room(Vec3::ZERO, 1.0, LAMP, number) },
            Self::Bounces => glowing(1.0, value as u32),
            Self::Gap => glowing(number, BOUNCES),
            Self::Sun => plane(value),
        }
    }
}

/// The room where nothing is extreme.
pub fn ordinary() -> Stage {
    Stage { truth: Truth::Ordinary(1.0), ..room(Vec3::ZERO, 1.0, LAMP, ROUGHNESS) }
}

fn object(shape: Shape, material: StandardMaterial, at: Transform) -> Thing {
    Thing::Object { shape, material: Box::new(material), subsurface: None, at }
}

fn matte(albedo: f32) -> StandardMaterial {
    let base_color = Color::linear_rgb(albedo, albedo, albedo);
    StandardMaterial { base_color, perceptual_roughness: 1.0, reflectance: 0.0, ..default() }
}

fn lamp(radiance: f32) -> StandardMaterial {
    StandardMaterial { emissive: LinearRgba::rgb(radiance, radiance, radiance), ..matte(0.0) }
}

fn glass() -> StandardMaterial {
    StandardMaterial { specular_transmission: 1.0, thickness: 1.0, perceptual_roughness: 0.0, ..Color::WHITE.into() }
}

/// A square whose side is 1 before `side` scales it, at a place, facing a direction.
fn facing(direction: Vec3, at: Vec3, side: f32) -> Transform {
    // A square faces +Z, and `looking_to` turns -Z.
    Transform::from_translation(at)
        .looking_to(-direction, direction.any_orthonormal_vector())
        .with_scale(Vec3::splat(side))
}

/// A sun without a disk that shines in a direction.
fn sun(illuminance: f32, direction: Vec3) -> Thing {
    let at = Transform::default().looking_to(direction, direction.any_orthonormal_vector());
    Thing::Sun(DirectionalLight { illuminance, ..default() }, None, at)
}

/// What a scene lacks and another one has, where it lights nothing: all scenes share their pipelines.  The sun shines from below a floor.
fn hidden_sun(radiance: f32) -> Thing {
    sun(1e-4 * radiance, Vec3::Y)
}

fn camera(eye: Transform, near: f32, fov: f32) -> (Transform, Projection) {
    (eye, Projection::Perspective(PerspectiveProjection { near, fov, ..default() }))
}

/// A room of 4 m with a lamp, a metal ball and a glass ball, open towards the camera.
fn room(offset: Vec3, scale: f32, radiance: f32, roughness: f32) -> Stage {
    let metal =
        StandardMaterial { metallic: 1.0, perceptual_roughness: roughness, ..Color::linear_rgb(0.9, 0.6, 0.3).into() };
    let ball = |at: Vec3, diameter: f32| Transform::from_translation(at).with_scale(Vec3::splat(diameter));
    let things = [
        (Shape::Square, matte(0.7), facing(Vec3::Z, Vec3::new(0.0, 0.0, -2.0), 4.0)),
        (Shape::Square, matte(0.5), facing(Vec3::Y, Vec3::new(0.0, -2.0, 0.0), 4.0)),
        (Shape::Square, matte(0.3), facing(Vec3::X, Vec3::new(-2.0, 0.0, 0.0), 4.0)),
        (Shape::Ball, metal, ball(Vec3::new(-0.8, -1.2, -0.5), 1.6)),
        (Shape::Ball, glass(), ball(Vec3::new(0.9, -1.4, 0.4), 1.0)),
        (Shape::Square, lamp(radiance), facing(Vec3::NEG_Y, Vec3::new(0.4, 1.9, 0.2), 1.2)),
    ];
    let placed =
        |at: Transform| Transform { translation: at.translation * scale + offset, scale: at.scale * scale, ..at };
    let things = things.map(|(shape, material, at)| object(shape, material, placed(at)));
    Stage {
        things: things.into_iter().chain([hidden_sun(radiance)]).collect(),
        camera: camera(placed(Transform::from_xyz(0.0, 0.0, 5.0)).with_scale(Vec3::ONE), 0.1 * scale, 0.8),
        bounces: BOUNCES,
        truth: Truth::Ordinary(1.0),
    }
}

/// A closed room, one meter wide, whose walls glow and reflect: the light is the sum of a geometric series, however flat the room is.
fn glowing(height: f32, bounces: u32) -> Stage {
    let wall = StandardMaterial { emissive: LinearRgba::rgb(GLOW, GLOW, GLOW), ..matte(ALBEDO) };
    let sides = [
        (Vec3::X, 0.5),
        (Vec3::NEG_X, 0.5),
        (Vec3::Z, 0.5),
        (Vec3::NEG_Z, 0.5),
        (Vec3::Y, 0.5 * height),
        (Vec3::NEG_Y, 0.5 * height),
    ];
    // The walls reach beyond each other, so that rounding leaves no slit.
    let wall = |(inward, distance): (Vec3, f32)| {
        object(Shape::Square, wall.clone(), facing(inward, CENTER - distance * inward, 2.0))
    };
    let outside = Transform::from_translation(CENTER + Vec3::splat(5.0));
    let hidden = [object(Shape::Ball, glass(), outside), hidden_sun(GLOW)];
    let things = sides.map(wall).into_iter().chain(hidden).collect();
    let sum = |bounces: u32| -> f64 { (0..=bounces).map(|k| f64::from(GLOW) * f64::from(ALBEDO).powi(k as i32)).sum() };
    let eye = Transform::from_translation(CENTER).looking_to(Vec3::new(0.6, 0.0, -0.8), Vec3::Y);
    Stage {
        things,
        camera: camera(eye, 0.01 * height, 1.5),
        bounces,
        truth: Truth::Exact { paths: sum(bounces), direct: sum(bounces.min(1)) },
    }
}

/// A plane under a sun, seen from above: radiance = albedo / π · illuminance · sin(elevation).
fn plane(degrees: f64) -> Stage {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let from_sun = -Vec3::new(cos as f32, sin as f32, 0.0);
    let below = Vec3::new(0.0, -3.0, 0.0);
    let things = vec![
        object(Shape::Square, matte(PLANE), facing(Vec3::Y, Vec3::ZERO, 40.0)),
        sun(SUN, from_sun),
        // Below the plane, for the pipelines of the room.
        object(Shape::Square, lamp(0.1), facing(Vec3::NEG_Y, below, 0.1)),
        object(Shape::Ball, glass(), Transform::from_translation(3.0 * below)),
    ];
    let radiance = f64::from(PLANE) / core::f64::consts::PI * f64::from(SUN) * sin;
    let eye = Transform::from_xyz(0.0, 4.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
    Stage {
        things,
        camera: camera(eye, 0.1, 0.6),
        bounces: BOUNCES,
        truth: Truth::Exact { paths: radiance, direct: radiance },
    }
}
