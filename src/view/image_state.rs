//! Decides when the accumulation of a view and its history continue, and when they restart.

use super::{RestirView, extract::ExtractedEnvironment};
use crate::{gpu_layout::GpuCamera, scene::SceneFeatures, settings::Restir, technique::frame::PipelineKey};
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
    /// The settings that the app asked for, without those that leave the image as it is.
    pub settings: Restir,
    pub environment: Option<ExtractedEnvironment>,
    pub layers: u32,
    pub background: [f32; 3],
    /// Whether pixels without a surface show what lies behind the image.  `Jitter::Auto` depends on it.
    pub shows_earlier: bool,
    /// Whether the projection is orthographic, and whether the camera sees back faces.  Uniforms have one flag for both this frame's and the
    /// last frame's camera.
    pub orthographic: bool,
    pub sees_back_faces: bool,
    pub pipelines: PipelineKey,
}

/// Why the history of a view restarted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reset {
    /// The first frame, or the frame before was not rendered.
    Start,
    /// `Restir::reset`.
    Requested,
    /// An edit of the scene that histories do not survive.
    Scene,
    Size,
    Settings,
    RenderLayers,
    /// From perspective to orthographic, from front faces to back faces, or back.
    Projection,
    /// The technique or the debug view changed, the first translucent object appeared or the last one disappeared, or pipelines have been
    /// compiled for the first light of a kind, the first material with a new kind of paths, or the first object that render layers hide.
    Pipelines,
}

impl Reset {
    /// All reasons with their names in the report.
    const ALL: [(Self, &str); 8] = [
        (Self::Start, "start"),
        (Self::Requested, "requested"),
        (Self::Scene, "scene"),
        (Self::Size, "size"),
        (Self::Settings, "settings"),
        (Self::RenderLayers, "render_layers"),
        (Self::Projection, "projection"),
        (Self::Pipelines, "pipelines"),
    ];
}

/// How often the history of a view restarted, by reason.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ResetCounts([u64; Reset::ALL.len()]);

impl ResetCounts {
    fn count(&mut self, reset: Reset) {
        let counts = Reset::ALL.iter().zip(&mut self.0);
        counts.filter(|((of, _), _)| *of == reset).for_each(|(_, count)| *count += 1);
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, count)| *sum += count);
    }

    /// Names and numbers of all reasons.
    pub(crate) fn named(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Reset::ALL.into_iter().zip(self.0).map(|((_, name), count)| (name, count))
    }
}

impl ImageState {
    /// Whether a frame may be averaged with the frames before it: the expected image must be identical.
    fn can_accumulate_onto(&self, last: &Self) -> bool {
        // A feature that the scene has lost leaves the image as it is.  So do counts of rays, and pairs and the number of neighbors, which a
        // budget may change.
        let new_features =
            self.pipelines.features.of_pictures() - last.pipelines.features - SceneFeatures::MANY_NEIGHBORS;
        self.pipelines.reads_reservoirs_of(last.pipelines)
            && new_features.is_empty()
            && Self { pipelines: last.pipelines, ..self.clone() } == *last
    }

    /// The changes after which temporal reuse must not read the last frame's reservoirs.  It handles changes of instances, lights, the camera,
    /// the environment, and the number of samples.  The background may change because no path contains it.
    fn resets_since(&self, last: &Self) -> impl Iterator<Item = Reset> {
        // All fields are named, so that a new one cannot be forgotten.
        let Self {
            motion_revision: _,
            edit_revision,
            environment_revision: _,
            camera: _,
            size,
            settings,
            environment: _,
            layers,
            background: _,
            shows_earlier: _,
            orthographic,
            sees_back_faces,
            pipelines,
        } = self;
        [
            (Reset::Scene, *edit_revision != last.edit_revision),
            (Reset::Size, *size != last.size),
            (Reset::Settings, settings.history_key() != last.settings.history_key()),
            (Reset::RenderLayers, *layers != last.layers),
            (Reset::Projection, (*orthographic, *sees_back_faces) != (last.orthographic, last.sees_back_faces)),
            (
                Reset::Pipelines,
                !pipelines.reads_reservoirs_of(last.pipelines) || pipelines.samples_more_than(last.pipelines),
            ),
        ]
        .into_iter()
        .filter_map(|(reset, changed)| changed.then_some(reset))
    }

    /// Whether paths of the last frame may have another contribution now.
    fn has_moved_since(&self, last: &Self) -> bool {
        // New shaders may give the light of a path another value.
        self.motion_revision != last.motion_revision || !self.has_environment_of(last)
    }

    /// Whether the environment and the shaders are those of the last frame.
    fn has_environment_of(&self, last: &Self) -> bool {
        let [features, of_last] = [self, last].map(|state| state.pipelines.features.of_pictures());
        self.environment == last.environment && self.has_environment_image_of(last) && features == of_last
    }

    /// Whether this frame and the last one both have an environment with the same image, or both have none.
    fn has_environment_image_of(&self, last: &Self) -> bool {
        let image = |state: &Self| (state.environment.map(ExtractedEnvironment::key), state.environment_revision);
        image(self) == image(last)
    }

    /// Whether the random sequence continues.  Changes of the scene, the camera and the number of samples must not restart it, because the
    /// noise would freeze while they last.
    fn continues_sequence_of(&self, last: &Self) -> bool {
        self.settings.history_key() == last.settings.history_key() && self.pipelines.reads_reservoirs_of(last.pipelines)
    }
}

impl RestirView {
    /// Advances the frame counters of accumulation, history and random numbers, or restarts those that `state` invalidates.
    pub(super) fn advance(&mut self, state: ImageState, settings: &Restir) {
        // Techniques without reservoirs have no other history than their sum.
        let is_progressive = self.key.is_none_or(|key| key.frame.domains().is_empty());
        let last = self.image_state.as_ref().filter(|_| !settings.reset);
        let can_accumulate = last.is_some_and(|last| state.can_accumulate_onto(last));
        let mut resets = ResetCounts::default();
        match (last, settings.reset) {
            (_, true) => resets.count(Reset::Requested),
            (None, false) => resets.count(self.beginning),
            (Some(last), false) => state.resets_since(last).for_each(|reset| resets.count(reset)),
        }
        self.beginning = Reset::Start;
        let can_reuse = resets.named().all(|(_, count)| count == 0);
        let keeps_history = if is_progressive { can_accumulate } else { can_reuse };
        let keeps_sequence = last.is_some_and(|last| state.continues_sequence_of(last));
        let sums = self.key.is_none_or(|key| key.frame.sums());
        let accumulates = sums && (is_progressive || settings.accumulate);
        self.moved = last.is_some_and(|last| state.has_moved_since(last));
        self.same_environment = last.is_some_and(|last| state.has_environment_of(last));
        self.same_environment_image = last.is_some_and(|last| state.has_environment_image_of(last));
        self.still = can_accumulate;
        if !is_progressive {
            self.resets.add(&resets);
        }
        self.frame = if keeps_history { self.frame.saturating_add(1) } else { 0 };
        let first_sequence = core::mem::take(&mut self.first_sequence);
        self.sequence = match keeps_sequence {
            true => self.sequence.wrapping_add(1),
            false if settings.reset => 0,
            false => first_sequence,
        };
        let has_sum = can_accumulate && accumulates && self.accumulates;
        self.accumulated = if has_sum { self.accumulated.saturating_add(1) } else { 0 };
        self.accumulates = accumulates;
        self.image_state = Some(state);
    }
}
