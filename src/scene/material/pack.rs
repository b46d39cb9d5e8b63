//! The record of a `StandardMaterial` for shaders, and the features that it needs.

use bevy::{
    color::{ColorToComponents, LinearRgba},
    material::AlphaMode,
    pbr::StandardMaterial,
    render::render_resource::Face,
};
use core::cell::Cell;

use super::texture_slots::LAYER_SLOTS;
use crate::{
    gpu_layout::*,
    scene::{extract::lights::MAX_LIGHT, features::SceneFeatures, texture::textures::TexturePool},
};

/// Packs a material for shaders.  Clamps numbers to their ranges and replaces those that are not finite, so that no material causes a NaN.
/// Returns whether there were such numbers.
pub(super) fn pack(m: &StandardMaterial, emissive_luminance: f32) -> (GpuMaterial, bool) {
    // Infinity is a valid distance.
    let has_replaced = Cell::new(m.attenuation_distance.is_nan());
    let finite = |x: f32, otherwise: f32| {
        has_replaced.set(has_replaced.get() || !x.is_finite());
        if x.is_finite() { x } else { otherwise }
    };
    let unit = |x: f32| finite(x, 0.0).clamp(0.0, 1.0);
    let unit_rgb = |c: [f32; 3]| c.map(unit);
    let base = m.base_color.to_linear();
    let base_rgb = base.to_f32_array_no_alpha().map(|c| finite(c, 0.0).clamp(0.0, 1e30));
    // Bevy draws unlit colors above 1, for glow: the excess goes into the luminance that the shaders multiply the color by.
    let excess = if m.unlit { base_rgb.into_iter().fold(1.0, f32::max) } else { 1.0 };
    let tint = m.specular_tint.to_linear().to_f32_array_no_alpha();
    // Bevy halves the values of a specular texture, so the reflectance of such a material may be up to 2.
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
        // Without multisampling, which `Restir` turns off, Bevy draws it as a mask, too.
        AlphaMode::AlphaToCoverage => set(true, MATERIAL_ALPHA_MASK),
        _ => set(true, MATERIAL_ALPHA_BLEND),
    }

    let thickness = finite(m.thickness, 0.0).max(0.0);
    // A thin wall has no interior that could absorb, and what transmits nothing has none that light reaches.
    let has_interior = unit(m.specular_transmission) > 0.0 || unit(m.diffuse_transmission) > 0.0;
    let attenuation = match thickness > 0.0 && has_interior {
        true => absorption(unit_rgb(m.attenuation_color.to_linear().to_f32_array_no_alpha()), m.attenuation_distance),
        false => [0.0; 3],
    };

    let emissive = if m.unlit {
        // The shaders multiply it by the base color: the camera sees an unlit material as a lamp of its color, which lights nothing.
        [(emissive_luminance * excess).min(MAX_LIGHT); 3]
    } else {
        // With a weight of 1, `emissive` is in cd/m².
        let unit_luminance = emissive_luminance + (1.0 - emissive_luminance) * unit(m.emissive_exposure_weight);
        m.emissive.to_f32_array_no_alpha().map(|c| (finite(c, 0.0).max(0.0) * unit_luminance).min(MAX_LIGHT))
    };
    let rotation = finite(m.anisotropy_rotation, 0.0);
    let packed = GpuMaterial {
        base_color: unit_rgb(base_rgb.map(|c| c / excess)),
        alpha: unit(base.alpha),
        emissive,
        perceptual_roughness: unit(m.perceptual_roughness),
        // Tints of glTF files may exceed 1; the shaders limit the product with textures to 1.
        dielectric_reflectance: tint.map(|t| 0.16 * (reflectance * finite(t, 0.0).clamp(0.0, 1e3)).powi(2)),
        metallic: unit(m.metallic),
        attenuation,
        specular_transmission: unit(m.specular_transmission),
        ior: finite(m.ior, 1.5).clamp(1.0, 10.0),
        thickness,
        alpha_cutoff,
        flags,
        anisotropy_direction: [rotation.cos(), rotation.sin()],
        anisotropy_strength: unit(m.anisotropy_strength),
        diffuse_transmission: unit(m.diffuse_transmission),
        // An unlit material reflects nothing, and neither does its coat.
        clearcoat: if m.unlit { 0.0 } else { unit(m.clearcoat) },
        clearcoat_perceptual_roughness: unit(m.clearcoat_perceptual_roughness),
        ..Default::default()
    };
    (packed, has_replaced.get())
}

/// Absorption coefficient of an interior in which white light has a color after a distance.  A white color or an infinite distance absorbs
/// nothing.
fn absorption(color: [f32; 3], distance: f32) -> [f32; 3] {
    match distance.is_finite() && distance > 0.0 {
        true => color.map(|c| (-c.max(1e-6).ln() / distance).min(1e30)),
        false => [0.0; 3],
    }
}

/// Perceptual roughness below which the denoiser follows rays.
const SMOOTH: f32 = 0.142;

/// Features of the scene that shaders need for a material.
pub(super) fn features_of(m: &GpuMaterial) -> SceneFeatures {
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
    let may_be_smooth = m.perceptual_roughness < SMOOTH || m.textures & SLOT_METALLIC_ROUGHNESS != 0;
    features.set(SceneFeatures::SMOOTH, may_be_smooth && m.flags & MATERIAL_UNLIT == 0);
    features.set(SceneFeatures::CLEARCOAT, m.clearcoat > 0.0);
    features.set(SceneFeatures::ANISOTROPY, m.anisotropy_strength > 0.0 && m.flags & MATERIAL_UNLIT == 0);
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

/// Emitted radiance, averaged over the texture.
pub(super) fn mean_emission(source: &StandardMaterial, packed: &GpuMaterial, textures: &TexturePool) -> [f32; 3] {
    if source.unlit {
        return [0.0; 3];
    }
    let mean = source.emissive_texture.as_ref().map_or(LinearRgba::WHITE, |handle| textures.mean(handle.id()));
    let [r, g, b] = packed.emissive;
    [r * mean.red, g * mean.green, b * mean.blue]
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_material_that_the_denoiser_follows_has_the_feature() {
        let shader = include_str!("../../../shaders/denoiser/optical_image.wgsl");
        let line = shader.lines().find_map(|line| line.strip_prefix("const SMOOTH: f32 = ")).expect("it is declared");
        let smooth: f32 = line.trim_end_matches(';').parse().expect("it is a number");
        // The shader compares the square.
        assert!((smooth..1.02 * smooth).contains(&super::SMOOTH.powi(2)), "{smooth}");
    }
}
