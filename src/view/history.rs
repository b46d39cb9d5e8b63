//! The history of a view: reservoirs of this frame and the last one, light subsets, and the last visibility buffer.  It exists only while
//! the camera runs a technique that resamples.

use bevy::{
    math::UVec2,
    render::{
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
    },
};

use super::{
    bind_groups::Bound,
    buffer,
    denoiser::{DenoiserTextures, ImageTextures},
    light_paths::{LightPathCounts, LightPaths},
    pairs::{PairKind, Pairs},
    pixels, texture, visibility_buffer,
};
use crate::{
    gpu_layout::*,
    planted::{Fault, is_planted},
    scene::storage::allocation,
    settings::{Direct, Restir},
    technique::{
        domain::{Domain, LightPart},
        pass::PassResource,
        place_in_technique,
        reuse_schedule::{LastFrame, MAX_ITERATIONS, ReuseSchedule},
    },
};

/// Format of the textures that hold light between passes.
pub(crate) const LIGHT_FORMAT: TextureFormat = TextureFormat::Rgba32Float;
/// Stride between the uniforms of iterations, bytes: an alignment that every device accepts.
pub(super) const SETTINGS_STRIDE: u64 = 256;

/// The history of a view.
pub(crate) struct History {
    /// Points of lights that the presampling pass samples, in subsets.
    pub(crate) subsets: Buffer,
    subset_entries: u64,
    /// The visibility buffer of the last frame.  It changes roles with that of the view from frame to frame.
    pub(crate) previous_visibility: TextureView,
    /// Bound in place of the light of a domain that the frame does not have.
    pub(crate) black: TextureView,
    reservoirs: Vec<Reservoirs>,
    /// Light sub-paths, if a domain traces them.
    pub(crate) light_paths: Option<LightPaths>,
    /// The resources of paired spatial reuse, if a domain makes pairs.
    pub(crate) pairs: Option<Pairs>,
    /// The textures of the denoiser, if it runs.
    pub(crate) denoiser: Option<DenoiserTextures>,
    size: UVec2,
}

/// The inputs of a frame, apart from the settings.
#[derive(Clone, Copy)]
pub(crate) struct FrameInputs {
    pub last: LastFrame,
    pub counts: LightPathCounts,
}

impl History {
    pub(crate) fn new(
        size: UVec2,
        domains: &[&'static Domain],
        settings: &Restir,
        counts: LightPathCounts,
        has_images: bool,
        device: &RenderDevice,
    ) -> Self {
        let entries = subset_entries(&settings.direct);
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let has_splats = domains.iter().any(|domain| domain.part == LightPart::Splats);
        Self {
            subsets: buffer(device, "light subsets", entries * PRESAMPLED_LIGHT_SIZE, storage),
            subset_entries: entries,
            previous_visibility: visibility_buffer(device, "last visibility", size),
            black: light(device, "no light", UVec2::ONE),
            reservoirs: domains.iter().map(|&domain| Reservoirs::new(size, domain, settings, device)).collect(),
            light_paths: traces_light(domains).then(|| LightPaths::new(size, counts, has_splats, device)),
            pairs: Pairs::new(size, pair_kind(domains, settings), device),
            denoiser: (settings.filter_iterations() > 0).then(|| DenoiserTextures::new(size, has_images, device)),
            size,
        }
    }

    /// Whether its buffers fit these settings.
    pub(crate) fn fits(
        &self,
        size: UVec2,
        domains: &[&'static Domain],
        settings: &Restir,
        counts: LightPathCounts,
    ) -> bool {
        self.size == size
            && self.light_paths.as_ref().is_none_or(|paths| paths.fits(counts))
            && self.subset_entries == subset_entries(&settings.direct)
            && self.reservoirs.iter().map(|r| r.domain).eq(domains.iter().copied())
            && self
                .reservoirs
                .iter()
                .all(|r| r.schedule.reservoir_layout() == (r.domain.schedule)(settings).reservoir_layout())
    }

    /// Whether the resources of pairs and of the denoiser fit these settings.  Reservoirs do not depend on these resources, so that they are
    /// replaced without a reset.
    pub(crate) fn fits_passes(&self, settings: &Restir, has_images: bool) -> bool {
        self.fits_pairs(settings) && self.fits_denoiser(settings, has_images)
    }

    fn fits_pairs(&self, settings: &Restir) -> bool {
        Pairs::kind_of(self.pairs.as_ref()) == self.pair_kind(settings)
    }

    fn fits_denoiser(&self, settings: &Restir, has_images: bool) -> bool {
        let wanted = (settings.filter_iterations() > 0).then_some(has_images);
        self.denoiser.as_ref().map(DenoiserTextures::has_images) == wanted
    }

    /// Replaces the resources of pairs and of the denoiser that do not fit.  If only the textures for optical images are missing or superfluous,
    /// the rest of the denoiser stays, and with it the means over frames.  After an error, resources that do not fit may remain.
    pub(crate) fn replace_passes(
        &mut self,
        settings: &Restir,
        has_images: bool,
        device: &RenderDevice,
    ) -> Result<(), String> {
        let filters = settings.filter_iterations() > 0;
        // Frees memory before more is allocated.
        if !filters {
            self.denoiser = None;
        }
        if !self.fits_pairs(settings) {
            self.pairs = None;
            let kind = self.pair_kind(settings);
            self.pairs = allocation::attempt(device, "pairs", || Pairs::new(self.size, kind, device))?;
        }
        if self.denoiser.is_none() && filters {
            let create = || DenoiserTextures::new(self.size, has_images, device);
            self.denoiser = Some(allocation::attempt(device, "denoiser", create)?);
        }
        if let Some(denoiser) = self.denoiser.as_mut().filter(|denoiser| denoiser.has_images() != has_images) {
            let create = || has_images.then(|| ImageTextures::new(self.size, device));
            denoiser.set_images(allocation::attempt(device, "denoiser", create)?);
        }
        Ok(())
    }

    fn pair_kind(&self, settings: &Restir) -> PairKind {
        let domains: Vec<_> = self.reservoirs.iter().map(|r| r.domain).collect();
        pair_kind(&domains, settings)
    }

    /// Begins a frame: the last frame's output becomes the input of temporal reuse.
    pub(crate) fn begin(&mut self, settings: &Restir, inputs: FrameInputs, queue: &RenderQueue) {
        for reservoirs in &mut self.reservoirs {
            reservoirs.begin((reservoirs.domain.schedule)(settings), self.size.y, inputs, queue);
        }
        if let Some(denoiser) = &mut self.denoiser {
            denoiser.begin(&settings.denoiser, inputs.last.has_history, queue);
        }
    }

    /// The reservoirs of all domains.
    pub(crate) fn reservoirs(&self) -> &[Reservoirs] {
        &self.reservoirs
    }

    /// The reservoirs of a domain.
    pub(crate) fn of(&self, domain: &Domain) -> Option<&Reservoirs> {
        self.reservoirs.iter().find(|r| r.domain == domain)
    }

    /// Names and bytes.
    pub(crate) fn memory(&self) -> Vec<(&'static str, u64)> {
        let pixels = pixels(self.size);
        let mut memory =
            vec![("light subsets", self.subset_entries * PRESAMPLED_LIGHT_SIZE), ("last visibility", pixels * 8)];
        for r in &self.reservoirs {
            let names = &r.domain.names;
            memory.extend([
                (names.settings, MAX_ITERATIONS as u64 * SETTINGS_STRIDE),
                (names.reservoirs, r.buffer_count() * r.bytes),
                (names.light, (2 + u64::from(r.unresampled.is_some())) * pixels * 16),
            ]);
        }
        memory.extend(self.light_paths.iter().flat_map(LightPaths::memory));
        memory.extend(self.pairs.iter().flat_map(|pairs| pairs.memory(pixels)));
        memory.extend(self.denoiser.iter().flat_map(|denoiser| denoiser.memory(pixels)));
        memory
    }

    /// Bytes of reservoirs per pixel.
    pub(crate) fn reservoir_bytes_per_pixel(&self) -> u64 {
        self.reservoirs.iter().map(|r| r.buffer_count() * r.domain.reservoir_bytes).sum()
    }
}

/// Reservoirs of a domain.
pub(crate) struct Reservoirs {
    domain: &'static Domain,
    schedule: ReuseSchedule,
    settings: Buffer,
    /// Reservoirs of this frame and of the last one; the buffers change roles from frame to frame.
    buffers: [Buffer; 2],
    /// Samples of the last frame in the pixels of this one, if the domain moves them there.
    forwarded: Option<Buffer>,
    bytes: u64,
    /// Contributions of the samples before and after an iteration of reuse; the textures change roles with each.
    light: [TextureView; 2],
    /// Light that the domain does not resample, if it finds any.
    pub(crate) unresampled: Option<TextureView>,
    /// Index of the buffer that holds this frame's candidates.
    candidates_index: usize,
    /// Index of the buffer that the next frame reads.
    final_index: usize,
}

impl Reservoirs {
    fn new(size: UVec2, domain: &'static Domain, settings: &Restir, device: &RenderDevice) -> Self {
        let schedule = (domain.schedule)(settings);
        let bytes = reservoir_bytes(size, domain, settings);
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let buffers = ["reservoirs", "last reservoirs"].map(|label| buffer(device, label, bytes, storage));
        if is_planted(Fault::ReservoirsLeak) {
            core::mem::forget(buffers.clone());
        }
        Self {
            domain,
            settings: buffer(device, "resampling settings", MAX_ITERATIONS as u64 * SETTINGS_STRIDE, uniform),
            buffers,
            forwarded: (!domain.forward.is_empty()).then(|| buffer(device, "forwarded reservoirs", bytes, storage)),
            bytes,
            light: ["light of candidates", "resampled light"].map(|label| light(device, label, size)),
            unresampled: finds_unresampled_light(domain).then(|| light(device, "unresampled light", size)),
            schedule,
            candidates_index: 0,
            final_index: 1,
        }
    }

    fn begin(&mut self, schedule: ReuseSchedule, height: u32, inputs: FrameInputs, queue: &RenderQueue) {
        self.schedule = schedule;
        self.candidates_index = 1 - self.final_index;
        self.final_index = self.output_index(self.iterations() - 1);
        let LightPathCounts { light_paths, splats, .. } = inputs.counts;
        write_settings(&self.settings, self.iterations(), queue, |iteration| GpuResampleSettings {
            light_paths,
            splats,
            nee_share: if light_paths > 0 { 1.0 / self.schedule.reuse_gain } else { 0.0 },
            caustic_share: if light_paths > 0 { self.schedule.reuse_gain } else { 0.0 },
            domain: place_in_technique(self.domain),
            ..self.schedule.uniforms(iteration, height, inputs.last)
        });
    }

    fn buffer_count(&self) -> u64 {
        2 + u64::from(self.forwarded.is_some())
    }

    /// The domain whose samples they hold.
    pub(crate) fn domain(&self) -> &'static Domain {
        self.domain
    }

    /// Uniforms of an iteration.
    pub(crate) fn settings_of(&self, iteration: usize) -> Option<Bound<'_>> {
        settings_of::<GpuResampleSettings>(&self.settings, iteration)
    }

    /// Number of iterations in this frame.
    pub(crate) fn iterations(&self) -> usize {
        self.schedule.iterations.len()
    }

    /// The schedule of this frame.
    pub(crate) fn schedule(&self) -> &ReuseSchedule {
        &self.schedule
    }

    /// Index of the buffer that an iteration writes.  An iteration over this frame's neighbors must not write to the buffer that it reads.
    fn output_index(&self, iteration: usize) -> usize {
        let turns = self.schedule.iterations[..=iteration].iter().filter(|r| !r.from_previous).count();
        (self.candidates_index + turns) % 2
    }

    pub(crate) fn candidates(&self) -> &Buffer {
        &self.buffers[self.candidates_index]
    }

    pub(crate) fn neighbors_of(&self, iteration: usize) -> &Buffer {
        self.forwarded().unwrap_or(&self.buffers[1 - self.output_index(iteration)])
    }

    pub(crate) fn forwarded(&self) -> Option<&Buffer> {
        self.forwarded.as_ref()
    }

    /// Reservoirs of the last frame.
    pub(crate) fn last_frame(&self) -> &Buffer {
        &self.buffers[1 - self.candidates_index]
    }

    pub(crate) fn output_of(&self, iteration: usize) -> &Buffer {
        &self.buffers[self.output_index(iteration)]
    }

    /// Reservoirs that this frame leaves to the next one.
    pub(crate) fn final_output(&self) -> &Buffer {
        &self.buffers[self.final_index]
    }

    /// Contributions of the samples before an iteration; before the first one, those of the candidates.
    pub(crate) fn light_before(&self, iteration: usize) -> &TextureView {
        &self.light[iteration % 2]
    }

    /// Light after the last iteration.
    pub(crate) fn light_of_last_iteration(&self) -> &TextureView {
        self.light_after(self.iterations() - 1)
    }

    /// Contributions of the samples after an iteration; after the last one, the light of the pixel.
    pub(crate) fn light_after(&self, iteration: usize) -> &TextureView {
        &self.light[(iteration + 1) % 2]
    }
}

/// Writes the uniforms of iterations, from the first one on.
pub(super) fn write_settings<T: bytemuck::NoUninit>(
    buffer: &Buffer,
    iterations: usize,
    queue: &RenderQueue,
    of: impl Fn(usize) -> T,
) {
    let mut bytes = vec![0u8; iterations * SETTINGS_STRIDE as usize];
    for (iteration, slot) in bytes.chunks_exact_mut(SETTINGS_STRIDE as usize).enumerate() {
        slot[..size_of::<T>()].copy_from_slice(bytemuck::bytes_of(&of(iteration)));
    }
    queue.write_buffer(buffer, 0, &bytes);
}

/// The uniforms of an iteration.
pub(super) fn settings_of<T>(buffer: &Buffer, iteration: usize) -> Option<Bound<'_>> {
    Some(Bound::Part(buffer, iteration as u64 * SETTINGS_STRIDE, BufferSize::new(size_of::<T>() as u64)?))
}

/// Resources for iterations with pairs; the domains of a frame run one after the other, and share them.
fn pair_kind(domains: &[&Domain], settings: &Restir) -> PairKind {
    let layers_of = |domain: &&Domain| (domain.schedule)(settings).pair_layers();
    let may_replay = |domain: &Domain| domain.pairs.as_ref().is_some_and(|pairs| pairs.compaction.is_some());
    let has_queue = domains.iter().any(|domain| layers_of(domain) > 0 && may_replay(domain));
    PairKind {
        layers: domains.iter().map(layers_of).max().unwrap_or(0),
        has_queue: has_queue && settings.research.replay_compaction,
    }
}

/// Whether a domain finds light that it does not resample.
fn finds_unresampled_light(domain: &Domain) -> bool {
    domain.candidates.resources.contains(&PassResource::UnresampledLight)
}

/// Whether a domain traces light sub-paths.
pub(crate) fn traces_light(domains: &[&Domain]) -> bool {
    domains.iter().any(|domain| domain.light_paths.is_some())
}

/// A texture for light.
pub(super) fn light(device: &RenderDevice, label: &'static str, size: UVec2) -> TextureView {
    let usage = TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING;
    texture(device, label, size, 1, LIGHT_FORMAT, usage).create_view(&TextureViewDescriptor::default())
}

/// Bytes of a domain's reservoirs of one frame.
pub(crate) fn reservoir_bytes(size: UVec2, domain: &Domain, settings: &Restir) -> u64 {
    reservoir_count(size, (domain.schedule)(settings).reservoir_layout()) * domain.reservoir_bytes
}

/// Number of reservoirs of an image.  Tiles at its edge are complete.
fn reservoir_count(size: UVec2, layout: u32) -> u64 {
    match layout {
        LAYOUT_ROWS | LAYOUT_COLUMNS => pixels(size),
        tile => {
            let tiles = pixels(UVec2::new(size.x.div_ceil(tile), size.y.div_ceil(tile)));
            tiles * u64::from(tile) * u64::from(tile)
        }
    }
}

/// Number of entries of the subsets; at least one, because a binding must not be empty.
fn subset_entries(direct: &Direct) -> u64 {
    (direct.subset_count as u64 * direct.subset_size as u64).max(1)
}

/// Workgroups of the pass that fills the subsets.
pub(crate) fn presample_workgroups(direct: &Direct) -> [u32; 2] {
    [direct.subset_size.div_ceil(64), direct.subset_count]
}
