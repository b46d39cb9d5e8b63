//! `StandardMaterial` → [`GpuMaterial`]: a slot for every material that an instance uses.

use bevy::{
    asset::AssetId,
    color::{ColorToComponents, LinearRgba},
    ecs::resource::Resource,
    image::Image,
    log::warn_once,
    material::AlphaMode,
    pbr::StandardMaterial,
    platform::collections::HashMap,
    render::{
        render_resource::Face,
        renderer::{RenderDevice, RenderQueue},
    },
};

use super::{
    extract::ExtractedScene, features::SceneFeatures, heap::GpuArray, heap::dirty_runs, textures::TexturePool,
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
        self.slots.iter().filter_map(|slot| self.sources.get(&slot.id)).flat_map(|material| {
            [
                &material.base_color_texture,
                &material.metallic_roughness_texture,
                &material.normal_map_texture,
                &material.emissive_texture,
            ]
            .into_iter()
            .flatten()
            .map(|handle| handle.id())
        })
    }

    /// Packs every slot again where a source or a texture changed.
    pub(crate) fn pack(&mut self, textures: &TexturePool, textures_changed: bool) {
        if !self.stale && !textures_changed {
            return;
        }
        self.stale = false;
        for (i, slot) in self.slots.iter_mut().enumerate() {
            let Some(source) = self.sources.get(&slot.id) else {
                continue;
            };
            let material = pack(source, textures, self.emissive_luminance);
            slot.features = features_of(&material);
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
        let runs = dirty_runs(&self.uploaded, &self.wanted);
        if runs.is_empty() {
            return 0;
        }
        if !self.gpu.reserve(self.wanted.len() as u32, device, queue) {
            warn_once!("{} materials are more than this device can bind", self.wanted.len());
            return 0;
        }
        self.revision += 1;
        let bytes = runs.into_iter().map(|r| self.gpu.write(r.start as u32, &self.wanted[r], queue)).sum();
        self.uploaded.clone_from(&self.wanted);
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
fn pack(m: &StandardMaterial, textures: &TexturePool, emissive_luminance: f32) -> GpuMaterial {
    let finite = |x: f32, otherwise: f32| if x.is_finite() { x } else { otherwise };
    let unit = |x: f32| finite(x, 0.0).clamp(0.0, 1.0);
    let unit_rgb = |c: [f32; 3]| c.map(unit);
    let base = m.base_color.to_linear();
    let tint = m.specular_tint.to_linear().to_f32_array_no_alpha();
    let slot =
        |handle: &Option<bevy::asset::Handle<Image>>| handle.as_ref().map_or(NO_TEXTURE, |h| textures.slot(h.id()));

    let mut flags = 0;
    let mut set = |condition: bool, flag: u32| flags |= if condition { flag } else { 0 };
    set(m.double_sided, MATERIAL_DOUBLE_SIDED);
    set(m.unlit, MATERIAL_UNLIT);
    set(m.flip_normal_map_y, MATERIAL_FLIP_NORMAL_MAP_Y);
    set(m.cull_mode == Some(Face::Back), MATERIAL_CULL_BACK);
    set(m.cull_mode == Some(Face::Front), MATERIAL_CULL_FRONT);
    if let Some(normal) = &m.normal_map_texture {
        set(textures.has_two_components(normal.id()), MATERIAL_TWO_COMPONENT_NORMAL_MAP);
    }
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
    let attenuation = if distance.is_finite() && distance > 0.0 {
        m.attenuation_color.to_linear().to_f32_array_no_alpha().map(|c| -unit(c).max(1e-6).ln() / distance)
    } else {
        [0.0; 3]
    };

    GpuMaterial {
        base_color: unit_rgb(base.to_f32_array_no_alpha()),
        alpha: unit(base.alpha),
        emissive: m.emissive.to_f32_array_no_alpha().map(|c| (finite(c, 0.0).max(0.0) * emissive_luminance).min(1e30)),
        perceptual_roughness: unit(m.perceptual_roughness),
        dielectric_reflectance: tint.map(|t| 0.16 * (unit(m.reflectance) * unit(t)).powi(2)),
        metallic: unit(m.metallic),
        attenuation,
        // A thin wall (thickness 0) is not built yet: light goes straight through it in Bevy too, so it stays opaque here.
        specular_transmission: if m.thickness > 0.0 { unit(m.specular_transmission) } else { 0.0 },
        ior: finite(m.ior, 1.5).clamp(1.0, 10.0),
        thickness: finite(m.thickness, 0.0).max(0.0),
        alpha_cutoff,
        flags,
        base_color_texture: slot(&m.base_color_texture),
        metallic_roughness_texture: slot(&m.metallic_roughness_texture),
        normal_texture: slot(&m.normal_map_texture),
        emissive_texture: slot(&m.emissive_texture),
    }
}

fn features_of(m: &GpuMaterial) -> SceneFeatures {
    let mut features = SceneFeatures::empty();
    let textured = [m.base_color_texture, m.metallic_roughness_texture, m.normal_texture, m.emissive_texture];
    features.set(SceneFeatures::TEXTURES, textured.iter().any(|t| t[0] != NONE));
    features.set(SceneFeatures::NORMAL_MAPS, m.normal_texture[0] != NONE);
    features.set(SceneFeatures::ALPHA, m.flags & (MATERIAL_ALPHA_MASK | MATERIAL_ALPHA_BLEND) != 0);
    features.set(SceneFeatures::TRANSMISSION, m.specular_transmission > 0.0 && m.metallic < 1.0);
    features.set(SceneFeatures::ATTENUATION, m.specular_transmission > 0.0 && m.attenuation != [0.0; 3]);
    features.set(SceneFeatures::UNLIT, m.flags & MATERIAL_UNLIT != 0);
    features
}

fn mean_emission(source: &StandardMaterial, packed: &GpuMaterial, textures: &TexturePool) -> [f32; 3] {
    if source.unlit {
        return [0.0; 3];
    }
    let mean = source.emissive_texture.as_ref().map_or(LinearRgba::WHITE, |handle| textures.mean(handle.id()));
    let [r, g, b] = packed.emissive;
    [r * mean.red, g * mean.green, b * mean.blue]
}
