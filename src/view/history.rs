//! What direct lighting keeps of a view between frames: reservoirs of this frame and of the last, and the last visibility buffer.
//! It exists only while a camera runs the technique.

use bevy::{
    math::UVec2,
    render::{
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
    },
};

use super::{VISIBILITY_FORMAT, buffer, pixels, texture};
use crate::{
    gpu_types::*,
    settings::{BiasCorrection, Direct, Mis, ReuseOrder, VisibilityReuse},
};

/// Format of the light that passes hand on to the resolve.
pub(crate) const LIGHT_FORMAT: TextureFormat = TextureFormat::Rgba32Float;

/// Inputs of a step of reuse that shaders without `MANY_TAPS` have room for (`MAX_INPUTS` in `shaders/restir/mis.wgsl`).
pub(crate) const FEW_INPUTS: u32 = 3;
/// Most rounds of reuse in a frame: one of the last frame, and four of this one.
pub(crate) const MOST_ROUNDS: usize = 5;
/// From one round's uniforms to the next one's, bytes: what every device aligns them to.
const SETTINGS_STRIDE: u64 = 256;

/// A round of reuse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Round {
    /// Neighbours are of the last frame; otherwise of this one's last round.
    from_previous: bool,
    temporal_taps: u32,
    spatial_taps: u32,
}

/// The rounds of reuse of a frame, in order: at least one, which shades.
pub(crate) fn rounds(direct: &Direct) -> Vec<Round> {
    let temporal_taps = direct.temporal as u32;
    let spatial_rounds = if direct.spatial_taps > 0 { direct.rounds as usize } else { 0 };
    let spatial = Round { from_previous: true, temporal_taps: 0, spatial_taps: direct.spatial_taps };
    match direct.order {
        ReuseOrder::Spatiotemporal => {
            let mut rounds = vec![spatial; spatial_rounds.max(1)];
            rounds[0].temporal_taps = temporal_taps;
            rounds
        }
        ReuseOrder::TemporalThenSpatial => {
            let first = (temporal_taps > 0 || spatial_rounds == 0).then_some(Round {
                from_previous: true,
                temporal_taps,
                spatial_taps: 0,
            });
            first
                .into_iter()
                .chain(core::iter::repeat_n(Round { from_previous: false, ..spatial }, spatial_rounds))
                .collect()
        }
    }
}

/// The history of direct lighting.
pub(crate) struct DirectHistory {
    settings: Buffer,
    pub(crate) subsets: Buffer,
    subset_entries: u64,
    /// Of this frame and of the last, in turns.
    reservoirs: [Buffer; 2],
    reservoir_bytes: u64,
    layout: u32,
    pub(crate) previous_visibility: Texture,
    pub(crate) previous_visibility_view: TextureView,
    pub(crate) unresampled: TextureView,
    pub(crate) resampled: TextureView,
    rounds: Vec<Round>,
    /// Which reservoirs this frame's candidates go to.
    first: usize,
    /// Which reservoirs a frame leaves.
    kept: usize,
    size: UVec2,
}

impl DirectHistory {
    pub(crate) fn new(size: UVec2, direct: &Direct, device: &RenderDevice) -> Self {
        let buffer = |label, size, usage| buffer(device, label, size, usage);
        let texture = |label, format, usage| texture(device, label, size, format, usage);
        let light = |label| {
            texture(label, LIGHT_FORMAT, TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING)
                .create_view(&TextureViewDescriptor::default())
        };
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let entries = subset_entries(direct);
        let layout = direct.layout.tile();
        let reservoir_bytes = reservoir_count(size, layout) * DIRECT_RESERVOIR_SIZE;
        let previous_visibility =
            texture("last visibility", VISIBILITY_FORMAT, TextureUsages::COPY_DST | TextureUsages::TEXTURE_BINDING);
        Self {
            settings: buffer(
                "direct settings",
                MOST_ROUNDS as u64 * SETTINGS_STRIDE,
                BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            ),
            subsets: buffer("light subsets", entries * PRESAMPLED_LIGHT_SIZE, storage),
            subset_entries: entries,
            reservoirs: ["reservoirs", "last reservoirs"].map(|label| buffer(label, reservoir_bytes, storage)),
            reservoir_bytes,
            layout,
            previous_visibility_view: previous_visibility.create_view(&TextureViewDescriptor::default()),
            previous_visibility,
            unresampled: light("unresampled light"),
            resampled: light("resampled light"),
            rounds: rounds(direct),
            first: 0,
            kept: 1,
            size,
        }
    }

    /// Whether the buffers serve these settings.
    pub(crate) fn fits(&self, size: UVec2, direct: &Direct) -> bool {
        self.size == size && self.subset_entries == subset_entries(direct) && self.layout == direct.layout.tile()
    }

    /// Begins a frame: what the last one kept is the history.
    pub(crate) fn begin(&mut self, direct: &Direct, has_history: bool, queue: &RenderQueue) {
        self.rounds = rounds(direct);
        self.first = 1 - self.kept;
        self.kept = self.output_index(self.rounds.len() - 1);
        let mut bytes = vec![0u8; self.rounds.len() * SETTINGS_STRIDE as usize];
        for (round, slot) in bytes.chunks_exact_mut(SETTINGS_STRIDE as usize).enumerate() {
            let settings = self.gpu_settings(direct, has_history, round);
            slot[..size_of_val(&settings)].copy_from_slice(bytemuck::bytes_of(&settings));
        }
        queue.write_buffer(&self.settings, 0, &bytes);
    }

    fn gpu_settings(&self, direct: &Direct, has_history: bool, index: usize) -> GpuDirectSettings {
        let round = self.rounds[index];
        let asks = !round.from_previous || has_history;
        let taps = |count| if asks { count } else { 0 };
        GpuDirectSettings {
            candidates: direct.candidates,
            subset_count: direct.subset_count,
            subset_size: direct.subset_size,
            tile: direct.tile,
            temporal_taps: taps(round.temporal_taps),
            spatial_taps: taps(round.spatial_taps),
            disocclusion_taps: if direct.order == ReuseOrder::Spatiotemporal { direct.disocclusion_taps } else { 0 },
            tries: direct.tries,
            radius: direct.radius,
            confidence_cap: direct.confidence_cap,
            mis: mis_constant(direct.bias_correction, direct.mis),
            flags: flags(direct, round, index, self.rounds.len()),
            normal_threshold: direct.normal_threshold,
            depth_threshold: direct.depth_threshold,
            visibility_radius: direct.visibility_radius,
            tiling: self.layout,
            round: index as u32,
            pad_a: 0,
            pad_b: 0,
            pad_c: 0,
        }
    }

    /// Uniforms of a round.
    pub(crate) fn settings_of(&self, round: usize) -> BindingResource<'_> {
        BindingResource::Buffer(BufferBinding {
            buffer: &self.settings,
            offset: round as u64 * SETTINGS_STRIDE,
            size: core::num::NonZero::new(size_of::<GpuDirectSettings>() as u64),
        })
    }

    /// How many rounds this frame has.
    pub(crate) fn rounds(&self) -> usize {
        self.rounds.len()
    }

    /// Rounds of this frame's neighbours write where they do not read, in turns.
    fn output_index(&self, round: usize) -> usize {
        let turns = self.rounds[..=round].iter().filter(|r| !r.from_previous).count();
        (self.first + turns) % 2
    }

    pub(crate) fn candidates(&self) -> &Buffer {
        &self.reservoirs[self.first]
    }

    pub(crate) fn neighbours_of(&self, round: usize) -> &Buffer {
        &self.reservoirs[1 - self.output_index(round)]
    }

    pub(crate) fn output_of(&self, round: usize) -> &Buffer {
        &self.reservoirs[self.output_index(round)]
    }

    pub(crate) fn kept(&self) -> &Buffer {
        &self.reservoirs[self.kept]
    }

    /// Names and bytes.
    pub(crate) fn memory(&self) -> Vec<(&'static str, u64)> {
        let pixels = pixels(self.size);
        vec![
            ("direct settings", MOST_ROUNDS as u64 * SETTINGS_STRIDE),
            ("light subsets", self.subset_entries * PRESAMPLED_LIGHT_SIZE),
            ("reservoirs", 2 * self.reservoir_bytes),
            ("last visibility", pixels * 8),
            ("light", 2 * pixels * 16),
        ]
    }
}

/// Reservoirs of an image: tiles are whole.
fn reservoir_count(size: UVec2, layout: u32) -> u64 {
    match layout {
        TILING_ROWS | TILING_COLUMNS => pixels(size),
        tile => {
            let tiles = pixels(UVec2::new(size.x.div_ceil(tile), size.y.div_ceil(tile)));
            tiles * u64::from(tile) * u64::from(tile)
        }
    }
}

/// Entries of the subsets; one where there are none, since a binding is never empty.
fn subset_entries(direct: &Direct) -> u64 {
    (direct.subset_count as u64 * direct.subset_size as u64).max(1)
}

/// Workgroups of the pass that fills the subsets.
pub(crate) fn presample_workgroups(direct: &Direct) -> [u32; 2] {
    [direct.subset_size.div_ceil(64), direct.subset_count]
}

/// What a round does, from what rays may decide (paper 003, Fig. 15) and how bias is held off.
fn flags(direct: &Direct, round: Round, index: usize, rounds: usize) -> u32 {
    use VisibilityReuse::*;
    let kind = direct.visibility;
    let of_target = matches!(kind, Discard | Resampled);
    let of_candidates = !matches!(kind, Ignored | Shading);
    [
        (direct.bsdf_candidate, DIRECT_BSDF_CANDIDATE),
        (of_candidates, DIRECT_CANDIDATE_RAYS),
        (of_target, DIRECT_TARGET_RAYS),
        (kind == Discard, DIRECT_DISCARD),
        (of_target && direct.bias_correction.uses_mis_rays(), DIRECT_MIS_RAYS),
        (matches!(kind, Shading | Decoupled), DIRECT_SHADING_RAYS),
        (kind == Decoupled, DIRECT_REUSE_VISIBILITY),
        (direct.bias_correction.uses_heuristics(), DIRECT_HEURISTICS),
        (direct.decoupled_shading, DIRECT_DECOUPLED),
        (round.from_previous, DIRECT_FROM_PREVIOUS),
        (index + 1 == rounds, DIRECT_SHADE),
        (of_candidates && index == 0, DIRECT_SEEN),
        (direct.simple_target, DIRECT_SIMPLE_TARGET),
        (direct.bilinear, DIRECT_BILINEAR),
        (direct.same_material, DIRECT_SAME_MATERIAL),
    ]
    .into_iter()
    .fold(0, |flags, (condition, flag)| if condition { flags | flag } else { flags })
}

fn mis_constant(correction: BiasCorrection, mis: Mis) -> u32 {
    if !correction.uses_mis() {
        return MIS_UNIFORM;
    }
    match mis {
        Mis::Valid => MIS_VALID,
        Mis::Balance => MIS_BALANCE,
        Mis::Pairwise => MIS_PAIRWISE,
        Mis::DefensivePairwise => MIS_DEFENSIVE_PAIRWISE,
        Mis::DefensivePairwiseGris => MIS_DEFENSIVE_PAIRWISE_GRIS,
    }
}
