//! Cost and error of ReSTIR SSS by its shift, compared with the reference tracer at equal time: two bodies under a moving camera.

use bevy::{
    camera::{PerspectiveProjection, Projection},
    prelude::*,
};
use bevy_restir::{DebugView, RayBackend, Restir, Reuse, Subsurface, SubsurfaceSampling, SubsurfaceShift, Technique};
use bevy_restir_support::{
    bodies,
    exposure::unit_exposure,
    progress::Progress,
    scene::{self, CameraSetup, spawn},
};
use std::path::Path;

use crate::{
    bench::Bench,
    equal_time::{Competitor, Detail, Lengths, column},
    series::plain,
    table::{Row, Table, Unit},
    variant,
};

/// Cost and error of ReSTIR SSS by its shift: a slab with the edge of a shadow under one light, as a close-up, and under 64 lights; and
/// a bust. Single bounces, 16 frames with a moving camera, as Werner et al. 2024 measure.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    lengths: Lengths,
    /// Scenes.
    #[arg(long, value_delimiter = ',', default_value = "slab,closeup,slab64,bust", value_parser = ["slab", "closeup", "slab64", "bust"])]
    scenes: Vec<String>,
    /// Fields of `Restir` as `"PATH=VALUE PATH=VALUE"`, measured instead of the shifts; repeatable.
    #[arg(long, value_parser = variant::parse)]
    variant: Vec<String>,
}

/// Albedo of all bodies; everything else is gray.
const ALBEDO: Vec3 = Vec3::new(0.83, 0.79, 0.75);
/// Frames of a motion.
const FRAMES: u32 = 16;
/// How much closer the close-up is: its 96 pixels are as small on the slab as those of a picture of 1,080 lines.
const CLOSER: f32 = 11.0;
/// Vertical field of view of the other pictures in radians.
const FOV: f32 = core::f32::consts::FRAC_PI_4;

/// A camera that turns around a point.
struct Orbit {
    /// The last eye, and where it looks.
    eye: Vec3,
    target: Vec3,
    /// Radians that the camera turns in a frame.
    turn: f32,
    /// Vertical field of view in radians.
    fov: f32,
}

impl Orbit {
    /// The camera of each frame; the last one is that of the picture.
    fn motion(&self) -> Vec<Transform> {
        let at = |left: u32| {
            let turned = Quat::from_rotation_y(self.turn * left as f32) * (self.eye - self.target);
            Transform::from_translation(self.target + turned).looking_at(self.target, Vec3::Y)
        };
        (0..FRAMES).rev().map(at).collect()
    }

    /// The camera with a longer lens and a slower turn, so that the picture shows a part of the object.
    fn closer(self, factor: f32) -> Self {
        Self { turn: self.turn / factor, fov: self.fov / factor, ..self }
    }

    fn projection(&self) -> Projection {
        Projection::Perspective(PerspectiveProjection { fov: self.fov, ..default() })
    }
}

pub fn run(args: &Args) -> Result<(), String> {
    let Lengths { output, counts, .. } = &args.lengths;
    output.check("subsurface")?;
    let mut table = Table::default();
    for name in &args.scenes {
        let mut app = Bench::app_in(Path::new("."), RayBackend::Auto)?;
        let orbit = match name.as_str() {
            "slab" => slab(app.world_mut(), 1),
            "closeup" => slab(app.world_mut(), 1).closer(CLOSER),
            "slab64" => slab(app.world_mut(), 8),
            "bust" => bust(app.world_mut()),
            other => return Err(format!("there is no scene `{other}`")),
        };
        // Radii count pixels of a picture of 1,080 lines; the close-up is a part of one.
        let radius_scale = if name == "closeup" { 1080.0 / args.lengths.size.y as f32 } else { 1.0 };
        let competitors = competitors(args, radius_scale)?;
        let motion = orbit.motion();
        let reference = plain(Technique::Reference, 1);
        let setup = CameraSetup {
            size: args.lengths.size,
            exposure: unit_exposure(),
            environment: None,
            settings: reference.clone(),
        };
        let camera = (motion[motion.len() - 1], orbit.projection());
        scene::spawn_camera(app.world_mut(), camera, setup);
        let mut bench = Bench::new(app, args.lengths.size, counts.clone())?.moving(motion);
        let share = translucent_share(&mut bench)?;
        let mut rows = column(&args.lengths, &mut bench, &reference, &competitors, Detail::Passes)?;
        rows.insert(0, Row::new("Scene", "pixels that show a translucent body", &[("", Unit::Ratio, share)]));
        rows.extend(diffuse(args, &mut bench)?);
        args.lengths.describe(&mut table, &bench, 1);
        table.columns.push((name.clone(), rows));
    }
    output.write("subsurface", &table)
}

fn with(subsurface: SubsurfaceSampling) -> Restir {
    Restir { subsurface, ..plain(Technique::Di, 1) }
}

fn competitors(args: &Args, radius_scale: f32) -> Result<Vec<Competitor>, String> {
    let mut default = SubsurfaceSampling::default();
    default.reuse.radius *= radius_scale;
    if !args.variant.is_empty() {
        let plain = with(default);
        let competitor = |text: &String| Ok(Competitor { name: text.clone(), settings: variant::of(&plain, text)? });
        return args.variant.iter().map(competitor).collect();
    }
    let alone = Reuse { temporal: false, spatial_samples: 0, ..default.reuse.clone() };
    let mut competitors = vec![Competitor {
        name: "Candidates without reuse".into(),
        settings: with(SubsurfaceSampling { reuse: alone, ..default.clone() }),
    }];
    let two_and_two = Reuse { spatial_iterations: 2, spatial_samples: 2, ..default.reuse.clone() };
    for (name, shift, reuse) in [
        ("Reconnection", SubsurfaceShift::Reconnection, &default.reuse),
        ("Delayed reconnection", SubsurfaceShift::Delayed, &default.reuse),
        ("Hybrid", SubsurfaceShift::Hybrid, &default.reuse),
        ("Sequential, two iterations of two neighbors", SubsurfaceShift::Sequential, &two_and_two),
    ] {
        let settings = with(SubsurfaceSampling { shift, reuse: reuse.clone(), ..default.clone() });
        competitors.push(Competitor { name: name.into(), settings });
    }
    Ok(competitors)
}

/// Times of the frame with the default settings, and of that frame with diffuse bodies.
fn diffuse(args: &Args, bench: &mut Bench) -> Result<Vec<Row>, String> {
    let settings = plain(Technique::Di, 1);
    let progress = Progress::new(2 * Bench::planned(&args.lengths.counts, &settings, 0));
    let (below, _) = bench.measure(&settings, None, &progress)?;
    let world = bench.app().world_mut();
    let bodies: Vec<Entity> = world.query_filtered::<Entity, With<Subsurface>>().iter(world).collect();
    for body in bodies {
        world.entity_mut(body).remove::<Subsurface>();
    }
    let (diffuse, _) = bench.measure(&settings, None, &progress)?;
    const SECTION: &str = "Default settings and diffuse bodies";
    let ratio = below.lighting() / diffuse.lighting();
    Ok(vec![
        Row::new(SECTION, "translucent", &[("", Unit::Ms, below.lighting()), ("", Unit::RaysAPixel, below.rays)]),
        Row::new(SECTION, "diffuse", &[("", Unit::Ms, diffuse.lighting()), ("", Unit::RaysAPixel, diffuse.rays)]),
        Row::new(SECTION, "translucent, relative to diffuse", &[("", Unit::Ratio, ratio)]),
    ])
}

/// Share of the picture's pixels whose base color is that of the bodies.
fn translucent_share(bench: &mut Bench) -> Result<f64, String> {
    let albedo = Restir { debug_view: DebugView::Albedo, ..plain(Technique::Reference, 1) };
    let (picture, _) = bench.show(&albedo, 0, &Progress::hidden())?;
    let bodies = picture.iter().filter(|pixel| pixel[0] > 1.05 * pixel[2]).count();
    Ok(bodies as f64 / picture.len() as f64)
}

fn matte(color: Vec3) -> StandardMaterial {
    let color = Color::linear_rgb(color.x, color.y, color.z);
    StandardMaterial { base_color: color, perceptual_roughness: 1.0, reflectance: 0.0, ..default() }
}

fn lamp(radiance: Vec3) -> StandardMaterial {
    let emissive = LinearRgba::rgb(radiance.x, radiance.y, radiance.z);
    StandardMaterial { emissive, ..matte(Vec3::ZERO) }
}

/// A body whose profile has these lengths d, in meters.
fn of_lengths(d: Vec3) -> Subsurface {
    let a = ALBEDO - 0.8;
    Subsurface { mean_free_path: d * (1.9 - ALBEDO + 3.5 * a * a), weight: 1.0 }
}

/// A slab under the edge of a screen. Its light is cut into `cells` x `cells` lights, which have colors if there are several.
fn slab(world: &mut World, cells: u32) -> Orbit {
    let slab = spawn(world, Cuboid::new(4.0, 0.6, 4.0), matte(ALBEDO), Transform::from_xyz(0.0, -0.3, 0.0));
    world.entity_mut(slab).insert(of_lengths(Vec3::new(0.3, 0.06, 0.03)));
    spawn(world, Cuboid::new(2.4, 0.02, 4.8), matte(Vec3::splat(0.3)), Transform::from_xyz(-1.2, 0.4, 0.0));
    let side = 1.0 / cells as f32;
    for i in 0..cells * cells {
        let hue = |k: u32| 0.5 + 0.5 * bevy::math::ops::sin((7 * i + 2 * k) as f32);
        let color = if cells == 1 { Vec3::ONE } else { 2.0 * Vec3::new(hue(0), hue(1), hue(2)) };
        let at = Vec2::new((i % cells) as f32 + 0.5, (i / cells) as f32 + 0.5) * side - 0.5;
        let down = Quat::from_rotation_x(core::f32::consts::FRAC_PI_2);
        let place = Transform::from_xyz(at.x, 3.0, at.y).with_rotation(down);
        spawn(world, Rectangle::new(side, side), lamp(30.0 * color), place);
    }
    Orbit { eye: Vec3::new(3.2, 1.75, 0.0), target: Vec3::new(0.2, 0.0, 0.0), turn: 0.01, fov: FOV }
}

/// A head with thin ears on a plinth, under a light in front of it and one behind it.
fn bust(world: &mut World) -> Orbit {
    let gray = Vec3::splat(0.3);
    spawn(world, Plane3d::default().mesh().size(4.0, 4.0), matte(gray), Transform::default());
    spawn(world, Cylinder::new(0.035, 0.03), matte(gray), Transform::from_xyz(0.0, 0.015, 0.0));
    let head = spawn(world, bodies::head(), matte(ALBEDO), Transform::from_xyz(0.0, 0.085, 0.0));
    world.entity_mut(head).insert(of_lengths(Vec3::new(0.0022, 0.001, 0.0006)));
    let mut light = |radius: f32, radiance: f32, at: Vec3| {
        spawn(
            world,
            Sphere::new(radius).mesh().uv(12, 8),
            lamp(Vec3::splat(radiance)),
            Transform::from_translation(at),
        );
    };
    light(0.02, 60.0, Vec3::new(-0.15, 0.3, 0.25));
    light(0.01, 400.0, Vec3::new(0.12, 0.14, -0.15));
    Orbit { eye: Vec3::new(0.08, 0.11, 0.17), target: Vec3::new(0.0, 0.08, 0.0), turn: 0.02, fov: FOV }
}
