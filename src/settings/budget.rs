//! [`RestirBudget`], and the settings that a frame may use instead of those of the camera to take less time.

use bevy::{
    ecs::{reflect::ReflectResource, resource::Resource},
    reflect::{Reflect, std_traits::ReflectDefault},
};

use super::{Restir, Reuse, ReuseOrder, Technique};

/// Keeps the GPU time of lighting below a limit: where a camera's [`Restir`] would take longer, its number of samples is reduced
/// ([`Restir::reduced`]), and it is raised again when the scene gets cheaper.  Fewer samples give more noise, add no bias and keep the history.
/// If they are not enough, [`least_resolution_scale`](Self::least_resolution_scale) lets the traced resolution fall, too, which restarts the
/// history.
///
/// Times arrive about three frames late, and the settings change after four times that are too long: after a jump of the cost, about seven
/// frames take too long, and ten more if fewer samples save less than expected.  Where the cost doubles within 200 frames, times exceed the
/// limit by less than a tenth.  Bounces and technique never change, nor do the light paths of [`Technique::Bdpt`] and the samples of
/// [`Restir::subsurface`], so a limit that is too low for them is not kept.
/// [`RestirReport::budget_step`](crate::RestirReport::budget_step) says how far the settings are reduced.
///
/// Needs Bevy's `RenderDiagnosticsPlugin` and a device with timestamps (on macOS, the times of some passes are missing).  Without them there is
/// one warning, and cameras use their settings as they are.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_restir::prelude::*;
/// # fn build(app: &mut App) {
/// use bevy::render::diagnostic::RenderDiagnosticsPlugin;
///
/// app.add_plugins(RenderDiagnosticsPlugin).insert_resource(RestirBudget { gpu_ms: 8.0, ..default() });
/// # }
/// ```
#[derive(Resource, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Resource, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct RestirBudget {
    /// Greatest GPU time of all passes of the plugin (time spans `restir/...`) of all cameras in a frame, ms.  Bevy measures at most 128 passes
    /// in a frame, its own included: from the fifth camera on, the times of some passes of the plugin are missing.  No bias.  0 or less: no
    /// limit; default 0.
    pub gpu_ms: f32,
    /// Least [`Restir::resolution_scale`] that the budget may choose where the fewest samples of all cameras still take too long.  Each step
    /// traces 0.8 times the width and the height, and restarts the camera's history, which is visible as noise for some frames.  Cameras
    /// that average frames ([`Restir::accumulate`], [`Technique::Reference`]) keep their resolution.  A resolution that took too long is not
    /// tried again within about 1,800 frames, unless the scene gets cheaper.  0.25 to 1; default 1: the resolution stays.
    pub least_resolution_scale: f32,
}

impl Default for RestirBudget {
    fn default() -> Self {
        Self { gpu_ms: 0.0, least_resolution_scale: 1.0 }
    }
}

/// How far the settings of all cameras are reduced.  A camera that has fewer steps of a kind takes all that it has.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reduction {
    /// Number of steps that take samples away.
    pub samples: u32,
    /// Number of steps that take traced pixels away.
    pub pixels: u32,
    /// Least resolution scale that these steps may choose.
    pub least_resolution_scale: f32,
}

impl Default for Reduction {
    fn default() -> Self {
        Self { samples: 0, pixels: 0, least_resolution_scale: 1.0 }
    }
}

impl Reduction {
    /// Factor of width and height in a step that takes traced pixels away.
    pub(crate) const RESOLUTION_STEP: f32 = 0.8;

    /// Number of all steps.
    pub(crate) fn steps(self) -> u32 {
        self.samples + self.pixels
    }

    /// The part of this reduction that its first `steps` make up.  Steps of pixels follow those of samples.
    pub(crate) fn first(self, steps: u32) -> Self {
        let samples = steps.min(self.samples);
        Self { samples, pixels: (steps - samples).min(self.pixels), ..self }
    }
}

/// A [`RestirBudget::least_resolution_scale`] in its range.  NaN leaves the resolution as it is.
pub(crate) fn least_scale(least: f32) -> f32 {
    least.clamp(Restir::LEAST_RESOLUTION_SCALE, 1.0).min(1.0)
}

impl Restir {
    /// These settings with fewer samples, as [`RestirBudget`] uses them.  Each step makes one reduction.  Paths come first, then direct
    /// light, each in this order: iterations of spatial reuse down to one, then neighbors one by one, then (in
    /// [`ReuseOrder::Spatiotemporal`](super::ReuseOrder::Spatiotemporal)) all extra neighbors of disocclusions at once.  After that the light
    /// candidates of direct light are halved, down to 4.  Steps after the last one change nothing.  Fields out of range are clamped.
    #[must_use]
    pub fn reduced(&self, step: u32) -> Self {
        self.reduced_within(step, 1.0)
    }

    /// As [`Restir::reduced`]; the steps after the last one of the samples trace fewer pixels, down to this
    /// [`RestirBudget::least_resolution_scale`].
    #[must_use]
    pub fn reduced_within(&self, step: u32, least_resolution_scale: f32) -> Self {
        self.reduced_by(self.most_reduction(least_scale(least_resolution_scale)).first(step))
    }

    /// These settings with fewer samples and traced pixels.
    pub(crate) fn reduced_by(&self, reduction: Reduction) -> Self {
        let mut settings = self.clone().clamped();
        take_steps(reduction.samples, || settings.reduce_samples());
        take_steps(reduction.pixels, || settings.reduce_resolution(reduction.least_resolution_scale));
        settings
    }

    /// These settings with every field in its range.
    pub(crate) fn clamped(mut self) -> Self {
        self.clamp(&mut |_| {});
        self
    }

    /// All steps that these settings have.
    pub(crate) fn most_reduction(&self, least_resolution_scale: f32) -> Reduction {
        let mut settings = self.clone().clamped();
        Reduction {
            samples: take_steps(u32::MAX, || settings.reduce_samples()),
            pixels: take_steps(u32::MAX, || settings.reduce_resolution(least_resolution_scale)),
            least_resolution_scale,
        }
    }

    /// Takes traced pixels away; false where no step is left.
    fn reduce_resolution(&mut self, least: f32) -> bool {
        // A step of less than a tenth is not worth the history.
        const LEAST_STEP: f32 = 0.9;
        let scale = (Reduction::RESOLUTION_STEP * self.resolution_scale).max(least);
        let averages = self.accumulate || self.technique == Technique::Reference;
        let is_reduced = !averages && scale < LEAST_STEP * self.resolution_scale;
        if is_reduced {
            self.resolution_scale = scale;
        }
        is_reduced
    }

    /// Takes samples away; false where no step is left.
    fn reduce_samples(&mut self) -> bool {
        const LEAST_CANDIDATES: u32 = 4;
        let (direct, paths) = match self.technique {
            Technique::Reference => return false,
            Technique::Di => (true, false),
            Technique::Gi => (true, true),
            Technique::Pt => (self.paths.separate_direct_light, true),
            Technique::Bdpt => (false, true),
        };
        if paths && take_neighbor(&mut self.paths.reuse) || direct && take_neighbor(&mut self.direct.reuse) {
            return true;
        }
        let candidates = &mut self.direct.candidates;
        let halves = direct && *candidates > LEAST_CANDIDATES;
        if halves {
            *candidates = (*candidates / 2).max(LEAST_CANDIDATES);
        }
        halves
    }
}

/// Takes steps as long as there are any.  Returns their number.
fn take_steps(steps: u32, mut take: impl FnMut() -> bool) -> u32 {
    (0..steps).take_while(|_| take()).count() as u32
}

/// Takes away one iteration, or else one neighbor; false where neither is left.
fn take_neighbor(reuse: &mut Reuse) -> bool {
    if reuse.spatial_iterations > 1 && reuse.spatial_samples > 0 {
        reuse.spatial_iterations -= 1;
        return true;
    }
    // Disocclusions are a small part of a picture; they lose their neighbors last.
    if reuse.spatial_samples > 0 {
        reuse.spatial_samples -= 1;
        return true;
    }
    let has_more = reuse.order == ReuseOrder::Spatiotemporal && reuse.temporal && reuse.disocclusion_samples > 0;
    if has_more {
        reuse.disocclusion_samples = 0;
    }
    has_more
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Preset;
    use bevy::reflect::{FromReflect, structs::DynamicStruct};

    #[test]
    fn the_resolution_falls_after_the_samples_and_not_below_its_limit() {
        let settings = Restir { resolution_scale: 0.9, ..Restir::default() };
        let scales = |settings: &Restir, least_resolution_scale| {
            let most = settings.most_reduction(least_resolution_scale);
            let after = |steps| settings.reduced_within(steps, least_resolution_scale).resolution_scale;
            (most.samples..=most.steps() + 1).map(after).collect::<Vec<_>>()
        };
        let equal = |scales: Vec<f32>, expected: &[f32]| {
            scales.len() == expected.len()
                && scales.iter().zip(expected).all(|(scale, expected)| (scale - expected).abs() < 1e-6)
        };
        assert!(equal(scales(&settings, 1.0), &[0.9, 0.9]), "the default");
        assert!(equal(scales(&settings, 0.85), &[0.9, 0.9]), "less than a step");
        assert!(equal(scales(&settings, 0.5), &[0.9, 0.72, 0.576, 0.5, 0.5]));
        let least = |least| settings.reduced_within(u32::MAX, least).resolution_scale;
        assert_eq!([least(0.0), least(f32::NAN), least(2.0)], [Restir::LEAST_RESOLUTION_SCALE, 0.9, 0.9]);
        let averaging = Restir { accumulate: true, ..settings.clone() };
        assert!(equal(scales(&averaging, 0.5), &[0.9, 0.9]), "frames that are averaged");
        let reference = Restir { technique: Technique::Reference, ..settings };
        assert_eq!(reference.most_reduction(0.5).steps(), 0);
    }

    #[test]
    fn a_budget_with_missing_fields_gets_their_defaults() {
        let expected = RestirBudget { gpu_ms: 8.0, ..RestirBudget::default() };
        let mut reflected = DynamicStruct::default();
        reflected.insert("gpu_ms", 8.0f32);
        assert_eq!(RestirBudget::from_reflect(&reflected), Some(expected));
        #[cfg(feature = "serde")]
        assert_eq!(serde_json::from_str::<RestirBudget>(r#"{"gpu_ms": 8.0}"#).ok(), Some(expected));
    }

    #[test]
    fn each_step_changes_numbers_of_samples_only() {
        for technique in Technique::ALL {
            for preset in Preset::ALL {
                let settings = Restir { technique, ..Restir::preset(preset) };
                let steps = settings.most_reduction(1.0).steps();
                assert_eq!(steps == 0, technique == Technique::Reference);
                for step in 0..steps {
                    assert!(settings.reduced(step) != settings.reduced(step + 1), "{technique:?}, step {step}");
                }
                assert_eq!(settings.reduced(steps), settings.reduced(steps + 1));
                assert_eq!(settings.reduced(steps).history_key(), settings.history_key());
                assert!(settings.reduced(steps).validate().is_empty());
                let mut wild = settings.clone();
                (wild.paths.reuse.spatial_iterations, wild.direct.candidates) = (u32::MAX, u32::MAX);
                assert_eq!(wild.reduced(u32::MAX).history_key(), wild.reduced(1).history_key());
            }
        }
    }
}
