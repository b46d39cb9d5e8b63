//! Caustics in a room: a lamp in a glass shell, an egg of glass under a spot, and a glass of water and a pane of colored glass in the sun.
//! Next-event estimation finds none of this light, because glass is in the way. Space moves the spot.
//!
//! `cargo run -p bevy_restir_apps --bin caustics`

use bevy::{
    asset::RenderAssetUsages,
    math::ops,
    mesh::{PrimitiveTopology, VertexAttributeValues},
    prelude::*,
};
use bevy_restir::{EmissiveLuminance, prelude::*};
use bevy_restir_apps::demo::Demo;
use bevy_restir_support::{arguments, scene::spawn};
use clap::Parser;
use std::path::PathBuf;

/// Caustics of a lamp, a spot and the sun.
#[derive(Parser, Clone, Debug)]
struct Args {
    /// The technique at the start.
    #[arg(long, default_value = "bdpt", value_parser = arguments::choice::<Technique>())]
    technique: Technique,
    /// Writes one frame to this PNG file, without a window.
    #[arg(long, value_parser = arguments::png_file)]
    picture: Option<PathBuf>,
    /// Frames before the one of the picture.
    #[arg(long, default_value_t = 32, requires = "picture")]
    frames: u32,
    /// Moves the spot during these frames.
    #[arg(long, requires = "picture")]
    moving: bool,
    /// Size of the window or the picture in pixels.
    #[arg(long, default_value = "640x360", value_parser = arguments::window_size)]
    size: UVec2,
}

/// The exposure of a room.
const EV100: f32 = 7.5;
/// The angle by which the spot moves in a frame of a picture, radians.
const STEP: f32 = 0.02;

fn main() -> AppExit {
    let args = Args::parse();
    let demo = Demo {
        size: args.size,
        eye: eye(),
        ev100: EV100,
        environment: surroundings(),
        settings: settings(&args),
        populate,
    };
    if let Some(path) = &args.picture {
        let step = |world: &mut World, frame: u32| {
            if args.moving {
                move_spot(world, STEP * frame as f32);
            }
        };
        return demo.picture(path, args.frames, step);
    }
    demo.window("caustics", "Space (held): move the spot").add_systems(Update, swing).run()
}

fn settings(args: &Args) -> Restir {
    let bdpt = Bdpt { light_paths: 4.0, ..default() };
    // Without jitter `Bdpt` blurs caustics by up to a pixel.
    Restir { technique: args.technique, bdpt, jitter: Jitter::Always, ..default() }
}

fn surroundings() -> RestirEnvironment {
    RestirEnvironment { color: LinearRgba::rgb(4.0, 5.0, 7.0), ..default() }
}

fn eye() -> Transform {
    Transform::from_xyz(0.0, 1.25, 2.3).looking_at(Vec3::new(0.0, 0.55, 0.0), Vec3::Y)
}

/// A spot that swings over the egg.
#[derive(Component)]
struct Swinging;

fn populate(app: &mut App) {
    app.insert_resource(EmissiveLuminance(1000.0));
    let world = app.world_mut();
    let matte =
        |color| StandardMaterial { base_color: color, perceptual_roughness: 0.9, reflectance: 0.1, ..default() };
    let wall = matte(Color::linear_rgb(0.6, 0.58, 0.55));
    let floor: Mesh = Plane3d::default().mesh().size(4.0, 4.0).into();
    spawn(world, floor.clone(), matte(Color::linear_rgb(0.5, 0.42, 0.35)), Transform::default());
    let back = Transform::from_xyz(0.0, 2.0, -1.2).with_rotation(Quat::from_rotation_x(core::f32::consts::FRAC_PI_2));
    spawn(world, floor, wall.clone(), back);

    // A lamp in a glass shell on a post.
    spawn(world, Cylinder::new(0.05, 0.3), wall.clone(), Transform::from_xyz(-0.9, 0.15, 0.0));
    let place = Transform::from_xyz(-0.9, 0.5, 0.0);
    spawn(world, Sphere::new(0.2).mesh().uv(64, 32), glass(), place);
    spawn(world, inverted(Sphere::new(0.18).mesh().uv(64, 32)), glass(), place);
    let filament = StandardMaterial { emissive: LinearRgba::rgb(900.0, 620.0, 380.0), ..default() };
    spawn(world, Cylinder::new(0.006, 0.1), filament, place.with_rotation(Quat::from_rotation_z(0.4)));

    // An egg on a table, and a spot above it.
    spawn(world, Cuboid::new(0.8, 0.3, 0.7), wall, Transform::from_xyz(0.05, 0.15, 0.0));
    let egg = Transform::from_xyz(0.0, 0.44, 0.0).with_scale(Vec3::new(0.14, 0.14, 0.2));
    spawn(world, Sphere::new(1.0).mesh().uv(96, 48), glass(), egg.with_rotation(Quat::from_rotation_y(0.5)));
    let spot = SpotLight { intensity: 30_000.0, outer_angle: 0.25, inner_angle: 0.1, color: Color::WHITE, ..default() };
    world.spawn((spot, spot_at(0.0), Swinging));

    // A pane of colored glass in the sun.
    let pane = StandardMaterial {
        attenuation_color: Color::linear_rgb(0.9, 0.35, 0.15),
        attenuation_distance: 0.02,
        ..glass()
    };
    let place = Transform::from_xyz(0.85, 0.3, 0.0).with_rotation(Quat::from_rotation_y(-0.6));
    spawn(world, Cuboid::new(0.5, 0.6, 0.02), pane, place);

    // A glass of water. A thin layer of air parts the two, because light does not pass from one medium into another.
    let place = Transform::from_xyz(0.5, 0.001, 0.6);
    let wall = [(0.0, 0.0), (0.1, 0.0), (0.12, 0.28), (0.112, 0.28), (0.094, 0.02), (0.0, 0.02)];
    spawn(world, turned(&wall.map(Vec2::from)), glass(), place);
    let water = [(0.0, 0.021), (0.093, 0.021), (0.1049, 0.2), (0.0, 0.2)];
    spawn(world, turned(&water.map(Vec2::from)), StandardMaterial { ior: 1.33, ..glass() }, place);

    let sun = DirectionalLight { illuminance: 200.0, color: Color::srgb(1.0, 0.95, 0.85), ..default() };
    world.spawn((sun, Transform::default().looking_to(Vec3::new(-0.6, -0.75, 0.15), Vec3::Y)));
}

fn glass() -> StandardMaterial {
    StandardMaterial { specular_transmission: 1.0, thickness: 0.1, ior: 1.5, perceptual_roughness: 0.0, ..default() }
}

/// The surface of a profile that turns around the y axis, counterclockwise seen with x to the right. Its segments meet at edges.
fn turned(profile: &[Vec2]) -> Mesh {
    const STEPS: u32 = 96;
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    for segment in profile.windows(2) {
        let along = (segment[1] - segment[0]).normalize();
        let turned_by = |step: u32, at: Vec2| {
            let (sin, cos) = ops::sin_cos(core::f32::consts::TAU * (step % STEPS) as f32 / STEPS as f32);
            Vec3::new(at.x * cos, at.y, at.x * sin)
        };
        for step in 0..STEPS {
            for (i, end) in [(0, 0), (0, 1), (1, 0), (0, 1), (1, 1), (1, 0)] {
                positions.push(turned_by(step + i, segment[end]));
                normals.push(turned_by(step + i, -along.perp()));
            }
        }
    }
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
}

/// A mesh whose front faces are its insides.
fn inverted(mut mesh: Mesh) -> Mesh {
    if let Some(VertexAttributeValues::Float32x3(normals)) = mesh.attribute_mut(Mesh::ATTRIBUTE_NORMAL) {
        for normal in normals {
            *normal = normal.map(|x| -x);
        }
    }
    mesh.invert_winding().expect("spheres are lists of triangles");
    mesh
}

/// Places of the spot, by its angle.
fn spot_at(angle: f32) -> Transform {
    let (sin, cos) = ops::sin_cos(angle);
    Transform::from_xyz(0.5 * sin - 0.25, 1.9, 0.35 * cos).looking_at(Vec3::new(0.0, 0.42, 0.0), Vec3::Z)
}

fn move_spot(world: &mut World, angle: f32) {
    let mut spots = world.query_filtered::<&mut Transform, With<Swinging>>();
    for mut spot in spots.iter_mut(world) {
        *spot = spot_at(angle);
    }
}

fn swing(
    time: Res<Time>,
    keys: Res<ButtonInput<KeyCode>>,
    mut passed: Local<f32>,
    mut spots: Query<&mut Transform, With<Swinging>>,
) {
    if keys.pressed(KeyCode::Space) {
        *passed += 0.8 * time.delta_secs();
        for mut spot in &mut spots {
            *spot = spot_at(*passed);
        }
    }
}
