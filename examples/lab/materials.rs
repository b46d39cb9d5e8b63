//! A grid of spheres: one row per feature of the material, with values that rise to the right.

use bevy::{math::UVec2, prelude::*};
use bevy_restir::{RayBackend, Restir, RestirEnvironment, Technique};
use bevy_restir_support::{
    arguments,
    environment::equirectangular,
    exposure::unit_exposure,
    files,
    headless::{self, frame, until_ready},
    picture::{screenshot, write_png},
    progress::Progress,
    scene::{self, CameraSetup, View},
};
use std::path::{Path, PathBuf};

/// A picture of materials: metallic, roughness of a metal, reflectance, specular tint, clearcoat, its roughness, anisotropy, its
/// rotation, thick glass by roughness, thin walls by transmission, diffuse transmission, emission.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder for the picture materials.png.
    #[arg(long, default_value = "target/lab")]
    out: PathBuf,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "490x840", value_parser = arguments::size)]
    size: UVec2,
    /// Technique that lights the picture.
    #[arg(long, default_value = "reference", value_parser = arguments::choice::<Technique>())]
    technique: Technique,
    /// Number of frames whose mean is the picture.
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// Maximum number of scattering events of a path.
    #[arg(long, default_value_t = 10)]
    bounces: u32,
    /// Traces by the device's ray queries instead of in software.
    #[arg(long)]
    hardware: bool,
    /// Rows to show, counted from 0 at the top; without it all.
    #[arg(long, value_delimiter = ',', value_parser = row)]
    rows: Vec<usize>,
}

fn row(text: &str) -> Result<usize, String> {
    let last = FEATURES.len() - 1;
    text.parse().ok().filter(|row| *row <= last).ok_or(format!("expected a number from 0 to {last}"))
}

/// The picture's file.
const PICTURE: &str = "materials.png";
/// Number of spheres in a row.
const COLUMNS: usize = 7;
const RADIUS: f32 = 0.43;
/// Distance of the wall behind the centers of the spheres.
const WALL: f32 = 2.5;

/// Makes the material of a row from a value from 0 to 1.
type Feature = fn(f32) -> StandardMaterial;

fn of(r: f32, g: f32, b: f32) -> StandardMaterial {
    StandardMaterial { base_color: Color::linear_rgb(r, g, b), perceptual_roughness: 0.5, ..Default::default() }
}

fn gold() -> StandardMaterial {
    StandardMaterial { metallic: 1.0, ..of(0.95, 0.65, 0.25) }
}

const FEATURES: [Feature; 12] = [
    // Metallic.
    |x| StandardMaterial { metallic: x, perceptual_roughness: 0.25, ..of(0.9, 0.35, 0.2) },
    // Roughness.
    |x| StandardMaterial { perceptual_roughness: x, ..gold() },
    // Reflectance.
    |x| StandardMaterial { reflectance: x, perceptual_roughness: 0.15, ..of(0.03, 0.04, 0.06) },
    // Specular tint.
    |x| StandardMaterial {
        specular_tint: Color::linear_rgb(1.0, 1.0 - 0.5 * x, 1.0 - x),
        reflectance: 1.0,
        perceptual_roughness: 0.15,
        ..of(0.03, 0.04, 0.06)
    },
    // Clearcoat.
    |x| StandardMaterial {
        clearcoat: x,
        clearcoat_perceptual_roughness: 0.03,
        reflectance: 0.0,
        perceptual_roughness: 0.9,
        ..of(0.5, 0.03, 0.03)
    },
    // Roughness of a clearcoat over a rough metal.
    |x| StandardMaterial {
        clearcoat: 1.0,
        clearcoat_perceptual_roughness: x,
        perceptual_roughness: 0.6,
        metallic: 1.0,
        ..of(0.1, 0.2, 0.5)
    },
    // Anisotropy.
    |x| StandardMaterial { anisotropy_strength: x, perceptual_roughness: 0.3, ..gold() },
    // Rotation of the anisotropy, up to half a turn.
    |x| StandardMaterial {
        anisotropy_strength: 0.9,
        anisotropy_rotation: x * core::f32::consts::PI,
        perceptual_roughness: 0.3,
        ..gold()
    },
    // Roughness of a glass body.
    |x| StandardMaterial {
        specular_transmission: 1.0,
        thickness: 2.0 * RADIUS,
        perceptual_roughness: 0.7 * x,
        attenuation_color: Color::linear_rgb(0.6, 0.9, 0.8),
        attenuation_distance: 1.0,
        ..of(1.0, 1.0, 1.0)
    },
    // Transmission of a thin wall.
    |x| StandardMaterial { specular_transmission: x, perceptual_roughness: 0.1, ..of(0.95, 0.7, 0.8) },
    // Diffuse transmission of a thin wall.
    |x| StandardMaterial { diffuse_transmission: x, reflectance: 0.0, perceptual_roughness: 1.0, ..of(0.7, 0.9, 0.4) },
    // Emission.
    |x| StandardMaterial { emissive: LinearRgba::rgb(1.2 * x, 0.5 * x, 0.15 * x), ..of(0.2, 0.2, 0.2) },
];

pub fn run(args: &Args) -> Result<(), String> {
    files::check_in(&args.out, &[PICTURE])?;
    let rows: Vec<usize> = if args.rows.is_empty() { (0..FEATURES.len()).collect() } else { args.rows.clone() };
    let backend = if args.hardware { RayBackend::Hardware } else { RayBackend::Software };
    let mut app = headless::app(Path::new("."), backend)?;
    let place = spawn(app.world_mut(), &rows, args.size);
    let image = app.world_mut().resource_mut::<Assets<Image>>().add(studio());
    let environment = RestirEnvironment { image: Some(image), ..Default::default() };
    let settings = Restir { technique: args.technique, bounces: args.bounces, ..Restir::default() };
    let setup = CameraSetup { size: args.size, exposure: unit_exposure(), environment: Some(environment), settings };
    scene::spawn_camera(app.world_mut(), place, setup);
    let camera = app.world().resource::<View>().camera;
    until_ready(&mut app)?;
    if let Some(mut restir) = app.world_mut().get_mut::<Restir>(camera) {
        (restir.accumulate, restir.reset) = (true, true);
    }
    let progress = Progress::new(u64::from(args.frames));
    for _ in 0..args.frames {
        frame(&mut app);
        progress.step();
    }
    let picture = screenshot(&mut app)?;
    files::create_folder(&args.out)?;
    write_png(&args.out.join(PICTURE), picture)
}

/// Spawns spheres in front of a checkered wall, and a lamp. Returns the transform and the projection of the camera.
fn spawn(world: &mut World, rows: &[usize], size: UVec2) -> (Transform, Projection) {
    let (width, height) = (COLUMNS as f32, rows.len() as f32);
    // The poles of a UV sphere are on its z axis. Upright, its tangents run along the circles of latitude.
    let upright = Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2);
    let ball = Sphere::new(RADIUS).mesh().uv(96, 64);
    let ball = world.resource_mut::<Assets<Mesh>>().add(ball);
    for (y, row) in rows.iter().enumerate() {
        for x in 0..COLUMNS {
            let material = FEATURES[*row](x as f32 / (COLUMNS - 1) as f32);
            let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
            let at = Vec3::new(x as f32 - 0.5 * (width - 1.0), 0.5 * (height - 1.0) - y as f32, 0.0);
            let place = Transform::from_translation(at).with_rotation(upright);
            world.spawn((Mesh3d(ball.clone()), MeshMaterial3d(material), place));
        }
    }
    // A checkerboard of squares half as wide as the distance of the spheres.
    let square = world.resource_mut::<Assets<Mesh>>().add(Rectangle::new(0.5, 0.5));
    let greys = [0.4, 0.12].map(|grey| {
        let material = StandardMaterial { perceptual_roughness: 1.0, reflectance: 0.0, ..of(grey, grey, grey) };
        world.resource_mut::<Assets<StandardMaterial>>().add(material)
    });
    let (columns, lines) = (2 * (COLUMNS + 4), 2 * (rows.len() + 4));
    for i in 0..columns * lines {
        let (x, y) = (i % columns, i / columns);
        let place = |i: usize, n: usize| 0.5 * (i as f32 + 0.5 - 0.5 * n as f32);
        let at = Transform::from_xyz(place(x, columns), place(y, lines), -WALL);
        world.spawn((Mesh3d(square.clone()), MeshMaterial3d(greys[(x + y) % 2].clone()), at));
    }
    // A rectangle faces +Z, which `looking_to` turns away from the target.
    let eye = Vec3::new(-0.8 * width, 0.8 * height, 0.9 * height);
    let panel = world.resource_mut::<Assets<Mesh>>().add(Rectangle::new(4.0, 4.0));
    let lamp = StandardMaterial { emissive: LinearRgba::rgb(7.0, 7.0, 7.0), ..of(0.0, 0.0, 0.0) };
    let lamp = world.resource_mut::<Assets<StandardMaterial>>().add(lamp);
    world.spawn((Mesh3d(panel), MeshMaterial3d(lamp), Transform::from_translation(eye).looking_to(eye, Vec3::Y)));
    // From far away, so that all spheres have nearly the same perspective.
    let fov = 0.16f32;
    let aspect = size.x as f32 / size.y as f32;
    let distance = 0.5 * height.max(width / aspect) * 1.02 / (0.5 * fov).tan();
    let projection = PerspectiveProjection { fov, near: 0.1, far: 1000.0, ..Default::default() };
    (Transform::from_xyz(0.0, 0.0, distance), Projection::Perspective(projection))
}

/// The environment: dim, brighter above, with bright windows that mirrors show.
fn studio() -> Image {
    let (width, height) = (128u32, 64u32);
    let texel = |x: u32, y: u32| -> [f32; 4] {
        let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
        let up = 0.1 + 0.25 * (1.0 - v);
        // u = 0.5 is in front of the camera. Two windows stand behind the camera, and one lights the spheres from behind.
        let window = |left: f32, right: f32| u > left && u < right && v > 0.3 && v < 0.55;
        if window(0.06, 0.14) || window(0.88, 0.92) {
            [6.0, 6.0, 6.5, 1.0]
        } else if u > 0.4 && u < 0.6 && v < 0.2 {
            [5.0, 4.6, 4.0, 1.0]
        } else {
            [0.9 * up, up, 1.1 * up, 1.0]
        }
    };
    let pixels: Vec<_> = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect();
    equirectangular(width, height, &pixels)
}
