//! `StandardMaterial` → [`GpuMaterial`]: a slot for every material that an instance uses.

use bevy::{
    asset::AssetId,
    color::{ColorToComponents, LinearRgba},
    ecs::resource::Resource,
    image::Image,
    log::warn_once,
    material::AlphaMode,
    pbr::StandardMaterial,
    platform::collections::{HashMap, HashSet},
    render::{
        render_resource::{Face, TextureFormat},
        renderer::{RenderDevice, RenderQueue},
    },
};

use super::{
    data_texture::DataTexture,
    extract::ExtractedScene,
    features::SceneFeatures,
    heap::{GpuArray, dirty_runs},
    slots::{LAYER_SLOTS, add_record, textures_of},
    textures::TexturePool,
};
use crate::gpu_types::*;

/// A material in use.
struct Slot {
    id: AssetId<StandardMaterial>,
    features: SceneFeatures,
    /// Mean radiance of its emission, cd/m², over its texture; 0 where it does not emit.
    mean_emission: [f32; 3],
}

/// The materials of the scene, on the CPU and on the GPU.
#[derive(Resource)]
pub(crate) struct MaterialPool {
    sources: HashMap<AssetId<StandardMaterial>, StandardMaterial>,
    by_id: HashMap<AssetId<StandardMaterial>, u32>,
    slots: Vec<Slot>,
    wanted: Vec<GpuMaterial>,
    uploaded: Vec<GpuMaterial>,
    pub gpu: GpuArray<GpuMaterial>,
    /// Records of textures, one after the other, of the materials that have any.
    wanted_table: Vec<[u32; 4]>,
    uploaded_table: Vec<[u32; 4]>,
    pub table: DataTexture<[u32; 4]>,
    emissive_luminance: f32,
    /// Slots whose contents must be packed again.
    stale: bool,
    /// Counts changes of anything that is shown.
    pub revision: u64,
}

impl Default for MaterialPool {
    fn default() -> Self {
        Self {
            sources: HashMap::default(),
            by_id: HashMap::default(),
            slots: Vec::new(),
            wanted: Vec::new(),
            uploaded: Vec::new(),
            gpu: GpuArray::new("materials"),
            wanted_table: Vec::new(),
            uploaded_table: Vec::new(),
            table: DataTexture::new("texture table", TextureFormat::Rgba32Uint, 1),
            emissive_luminance: 0.0,
            stale: false,
            revision: 0,
        }
    }
}

impl MaterialPool {
    /// Takes the materials that changed in the main world.
    pub(crate) fn update_sources(&mut self, scene: &mut ExtractedScene) {
        for id in scene.removed_materials.drain() {
            self.sources.remove(&id);
        }
        for (id, material) in scene.materials.drain() {
            self.stale |= self.by_id.contains_key(&id);
            self.sources.insert(id, material);
        }
        if self.emissive_luminance != scene.emissive_luminance {
            self.emissive_luminance = scene.emissive_luminance;
            self.stale = true;
        }
    }

    /// The slot of a material, made on first use; `None` while the asset is not there.
    pub(crate) fn slot(&mut self, id: AssetId<StandardMaterial>) -> Option<u32> {
        if !self.sources.contains_key(&id) {
            return None;
        }
        Some(*self.by_id.entry(id).or_insert_with(|| {
            self.slots.push(Slot { id, features: SceneFeatures::empty(), mean_emission: [0.0; 3] });
            self.stale = true;
            self.slots.len() as u32 - 1
        }))
    }

    /// Images that the materials in use need.
    pub(crate) fn images(&self) -> impl Iterator<Item = AssetId<Image>> {
        let materials = self.slots.iter().filter_map(|slot| self.sources.get(&slot.id));
        materials.flat_map(textures_of).map(|texture| texture.image.id())
    }

    /// Images that some material emits, also of those that changed in this frame.
    pub(crate) fn emissive_images(&self, scene: &ExtractedScene) -> HashSet<AssetId<Image>> {
        let materials = self.sources.values().chain(scene.materials.values());
        materials.filter_map(|m| m.emissive_texture.as_ref()).map(|image| image.id()).collect()
    }

    /// Packs every slot again where a source or a texture changed.
    pub(crate) fn pack(&mut self, textures: &TexturePool, textures_changed: bool) {
        if !self.stale && !textures_changed {
            return;
        }
        self.stale = false;
        self.wanted_table.clear();
        for (i, slot) in self.slots.iter_mut().enumerate() {
            let Some(source) = self.sources.get(&slot.id) else {
                continue;
            };
            let mut material = pack(source, self.emissive_luminance);
            material.texture_record = self.wanted_table.len() as u32;
            let features;
            (material.textures, features) = add_record(source, textures, &mut self.wanted_table);
            slot.features = features_of(&material) | features;
            slot.mean_emission = mean_emission(source, &material, textures);
            if i < self.wanted.len() {
                self.wanted[i] = material;
            } else {
                self.wanted.push(material);
            }
        }
    }

    /// Sends what changed.  Returns the bytes sent.
    pub(crate) fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        let mut bytes = self.upload_table(device, queue);
        let runs = dirty_runs(&self.uploaded, &self.wanted);
        if runs.is_empty() {
            return bytes;
        }
        if !self.gpu.reserve(self.wanted.len() as u32, device, queue) {
            warn_once!("restir: {} materials are more than this device can bind", self.wanted.len());
            return bytes;
        }
        self.revision += 1;
        bytes += runs.into_iter().map(|r| self.gpu.write(r.start as u32, &self.wanted[r], queue)).sum::<u64>();
        self.uploaded.clone_from(&self.wanted);
        bytes
    }

    fn upload_table(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        if self.wanted_table == self.uploaded_table {
            return 0;
        }
        self.revision += 1;
        let limit = DataTexture::<[u32; 4]>::limit(device) as usize;
        if self.wanted_table.len() > limit {
            warn_once!("restir: {} textures of materials are more than this device can bind", self.wanted_table.len());
            self.wanted_table.truncate(limit);
        }
        if self.table.reserve(self.wanted_table.len() as u32, device) {
            self.uploaded_table.clear();
        }
        let runs = dirty_runs(&self.uploaded_table, &self.wanted_table);
        let bytes = runs.into_iter().map(|r| self.table.write(r.start as u32, &self.wanted_table[r], queue)).sum();
        self.uploaded_table.clone_from(&self.wanted_table);
        bytes
    }

    /// The packed material of a slot.
    pub(crate) fn get(&self, slot: u32) -> Option<&GpuMaterial> {
        self.wanted.get(slot as usize)
    }

    /// What a slot asks of the shaders.
    pub(crate) fn features(&self, slot: u32) -> SceneFeatures {
        self.slots.get(slot as usize).map_or(SceneFeatures::empty(), |s| s.features)
    }

    /// Mean radiance of a slot's emission, cd/m².
    pub(crate) fn mean_emission(&self, slot: u32) -> [f32; 3] {
        self.slots.get(slot as usize).map_or([0.0; 3], |s| s.mean_emission)
    }
}

/// What the shaders read.  Numbers out of range are brought into it: a material never makes a NaN.
fn pack(m: &StandardMaterial, emissive_luminance: f32) -> GpuMaterial {
    let finite = |x: f32, otherwise: f32| if x.is_finite() { x } else { otherwise };
    let unit = |x: f32| finite(x, 0.0).clamp(0.0, 1.0);
    let unit_rgb = |c: [f32; 3]| c.map(unit);
    let base = m.base_color.to_linear();
    let tint = m.specular_tint.to_linear().to_f32_array_no_alpha();
    // Bevy halves what its specular texture gives, so that such a material may ask for twice as much.
    let reflectance = finite(m.reflectance, 0.0).clamp(0.0, if has_specular_texture(m) { 2.0 } else { 1.0 });

    let mut flags = 0;
    let mut set = |condition: bool, flag: u32| flags |= if condition { flag } else { 0 };
    set(m.double_sided, MATERIAL_DOUBLE_SIDED);
    set(m.unlit, MATERIAL_UNLIT);
    set(m.flip_normal_map_y, MATERIAL_FLIP_NORMAL_MAP_Y);
    set(m.cull_mode == Some(Face::Back), MATERIAL_CULL_BACK);
    set(m.cull_mode == Some(Face::Front), MATERIAL_CULL_FRONT);
    let mut alpha_cutoff = 0.5;
    match m.alpha_mode {
        AlphaMode::Opaque => {}
        AlphaMode::Mask(cutoff) => {
            alpha_cutoff = finite(cutoff, 0.5);
            set(true, MATERIAL_ALPHA_MASK);
        }
        _ => set(true, MATERIAL_ALPHA_BLEND),
    }

    // Absorption so that white light is `attenuation_color` after `attenuation_distance`; white or an infinite distance absorbs nothing.
    let distance = m.attenuation_distance;
    let thickness = finite(m.thickness, 0.0).max(0.0);
    // A thin wall has no inside.
    let attenuation = if distance.is_finite() && distance > 0.0 && thickness > 0.0 {
        m.attenuation_color.to_linear().to_f32_array_no_alpha().map(|c| -unit(c).max(1e-6).ln() / distance)
    } else {
        [0.0; 3]
    };

    let turned = finite(m.anisotropy_rotation, 0.0);
    GpuMaterial {
        base_color: unit_rgb(base.to_f32_array_no_alpha()),
        alpha: unit(base.alpha),
        emissive: m.emissive.to_f32_array_no_alpha().map(|c| (finite(c, 0.0).max(0.0) * emissive_luminance).min(1e30)),
        perceptual_roughness: unit(m.perceptual_roughness),
        dielectric_reflectance: tint.map(|t| 0.16 * (reflectance * unit(t)).powi(2)),
        metallic: unit(m.metallic),
        attenuation,
        specular_transmission: unit(m.specular_transmission),
        ior: finite(m.ior, 1.5).clamp(1.0, 10.0),
        thickness,
        alpha_cutoff,
        flags,
        anisotropy_direction: [turned.cos(), turned.sin()],
        anisotropy_strength: unit(m.anisotropy_strength),
        diffuse_transmission: unit(m.diffuse_transmission),
        // Unlit is black to light, its coat too.
        clearcoat: if m.unlit { 0.0 } else { unit(m.clearcoat) },
        clearcoat_perceptual_roughness: unit(m.clearcoat_perceptual_roughness),
        ..Default::default()
    }
}

fn features_of(m: &GpuMaterial) -> SceneFeatures {
    let mut features = SceneFeatures::empty();
    features.set(SceneFeatures::TEXTURES, m.textures != 0);
    features.set(SceneFeatures::NORMAL_MAPS, m.textures & SLOT_NORMAL != 0);
    features.set(SceneFeatures::LAYER_TEXTURES, m.textures & LAYER_SLOTS != 0);
    features.set(SceneFeatures::ALPHA, m.flags & (MATERIAL_ALPHA_MASK | MATERIAL_ALPHA_BLEND) != 0);
    let may_be_no_metal = m.metallic < 1.0 || m.textures & SLOT_METALLIC_ROUGHNESS != 0;
    let transmits = may_be_no_metal && m.flags & MATERIAL_UNLIT == 0;
    let specular = transmits && m.specular_transmission > 0.0;
    let diffuse = transmits && m.diffuse_transmission > 0.0;
    features.set(SceneFeatures::TRANSMISSION, specular);
    features.set(SceneFeatures::DIFFUSE_TRANSMISSION, diffuse);
    features.set(
        SceneFeatures::THIN_WALL,
        (specular || diffuse) && (m.thickness == 0.0 || m.textures & SLOT_THICKNESS != 0),
    );
    features.set(SceneFeatures::ATTENUATION, (specular || diffuse) && m.attenuation != [0.0; 3]);
    features.set(SceneFeatures::CLEARCOAT, m.clearcoat > 0.0);
    features.set(SceneFeatures::ANISOTROPY, m.anisotropy_strength > 0.0 && m.flags & MATERIAL_UNLIT == 0);
    features.set(SceneFeatures::UNLIT, m.flags & MATERIAL_UNLIT != 0);
    features
}

#[cfg(feature = "material_textures")]
fn has_specular_texture(m: &StandardMaterial) -> bool {
    m.specular_texture.is_some()
}

#[cfg(not(feature = "material_textures"))]
fn has_specular_texture(_: &StandardMaterial) -> bool {
    false
}

fn mean_emission(source: &StandardMaterial, packed: &GpuMaterial, textures: &TexturePool) -> [f32; 3] {
    if source.unlit {
        return [0.0; 3];
    }
    let mean = source.emissive_texture.as_ref().map_or(LinearRgba::WHITE, |handle| textures.mean(handle.id()));
    let [r, g, b] = packed.emissive;
    [r * mean.red, g * mean.green, b * mean.blue]
}
