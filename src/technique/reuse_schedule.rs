//! Iterations of reuse and their uniforms, for some settings.

use crate::{
    gpu_layout::*,
    settings::{
        BiasCorrection, Direct, Mis, Paths, Reconnection, Research, Restir, Reuse, ReuseOrder, SubsurfaceShift,
        SuffixRetrace, VisibilityReuse,
    },
};

/// Inputs of the resampling routine without `MANY_NEIGHBORS` (`MAX_INPUTS` in `shaders/restir/mis.wgsl`).
pub const FEW_INPUTS: u32 = 3;
/// Least radius, pixels: a smaller ring around the pixel contains hardly any other pixels.
const MIN_RADIUS: f32 = 2.0;
/// Side of a tile of partners, in radii.  With it, two random pixels of a tile are as far apart on average as a pixel and a random neighbor
/// within the radius.
const PAIR_TILE: f32 = 1.28;
/// Layers of shifts beyond the neighbors that a pixel asks for, so that it can also serve partners that found few others.
const SPARE_PAIR_LAYERS: u32 = 1;
/// Greatest number of layers: inputs of the resampling routine with `MANY_NEIGHBORS`, besides the pixel's own.
pub const MAX_PAIR_LAYERS: u32 = 6;
/// Greatest number of iterations in a frame: one over the last frame, and four over this one.
pub const MAX_ITERATIONS: usize = 5;

/// How an iteration finds neighbors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum IterationKind {
    /// Each pixel searches for its own.
    Search,
    /// Pixels are paired, and each shift serves both partners.
    Pairs,
}

/// An iteration of reuse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Iteration {
    /// Neighbors are taken from the last frame; otherwise from the previous iteration of this frame.
    pub from_previous: bool,
    temporal_samples: u32,
    spatial_samples: u32,
    /// Takes `disocclusion_samples` neighbors where the surface was not visible in the last frame.
    extra_at_disocclusions: bool,
    kind: IterationKind,
    /// `SUBSURFACE_*`, for the domain of light that enters objects.
    subsurface_shift: u32,
}

impl Iteration {
    /// An iteration over the last frame without any neighbors.
    const OVER_LAST_FRAME: Self = Self {
        from_previous: true,
        temporal_samples: 0,
        spatial_samples: 0,
        extra_at_disocclusions: false,
        kind: IterationKind::Search,
        subsurface_shift: 0,
    };
}

/// The iterations of a frame, in order; at least one, which shades.
fn iterations(reuse: &Reuse) -> Vec<Iteration> {
    let temporal_samples = u32::from(reuse.temporal);
    let spatial_iterations = if reuse.spatial_samples > 0 { reuse.spatial_iterations as usize } else { 0 };
    let spatial = Iteration {
        spatial_samples: reuse.spatial_samples,
        extra_at_disocclusions: true,
        ..Iteration::OVER_LAST_FRAME
    };
    match reuse.order {
        ReuseOrder::Spatiotemporal => {
            let mut iterations = vec![spatial; spatial_iterations.max(1)];
            iterations[0].temporal_samples = temporal_samples;
            iterations
        }
        ReuseOrder::TemporalThenSpatial => {
            // At disocclusions the next iteration takes more neighbors, among samples of this frame.
            let temporal = Iteration { temporal_samples, ..Iteration::OVER_LAST_FRAME };
            let first = (temporal_samples > 0 || spatial_iterations == 0).then_some(temporal);
            first
                .into_iter()
                .chain(core::iter::repeat_n(Iteration { from_previous: false, ..spatial }, spatial_iterations))
                .collect()
        }
    }
}

/// The iterations of a frame of a domain that pairs pixels where the settings ask for it.
fn iterations_with_pairs(reuse: &Reuse) -> Vec<Iteration> {
    let mut iterations = iterations(reuse);
    for iteration in &mut iterations {
        // A pair knows only the shifts between its two pixels, which is enough for pairwise MIS alone; and a pixel of the last frame cannot
        // reuse a sample of this one.
        if reuse.paired && reuse.mis.is_pairwise() && !iteration.from_previous {
            iteration.kind = IterationKind::Pairs;
        }
    }
    iterations
}

/// The last frame as reuse sees it.
#[derive(Clone, Copy)]
pub(crate) struct LastFrame {
    /// Its reservoirs may be read.
    pub has_history: bool,
    /// An instance has moved or a light has changed since then.
    pub moved: bool,
    /// Lights had the same probabilities to be chosen, although something has moved.
    pub same_densities: bool,
    /// The scene and the camera were the same.
    pub still: bool,
    /// Scene, camera and jitter were the same, so that all pixels had the same rays.
    pub same_rays: bool,
}

/// The iterations of reuse of a domain.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ReuseSchedule {
    pub iterations: Vec<Iteration>,
    /// Uniforms that all iterations share.
    common: GpuResampleSettings,
    /// Flags of the first iteration only.
    first_flags: u32,
    /// Flags of iterations over the last frame, where something moved.
    moved_flags: u32,
    /// Flags of iterations over the last frame, where something moved and lights kept their probabilities.
    same_densities_flags: u32,
    /// Flags of unchanged frames (`RESAMPLE_STILL`, `RESAMPLE_SAME_RAYS`) that the domain uses, in iterations over the last frame.
    still_flags: u32,
    /// MIS weights of temporal reuse alone.
    temporal_mis: u32,
    /// Samples that a resampled path stands for, in weights against light sub-paths.
    pub reuse_gain: f32,
}

/// Whether the shift of a path to its own pixel never fails.  Otherwise the shortcut for unchanged frames (`is_same_pixel` in
/// shaders/pass/reuse.wgsl) would be wrong.
fn every_path_shifts_to_its_own_pixel(paths: &Paths) -> bool {
    /// By rounding, the Jacobian of that shift is not exactly 1.
    const ROUNDING: f32 = 1.1;
    // With `PathFootprint` paths may reconnect at mirrors.  Such a path has no shift.
    paths.reconnection != Reconnection::PathFootprint && paths.jacobian_limit >= ROUNDING
}

impl ReuseSchedule {
    /// The schedule of ReSTIR DI.
    pub(crate) fn of_direct_light(settings: &Restir) -> Self {
        let direct = &settings.direct;
        let mis = mis_constant(direct.bias_correction, direct.reuse.mis);
        let candidates_visible = !matches!(direct.visibility, VisibilityReuse::Ignored | VisibilityReuse::Shading);
        let common = common_settings(&direct.reuse, direct, &settings.research);
        let flags = common.flags | direct_flags(direct, &settings.research);
        // The same rays must decide the targets of the pixel and of its neighbors.
        let rays = RESAMPLE_TARGET_RAYS | RESAMPLE_MIS_RAYS;
        // The MIS weights of a pair are those of shifts whose visibility rays have tested.
        let tests_shifts = direct.visibility == VisibilityReuse::Resampled && flags & rays == rays;
        Self {
            iterations: if tests_shifts { iterations_with_pairs(&direct.reuse) } else { iterations(&direct.reuse) },
            common: GpuResampleSettings {
                candidates: direct.candidates,
                mis,
                flags,
                visibility_radius: direct.visibility_radius,
                ..common
            },
            first_flags: if candidates_visible { RESAMPLE_CANDIDATES_VISIBLE } else { 0 },
            moved_flags: 0,
            same_densities_flags: 0,
            still_flags: if flags & rays == rays { RESAMPLE_SAME_RAYS } else { 0 },
            temporal_mis: mis,
            reuse_gain: 1.0,
        }
    }

    /// The schedule of ReSTIR PT.
    pub(crate) fn of_paths(settings: &Restir) -> Self {
        let paths = &settings.paths;
        let common = common_settings(&paths.reuse, &settings.direct, &settings.research);
        let flags = [
            (true, RESAMPLE_TARGET_RAYS | RESAMPLE_MIS_RAYS),
            (paths.heuristics, RESAMPLE_HEURISTICS),
            (!settings.research.russian_roulette, RESAMPLE_NO_ROULETTE),
        ];
        Self {
            iterations: iterations_with_pairs(&paths.reuse),
            common: GpuResampleSettings {
                candidates: paths.candidates,
                decorrelation: paths.decorrelation,
                mis: mis_constant(BiasCorrection::UnbiasedMis, paths.reuse.mis),
                flags: common.flags | flags_of(flags),
                ..reconnection_settings(paths, common)
            },
            first_flags: 0,
            moved_flags: RESAMPLE_MOVED
                | match paths.suffix_retrace {
                    SuffixRetrace::BothWays => RESAMPLE_RETRACE_FORWARD | RESAMPLE_RETRACE_BACKWARD,
                    SuffixRetrace::ForwardOnly => RESAMPLE_RETRACE_FORWARD,
                    SuffixRetrace::Off => 0,
                },
            same_densities_flags: RESAMPLE_SAME_DENSITIES,
            still_flags: if every_path_shifts_to_its_own_pixel(paths) { RESAMPLE_SAME_RAYS } else { 0 },
            temporal_mis: MIS_BALANCE,
            reuse_gain: 1.0,
        }
    }

    /// The schedule of the indirect light of ReSTIR GI.
    pub(crate) fn of_indirect_light(settings: &Restir) -> Self {
        let paths = &settings.paths;
        let schedule = Self::of_paths(settings);
        let flags = flags_of([(paths.assume_diffuse_secondary, RESAMPLE_DIFFUSE_SECONDARY)]);
        Self {
            common: GpuResampleSettings {
                flags: schedule.common.flags | flags,
                reconnection: RECONNECT_FIRST,
                roughness: 0.0,
                separation: paths.distance,
                ..schedule.common
            },
            moved_flags: if paths.assume_diffuse_secondary { 0 } else { schedule.moved_flags },
            ..schedule
        }
    }

    /// The schedule of ReSTIR SSS.  Where shifts follow one another, a reconnected sample gets a probe for the delayed shift.
    pub(crate) fn of_subsurface(settings: &Restir) -> Self {
        let subsurface = &settings.subsurface;
        let common = common_settings(&subsurface.reuse, &settings.direct, &settings.research);
        let flags = [(true, RESAMPLE_TARGET_RAYS | RESAMPLE_MIS_RAYS), (subsurface.heuristics, RESAMPLE_HEURISTICS)];
        let mut iterations = iterations(&subsurface.reuse);
        let last = iterations.len() - 1;
        for (i, iteration) in iterations.iter_mut().enumerate() {
            iteration.subsurface_shift = match subsurface.shift {
                SubsurfaceShift::Reconnection => SUBSURFACE_RECONNECTION,
                SubsurfaceShift::Sequential if i < last => SUBSURFACE_RECONNECTION,
                SubsurfaceShift::Delayed | SubsurfaceShift::Sequential => SUBSURFACE_DELAYED,
                SubsurfaceShift::Hybrid => SUBSURFACE_HYBRID,
            };
        }
        Self {
            iterations,
            common: GpuResampleSettings {
                candidates: subsurface.candidates,
                mis: mis_constant(BiasCorrection::UnbiasedMis, subsurface.reuse.mis),
                flags: common.flags | flags_of(flags),
                ..common
            },
            first_flags: 0,
            moved_flags: RESAMPLE_MOVED,
            same_densities_flags: 0,
            still_flags: 0,
            temporal_mis: MIS_BALANCE,
            reuse_gain: 1.0,
        }
    }

    /// The schedule of ReSTIR BDPT.
    pub(crate) fn of_bidirectional_paths(settings: &Restir) -> Self {
        let schedule = Self::of_paths(settings);
        // Reservoirs hold weights with the gain, so that it must not depend on a setting that keeps the history.
        let Reuse { temporal, order, .. } = settings.paths.reuse;
        let reads_history = temporal || order == ReuseOrder::Spatiotemporal;
        let reads_other_pixels = reads_history || schedule.max_inputs() > 1;
        let flags = flags_of([(settings.bdpt.reconnects(), RESAMPLE_RECONNECT_LIGHT_PATHS)]);
        Self {
            common: GpuResampleSettings { flags: schedule.common.flags | flags, ..schedule.common },
            // MIS weights against light sub-paths depend on more than the probabilities of lights.
            same_densities_flags: 0,
            reuse_gain: if reads_other_pixels { settings.bdpt.reuse_gain } else { 1.0 },
            ..schedule
        }
    }

    /// The schedule of light sub-paths that the camera sees: they are reused from the last frame, in their own pixels.
    pub(crate) fn of_splats(settings: &Restir) -> Self {
        let reuse = &settings.paths.reuse;
        let paths = Self::of_bidirectional_paths(settings);
        Self {
            iterations: vec![Iteration { temporal_samples: u32::from(reuse.temporal), ..Iteration::OVER_LAST_FRAME }],
            common: GpuResampleSettings {
                // All inputs are shaded, because the color of the candidates is that of all splats.
                flags: RESAMPLE_SHADE_ALL | paths.common.flags & RESAMPLE_RECONNECT_LIGHT_PATHS,
                decorrelation: 0.0,
                ..paths.common
            },
            first_flags: 0,
            moved_flags: RESAMPLE_MOVED,
            same_densities_flags: 0,
            still_flags: RESAMPLE_STILL,
            temporal_mis: MIS_BALANCE,
            reuse_gain: paths.reuse_gain,
        }
    }

    /// The schedule of light sub-paths that can be reconnected: that of paths.  Where something moved, they are replayed in both directions.
    pub(crate) fn of_reconnected_light_paths(settings: &Restir) -> Self {
        Self { moved_flags: RESAMPLE_MOVED, still_flags: RESAMPLE_SAME_RAYS, ..Self::of_bidirectional_paths(settings) }
    }

    /// The kinds of the iterations, in order.
    pub(crate) fn iteration_kinds(&self) -> Vec<IterationKind> {
        self.iterations.iter().map(|iteration| iteration.kind).collect()
    }

    /// How many shifts a pixel stores, at most, in an iteration with pairs; 0 if no iteration makes pairs.
    pub(crate) fn pair_layers(&self) -> u32 {
        let in_pairs = self.iterations.iter().filter(|iteration| iteration.kind == IterationKind::Pairs);
        let wanted = in_pairs.map(|iteration| iteration.spatial_samples).max();
        let layers = |wanted: u32| (wanted + SPARE_PAIR_LAYERS).max(self.common.disocclusion_samples);
        wanted.map_or(0, |wanted| layers(wanted).min(MAX_PAIR_LAYERS))
    }

    /// Greatest number of inputs of the resampling routine: the pixel's own sample and its neighbors.
    fn max_inputs(&self) -> u32 {
        let in_pairs = self.iterations.iter().any(|iteration| iteration.kind == IterationKind::Pairs);
        self.max_searched_inputs().max(if in_pairs { 1 + self.pair_layers() } else { 0 })
    }

    /// Greatest number of its inputs in the iterations without pairs.
    pub(crate) fn max_searched_inputs(&self) -> u32 {
        let neighbors =
            self.iterations.iter().filter(|iteration| iteration.kind == IterationKind::Search).map(|iteration| {
                let disocclusion = if iteration.extra_at_disocclusions { self.common.disocclusion_samples } else { 0 };
                (iteration.temporal_samples + iteration.spatial_samples).max(disocclusion)
            });
        1 + neighbors.max().unwrap_or(0)
    }

    /// Greatest number of shifts of a pixel in these iterations: with pairwise MIS weights, between its own sample and each neighbor's;
    /// otherwise, between all inputs.
    pub(crate) fn max_searched_shifts(&self) -> u32 {
        let inputs = self.max_searched_inputs();
        match self.common.mis {
            MIS_PAIRWISE | MIS_DEFENSIVE_PAIRWISE | MIS_DEFENSIVE_PAIRWISE_GRIS => 2 * (inputs - 1),
            _ => inputs * (inputs - 1),
        }
    }

    /// Order of reservoirs in memory: `LAYOUT_*`, or pixels a side of a tile.
    pub(crate) fn reservoir_layout(&self) -> u32 {
        self.common.reservoir_layout
    }

    /// Uniforms of an iteration.  `height`: of the image, pixels.  `last`: what is known about the last frame.
    pub(crate) fn uniforms(&self, index: usize, height: u32, last: LastFrame) -> GpuResampleSettings {
        let iteration = self.iterations[index];
        let available = |count| if !iteration.from_previous || last.has_history { count } else { 0 };
        let still_flags = flags_of([(last.still, RESAMPLE_STILL), (last.same_rays, RESAMPLE_SAME_RAYS)]);
        // Probes are inverted once, before the iteration that draws them again.
        let next = self.iterations.get(index + 1).map(|next| next.subsurface_shift);
        let inverts_probes = iteration.subsurface_shift == SUBSURFACE_RECONNECTION && next == Some(SUBSURFACE_DELAYED);
        let flags = flags_of([
            (iteration.from_previous, RESAMPLE_FROM_PREVIOUS),
            (index + 1 == self.iterations.len(), RESAMPLE_SHADE),
            (index == 0, self.first_flags),
            (iteration.from_previous && last.moved, self.moved_flags),
            (iteration.from_previous && last.moved && last.same_densities, self.same_densities_flags),
            (iteration.from_previous, still_flags & self.still_flags),
            (inverts_probes, RESAMPLE_INVERT_PROBES),
        ]);
        let radius = scaled_radius(self.common.radius, height).max(MIN_RADIUS.min(self.common.radius));
        GpuResampleSettings {
            temporal_samples: available(iteration.temporal_samples),
            spatial_samples: available(iteration.spatial_samples),
            decorrelation: if iteration.from_previous { self.common.decorrelation } else { 0.0 },
            disocclusion_samples: if iteration.extra_at_disocclusions { self.common.disocclusion_samples } else { 0 },
            mis: if iteration.spatial_samples == 0 { self.temporal_mis } else { self.common.mis },
            flags: self.common.flags | flags,
            iteration: index as u32,
            subsurface_shift: iteration.subsurface_shift,
            radius,
            pair_layers: self.pair_layers(),
            pair_tile_bits: pair_tile_bits(radius, height),
            visibility_radius: scaled_radius(self.common.visibility_radius, height),
            ..self.common
        }
    }
}

/// Converts a radius in pixels of an image 1080 pixels high to pixels of an image `height` pixels high.  The distance over which samples
/// are similar depends on the surfaces, so it is a share of the image and not a number of pixels.
fn scaled_radius(radius: f32, height: u32) -> f32 {
    radius * height as f32 / 1080.0
}

/// Logarithm of the side of the tiles that hold partners, pixels; at least 4 pixels, and about the height of the image at most.
fn pair_tile_bits(radius: f32, height: u32) -> u32 {
    let greatest = height.max(4).next_power_of_two().ilog2();
    ((PAIR_TILE * radius).max(1.0).log2().round() as u32).clamp(2, greatest)
}

/// Uniforms that every domain takes from the same settings.
fn common_settings(reuse: &Reuse, direct: &Direct, research: &Research) -> GpuResampleSettings {
    GpuResampleSettings {
        subset_count: direct.subset_count,
        subset_size: direct.subset_size,
        light_tile_size: research.light_tile_size,
        // Without temporal reuse, every surface would count as new.
        disocclusion_samples: if reuse.temporal { reuse.disocclusion_samples } else { 0 },
        neighbor_attempts: reuse.neighbor_attempts,
        temporal_attempts: reuse.temporal_attempts,
        radius: reuse.radius,
        confidence_cap: reuse.confidence_cap,
        flags: flags_of([
            (reuse.shade_all, RESAMPLE_SHADE_ALL),
            (reuse.bilinear, RESAMPLE_BILINEAR),
            (reuse.same_material, RESAMPLE_SAME_MATERIAL),
            (reuse.dual_motion, RESAMPLE_DUAL_MOTION),
        ]),
        normal_threshold: reuse.normal_threshold,
        depth_threshold: reuse.depth_threshold,
        reservoir_layout: research.reservoir_layout.tile(),
        ..GpuResampleSettings::default()
    }
}

fn reconnection_settings(paths: &Paths, common: GpuResampleSettings) -> GpuResampleSettings {
    let (reconnection, separation) = match paths.reconnection {
        Reconnection::Footprints => (RECONNECT_FOOTPRINTS, paths.footprint),
        Reconnection::BlackBox => (RECONNECT_BLACK_BOX, paths.footprint),
        Reconnection::BlackBoxPrinted => (RECONNECT_BLACK_BOX_PRINTED, paths.footprint),
        Reconnection::JacobianBound => (RECONNECT_JACOBIAN_BOUND, paths.footprint),
        Reconnection::PathFootprint => (RECONNECT_PATH_FOOTPRINT, paths.footprint),
        Reconnection::Distance => (RECONNECT_DISTANCE, paths.distance),
    };
    GpuResampleSettings {
        reconnection,
        separation,
        roughness: paths.roughness,
        jacobian_limit: paths.jacobian_limit,
        ..common
    }
}

/// Flags for visibility rays (Wyman and Panteleev 2021, Fig. 15) and for the bias correction.
fn direct_flags(direct: &Direct, research: &Research) -> u32 {
    use VisibilityReuse::*;
    let kind = direct.visibility;
    let in_target = kind.tests_neighbors();
    flags_of([
        (direct.bsdf_candidate, RESAMPLE_BSDF_CANDIDATE),
        (!matches!(kind, Ignored | Shading), RESAMPLE_CANDIDATE_RAYS),
        (in_target, RESAMPLE_TARGET_RAYS),
        (kind == Discard, RESAMPLE_DISCARD_OCCLUDED),
        (in_target && direct.bias_correction.uses_mis_rays(), RESAMPLE_MIS_RAYS),
        (matches!(kind, Shading | Decoupled), RESAMPLE_SHADING_RAYS),
        (kind == Decoupled, RESAMPLE_REUSE_VISIBILITY),
        (direct.bias_correction.uses_heuristics(), RESAMPLE_HEURISTICS),
        (research.target_without_bsdf, RESAMPLE_TARGET_WITHOUT_BSDF),
    ])
}

fn flags_of<const N: usize>(flags: [(bool, u32); N]) -> u32 {
    flags.into_iter().filter(|(condition, _)| *condition).fold(0, |all, (_, flag)| all | flag)
}

fn mis_constant(correction: BiasCorrection, mis: Mis) -> u32 {
    if !correction.uses_mis() {
        return MIS_UNIFORM;
    }
    match mis {
        Mis::OneOverZ => MIS_ONE_OVER_Z,
        Mis::Balance => MIS_BALANCE,
        Mis::Pairwise => MIS_PAIRWISE,
        Mis::DefensivePairwise => MIS_DEFENSIVE_PAIRWISE,
        Mis::DefensivePairwiseGris => MIS_DEFENSIVE_PAIRWISE_GRIS,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_neighbors_that_keep_a_history_keep_its_weights() {
        for order in [ReuseOrder::Spatiotemporal, ReuseOrder::TemporalThenSpatial] {
            for temporal in [false, true] {
                let gain = |spatial_samples| {
                    let mut settings = Restir::default();
                    let reuse = &mut settings.paths.reuse;
                    (reuse.order, reuse.temporal, reuse.spatial_samples) = (order, temporal, spatial_samples);
                    ReuseSchedule::of_bidirectional_paths(&settings).reuse_gain
                };
                let reads_history = temporal || order == ReuseOrder::Spatiotemporal;
                assert_eq!(gain(0) == gain(3), reads_history, "{order:?}, temporal: {temporal}");
            }
        }
    }
}
