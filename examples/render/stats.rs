//! The file of `--stats`: measured times, counted rays, bytes of every buffer and texture.

use bevy::{prelude::*, render::renderer::RenderAdapterInfo};
use bevy_restir::{RestirStatistics, pass_names};
use bevy_restir_support::{headless, times::median};
use serde_json::{Value, json};
use std::collections::BTreeMap;

use crate::{Frames, aovs::frame_without_time, args::Args};

/// The contents of the file. Renders one more frame, in which the counters and the times of the last one arrive.
pub fn of_last_frame(app: &mut App, args: &Args, budget_step: u32, frames: &mut Frames) -> Result<Value, String> {
    frame_without_time(app);
    headless::alive(app)?;
    frames.passes.sample(app.world(), &frames.settings);
    Ok(json(app.world(), args, budget_step, frames))
}

fn json(world: &World, args: &Args, budget_step: u32, frames: &Frames) -> Value {
    let non_finite = frames.pixels.iter().filter(|p| !p.iter().all(|c| c.is_finite())).count() as u64;
    let report = world.resource::<RestirStatistics>().report();
    let guards: BTreeMap<_, _> = report.guards.iter().copied().collect();
    let passes: Vec<Value> = pass_names(&frames.settings, report.features)
        .into_iter()
        .map(|name| (name, frames.passes.of(name)))
        .filter(|(_, values)| !values.is_empty())
        .map(|(name, values)| {
            json!({
                "name": name,
                "ms_median": median(values),
                "ms_min": values.iter().copied().fold(f64::INFINITY, f64::min),
                "ms_max": values.iter().copied().fold(0.0, f64::max),
            })
        })
        .collect();
    let total: u64 = report.memory.iter().map(|(_, bytes)| bytes).sum();
    json!({
        "adapter": world.resource::<RenderAdapterInfo>().name,
        "backend": report.backend,
        "technique": format!("{:?}", frames.settings.technique).to_lowercase(),
        "preset": format!("{:?}", args.preset).to_lowercase(),
        "size": [args.size.x, args.size.y],
        "frames": args.frames,
        "features": report.features.names(),
        "passes": passes,
        "frame_ms_median": median(&frames.all_ms),
        "cpu_ms_median": median(&frames.cpu_ms),
        "cpu_stages": frames.stages.iter().map(|(name, ms)| json!({"name": name, "ms_last_frame": ms})).collect::<Vec<_>>(),
        "rays_per_frame": report.rays,
        "light_paths_per_frame": report.light_paths,
        "light_vertices_per_frame": report.light_vertices,
        "splats_per_frame": report.splats,
        "memory": {
            "total_bytes": total,
            "reservoir_bytes_per_pixel": report.reservoir_bytes_per_pixel,
            "items": report.memory.iter().map(|(name, bytes)| json!({"name": name, "bytes": bytes})).collect::<Vec<_>>(),
        },
        "pipelines": report.pipelines.iter().map(|p| json!({
            "name": p.name, "defs": p.defs, "compile_ms": p.compile_ms,
        })).collect::<Vec<_>>(),
        "uploaded_bytes_last_frame": frames.uploaded_bytes,
        "non_finite_pixels": non_finite + guards.get("non_finite").copied().unwrap_or_default(),
        "overflow_flags": report.overflow_flags,
        "guards": guards,
        "resets": report.history_resets.iter().copied().collect::<BTreeMap<_, _>>(),
        "budget_step": budget_step,
        "triangles": report.triangles,
        "instances": report.instances,
        "lights": report.lights,
    })
}
