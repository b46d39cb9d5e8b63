//! Translucent objects under two orbiting lamps: a head of skin with thin ears, a slab of marble that is lit from behind, and balls of
//! measured materials. Space stops the lamps and starts them again.
//!
//! `cargo run -p bevy_restir_apps --bin subsurface`

use bevy::{math::ops, prelude::*};
use bevy_restir::{EmissiveLuminance, prelude::*};
use bevy_restir_apps::{demo::Demo, panel::keys::PressedKeys};
use bevy_restir_support::{arguments, bodies, scene::spawn};
use clap::Parser;
use std::{f32::consts::TAU, path::PathBuf};

/// Translucent objects under two orbiting lamps.
#[derive(Parser, Clone, Debug)]
struct Args {
    /// The technique at the start.
    #[arg(long, default_value = "gi", value_parser = arguments::choice::<Technique>())]
    technique: Technique,
    /// Writes the mean of `--frames` frames to this PNG file, without a window. The lamps stay in their first places.
    #[arg(long, value_parser = arguments::png_file)]
    picture: Option<PathBuf>,
    /// Number of frames of the picture.
    #[arg(long, default_value_t = 64, requires = "picture")]
    frames: u32,
    /// Size of the window or the picture in pixels.
    #[arg(long, default_value = "640x360", value_parser = arguments::window_size)]
    size: UVec2,
    /// First place of the low lamp on its orbit, in turns; 0.5 is behind the head.
    #[arg(long, default_value_t = 0.6)]
    turn: f32,
}

/// The exposure of a dim room.
const EV100: f32 = 5.5;

fn main() -> AppExit {
    let args = Args::parse();
    let demo = Demo {
        size: args.size,
        eye: eye(),
        ev100: EV100,
        environment: surroundings(),
        settings: settings(&args),
        populate: |app: &mut App| populate(app, args.turn),
    };
    if let Some(path) = &args.picture {
        return demo.picture(path, args.frames, |_, _| {});
    }
    demo.window("subsurface scattering", "Space: pause").add_systems(Update, orbit).run()
}

fn settings(args: &Args) -> Restir {
    // A picture is the mean of its frames.
    Restir { technique: args.technique, accumulate: args.picture.is_some(), ..default() }
}

fn surroundings() -> RestirEnvironment {
    RestirEnvironment { color: LinearRgba::rgb(1.2, 1.4, 1.8), ..default() }
}

fn eye() -> Transform {
    Transform::from_xyz(0.0, 0.13, 0.42).looking_at(Vec3::new(0.0, 0.075, 0.0), Vec3::Y)
}

/// A lamp that orbits the head.
#[derive(Component)]
struct Lamp {
    /// Center of the orbit, m.
    center: Vec3,
    /// Radius of the orbit, m.
    radius: f32,
    /// Place on the orbit, in turns; 0 is in front of the head.
    turn: f32,
    /// Turns per second.
    speed: f32,
}

impl Lamp {
    fn place(&self) -> Transform {
        let (sin, cos) = ops::sin_cos(TAU * self.turn);
        Transform::from_translation(self.center + self.radius * Vec3::new(sin, 0.0, cos))
    }
}

fn populate(app: &mut App, turn: f32) {
    app.insert_resource(EmissiveLuminance(1000.0));
    let world = app.world_mut();
    let matte =
        |color| StandardMaterial { base_color: color, perceptual_roughness: 0.9, reflectance: 0.1, ..default() };
    let gray = matte(Color::linear_rgb(0.25, 0.25, 0.27));
    let lamp = |strength: f32| StandardMaterial {
        emissive: LinearRgba::rgb(strength, 0.9 * strength, 0.7 * strength),
        ..default()
    };
    let floor = Plane3d::default().mesh().size(2.0, 2.0);
    spawn(world, floor, gray.clone(), Transform::default());
    spawn(world, Cylinder::new(0.035, 0.03), gray.clone(), Transform::from_xyz(0.0, 0.015, -0.02));
    let body = |color: [f32; 3], roughness| StandardMaterial {
        base_color: Color::linear_rgb(color[0], color[1], color[2]),
        perceptual_roughness: roughness,
        ..default()
    };
    let head = spawn(world, bodies::head(), body([0.63, 0.44, 0.34], 0.45), Transform::from_xyz(0.0, 0.085, -0.02));
    world.entity_mut(head).insert(Subsurface::PALE_SKIN);
    // A thin slab with a lamp behind it.
    let slab = Cuboid::new(0.1, 0.09, 0.004);
    let place = Transform::from_xyz(0.15, 0.046, -0.02).with_rotation(Quat::from_rotation_y(-0.3));
    let slab = spawn(world, slab, body([0.83, 0.79, 0.75], 0.3), place);
    world.entity_mut(slab).insert(Subsurface::MARBLE);
    spawn(world, Sphere::new(0.008), lamp(30.0), Transform::from_xyz(0.16, 0.05, -0.06));
    // A softer slab that a bar shades: the edge of the shadow bleeds.
    let slab = spawn(
        world,
        Cuboid::new(0.1, 0.03, 0.08),
        body([0.77, 0.62, 0.21], 0.5),
        Transform::from_xyz(-0.15, 0.0151, -0.01).with_rotation(Quat::from_rotation_y(0.3)),
    );
    world.entity_mut(slab).insert(Subsurface::POTATO);
    spawn(world, Cuboid::new(0.012, 0.004, 0.14), gray, Transform::from_xyz(-0.15, 0.06, -0.01));
    let balls = [
        (Subsurface::SKIN, [0.44, 0.22, 0.13]),
        (Subsurface::WHOLE_MILK, [0.91, 0.88, 0.76]),
        (Subsurface::MARBLE, [0.83, 0.79, 0.75]),
        (Subsurface::SKIM_MILK, [0.81, 0.81, 0.69]),
        (Subsurface::APPLE, [0.85, 0.84, 0.53]),
        (Subsurface::KETCHUP, [0.16, 0.01, 0.003]),
    ];
    for (i, (material, color)) in balls.into_iter().enumerate() {
        let place = Transform::from_xyz(-0.125 + 0.05 * i as f32, 0.015, 0.11);
        let ball = spawn(world, Sphere::new(0.015).mesh().uv(64, 32), body(color, 0.3), place);
        world.entity_mut(ball).insert(material);
    }
    // At first the high lamp is in front of the head, to the left in the picture.
    let high = Lamp { center: Vec3::new(0.0, 0.4, 0.0), radius: 0.39, turn: 0.89, speed: -0.05 };
    let low = Lamp { center: Vec3::new(0.0, 0.12, -0.02), radius: 0.13, turn, speed: 0.1 };
    for (radius, strength, orbiting) in [(0.03, 12.0, high), (0.012, 40.0, low)] {
        let ball = spawn(world, Sphere::new(radius), lamp(strength), orbiting.place());
        world.entity_mut(ball).insert(orbiting);
    }
}

/// Moves the lamps, unless Space has stopped them.
fn orbit(
    time: Res<Time>,
    mut keys: PressedKeys,
    mut paused: Local<bool>,
    mut lamps: Query<(&mut Transform, &mut Lamp)>,
) {
    for (key, _) in keys.read() {
        *paused ^= key == KeyCode::Space;
    }
    if *paused {
        return;
    }
    for (mut transform, mut lamp) in &mut lamps {
        lamp.turn = (lamp.turn + lamp.speed * time.delta_secs()).fract();
        *transform = lamp.place();
    }
}
