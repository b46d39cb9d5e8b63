//! CPU time of each stage of a frame.  A measurement costs two reads of the clock.

use bevy::{ecs::resource::Resource, platform::time::Instant};
use core::sync::atomic::{AtomicU64, Ordering};

/// A part of the plugin's work on the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    ExtractInstances,
    ExtractLights,
    ExtractMaterials,
    ExtractViews,
    Handoff,
    Meshes,
    Materials,
    Textures,
    Bodies,
    Instances,
    Lights,
    TopLevel,
    Upload,
    Bindings,
    Summary,
    Environments,
    Pipelines,
    Views,
    Passes,
    Report,
}

impl Stage {
    /// All stages in their order within a frame, with their names in the report.
    const ALL: [(Self, &str); 20] = [
        (Self::ExtractInstances, "extract_instances"),
        (Self::ExtractLights, "extract_lights"),
        (Self::ExtractMaterials, "extract_materials"),
        (Self::ExtractViews, "extract_views"),
        (Self::Handoff, "handoff"),
        (Self::Meshes, "meshes"),
        (Self::Materials, "materials"),
        (Self::Textures, "textures"),
        (Self::Bodies, "bodies"),
        (Self::Instances, "instances"),
        (Self::Lights, "lights"),
        (Self::TopLevel, "top_level"),
        (Self::Upload, "upload"),
        (Self::Bindings, "bindings"),
        (Self::Summary, "summary"),
        (Self::Environments, "environments"),
        (Self::Pipelines, "pipelines"),
        (Self::Views, "views"),
        (Self::Passes, "passes"),
        (Self::Report, "report"),
    ];
}

/// Times since the last report, nanoseconds.
#[derive(Resource, Debug, Default)]
pub(crate) struct CpuTimes([AtomicU64; Stage::ALL.len()]);

impl CpuTimes {
    /// Measures a stage until the returned value is dropped.
    pub(crate) fn measure(&self, stage: Stage) -> Running<'_> {
        Running { sum: &self.0[stage as usize], start: Instant::now() }
    }

    /// Names and milliseconds of all stages since the last call.
    pub(crate) fn take(&self) -> Vec<(&'static str, f32)> {
        let take = |(sum, (_, name)): (&AtomicU64, (Stage, &'static str))| {
            (name, sum.swap(0, Ordering::Relaxed) as f32 * 1e-6)
        };
        self.0.iter().zip(Stage::ALL).map(take).collect()
    }
}

/// Measures a stage until it is dropped.
#[must_use]
pub(crate) struct Running<'a> {
    sum: &'a AtomicU64,
    start: Instant,
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        self.sum.fetch_add(self.start.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_has_its_own_sum() {
        let times = CpuTimes::default();
        for (i, (stage, name)) in Stage::ALL.into_iter().enumerate() {
            assert_eq!(stage as usize, i, "{name}");
            drop(times.measure(stage));
            let measured: Vec<_> = times.take().into_iter().filter(|(_, ms)| *ms > 0.0).collect();
            assert!(measured.len() <= 1 && measured.iter().all(|(of, _)| *of == name), "{measured:?}");
        }
    }
}
