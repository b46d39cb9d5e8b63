//! Cost of direct light by the number of lights: a panel of constant power, divided into more and more triangles.

use bevy::{camera::primitives::Aabb, math::UVec2, prelude::*};
use bevy_restir::{RayBackend, RestirStatistics};
use bevy_restir_support::{
    arguments,
    exposure::unit_exposure,
    framing,
    headless::{self, frame, until},
    progress::Progress,
    scene::{self, CameraSetup},
    times::median,
};
use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use crate::{
    bench::{Bench, Cost, Counts, scenes},
    lights,
    output::{Output, header},
    series,
    table::{Row, Table, Unit},
};

/// Times of direct light by the number of lights: a panel of constant power is divided into more and more triangles. It hangs over a
/// floor with blocks, or over a scene. Then one lamp flickers beside the panel.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// A glTF file over which the panel hangs, beside the lights of the scene; `references.json` beside it may name its environment.
    scene: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "128x128", value_parser = arguments::size)]
    size: UVec2,
    #[command(flatten)]
    counts: Counts,
    /// Numbers of emissive triangles: even, from 2 to 10,000,000.
    #[arg(long, value_delimiter = ',', default_value = "2,100,10000,1000000", value_parser = even)]
    lights: Vec<u32>,
}

fn even(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|n| (2..=10_000_000).contains(n) && n % 2 == 0)
        .ok_or("expected even numbers from 2 to 10000000".into())
}

/// Measurements with one number of lights.
struct Measured {
    triangles: u64,
    lights: u64,
    /// Milliseconds from the new panel to the first frame with it.
    build_ms: f64,
    bytes: u64,
    /// Mean radiance of a frame.
    light: f64,
    flicker: Flicker,
    default: Cost,
    bare: Cost,
    bare_unpresampled: Cost,
}

/// A frame in which one lamp beside the panel has changed its brightness.
#[derive(Default)]
struct Flicker {
    /// Median time of the CPU stages that update and send lights, ms.
    ms: f64,
    /// Scene bytes sent.
    sent: f64,
    /// Emissive triangles that were visited.
    visited: f64,
}

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check("scale")?;
    let (mut bench, at) = match &args.scene {
        Some(path) => {
            let scene = scenes(core::slice::from_ref(path))?.remove(0);
            let in_scene = |error| format!("{}: {error}", scene.1);
            let mut bench = Bench::of_scene(&scene, args.size, series::default(), &args.counts).map_err(in_scene)?;
            let at = above(bench.app().world_mut());
            (bench, at)
        }
        None => {
            let mut app = Bench::app_in(Path::new("."), RayBackend::Auto)?;
            let place = lights::spawn_room(app.world_mut());
            let settings = series::default();
            let camera = CameraSetup { size: args.size, exposure: unit_exposure(), environment: None, settings };
            scene::spawn_camera(app.world_mut(), place, camera);
            (Bench::new(app, args.size, args.counts.clone())?, Transform::from_xyz(0.0, lights::HEIGHT, 0.0))
        }
    };
    let room = Room { triangles: bench.report().triangles, lights: bench.report().lights, at };
    // This panel only triggers the compilation of the pipelines, so that no timed frame waits for it.
    build(&mut bench, &room, 2)?;

    let default = series::default();
    let bare = series::without_rays(default.clone());
    let bare_unpresampled = series::without_rays(series::with(|d| d.subset_count = 0));
    let each: u64 = [&default, &bare, &bare_unpresampled].map(|s| Bench::planned(&args.counts, s, 0)).iter().sum();
    let progress = Progress::new((each + 1) * args.lights.len() as u64);
    let mut all = Vec::new();
    for &count in &args.lights {
        let build_ms = build(&mut bench, &room, count)?;
        let mut measure = |settings| Ok::<_, String>(bench.measure(settings, None, &progress)?.0);
        let (bare, bare_unpresampled, default) = (measure(&bare)?, measure(&bare_unpresampled)?, measure(&default)?);
        let light = bench.light(&progress)?;
        let report = bench.report();
        all.push(Measured {
            triangles: report.triangles - room.triangles,
            lights: report.lights - room.lights,
            build_ms,
            bytes: bench.bytes(),
            light,
            flicker: Flicker::default(),
            default,
            bare,
            bare_unpresampled,
        });
    }
    // The lamp needs other pipelines, which must not time the passes above.
    for (&count, measured) in args.lights.iter().zip(&mut all) {
        build(&mut bench, &room, count)?;
        measured.flicker = flicker(&mut bench, &room, args.counts.frames)?;
    }
    args.output.write("scale", &table(args, bench.adapter(), &room, &all))
}

/// The scene without the panel of lights, and the place of the panel.
struct Room {
    triangles: u64,
    lights: u64,
    at: Transform,
}

/// A place over a scene for a panel of its width.
fn above(world: &mut World) -> Transform {
    let (center, radius) = framing::bounding_sphere(world.query::<(&GlobalTransform, &Aabb)>().iter(world));
    let scale = Vec3::splat(2.0 * radius / lights::PANEL.x);
    Transform::from_translation(center + radius * Vec3::Y).with_scale(scale)
}

/// Replaces the panel. Returns the milliseconds until the new one is in the scene and in the table of lights.
fn build(bench: &mut Bench, room: &Room, count: u32) -> Result<f64, String> {
    let panel = lights::panel(count);
    let start = Instant::now();
    let app = bench.app();
    lights::hang(app.world_mut(), panel, room.at);
    // The plugin also reports that it is ready where it had to leave the panel out, so waiting ends after ten frames.
    let mut idle = 0;
    until(app, "the panel is not ready", |app| {
        let report = app.world().resource::<RestirStatistics>().report();
        idle = if report.ready { idle + 1 } else { 0 };
        idle > 10 || (report.ready && report.triangles == room.triangles + u64::from(count))
    })?;
    Ok(start.elapsed().as_secs_f64() * 1e3)
}

/// Lets a lamp under the panel flicker for some frames.
fn flicker(bench: &mut Bench, room: &Room, frames: u32) -> Result<Flicker, String> {
    let app = bench.app();
    let lamp =
        app.world_mut().spawn((PointLight::default(), Transform::from_translation(0.5 * room.at.translation))).id();
    let (mut times, mut sent, mut visited) = (Vec::new(), 0.0, 0.0);
    // In the first frames the lamp is new.
    const SETTLE: u32 = 4;
    for number in 0..SETTLE + frames {
        if let Some(mut light) = app.world_mut().get_mut::<PointLight>(lamp) {
            light.intensity = 100.0 + (number % 7) as f32;
        }
        frame(app);
        headless::alive(app)?;
        if number < SETTLE {
            continue;
        }
        let report = app.world().resource::<RestirStatistics>().report();
        let stages = report.cpu_ms.iter().filter(|(name, _)| ["lights", "upload"].contains(name));
        times.push(stages.map(|(_, ms)| f64::from(*ms)).sum());
        sent = report.uploaded_bytes as f64;
        visited = report.visited.iter().find(|(name, _)| *name == "emissive_triangles").map_or(0.0, |(_, n)| *n as f64);
    }
    app.world_mut().despawn(lamp);
    Ok(Flicker { ms: median(&times), sent, visited })
}

fn table(args: &Args, adapter: String, room: &Room, all: &[Measured]) -> Table {
    let mut header = header(adapter, args.size);
    let Counts { warmup, frames } = args.counts;
    header.push(format!("times: medians over {frames} frames after {warmup}; x: times that of the first column"));
    if let Some(scene) = &args.scene {
        let Room { triangles, lights, .. } = room;
        header.push(format!(
            "the panel hangs over {}, which has {triangles} triangles and {lights} lights itself",
            scene.display()
        ));
    }
    let mut notes = Vec::new();
    for (asked, measured) in args.lights.iter().zip(all) {
        if measured.lights != u64::from(*asked) || measured.triangles != u64::from(*asked) {
            notes.push(format!(
                "Of {asked} emissive triangles {} are in the scene and {} in the table of lights.",
                measured.triangles, measured.lights
            ));
        }
    }
    let columns = args.lights.iter().zip(all).map(|(asked, m)| (asked.to_string(), rows(m, &all[0]))).collect();
    Table { header, columns, notes }
}

/// The column of one number of lights, with ratios to the smallest number.
fn rows(measured: &Measured, smallest: &Measured) -> Vec<Row> {
    let ms = |section, label: &str, of: fn(&Measured) -> f64| {
        let (value, base) = (of(measured), of(smallest));
        Row::new(section, label, &[("", Unit::Ms, value), ("", Unit::Ratio, value / base)])
    };
    const SCENE: &str = "Scene";
    const FLICKER: &str = "One lamp beside the panel flickers";
    const BARE: &str = "Without rays";
    const DEFAULT: &str = "Default settings";
    vec![
        Row::new(SCENE, "lights of the panel in the table", &[("", Unit::Count, measured.lights as f64)]),
        Row::new(SCENE, "all buffers and textures", &[("", Unit::MiB, measured.bytes as f64 / f64::from(1 << 20))]),
        Row::new(SCENE, "light in a frame", &[("", Unit::Radiance, measured.light)]),
        ms(SCENE, "from the mesh to the picture", |m| m.build_ms),
        ms(FLICKER, "CPU time of lights and uploads", |m| m.flicker.ms),
        Row::new(FLICKER, "scene bytes sent", &[("", Unit::Bytes, measured.flicker.sent)]),
        Row::new(FLICKER, "emissive triangles visited", &[("", Unit::Count, measured.flicker.visited)]),
        ms(BARE, "presample", |m| m.bare.presample()),
        ms(BARE, "candidates, presampled (demanded: at most 1.25 x)", |m| m.bare.candidates()),
        ms(BARE, "presample and candidates", |m| m.bare.presample() + m.bare.candidates()),
        ms(BARE, "candidates, not presampled", |m| m.bare_unpresampled.candidates()),
        ms(BARE, "reuse", |m| m.bare.reuse()),
        ms(DEFAULT, "candidates", |m| m.default.candidates()),
        ms(DEFAULT, "reuse", |m| m.default.reuse()),
        ms(DEFAULT, "total lighting", |m| m.default.lighting()),
        Row::new(DEFAULT, "rays", &[("", Unit::RaysAPixel, measured.default.rays)]),
    ]
}
