//! Keeps a record for each [`Subsurface`] of the scene, in a texture that shaders read.  Equal components share a record.

use bevy::{
    ecs::resource::Resource,
    log::{warn, warn_once},
    platform::collections::HashMap,
    render::{
        render_resource::TextureFormat,
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};

use crate::gpu_layout::*;
use crate::scene::storage::data_texture::DataTexture;
use crate::settings::Subsurface;
use crate::warned::Warned;

/// The records of the scene, on the CPU and on the GPU.
#[derive(Resource)]
pub(crate) struct SubsurfacePool {
    /// Mean free path and weight, in the order of their first use.
    records: Vec<[f32; 4]>,
    uploaded: Vec<[f32; 4]>,
    by_value: HashMap<[u32; 4], u32>,
    pub gpu: DataTexture<[f32; 4]>,
    /// Entities with values out of range, for which there was a warning.
    warned: Warned<MainEntity>,
    limit: u32,
    /// Counts changes of records that the last frame used, other than the addition of new ones.
    pub edit_revision: u64,
}

impl Default for SubsurfacePool {
    fn default() -> Self {
        Self {
            records: Vec::new(),
            uploaded: Vec::new(),
            by_value: HashMap::default(),
            gpu: DataTexture::new("subsurface", TextureFormat::Rgba32Float, 1),
            warned: Warned::default(),
            limit: 0,
            edit_revision: 0,
        }
    }
}

impl SubsurfacePool {
    /// Lengths of the pool's tables.
    #[cfg(feature = "testing")]
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![("records of subsurface", self.records.len()), ("warnings of subsurface", self.warned.len())]
    }

    pub(crate) fn begin_frame(&mut self) {
        self.warned.begin_frame();
    }

    /// Forgets warnings of entities that are gone.
    pub(crate) fn forget_warnings(&mut self, exists: impl Fn(MainEntity) -> bool) {
        self.warned.retain(|entity| exists(*entity));
    }

    /// Forgets all records, before all instances with a [`Subsurface`] are visited.
    pub(crate) fn restart(&mut self, device: &RenderDevice) {
        self.records.clear();
        self.by_value.clear();
        self.limit = DataTexture::<[f32; 4]>::limit(device).min(1 << (32 - INSTANCE_SUBSURFACE_SHIFT));
    }

    /// The flags of an instance with this component; no flags if no light scatters below its surface.
    pub(crate) fn flags_of(&mut self, entity: MainEntity, subsurface: Subsurface) -> u32 {
        let mut valid = subsurface;
        let warnings = valid.validate();
        if !warnings.is_empty() && self.warned.is_due(entity) {
            warn!("restir: entity {} has a Subsurface out of range: {}", *entity, warnings.join(", "));
        }
        if valid.weight == 0.0 || valid.mean_free_path.max_element() == 0.0 {
            return 0;
        }
        let record = valid.mean_free_path.extend(valid.weight).to_array();
        let next = self.records.len() as u32;
        let index = *self.by_value.entry(record.map(f32::to_bits)).or_insert(next);
        if index >= self.limit {
            warn_once!(
                "restir: only {} different Subsurface components fit this device; other objects are diffuse",
                self.limit
            );
            return 0;
        }
        if index == next {
            self.records.push(record);
        }
        INSTANCE_SUBSURFACE | index << INSTANCE_SUBSURFACE_SHIFT
    }

    /// Uploads the records if they changed, and frees the texture of a scene without any.  Returns the number of bytes.
    pub(crate) fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        if self.records == self.uploaded {
            return 0;
        }
        let has_only_grown = self.records.starts_with(&self.uploaded);
        self.edit_revision += u64::from(!has_only_grown);
        self.uploaded.clone_from(&self.records);
        if self.records.is_empty() {
            self.gpu.clear();
            return 0;
        }
        self.gpu.reserve(self.records.len() as u32, device);
        self.gpu.write(0, &self.records, queue)
    }
}
