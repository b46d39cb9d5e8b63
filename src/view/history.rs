//! What resampling keeps of a view between frames: reservoirs of this frame and of the last, and the last visibility buffer.  It exists
//! only while a camera runs a technique that resamples.

use bevy::{
    math::UVec2,
    render::{
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
    },
};

use super::{
    VISIBILITY_FORMAT, buffer, pixels,
    plan::{Domain, MOST_ROUNDS, Plan},
    texture,
};
use crate::{
    gpu_types::*,
    settings::{Direct, Restir},
};

/// Format of the light that passes hand on.
pub(crate) const LIGHT_FORMAT: TextureFormat = TextureFormat::Rgba32Float;
/// From one round's uniforms to the next one's, bytes: what every device aligns them to.
const SETTINGS_STRIDE: u64 = 256;

/// What is kept of a view.
pub(crate) struct History {
    pub(crate) subsets: Buffer,
    subset_entries: u64,
    pub(crate) previous_visibility: Texture,
    pub(crate) previous_visibility_view: TextureView,
    /// Light of a technique that does not run.
    pub(crate) black: TextureView,
    reservoirs: Vec<Reservoirs>,
    size: UVec2,
}

impl History {
    pub(crate) fn new(size: UVec2, domains: &[Domain], settings: &Restir, device: &RenderDevice) -> Self {
        let entries = subset_entries(&settings.direct);
        let previous_visibility = texture(
            device,
            "last visibility",
            size,
            VISIBILITY_FORMAT,
            TextureUsages::COPY_DST | TextureUsages::TEXTURE_BINDING,
        );
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        Self {
            subsets: buffer(device, "light subsets", entries * PRESAMPLED_LIGHT_SIZE, storage),
            subset_entries: entries,
            previous_visibility_view: previous_visibility.create_view(&TextureViewDescriptor::default()),
            previous_visibility,
            black: light(device, "no light", UVec2::ONE),
            reservoirs: domains.iter().map(|&domain| Reservoirs::new(size, domain, settings, device)).collect(),
            size,
        }
    }

    /// Whether all of it serves these settings.
    pub(crate) fn fits(&self, size: UVec2, domains: &[Domain], settings: &Restir) -> bool {
        self.size == size
            && self.subset_entries == subset_entries(&settings.direct)
            && self.reservoirs.iter().map(|r| r.domain).eq(domains.iter().copied())
            && self.reservoirs.iter().all(|r| r.plan.tiling() == Plan::of(r.domain, settings).tiling())
    }

    /// Begins a frame: what the last one kept is the history.  `moved`: something did since then.
    pub(crate) fn begin(&mut self, settings: &Restir, has_history: bool, moved: bool, queue: &RenderQueue) {
        for reservoirs in &mut self.reservoirs {
            reservoirs.begin(Plan::of(reservoirs.domain, settings), self.size.y, has_history, moved, queue);
        }
    }

    /// The reservoirs of a domain.
    pub(crate) fn of(&self, domain: Domain) -> Option<&Reservoirs> {
        self.reservoirs.iter().find(|r| r.domain == domain)
    }

    /// Names and bytes.
    pub(crate) fn memory(&self) -> Vec<(&'static str, u64)> {
        let pixels = pixels(self.size);
        let mut memory =
            vec![("light subsets", self.subset_entries * PRESAMPLED_LIGHT_SIZE), ("last visibility", pixels * 8)];
        for r in &self.reservoirs {
            let [settings, reservoirs, light] = match r.domain {
                Domain::Direct => ["direct settings", "reservoirs", "light"],
                Domain::Paths => ["path settings", "path reservoirs", "light of paths"],
                Domain::Indirect => ["indirect settings", "indirect reservoirs", "indirect light"],
            };
            memory.extend([
                (settings, MOST_ROUNDS as u64 * SETTINGS_STRIDE),
                (reservoirs, 2 * r.bytes),
                (light, 2 * pixels * 16),
            ]);
        }
        memory
    }

    /// Bytes of reservoirs a pixel.
    pub(crate) fn reservoir_bytes_per_pixel(&self) -> u64 {
        self.reservoirs.iter().map(|r| 2 * reservoir_size(r.domain)).sum()
    }
}

/// What a domain keeps.
pub(crate) struct Reservoirs {
    domain: Domain,
    plan: Plan,
    settings: Buffer,
    /// Of this frame and of the last, in turns.
    buffers: [Buffer; 2],
    bytes: u64,
    /// Light that candidates leave, and that rounds of reuse do.
    light: [TextureView; 2],
    /// Which buffer this frame's candidates go to.
    first: usize,
    /// Which buffer a frame leaves.
    kept: usize,
}

impl Reservoirs {
    fn new(size: UVec2, domain: Domain, settings: &Restir, device: &RenderDevice) -> Self {
        let plan = Plan::of(domain, settings);
        let bytes = reservoir_bytes(size, domain, settings);
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Self {
            domain,
            settings: buffer(device, "resampling settings", MOST_ROUNDS as u64 * SETTINGS_STRIDE, uniform),
            buffers: ["reservoirs", "last reservoirs"].map(|label| buffer(device, label, bytes, storage)),
            bytes,
            light: ["light of candidates", "resampled light"].map(|label| light(device, label, size)),
            plan,
            first: 0,
            kept: 1,
        }
    }

    fn begin(&mut self, plan: Plan, height: u32, has_history: bool, moved: bool, queue: &RenderQueue) {
        self.plan = plan;
        self.first = 1 - self.kept;
        self.kept = self.output_index(self.rounds() - 1);
        let mut bytes = vec![0u8; self.rounds() * SETTINGS_STRIDE as usize];
        for (round, slot) in bytes.chunks_exact_mut(SETTINGS_STRIDE as usize).enumerate() {
            let settings = self.plan.uniforms(round, height, has_history, moved);
            slot[..size_of_val(&settings)].copy_from_slice(bytemuck::bytes_of(&settings));
        }
        queue.write_buffer(&self.settings, 0, &bytes);
    }

    /// Uniforms of a round.
    pub(crate) fn settings_of(&self, round: usize) -> BindingResource<'_> {
        BindingResource::Buffer(BufferBinding {
            buffer: &self.settings,
            offset: round as u64 * SETTINGS_STRIDE,
            size: core::num::NonZero::new(size_of::<GpuResampleSettings>() as u64),
        })
    }

    /// How many rounds this frame has.
    pub(crate) fn rounds(&self) -> usize {
        self.plan.rounds.len()
    }

    /// Rounds of this frame's neighbours write where they do not read, in turns.
    fn output_index(&self, round: usize) -> usize {
        let turns = self.plan.rounds[..=round].iter().filter(|r| !r.from_previous).count();
        (self.first + turns) % 2
    }

    pub(crate) fn candidates(&self) -> &Buffer {
        &self.buffers[self.first]
    }

    pub(crate) fn neighbours_of(&self, round: usize) -> &Buffer {
        &self.buffers[1 - self.output_index(round)]
    }

    pub(crate) fn output_of(&self, round: usize) -> &Buffer {
        &self.buffers[self.output_index(round)]
    }

    pub(crate) fn kept(&self) -> &Buffer {
        &self.buffers[self.kept]
    }

    /// What candidates leave: light that only they find, or what the samples carry that they keep.
    pub(crate) fn light_of_candidates(&self) -> &TextureView {
        &self.light[0]
    }

    /// What the samples carry that a round finds.
    pub(crate) fn light_before(&self, round: usize) -> &TextureView {
        match self.domain {
            Domain::Direct => &self.light[0],
            Domain::Paths | Domain::Indirect => &self.light[round % 2],
        }
    }

    /// What the last one leaves.
    pub(crate) fn light_of_last_round(&self) -> &TextureView {
        self.light_after(self.rounds() - 1)
    }

    /// What a round leaves.
    pub(crate) fn light_after(&self, round: usize) -> &TextureView {
        match self.domain {
            Domain::Direct => &self.light[1],
            Domain::Paths | Domain::Indirect => &self.light[(round + 1) % 2],
        }
    }
}

/// A texture of light.
fn light(device: &RenderDevice, label: &'static str, size: UVec2) -> TextureView {
    let usage = TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING;
    texture(device, label, size, LIGHT_FORMAT, usage).create_view(&TextureViewDescriptor::default())
}

fn reservoir_size(domain: Domain) -> u64 {
    match domain {
        Domain::Direct => DIRECT_RESERVOIR_SIZE,
        Domain::Paths => PATH_RESERVOIR_SIZE,
        Domain::Indirect => INDIRECT_RESERVOIR_SIZE,
    }
}

/// Bytes of a domain's reservoirs of one frame.
pub(crate) fn reservoir_bytes(size: UVec2, domain: Domain, settings: &Restir) -> u64 {
    reservoir_count(size, Plan::of(domain, settings).tiling()) * reservoir_size(domain)
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
