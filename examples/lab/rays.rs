//! Cost of rays by both back ends: rates in generated scenes compared with a bare kernel, build times and bytes of both levels of the
//! acceleration structure, and frame times of an app with ten thousand moving instances.

use bevy::{
    prelude::*,
    render::renderer::{RenderDevice, RenderQueue, WgpuWrapper},
};
use bevy_restir::{
    RayBackend, Restir, RestirStatistics, Technique,
    testing::gpu_layout::{NODE_STRIDE, Rows},
    testing::{
        accel::blas::{Bounds, build_blas},
        accel::ray_query::{AccelerationStructures, INSTANCE_SIZE, Placed},
        accel::tlas::{build_tlas, world_bounds},
        geometry::triangulate::Geometry,
    },
};
use bevy_restir_support::{
    compose::{Def, flag},
    exposure::unit_exposure,
    gpu::{Gpu, back_ends},
    headless::{self, alive, frame, until_ready},
    scene::{self, CameraSetup},
    scenes::{Random, Ray, TestScene, random_rows, ray, sphere},
    times::median,
};
use std::{path::Path, sync::Arc, time::Instant};

use crate::{
    bench::adapter_of,
    output::{Output, provenance},
    table::{Row, Table, Unit},
};

const SPEED: &str = include_str!("kernels/trace_speed.wgsl");
const BARE: &str = include_str!("kernels/bare.wgsl");

/// Numbers of triangles of the large mesh and of the small one.
const LARGE: usize = 512_000;
const SMALL: usize = 200;

/// Rays per second, build times and memory of the acceleration structures, for both ray back ends.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    output: Output,
    /// Number of rays of a dispatch.
    #[arg(long, default_value_t = 1 << 19, value_parser = clap::value_parser!(u32).range(64..=4_194_240))]
    rays: u32,
    /// Number of dispatches whose median time counts.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    repeat: u32,
    /// Number of instances of the small mesh.
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    instances: u32,
    /// Number of timed frames of the app.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(2..))]
    frames: u32,
}

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check("rays")?;
    let back_ends = back_ends();
    if back_ends.is_empty() {
        return Err("there is no GPU adapter".into());
    }
    let large = Scene::large();
    let small = Scene::small(args.instances);
    let mut columns = Vec::new();
    let mut adapter = String::new();
    for (gpu, defs) in back_ends {
        let hardware = !defs.is_empty();
        let name = if hardware { "hardware" } else { "software" };
        let mut rows = Vec::new();
        for scene in [&large, &small] {
            println!("{name}: {}", scene.name);
            rows.extend(rates(args, gpu, &defs, scene));
        }
        println!("{name}: builds");
        rows.extend(builds(args, gpu, hardware, &large, &small));
        println!("{name}: an app");
        let backend = if hardware { RayBackend::Hardware } else { RayBackend::Software };
        rows.extend(in_an_app(args, backend, &mut adapter)?);
        columns.push((name.to_string(), rows));
    }
    let mut header = provenance(Some(adapter));
    header.push(format!(
        "medians of {} dispatches of {} rays, of {} frames; a CPU's rates are by its CPU time over all cores",
        args.repeat, args.rays, args.frames
    ));
    args.output.write("rays", &Table { header, columns, notes: Vec::new() })
}

/// A generated scene and rays through it.
struct Scene {
    name: String,
    scene: TestScene,
    mesh: Geometry,
    /// Incoherent rays start within `inside` of the center, coherent ones at the distance `outside`.
    inside: f32,
    outside: f32,
}

impl Scene {
    /// One bumpy sphere with the rays inside it.
    fn large() -> Self {
        let mesh = sphere(LARGE / 1024 + 1, 512, 0.1, |p| p);
        assert_eq!(mesh.triangles.len(), LARGE);
        let scene = TestScene::of(mesh.clone());
        Self { name: format!("{LARGE} triangles"), scene, mesh, inside: 0.5, outside: 2.5 }
    }

    /// Rotated, stretched and mirrored bumpy spheres that fill a cube.
    fn small(count: u32) -> Self {
        let mesh = sphere(SMALL / 20 + 1, 10, 0.2, |p| p);
        assert_eq!(mesh.triangles.len(), SMALL);
        let mut random = Random::new(71);
        let instances: Vec<_> = (0..count).map(|_| (0, random_rows(&mut random, 0.03, 1.0), 0, 0)).collect();
        let scene = TestScene::new(std::slice::from_ref(&mesh), &instances);
        Self { name: format!("{count} instances of {SMALL} triangles"), scene, mesh, inside: 1.0, outside: 3.0 }
    }

    /// Rays of a pinhole camera, 8 x 8 pixels per workgroup.
    fn coherent(&self, count: usize) -> Vec<Ray> {
        let side = (count as f32).sqrt() as usize / 8 * 8;
        let eye = [0.0, 0.0, self.outside];
        let pixel = |i: usize| {
            let (tile, within) = (i / 64, i % 64);
            let across = side / 8;
            let x = (tile % across * 8 + within % 8) as f32 / side as f32 - 0.5;
            let y = (tile / across * 8 + within / 8) as f32 / side as f32 - 0.5;
            ray(eye, [x, y, -1.0])
        };
        (0..side * side).map(pixel).collect()
    }

    /// Rays with random origins and directions.
    fn incoherent(&self, count: usize) -> Vec<Ray> {
        let mut random = Random::new(72);
        (0..count).map(|_| ray(random.point(self.inside), random.direction())).collect()
    }
}

fn wait(gpu: &Gpu) {
    let _ = gpu.device.poll(wgpu::PollType::wait_indefinitely());
}

/// Seconds of CPU time of a task by the operating system; `None` where it does not report them.
fn run_time(of: &str) -> Option<f64> {
    let text = std::fs::read_to_string(format!("{of}/schedstat")).ok()?;
    Some(text.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}

/// Seconds of CPU time of all threads of this process.
fn process_time() -> Option<f64> {
    let tasks = std::fs::read_dir("/proc/self/task").ok()?;
    Some(tasks.flatten().filter_map(|task| run_time(&task.path().to_string_lossy())).sum())
}

/// Seconds from start to end of `work`.
fn wall_seconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// Median seconds of `work` including the device's part. Where the device is the CPU, they are its CPU time divided by the cores.
fn seconds(repeat: u32, gpu: &Gpu, mut work: impl FnMut()) -> f64 {
    let cores = std::thread::available_parallelism().map_or(1.0, |cores| cores.get() as f64);
    let once = |work: &mut dyn FnMut()| {
        wait(gpu);
        let (start, before) = (Instant::now(), process_time());
        work();
        wait(gpu);
        match (before, process_time()) {
            (Some(before), Some(after)) if gpu.is_cpu => (after - before) / cores,
            _ => start.elapsed().as_secs_f64(),
        }
    };
    // The first dispatch may compile.
    once(&mut work);
    let all: Vec<f64> = (0..repeat).map(|_| once(&mut work)).collect();
    median(&all)
}

fn rates(args: &Args, gpu: &Gpu, backend: &[Def], scene: &Scene) -> Vec<Row> {
    let count = args.rays as usize;
    let mut rows = Vec::new();
    for (kind, rays) in [("coherent", scene.coherent(count)), ("incoherent", scene.incoherent(count))] {
        let structures = (!backend.is_empty()).then(|| scene.scene.structures(gpu));
        let uploaded = scene.scene.upload(gpu, structures, &rays, rays.len() * 4);
        let rate = |name: &str, source: &str, defs: &[Def]| {
            let kernel = gpu.kernel(name, source, defs);
            rays.len() as f64 / seconds(args.repeat, gpu, || uploaded.run(&kernel)) / 1e6
        };
        let closest = rate("closest", SPEED, backend);
        let any = rate("any", SPEED, &[backend, &[flag("ANY_HIT")]].concat());
        let figures = [("closest", Unit::Rate, closest), ("any", Unit::Rate, any)];
        rows.push(Row::new(scene.name.clone(), format!("{kind} rays"), &figures));
        if scene.scene.instances.len() == 1 {
            // Shaders cannot walk the acceleration structures of the device.
            let bare = if backend.is_empty() { rate("bare", BARE, &[]) } else { f64::NAN };
            let figures = [("closest", Unit::Rate, bare), ("ours", Unit::Ratio, closest / bare)];
            rows.push(Row::new(scene.name.clone(), format!("{kind} rays, a bare kernel"), &figures));
        }
    }
    rows
}

fn builds(args: &Args, gpu: &Gpu, hardware: bool, large: &Scene, small: &Scene) -> Vec<Row> {
    const SECTION: &str = "Builds and bytes";
    let mut blas = None;
    let ours = wall_seconds(|| blas = build_blas(&large.mesh));
    let blas = blas.expect("it has triangles");
    let per_triangle = |bytes: usize| bytes as f64 / LARGE as f64;
    let nodes = if hardware { 0 } else { blas.nodes.len() * 16 };
    let bytes = nodes + size_of_val(&*blas.triangles) + size_of_val(&*blas.vertices);

    // Every build gets new transforms of all instances.
    let mut random = Random::new(73);
    let moved = || -> Vec<Rows> {
        let one = |instance: &bevy_restir::testing::gpu_layout::GpuInstance| {
            let mut rows = instance.world_from_object;
            rows.iter_mut().for_each(|row| row[3] += random.range(-0.01, 0.01));
            rows
        };
        small.scene.instances.iter().map(one).collect()
    };
    let built =
        if hardware { hardware_builds(args, gpu, large, small, moved) } else { software_builds(args, small, moved) };
    // The first two builds allocate the buffers that the others reuse.
    let ms = |all: &[f64]| median(&all[2..]) * 1e3;
    vec![
        Row::new(
            SECTION,
            format!("bottom level of {LARGE} triangles"),
            &[("on a core", Unit::Ms, ours * 1e3), ("on the device", Unit::Ms, built.bottom * 1e3)],
        ),
        Row::new(
            SECTION,
            format!("top level of {} instances (demanded: at most 2.5 ms)", args.instances),
            &[("on a core", Unit::Ms, ms(&built.cpu)), ("until the device has it", Unit::Ms, ms(&built.all))],
        ),
        Row::new(SECTION, "sent to the device", &[("", Unit::Bytes, built.sent)]),
        Row::new(SECTION, "trees, where they are ours", &[("", Unit::BytesATriangle, per_triangle(nodes))]),
        Row::new(SECTION, "trees, corners and attributes", &[("", Unit::BytesATriangle, per_triangle(bytes))]),
    ]
}

/// Times of building a bottom level once, and a top level many times; seconds.
struct Built {
    bottom: f64,
    /// Of the CPU, and until the device has it.
    cpu: Vec<f64>,
    all: Vec<f64>,
    /// Bytes that are sent for a top level.
    sent: f64,
}

/// Top levels of the software back end; the caller measures its bottom level.
fn software_builds(args: &Args, small: &Scene, mut moved: impl FnMut() -> Vec<Rows>) -> Built {
    let object: Bounds = build_blas(&small.mesh).expect("it has triangles").bounds;
    let mut built = Built { bottom: f64::NAN, cpu: Vec::new(), all: Vec::new(), sent: 0.0 };
    for _ in 0..args.repeat + 2 {
        let rows = moved();
        let start = Instant::now();
        let mut tlas = None;
        built.cpu.push(wall_seconds(|| {
            let boxes: Vec<_> = rows
                .iter()
                .enumerate()
                .filter_map(|(i, rows)| Some((i as u32, world_bounds(rows, &object)?)))
                .collect();
            tlas = Some(build_tlas(&boxes));
        }));
        built.all.push(start.elapsed().as_secs_f64());
        let tlas = tlas.expect("it was built");
        built.sent = ((tlas.nodes.len() + tlas.indices.len()) * 16).next_multiple_of(NODE_STRIDE as usize * 16) as f64;
    }
    built
}

/// The device's own acceleration structures.
fn hardware_builds(
    args: &Args,
    gpu: &Gpu,
    large: &Scene,
    small: &Scene,
    mut moved: impl FnMut() -> Vec<Rows>,
) -> Built {
    let device = RenderDevice::new(WgpuWrapper::new(gpu.device.clone()));
    let queue = RenderQueue(Arc::new(WgpuWrapper::new(gpu.queue.clone())));
    let placed = |scene: &Scene, rows: &[Rows]| -> Vec<Placed> {
        let one = |(slot, rows): (usize, &Rows)| Placed {
            slot: slot as u32,
            version: 1,
            rebuild: false,
            triangles: 0..scene.scene.triangles.len() as u32,
            vertices_end: scene.scene.vertices.len() as u32,
            world_from_object: *rows,
            opaque: true,
            mask: 0xff,
        };
        rows.iter().enumerate().map(one).collect()
    };
    let large_inputs = large.scene.inputs_of_structures(&device);
    let small_inputs = small.scene.inputs_of_structures(&device);
    let here = placed(large, &[large.scene.instances[0].world_from_object]);
    let bottom = seconds(1, gpu, || {
        AccelerationStructures::default().update(&here, large_inputs.each_ref(), &device, &queue);
    });
    let mut built = Built { bottom, cpu: Vec::new(), all: Vec::new(), sent: 0.0 };
    let mut structures = AccelerationStructures::default();
    for _ in 0..args.repeat + 2 {
        let placed = placed(small, &moved());
        wait(gpu);
        let start = Instant::now();
        let mut sent = 0.0;
        built
            .cpu
            .push(wall_seconds(|| sent = structures.update(&placed, small_inputs.each_ref(), &device, &queue) as f64));
        wait(gpu);
        built.all.push(start.elapsed().as_secs_f64());
        built.sent = sent;
    }
    assert_eq!(built.sent, (args.instances as u64 * INSTANCE_SIZE) as f64);
    built
}

/// An instance that moves.
#[derive(Component)]
struct Turns;

/// Frame times of an app, Bevy's share included, and uploaded bytes: first with instances at rest, then with all of them moving.
fn in_an_app(args: &Args, backend: RayBackend, adapter: &mut String) -> Result<Vec<Row>, String> {
    let mut app = headless::app(Path::new("."), backend)?;
    *adapter = adapter_of(&app);
    let world = app.world_mut();
    let mesh = world.resource_mut::<Assets<Mesh>>().add(Cuboid::new(0.02, 0.03, 0.04).mesh().build());
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(Color::WHITE);
    let mut random = Random::new(74);
    for _ in 0..args.instances {
        let at = Transform::from_translation(Vec3::from(random.point(1.0)));
        world.spawn((Turns, Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), at));
    }
    world.spawn((DirectionalLight::default(), Transform::default().looking_to(Vec3::NEG_ONE, Vec3::Y)));
    let eye = Transform::from_xyz(0.0, 0.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y);
    let settings = Restir { technique: Technique::Reference, bounces: 1, ..Default::default() };
    let setup = CameraSetup { size: UVec2::splat(16), exposure: unit_exposure(), environment: None, settings };
    scene::spawn_camera(world, (eye, Projection::default()), setup);
    until_ready(&mut app)?;
    for _ in 0..4 {
        frame(&mut app);
    }
    let (still_ms, still_bytes) = measured(args, &mut app);
    app.add_systems(Update, |mut turning: Query<&mut Transform, With<Turns>>| {
        for mut transform in &mut turning {
            transform.rotate_y(0.1);
            transform.translation.x += 0.001;
        }
    });
    for _ in 0..4 {
        frame(&mut app);
    }
    let (moving_ms, moving_bytes) = measured(args, &mut app);
    alive(&app)?;
    let section = format!("{} instances in an app", args.instances);
    Ok(vec![
        Row::new(
            section.clone(),
            "CPU time of a frame, Bevy's included",
            &[("still", Unit::Ms, still_ms), ("all in motion", Unit::Ms, moving_ms)],
        ),
        Row::new(
            section,
            "scene bytes sent a frame",
            &[("still", Unit::Bytes, still_bytes), ("all in motion", Unit::Bytes, moving_bytes)],
        ),
    ])
}

/// Medians of the CPU time and of the uploaded bytes of a frame.
fn measured(args: &Args, app: &mut App) -> (f64, f64) {
    let (mut ms, mut bytes) = (Vec::new(), Vec::new());
    for _ in 0..args.frames {
        ms.push(frame(app).1);
        bytes.push(app.world().resource::<RestirStatistics>().report().uploaded_bytes as f64);
    }
    (median(&ms), median(&bytes))
}
