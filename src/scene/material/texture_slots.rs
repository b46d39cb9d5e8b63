//! Texture slots: lists the textures of a `StandardMaterial` that affect its look, and writes the record by which shaders find them
//! (`shaders/scene/material.wgsl`).

use bevy::{asset::Handle, image::Image, log::warn_once, math::Affine2, mesh::UvChannel, pbr::StandardMaterial};

use crate::gpu_layout::*;
use crate::scene::{
    features::SceneFeatures,
    texture::image_info::{BINDLESS, SECOND_UV},
    texture::textures::TexturePool,
};

/// A texture that a material uses: its kind, `SLOT_*`, and whether it uses the second texture coordinates.
pub(crate) struct MaterialTexture<'a> {
    pub kind: u32,
    pub image: &'a Handle<Image>,
    pub second_uv: bool,
}

/// Textures of a material in the order of their kinds.  A texture that only scales a factor of 0 is omitted.
pub(crate) fn textures_of(m: &StandardMaterial) -> impl Iterator<Item = MaterialTexture<'_>> {
    let emits = m.emissive.red.max(m.emissive.green).max(m.emissive.blue) > 0.0 && !m.unlit;
    [
        (SLOT_BASE_COLOR, true, &m.base_color_texture, &m.base_color_channel),
        (SLOT_METALLIC_ROUGHNESS, true, &m.metallic_roughness_texture, &m.metallic_roughness_channel),
        (SLOT_NORMAL, true, &m.normal_map_texture, &m.normal_map_channel),
        (SLOT_EMISSIVE, emits, &m.emissive_texture, &m.emissive_channel),
    ]
    .into_iter()
    .chain(layer_textures_of(m))
    .filter_map(|(kind, is_visible, image, channel)| {
        let image = image.as_ref().filter(|_| is_visible)?;
        Some(MaterialTexture { kind, image, second_uv: matches!(channel, UvChannel::Uv1) })
    })
}

/// Kind, whether the texture affects the material, image and texture coordinates.
type Row<'a> = (u32, bool, &'a Option<Handle<Image>>, &'a UvChannel);

#[cfg(feature = "material_textures")]
fn layer_textures_of(m: &StandardMaterial) -> impl Iterator<Item = Row<'_>> {
    let transmits = m.specular_transmission > 0.0;
    [
        (SLOT_SPECULAR_TRANSMISSION, transmits, &m.specular_transmission_texture, &m.specular_transmission_channel),
        (
            SLOT_DIFFUSE_TRANSMISSION,
            m.diffuse_transmission > 0.0,
            &m.diffuse_transmission_texture,
            &m.diffuse_transmission_channel,
        ),
        (
            SLOT_THICKNESS,
            m.thickness > 0.0 && (transmits || m.diffuse_transmission > 0.0),
            &m.thickness_texture,
            &m.thickness_channel,
        ),
        (SLOT_CLEARCOAT, m.clearcoat > 0.0, &m.clearcoat_texture, &m.clearcoat_channel),
        (SLOT_CLEARCOAT_ROUGHNESS, m.clearcoat > 0.0, &m.clearcoat_roughness_texture, &m.clearcoat_roughness_channel),
        (SLOT_CLEARCOAT_NORMAL, m.clearcoat > 0.0, &m.clearcoat_normal_texture, &m.clearcoat_normal_channel),
        (SLOT_ANISOTROPY, m.anisotropy_strength > 0.0, &m.anisotropy_texture, &m.anisotropy_channel),
        (SLOT_SPECULAR, m.reflectance > 0.0, &m.specular_texture, &m.specular_channel),
        (SLOT_SPECULAR_TINT, m.reflectance > 0.0, &m.specular_tint_texture, &m.specular_tint_channel),
    ]
    .into_iter()
}

/// Without the feature, Bevy's `StandardMaterial` may lack these slots.
#[cfg(not(feature = "material_textures"))]
fn layer_textures_of(_: &StandardMaterial) -> impl Iterator<Item = Row<'_>> {
    core::iter::empty()
}

/// Kinds that shaders read only with `SceneFeatures::LAYER_TEXTURES`.
pub(crate) const LAYER_SLOTS: u32 =
    !(SLOT_BASE_COLOR | SLOT_METALLIC_ROUGHNESS | SLOT_NORMAL | SLOT_EMISSIVE | SLOT_TRANSFORM);

/// Appends the record of a material's textures to the table.  Returns the kinds of the textures that are loaded (0: there is no record) and
/// the features that shaders need for them.
pub(crate) fn add_record(
    m: &StandardMaterial,
    textures: &TexturePool,
    table: &mut Vec<[u32; 4]>,
) -> (u32, SceneFeatures) {
    let first = table.len();
    let (mut kinds, mut features) = (0, SceneFeatures::empty());
    for texture in textures_of(m) {
        let mut slot = textures.slot(texture.image.id());
        if slot == NO_TEXTURE {
            continue;
        }
        if kinds == 0 && m.uv_transform != Affine2::IDENTITY {
            kinds |= SLOT_TRANSFORM;
            table.extend(transform_of(m));
        }
        if texture.second_uv {
            slot[0] |= SECOND_UV;
            features |= SceneFeatures::SECOND_UVS;
        }
        if slot[0] & BINDLESS != 0 {
            features |= SceneFeatures::BOUND_TEXTURES;
        }
        kinds |= texture.kind;
        table.push(slot);
    }
    debug_assert!(kinds != 0 || table.len() == first);
    (kinds, features)
}

fn transform_of(m: &StandardMaterial) -> [[u32; 4]; 2] {
    let mut transform = m.uv_transform;
    if !transform.is_finite() {
        warn_once!("restir: the uv_transform of a StandardMaterial is not finite; its textures are not transformed");
        transform = Affine2::IDENTITY;
    }
    let [a, b, c, d] = transform.matrix2.to_cols_array().map(f32::to_bits);
    let [x, y] = transform.translation.to_array().map(f32::to_bits);
    [[a, b, c, d], [x, y, 0, 0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::asset::uuid::Uuid;

    /// A handle that a test can recognize.
    fn image(number: u128) -> Option<Handle<Image>> {
        Some(Handle::Uuid(Uuid::from_u128(number), core::marker::PhantomData))
    }

    fn found(m: &StandardMaterial) -> Vec<(u32, u128, bool)> {
        let number = |handle: &Handle<Image>| match handle {
            Handle::Uuid(uuid, _) => uuid.as_u128(),
            Handle::Strong(_) => 0,
        };
        textures_of(m).map(|t| (t.kind, number(t.image), t.second_uv)).collect()
    }

    #[test]
    fn every_texture_of_a_material_is_found_in_order() {
        let m = StandardMaterial {
            base_color_texture: image(1),
            metallic_roughness_texture: image(2),
            normal_map_texture: image(3),
            normal_map_channel: UvChannel::Uv1,
            emissive_texture: image(4),
            ..Default::default()
        };
        let dark = [(SLOT_BASE_COLOR, 1, false), (SLOT_METALLIC_ROUGHNESS, 2, false), (SLOT_NORMAL, 3, true)];
        assert_eq!(found(&m), dark, "a material without emission needs no emissive texture");
        let m = StandardMaterial { emissive: bevy::color::LinearRgba::WHITE, ..m };
        assert_eq!(found(&m).last(), Some(&(SLOT_EMISSIVE, 4, false)));
    }

    #[cfg(feature = "material_textures")]
    #[test]
    fn textures_of_layers_are_found_if_their_factors_are_not_0() {
        let m = StandardMaterial {
            specular_transmission_texture: image(5),
            specular_texture: image(12),
            specular_channel: UvChannel::Uv1,
            specular_tint_texture: image(13),
            reflectance: 2.0,
            ..Default::default()
        };
        assert_eq!(found(&m), [(SLOT_SPECULAR, 12, true), (SLOT_SPECULAR_TINT, 13, false)]);
        let m = StandardMaterial { specular_transmission: 0.5, ..m };
        assert_eq!(found(&m)[0], (SLOT_SPECULAR_TRANSMISSION, 5, false));
        let m = StandardMaterial {
            diffuse_transmission: 0.5,
            thickness: 0.1,
            clearcoat: 0.5,
            anisotropy_strength: 0.5,
            diffuse_transmission_texture: image(6),
            thickness_texture: image(7),
            clearcoat_texture: image(8),
            clearcoat_roughness_texture: image(9),
            clearcoat_roughness_channel: UvChannel::Uv1,
            clearcoat_normal_texture: image(10),
            anisotropy_texture: image(11),
            ..m
        };
        let all = found(&m);
        assert!(all.iter().zip(5..).all(|(t, number)| (t.0, t.1) == (1 << (number - 1), number as u128)), "{all:?}");
        assert_eq!(all.iter().filter(|t| t.2).count(), 2, "two textures use the second coordinates: {all:?}");
    }
}
