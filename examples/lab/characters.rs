//! Cost of bodies that bend: characters that sway, against the same characters at rest.

use bevy::{mesh::Mesh3d, prelude::*};
use bevy_restir::{RayBackend, Restir, RestirStatistics, Technique};
use bevy_restir_support::{
    arguments,
    exposure::unit_exposure,
    headless::{self, frame},
    progress::Progress,
    scene::{self, CameraSetup},
    skinned,
    times::median,
};
use std::path::Path;

use crate::{
    bench::adapter_of,
    output::{Output, header},
    table::{Row, Table, Unit},
};

/// Time of a frame with characters that move and with characters at rest.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    output: Output,
    /// Pixels. A small picture shows the cost of the characters, not that of the light.
    #[arg(long, default_value = "32x32", value_parser = arguments::size)]
    size: UVec2,
    /// Numbers of characters.
    #[arg(long, value_delimiter = ',', default_value = "1,10,100", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    characters: Vec<u32>,
    /// Approximate number of triangles of a character.
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(4..=10_000_000))]
    triangles: u32,
    /// Number of frames that are timed at rest, and again in motion.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
}

/// Measurements with one number of characters.
struct Measured {
    triangles: u64,
    still_ms: f64,
    moving_ms: f64,
    moving_cpu_ms: f64,
    sent: u64,
    bytes: u64,
}

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check("characters")?;
    let progress = Progress::new(args.characters.iter().map(|_| u64::from(2 * args.frames)).sum());
    let mut columns = Vec::new();
    let mut name = String::new();
    for &count in &args.characters {
        let mut app = headless::app(Path::new("."), RayBackend::Auto)?;
        name = adapter_of(&app);
        let measured = measure(&mut app, count, args, &progress)?;
        columns.push((count.to_string(), rows(&measured)));
    }
    let mut header = header(name, args.size);
    header.push(format!("times: medians over {} frames; direct light by ReSTIR DI", args.frames));
    args.output.write("characters", &Table { header, columns, notes: Vec::new() })
}

fn measure(app: &mut App, count: u32, args: &Args, progress: &Progress) -> Result<Measured, String> {
    let bodies = spawn(app.world_mut(), count, args.triangles);
    let settings = Restir { technique: Technique::Di, ..default() };
    let side = (count as f32).sqrt().ceil();
    let place = Transform::from_xyz(0.0, 0.8 * side + 1.0, 1.5 * side + 3.0).looking_at(Vec3::ZERO, Vec3::Y);
    let setup = CameraSetup { size: args.size, exposure: unit_exposure(), environment: None, settings };
    scene::spawn_camera(app.world_mut(), (place, Projection::default()), setup);
    headless::until_ready(app)?;
    // The allocations of the first motion are not part of the times.
    for step in 0..4 {
        sway(app.world_mut(), &bodies, step as f32);
        frame(app);
    }
    let mut timed = |moves: bool| {
        let mut times = Vec::new();
        for step in 0..args.frames + 2 {
            if moves {
                sway(app.world_mut(), &bodies, 0.05 * step as f32);
            }
            let time = frame(app);
            // The first two frames still follow the state before.
            if step >= 2 {
                times.push(time);
                progress.step();
            }
        }
        let all: Vec<f64> = times.iter().map(|(all, _)| *all).collect();
        let cpu: Vec<f64> = times.iter().map(|(_, cpu)| *cpu).collect();
        (median(&all), median(&cpu))
    };
    let (still_ms, _) = timed(false);
    let (moving_ms, moving_cpu_ms) = timed(true);
    headless::alive(app)?;
    let report = app.world().resource::<RestirStatistics>().report();
    Ok(Measured {
        triangles: report.triangles - 2,
        still_ms,
        moving_ms,
        moving_cpu_ms,
        sent: report.uploaded_bytes,
        bytes: report.memory.iter().map(|(_, bytes)| bytes).sum(),
    })
}

/// A crowd on a square, under a lamp.
fn spawn(world: &mut World, count: u32, triangles: u32) -> Vec<(Entity, Transform)> {
    let sides = ((triangles as f32 / 4.0).sqrt() as usize).max(3);
    let mesh = world.resource_mut::<Assets<Mesh>>().add(skinned::tube(2 * sides, sides));
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(StandardMaterial::default());
    let columns = (count as f32).sqrt().ceil() as u32;
    let place = |i: u32| {
        let at = UVec2::new(i % columns, i / columns).as_vec2() - 0.5 * (columns - 1) as f32;
        Transform::from_xyz(at.x, 0.0, at.y)
    };
    let bodies = (0..count)
        .map(|i| {
            let skin = skinned::skin(world);
            let body =
                world.spawn((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), Transform::default(), skin));
            (body.id(), place(i))
        })
        .collect();
    let lamp = StandardMaterial { emissive: LinearRgba::rgb(5.0, 5.0, 5.0), ..default() };
    let lamp = world.resource_mut::<Assets<StandardMaterial>>().add(lamp);
    let square = world.resource_mut::<Assets<Mesh>>().add(Rectangle::from_length(4.0));
    let above = Transform::from_xyz(0.0, 6.0, 0.0).with_rotation(Quat::from_rotation_x(core::f32::consts::FRAC_PI_2));
    world.spawn((Mesh3d(square), MeshMaterial3d(lamp), above));
    bodies
}

fn sway(world: &mut World, bodies: &[(Entity, Transform)], time: f32) {
    for (i, (body, foot)) in bodies.iter().enumerate() {
        skinned::set_joints(world, *body, &skinned::swaying(*foot, time + i as f32, 1.0));
    }
}

fn rows(m: &Measured) -> Vec<Row> {
    let ms = |label: &str, value: f64| Row::new("Frame", label, &[("", Unit::Ms, value)]);
    vec![
        Row::new("Scene", "triangles of all characters", &[("", Unit::Count, m.triangles as f64)]),
        ms("all at rest", m.still_ms),
        ms("all in motion", m.moving_ms),
        ms("motion alone", m.moving_ms - m.still_ms),
        ms("CPU, in motion", m.moving_cpu_ms),
        Row::new("Scene", "sent in a frame of motion", &[("", Unit::Bytes, m.sent as f64)]),
        Row::new("Scene", "all buffers and textures", &[("", Unit::MiB, m.bytes as f64 / f64::from(1 << 20))]),
    ]
}
