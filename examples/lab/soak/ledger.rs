//! The figures that a soak records in each round, and the comparison of the second half of the rounds with the first.

use bevy::render::{RenderApp, renderer::RenderInstance};
use bevy::{image::Image, mesh::Mesh, mesh::skinning::SkinnedMeshInverseBindposes, pbr::StandardMaterial, prelude::*};
use bevy_restir::{RestirReport, testing::lengths::table_lengths};
use std::{collections::BTreeMap, rc::Rc};

use crate::{heap, significance};

/// Share by which memory may grow.
const GROWTH: f64 = 0.02;
/// Bytes by which the heap may grow besides.
const SLACK: f64 = (1 << 20) as f64;
/// Figures of one round.
#[derive(Default)]
pub struct Round {
    /// Mean radiance of each frame.
    pub light: Vec<f64>,
    /// The most bytes of the plugin's buffers and textures.
    pub device_bytes: f64,
    /// Bytes of the heap, without those of the driver.
    pub heap_bytes: f64,
    /// Bytes of the process, where the system reports them.  They are not checked: Mesa 22.3's software driver copies shaders in each frame
    /// and keeps the copies.
    pub resident_bytes: Option<f64>,
    /// Numbers of things that are alive at the end, by name.  Rounds share the names, so that a long soak needs little memory for them.
    pub alive: BTreeMap<Rc<str>, f32>,
    pub milliseconds: f64,
}

impl Round {
    /// Records the end of a round, when only the permanent scene is left.
    pub fn end(&mut self, app: &App, report: &RestirReport, last: Option<&Self>) {
        (self.heap_bytes, self.resident_bytes) = (heap::bytes() as f64, resident_bytes());
        let world = app.world();
        let known = |name: &str| Some(last?.alive.get_key_value(name)?.0.clone());
        let mut count = |name: &str, number: usize| {
            self.alive.insert(known(name).unwrap_or_else(|| name.into()), number as f32);
        };
        count("entities", world.entity_count() as usize);
        count("meshes of the app", world.resource::<Assets<Mesh>>().len());
        count("materials of the app", world.resource::<Assets<StandardMaterial>>().len());
        count("images of the app", world.resource::<Assets<Image>>().len());
        count("skins of the app", world.resource::<Assets<SkinnedMeshInverseBindposes>>().len());
        count("pipelines", report.pipelines.len());
        for (name, number) in table_lengths(app) {
            count(&format!("table: {name}"), number);
        }
        let Some(render_app) = app.get_sub_app(RenderApp) else { return };
        count("entities of the renderer", render_app.world().entity_count() as usize);
        let instance = render_app.world().get_resource::<RenderInstance>();
        if let Some(report) = instance.and_then(|instance| instance.generate_report()) {
            count("buffers", report.hub.buffers.num_kept_from_user);
            count("textures", report.hub.textures.num_kept_from_user);
            count("texture views", report.hub.texture_views.num_kept_from_user);
            count("bind groups", report.hub.bind_groups.num_kept_from_user);
            count("shader modules", report.hub.shader_modules.num_kept_from_user);
        }
    }
}

/// Memory of this process that is in use.
fn resident_bytes() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: f64 = line.trim().split(' ').next()?.parse().ok()?;
    Some(1024.0 * kilobytes)
}

/// The rounds after the warm-up, in two halves.
pub struct Halves<'a>(pub &'a [Round], pub &'a [Round]);

/// Rounds in which capacities settle: one in eight, and at least two.
pub fn warm_up(rounds: usize) -> usize {
    (rounds / 8).max(2)
}

impl<'a> Halves<'a> {
    pub fn of(rounds: &'a [Round]) -> Self {
        let rest = &rounds[warm_up(rounds.len()).min(rounds.len())..];
        let (first, second) = rest.split_at(rest.len() / 2);
        Self(first, second)
    }

    /// The greatest values of both halves.
    pub fn most(&self, of: impl Fn(&Round) -> f64) -> [f64; 2] {
        [self.0, self.1].map(|half| half.iter().map(&of).fold(0.0, f64::max))
    }

    /// Medians in both halves; `None` without a value.
    pub fn medians(&self, of: impl Fn(&Round) -> Option<f64>) -> Option<[f64; 2]> {
        let median = |half: &[Round]| {
            let mut bytes: Vec<f64> = half.iter().filter_map(&of).collect();
            bytes.sort_by(f64::total_cmp);
            bytes.get(bytes.len() / 2).copied()
        };
        Some([median(self.0)?, median(self.1)?])
    }

    /// A line for each quantity that has grown.
    pub fn growth(&self) -> Vec<String> {
        let mut grown = Vec::new();
        let [before, after] = self.most(|round| round.device_bytes);
        if after > before * (1.0 + GROWTH) {
            grown.push(format!("memory of the device grows from {before} to {after} bytes"));
        }
        if let Some([before, after]) = self.medians(|round| Some(round.heap_bytes))
            && after > before * (1.0 + GROWTH) + SLACK
        {
            grown.push(format!("the heap grows from {before} to {after} bytes"));
        }
        for name in self.1.first().into_iter().flat_map(|round| round.alive.keys()) {
            let [before, after] = self.most(|round| round.alive.get(name).map_or(0.0, |number| f64::from(*number)));
            if after > before {
                grown.push(format!("{name}: {before} become {after}"));
            }
        }
        grown
    }

    /// How the light of each frame of the round, and their mean, drifts from round to round, in standard errors of this run, and the limit.
    pub fn light(&self) -> (Vec<f64>, f64) {
        let frames = self.0.first().map_or(0, |round| round.light.len());
        let of_round = |round: &Round| round.light.iter().sum::<f64>() / frames as f64;
        let values = |half: &[Round], frame: usize| -> Vec<f64> {
            half.iter().map(|round| round.light.get(frame).copied().unwrap_or_else(|| of_round(round))).collect()
        };
        let drift = |frame: usize| {
            let (before, after) = (values(self.0, frame), values(self.1, frame));
            // A step is a difference of the halves, and a steady change is a slope.
            let (step, slope) =
                (significance::difference(&before, &after), significance::slope(&[before, after].concat()));
            if slope.abs() > step.abs() { slope } else { step }
        };
        ((0..=frames).map(drift).collect(), significance::limit(self.0.len() + self.1.len()))
    }
}
