//! CPU time of a frame by the number of instances: at rest, in motion, and with one that comes or goes in each frame.

use bevy::prelude::*;
use bevy_restir::{RayBackend, Restir, RestirStatistics, Technique};
use bevy_restir_support::{
    arguments,
    exposure::unit_exposure,
    headless::{self, frame},
    progress::Progress,
    scene::{self, CameraSetup},
};
use std::path::Path;

use crate::{
    bench::adapter_of,
    output::{Output, header},
    table::{Row, Table, Unit},
};

/// CPU times of the plugin by the number of instances, in parts.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Numbers of instances.
    #[arg(long, value_delimiter = ',', default_value = "1000,10000,100000", value_parser = clap::value_parser!(u32).range(1..=4_000_000))]
    instances: Vec<u32>,
    /// Instances up to which each also gets a mesh and a material of its own.
    #[arg(long, default_value_t = 10_000)]
    meshes: u32,
    /// Frames of each case.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(4..=1_000_000))]
    frames: u32,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "16x16", value_parser = arguments::size)]
    size: UVec2,
    #[command(flatten)]
    output: Output,
}

/// The edit before each frame.
#[derive(Clone, Copy, PartialEq)]
enum Change {
    Nothing,
    /// Each of this many instances moves.
    Move(usize),
    Spawn,
    /// One of the instances goes, and another one comes.
    Exchange,
}

const NAME: &str = "instances";

/// A case: its name and the times of its stages.
type Case = (&'static str, Measured);

#[derive(Clone)]
struct Measured {
    /// Names of stages and lower quartiles of their times, ms.
    stages: Vec<(&'static str, f64)>,
    /// Lower quartile of the sum of all stages.
    ours: f64,
    /// Lower quartile of the CPU time of a frame.
    frame: f64,
    sent: f64,
}

impl Measured {
    /// A case that was not measured.
    fn missing() -> Self {
        Self { stages: Vec::new(), ours: f64::NAN, frame: f64::NAN, sent: f64::NAN }
    }

    fn of(&self, stage: &str) -> f64 {
        self.stages.iter().find(|(name, _)| *name == stage).map_or(f64::NAN, |(_, ms)| *ms)
    }
}

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check(NAME)?;
    let own_meshes = |count: u32| count <= args.meshes;
    let cases: u32 = args.instances.iter().map(|count| if own_meshes(*count) { 7 } else { 6 }).sum();
    let progress = Progress::new(u64::from(cases * args.frames));
    let (mut columns, mut name) = (Vec::new(), String::new());
    for &count in &args.instances {
        let (mut app, instances) = crowd(args, count, 1)?;
        name = adapter_of(&app);
        let mut measure = |change| measure(args, &mut app, &instances, change, &progress);
        let mut cases = vec![
            ("one mesh, at rest", measure(Change::Nothing)?),
            ("100 in motion", measure(Change::Move(instances.len().min(100)))?),
            ("1 % in motion", measure(Change::Move(instances.len().div_ceil(100)))?),
            ("all in motion", measure(Change::Move(instances.len()))?),
            ("one more in each frame", measure(Change::Spawn)?),
            ("one comes and one goes in each frame", measure(Change::Exchange)?),
        ];
        drop(app);
        let mut at_rest = Measured::missing();
        if own_meshes(count) {
            let (mut app, instances) = crowd(args, count, count)?;
            at_rest = self::measure(args, &mut app, &instances, Change::Nothing, &progress)?;
        }
        cases.push(("a mesh and a material each, at rest", at_rest));
        columns.push((count.to_string(), cases));
    }
    let mut header = header(name, args.size);
    header.push(format!("ms of the CPU: lower quartiles over {} frames; direct light by the reference", args.frames));
    let shown = stages_to_show(&columns);
    let columns = columns.into_iter().map(|(name, cases)| (name, rows(&cases, &shown))).collect();
    let notes = vec!["Stages below 0.02 ms in every column are left out; the sums contain them.".into()];
    args.output.write(NAME, &Table { header, columns, notes })
}

/// A grid of squares that share this number of meshes and materials, before a camera.
fn crowd(args: &Args, count: u32, meshes: u32) -> Result<(App, Vec<Entity>), String> {
    let mut app = headless::app(Path::new("."), RayBackend::Auto)?;
    let world = app.world_mut();
    let looks: Vec<_> = (0..meshes)
        .map(|i| {
            let side = 0.5 + 0.3 * i as f32 / meshes as f32;
            let mesh = world.resource_mut::<Assets<Mesh>>().add(Rectangle::from_length(side));
            let gray = Color::linear_rgb(0.2, 0.2, side);
            (mesh, world.resource_mut::<Assets<StandardMaterial>>().add(gray))
        })
        .collect();
    let instances = (0..count).map(|i| spawn(world, &looks[i as usize % looks.len()], i, count)).collect();
    world.spawn((DirectionalLight::default(), Transform::default().looking_to(Vec3::NEG_ONE, Vec3::Y)));
    let side = (count as f32).sqrt();
    let eye = Transform::from_xyz(0.0, 0.0, side).looking_at(Vec3::ZERO, Vec3::Y);
    let projection = Projection::Perspective(PerspectiveProjection { far: 10.0 * side, ..default() });
    let settings = Restir { technique: Technique::Reference, bounces: 1, ..default() };
    let setup = CameraSetup { size: args.size, exposure: unit_exposure(), environment: None, settings };
    scene::spawn_camera(world, (eye, projection), setup);
    headless::until_ready(&mut app)?;
    Ok((app, instances))
}

type Look = (Handle<Mesh>, Handle<StandardMaterial>);

fn spawn(world: &mut World, (mesh, material): &Look, i: u32, count: u32) -> Entity {
    let columns = (count as f32).sqrt().ceil() as u32;
    let at = UVec2::new(i % columns, i / columns).as_vec2() - 0.5 * columns as f32;
    let at = Transform::from_translation(at.extend(0.0));
    world.spawn((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), at)).id()
}

fn measure(
    args: &Args,
    app: &mut App,
    instances: &[Entity],
    change: Change,
    progress: &Progress,
) -> Result<Measured, String> {
    let (mut stages, mut ours, mut frames, mut sent) = (Vec::<(_, Vec<f64>)>::new(), Vec::new(), Vec::new(), 0.0);
    // The first frames follow the case before.
    const SETTLE: u32 = 4;
    for number in 0..SETTLE + args.frames {
        apply(app.world_mut(), instances, change, number);
        let (_, cpu) = frame(app);
        headless::alive(app)?;
        if number < SETTLE {
            continue;
        }
        progress.step();
        let report = app.world().resource::<RestirStatistics>().report();
        stages.resize_with(report.cpu_ms.len(), || ("", Vec::new()));
        for ((name, all), (of, ms)) in stages.iter_mut().zip(&report.cpu_ms) {
            *name = of;
            all.push(f64::from(*ms));
        }
        ours.push(report.cpu_ms.iter().map(|(_, ms)| f64::from(*ms)).sum());
        frames.push(cpu);
        sent = report.uploaded_bytes as f64;
    }
    let stages = stages.into_iter().map(|(name, all)| (name, quartile(all))).collect();
    Ok(Measured { stages, ours: quartile(ours), frame: quartile(frames), sent })
}

fn apply(world: &mut World, instances: &[Entity], change: Change, number: u32) {
    match change {
        Change::Nothing => {}
        Change::Move(count) => {
            // Movers are spread over the memory of the scene.
            for entity in instances.iter().step_by(instances.len() / count) {
                if let Some(mut transform) = world.get_mut::<Transform>(*entity) {
                    transform.translation.z = 0.01 * (number % 7) as f32;
                }
            }
        }
        Change::Spawn => spawn_another(world, instances, number),
        Change::Exchange => {
            spawn_another(world, instances, number);
            // The first one stays, because others look like it.  Those that go are spread like movers.
            let others = instances.get(1..).unwrap_or_default();
            let gone = others.get((101 * number as usize) % others.len().max(1));
            if let Some(gone) = gone
                && let Ok(entity) = world.get_entity_mut(*gone)
            {
                entity.despawn();
            }
        }
    }
}

/// Spawns an instance that looks like the first one.
fn spawn_another(world: &mut World, instances: &[Entity], number: u32) {
    let first = instances.first().map(|first| world.entity(*first));
    let look = first.and_then(|e| Some((e.get::<Mesh3d>()?.0.clone(), e.get::<MeshMaterial3d<_>>()?.0.clone())));
    if let Some(look) = look {
        spawn(world, &look, number, instances.len() as u32);
    }
}

/// The lower quartile: other programs only ever lengthen a time.
fn quartile(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 4).copied().unwrap_or(f64::NAN)
}

/// The stages of each case that matter in some column.
fn stages_to_show(columns: &[(String, Vec<Case>)]) -> Vec<Vec<&'static str>> {
    let cases = columns.first().map_or(0, |(_, cases)| cases.len());
    let names: Vec<&str> = columns.iter().flat_map(|c| &c.1[0].1.stages).map(|(name, _)| *name).collect();
    (0..cases)
        .map(|case| {
            let matters = |name: &&str| columns.iter().any(|(_, cases)| cases[case].1.of(name) >= 0.02);
            let mut shown: Vec<&str> = Vec::new();
            for name in names.iter().filter(|name| matters(name)) {
                if !shown.contains(name) {
                    shown.push(name);
                }
            }
            shown
        })
        .collect()
}

fn rows(cases: &[Case], shown: &[Vec<&'static str>]) -> Vec<Row> {
    let mut rows = Vec::new();
    for ((section, m), shown) in cases.iter().zip(shown) {
        let mut row = |label: &str, unit, value| rows.push(Row::new(*section, label, &[("", unit, value)]));
        row("**all stages**", Unit::Ms, m.ours);
        shown.iter().for_each(|stage| row(stage, Unit::Ms, m.of(stage)));
        row("CPU time of the frame, Bevy's included", Unit::Ms, m.frame);
        row("scene bytes sent", Unit::Bytes, m.sent);
    }
    rows
}
