//! Decides when the accumulation of a view and its history continue, and when they restart.

use super::{RestirView, extract::ExtractedEnvironment};
use crate::{gpu_layout::GpuCamera, settings::Restir, technique::frame::PipelineKey};
use bevy::math::UVec2;

/// Everything that the expected image depends on, that is, everything but the random numbers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ImageState {
    /// Counts moves of instances and changes of lights.
    pub motion_revision: u64,
    /// Counts all other changes of the scene.
    pub edit_revision: u64,
    pub environment_revision: u64,
    pub camera: GpuCamera,
    pub size: UVec2,
    /// The settings, without those that leave the image as it is.
    pub settings: Restir,
    pub environment: Option<ExtractedEnvironment>,
    pub layers: u32,
    pub background: [f32; 3],
    /// Whether the projection is orthographic.  Uniforms have one such flag for both this frame's and the last frame's camera.
    pub orthographic: bool,
    pub pipelines: PipelineKey,
}

impl ImageState {
    /// Whether a frame may be averaged with the frames before it: the expected image must be identical.
    fn can_accumulate_onto(&self, last: &Self) -> bool {
        self == last
    }

    /// Whether temporal reuse may read the last frame's reservoirs.  It handles changes of instances, lights, the camera, and the rotation and
    /// color of the environment.  The background may change because no path contains it.
    fn can_reuse_history_of(&self, last: &Self) -> bool {
        let Self { motion_revision, camera, background, .. } = *self;
        let environment = match (self.environment, last.environment) {
            (Some(now), Some(last)) => Some(ExtractedEnvironment { rotation: now.rotation, color: now.color, ..last }),
            _ => last.environment,
        };
        *self == Self { motion_revision, camera, background, environment, ..last.clone() }
    }

    /// Whether paths of the last frame may have another contribution now.
    fn has_moved_since(&self, last: &Self) -> bool {
        self.motion_revision != last.motion_revision || self.environment != last.environment
    }

    /// Whether the random sequence continues.  Changes of the scene and the camera must not restart it, because the noise would freeze while
    /// they last.
    fn continues_sequence_of(&self, last: &Self) -> bool {
        self.settings == last.settings && self.pipelines == last.pipelines
    }
}

impl RestirView {
    /// Advances the frame counters of accumulation, history and random numbers, or restarts those that `state` invalidates.
    pub(super) fn advance(&mut self, state: ImageState, settings: &Restir) {
        // Techniques without reservoirs have no other history than their sum.
        let is_progressive = self.key.is_none_or(|key| key.frame.domains().is_empty());
        let last = self.image_state.as_ref().filter(|_| !settings.reset);
        let can_accumulate = last.is_some_and(|last| state.can_accumulate_onto(last));
        let can_reuse = last.is_some_and(|last| state.can_reuse_history_of(last));
        let keeps_history = if is_progressive { can_accumulate } else { can_reuse };
        let keeps_sequence = last.is_some_and(|last| state.continues_sequence_of(last));
        let accumulates = is_progressive || settings.accumulate;
        self.moved = last.is_some_and(|last| state.has_moved_since(last));
        self.frame = if keeps_history { self.frame.saturating_add(1) } else { 0 };
        self.sequence = if keeps_sequence { self.sequence.wrapping_add(1) } else { 0 };
        let has_sum = can_accumulate && accumulates && self.accumulates;
        self.accumulated = if has_sum { self.accumulated.saturating_add(1) } else { 0 };
        self.accumulates = accumulates;
        self.image_state = Some(state);
    }
}
