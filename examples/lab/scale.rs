//! Cost of direct light by the number of lights: a panel of constant power, divided into more and more triangles.

use bevy::math::UVec2;
use bevy_restir::{RayBackend, RestirStatistics};
use bevy_restir_support::{
    arguments,
    exposure::unit_exposure,
    headless::{self, until},
    progress::Progress,
    scene::{self, CameraSetup},
};
use std::{path::Path, time::Instant};

use crate::{
    bench::{Bench, Cost, Counts},
    lights,
    output::{Output, header},
    series,
    table::{Row, Table, Unit},
};

/// Times of direct light by the number of lights.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    output: Output,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "128x128", value_parser = arguments::size)]
    size: UVec2,
    #[command(flatten)]
    counts: Counts,
    /// Numbers of emissive triangles, even.
    #[arg(long, value_delimiter = ',', default_value = "2,100,10000,1000000", value_parser = even)]
    lights: Vec<u32>,
}

fn even(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|n| (2..=10_000_000).contains(n) && n % 2 == 0)
        .ok_or("expected even numbers from 2 on".into())
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
    default: Cost,
    bare: Cost,
    bare_unpresampled: Cost,
}

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check("scale")?;
    let mut app = headless::app(Path::new("."), RayBackend::Auto)?;
    let place = lights::spawn_room(app.world_mut());
    let camera =
        CameraSetup { size: args.size, exposure: unit_exposure(), environment: None, settings: series::default() };
    scene::spawn_camera(app.world_mut(), place, camera);
    // This panel only triggers the compilation of the pipelines, so that no timed frame waits for it.
    lights::hang(app.world_mut(), lights::panel(2));
    let mut bench = Bench::new(app, args.size, args.counts.clone())?;
    let room = bench.report().triangles - 2;

    let default = series::default();
    let bare = series::without_rays(default.clone());
    let bare_unpresampled = series::without_rays(series::with(|d| d.subset_count = 0));
    let each: u64 = [&default, &bare, &bare_unpresampled].map(|s| Bench::planned(&args.counts, s, 0)).iter().sum();
    let progress = Progress::new((each + 1) * args.lights.len() as u64);
    let mut all = Vec::new();
    for &count in &args.lights {
        let build_ms = build(&mut bench, room, count)?;
        let mut measure = |settings| Ok::<_, String>(bench.measure(settings, None, &progress)?.0);
        let (bare, bare_unpresampled, default) = (measure(&bare)?, measure(&bare_unpresampled)?, measure(&default)?);
        let light = bench.light(&progress)?;
        let report = bench.report();
        all.push(Measured {
            triangles: report.triangles - room,
            lights: report.lights,
            build_ms,
            bytes: bench.bytes(),
            light,
            default,
            bare,
            bare_unpresampled,
        });
    }
    args.output.write("scale", &table(args, bench.adapter(), &all))
}

/// Replaces the panel. Returns the milliseconds until the new one is in the scene and in the table of lights.
fn build(bench: &mut Bench, room: u64, count: u32) -> Result<f64, String> {
    let panel = lights::panel(count);
    let start = Instant::now();
    let app = bench.app();
    lights::hang(app.world_mut(), panel);
    // The plugin also reports that it is ready where it had to leave the panel out, so waiting ends after ten frames.
    let mut idle = 0;
    until(app, "the panel is not ready", |app| {
        let report = app.world().resource::<RestirStatistics>().report();
        idle = if report.ready { idle + 1 } else { 0 };
        idle > 10 || (report.ready && report.triangles == room + u64::from(count))
    })?;
    Ok(start.elapsed().as_secs_f64() * 1e3)
}

fn table(args: &Args, adapter: String, all: &[Measured]) -> Table {
    let mut header = header(adapter, args.size);
    let Counts { warmup, frames } = args.counts;
    header.push(format!("times: medians over {frames} frames after {warmup}; x: times that of the first column"));
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
    const BARE: &str = "Without rays";
    const DEFAULT: &str = "Default settings";
    vec![
        Row::new(SCENE, "lights in the table", &[("", Unit::Count, measured.lights as f64)]),
        Row::new(SCENE, "all buffers and textures", &[("", Unit::MiB, measured.bytes as f64 / f64::from(1 << 20))]),
        Row::new(SCENE, "light in a frame", &[("", Unit::Radiance, measured.light)]),
        ms(SCENE, "from the mesh to the picture", |m| m.build_ms),
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
