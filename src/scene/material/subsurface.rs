//! Keeps a record for each [`Subsurface`] of the scene, in a texture that shaders read.  Equal components share a record.
//!
//! Temporal reuse also reads the records of the last frame.  So a record stays as it is while an instance of this frame or of the last one
//! has its number, and an object whose component changes gets the number of another record.

use bevy::{
    ecs::resource::Resource,
    log::{warn, warn_once},
    platform::collections::HashMap,
    render::{
        render_resource::TextureFormat,
        renderer::{RenderDevice, RenderQueue},
        sync_world::{MainEntity, MainEntityHashMap},
    },
};

use crate::gpu_layout::*;
use crate::scene::storage::{
    data_texture::{DataTexture, Reserved},
    dirty_runs::dirty_runs,
};
use crate::settings::Subsurface;
use crate::warned::Warned;

/// Mean free path and weight.
type Record = [f32; 4];

/// The records of the scene, on the CPU and on the GPU.
#[derive(Resource)]
pub(crate) struct SubsurfacePool {
    /// Records, some of them free, with the number of shown objects that use each.
    records: Vec<(Record, u32)>,
    by_value: HashMap<[u32; 4], u32>,
    /// Records that are free.
    free: Vec<u32>,
    /// Records that have lost their last user in this frame.  The last frame still has them.
    retired: Vec<u32>,
    /// The record of each shown object that has one.
    users: MainEntityHashMap<u32>,
    /// The GPU may lack records.
    is_dirty: bool,
    uploaded: Vec<Record>,
    pub gpu: DataTexture<Record>,
    /// The GPU has the records of this frame.
    pub fits: bool,
    /// Entities with values out of range, for which there was a warning.
    warned: Warned<MainEntity>,
    limit: u32,
}

impl Default for SubsurfacePool {
    fn default() -> Self {
        Self {
            records: Vec::new(),
            by_value: HashMap::default(),
            free: Vec::new(),
            retired: Vec::new(),
            users: MainEntityHashMap::default(),
            is_dirty: false,
            uploaded: Vec::new(),
            gpu: DataTexture::new("subsurface", TextureFormat::Rgba32Float, 1),
            fits: true,
            warned: Warned::default(),
            limit: 0,
        }
    }
}

impl SubsurfacePool {
    /// Lengths of the pool's tables.
    #[cfg(feature = "testing")]
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("records of subsurface", self.records.len()),
            ("users of subsurface", self.users.len()),
            ("warnings of subsurface", self.warned.len()),
        ]
    }

    /// Frees the records that the last frame was the last to use.
    pub(crate) fn begin_frame(&mut self, device: &RenderDevice) {
        self.warned.begin_frame();
        self.limit = DataTexture::<Record>::limit(device).min(1 << (32 - INSTANCE_SUBSURFACE_SHIFT));
        for index in self.retired.drain(..) {
            let (record, users) = self.records[index as usize];
            // It may have found a new user since it lost the last one, and lost that one, too.
            if users == 0 && self.by_value.remove(&record.map(f32::to_bits)).is_some() {
                self.free.push(index);
            }
        }
        if self.by_value.is_empty() && !self.records.is_empty() {
            self.records.clear();
            self.free.clear();
            self.is_dirty = true;
        }
    }

    /// Forgets warnings of entities that are gone.
    pub(crate) fn forget_warnings(&mut self, exists: impl Fn(MainEntity) -> bool) {
        self.warned.retain(|entity| exists(*entity));
    }

    /// The flags of an object with this component, or without one; no flags if no light scatters below its surface.
    pub(crate) fn flags_of(&mut self, entity: MainEntity, subsurface: Option<Subsurface>) -> u32 {
        let record = subsurface.and_then(|subsurface| self.record_of(entity, subsurface));
        let index = record.and_then(|record| self.index_of(record));
        // Most objects have no record, neither before nor now.
        if index.is_some() || !self.users.is_empty() {
            let old = match index {
                Some(index) => self.users.insert(entity, index),
                None => self.users.remove(&entity),
            };
            // The new user comes first: an object that keeps its record does not retire it.
            if let Some(index) = index {
                self.records[index as usize].1 += 1;
            }
            if let Some(old) = old {
                self.leave(old);
            }
        }
        index.map_or(0, |index| INSTANCE_SUBSURFACE | index << INSTANCE_SUBSURFACE_SHIFT)
    }

    /// Gives up the record of an object that has disappeared.
    pub(crate) fn release(&mut self, entity: MainEntity) {
        if let Some(index) = self.users.remove(&entity) {
            self.leave(index);
        }
    }

    fn leave(&mut self, index: u32) {
        let (_, users) = &mut self.records[index as usize];
        *users -= 1;
        if *users == 0 {
            self.retired.push(index);
        }
    }

    /// The record of a component; `None` if no light scatters below the surface.
    fn record_of(&mut self, entity: MainEntity, subsurface: Subsurface) -> Option<Record> {
        let mut valid = subsurface;
        let warnings = valid.validate();
        if !warnings.is_empty() && self.warned.is_due(entity) {
            warn!("restir: entity {} has a Subsurface with values out of range: {}", *entity, warnings.join(", "));
        }
        let scatters = valid.weight != 0.0 && valid.mean_free_path.max_element() != 0.0;
        scatters.then(|| valid.mean_free_path.extend(valid.weight).to_array())
    }

    /// The number of a record; `None` if the device cannot bind more.
    fn index_of(&mut self, record: Record) -> Option<u32> {
        let bits = record.map(f32::to_bits);
        if let Some(index) = self.by_value.get(&bits) {
            return Some(*index);
        }
        let index = match self.free.pop() {
            Some(index) => index,
            None if self.records.len() as u32 >= self.limit => {
                warn_once!(
                    "restir: only {} different values of Subsurface fit this device; objects with further ones are diffuse",
                    self.limit
                );
                return None;
            }
            None => {
                self.records.push((record, 0));
                self.records.len() as u32 - 1
            }
        };
        self.records[index as usize] = (record, 0);
        self.by_value.insert(bits, index);
        self.is_dirty = true;
        Some(index)
    }

    /// Uploads the records that changed, and frees the texture of a scene without any.  Returns the number of bytes.
    pub(crate) fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        self.fits = true;
        if !self.is_dirty {
            return 0;
        }
        if self.records.is_empty() {
            self.is_dirty = false;
            self.uploaded.clear();
            self.gpu.clear();
            return 0;
        }
        match self.gpu.reserve(self.records.len() as u32, device) {
            Reserved::Kept => {}
            Reserved::Replaced => self.uploaded.clear(),
            Reserved::Failed => {
                // The next frame tries again: memory may have become free.
                self.fits = false;
                return 0;
            }
        }
        self.is_dirty = false;
        let records: Vec<Record> = self.records.iter().map(|(record, _)| *record).collect();
        let runs = dirty_runs(&self.uploaded, &records);
        let bytes = runs.into_iter().map(|run| self.gpu.write(run.start as u32, &records[run], queue)).sum();
        self.uploaded = records;
        bytes
    }
}
