//! Requirements on the device.  If one is not met, the plugin warns, names it, and stays off.

use bevy::{
    ecs::world::World,
    pbr::StandardMaterial,
    reflect::{TypeInfo, Typed},
    render::{
        render_resource::{AsBindGroup, DownlevelFlags},
        renderer::{RenderAdapter, RenderDevice},
        settings::WgpuLimits,
    },
};

/// The largest storage binding that limits allow, bytes.
pub(crate) fn binding_limit(limits: &WgpuLimits) -> u64 {
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
}

/// The first requirement of the portable tier that the device does not meet.
pub(crate) fn missing_feature(render_world: &World) -> Option<&'static str> {
    let device = render_world.get_resource::<RenderDevice>()?;
    let adapter = render_world.get_resource::<RenderAdapter>()?;
    missing_of(&device.limits(), adapter.get_downlevel_capabilities().flags)
}

/// Smallest accepted limit for a storage binding, bytes.  Below WebGPU's 128 MiB large images are traced at a lower resolution, and parts
/// of large scenes are left out, with warnings.
const MIN_BINDING: u64 = 1 << 20;

fn missing_of(limits: &WgpuLimits, flags: DownlevelFlags) -> Option<&'static str> {
    if !flags.contains(DownlevelFlags::COMPUTE_SHADERS) {
        return Some("compute shaders");
    }
    if !flags.contains(DownlevelFlags::VERTEX_STORAGE) {
        return Some("storage buffers in vertex shaders");
    }
    if limits.max_storage_buffers_per_shader_stage < 8 {
        return Some("eight storage buffers per shader stage");
    }
    if limits.max_compute_invocations_per_workgroup < 64 {
        return Some("64 compute invocations per workgroup");
    }
    if binding_limit(limits) < MIN_BINDING {
        return Some("storage bindings of 1 MiB");
    }
    None
}

/// Sampled textures, and samplers, that Bevy's own shaders of a `StandardMaterial` without layer textures bind in a stage, without prepasses.
const BEVY_TEXTURES: u32 = 10;

/// The layer textures of `StandardMaterial`.  Bevy has them only with its features `pbr_*_texture(s)`, which the feature
/// `material_textures` turns on, and which any other crate may turn on.
const LAYER_TEXTURES: [&str; 9] = [
    "diffuse_transmission_texture",
    "specular_transmission_texture",
    "thickness_texture",
    "specular_texture",
    "specular_tint_texture",
    "clearcoat_texture",
    "clearcoat_roughness_texture",
    "clearcoat_normal_texture",
    "anisotropy_texture",
];

/// Number of layer textures that a material has.
fn layer_textures(material: &TypeInfo) -> u32 {
    let TypeInfo::Struct(material) = material else { return 0 };
    LAYER_TEXTURES.iter().filter(|name| material.field(name).is_some()).count() as u32
}

/// A warning if Bevy loads layer textures that our pictures leave out.
pub(crate) fn ignored_textures_warning() -> Option<&'static str> {
    let is_ignored = !cfg!(feature = "material_textures") && layer_textures(StandardMaterial::type_info()) > 0;
    is_ignored.then_some(
        "the app turns on Bevy's features for textures of transmission, specular, clearcoat or anisotropy (`pbr_*_texture(s)`), but not \
         the feature `material_textures` of bevy_restir; cameras with `Restir` leave these textures out",
    )
}

/// A warning if Bevy's own shaders do not run on this device because of layer textures.
pub(crate) fn textures_warning(render_world: &World) -> Option<String> {
    let device = render_world.get_resource::<RenderDevice>()?;
    let is_bindless = StandardMaterial::bindless_supported(device);
    let layers = layer_textures(StandardMaterial::type_info());
    if layers > 0 && !is_bindless { too_few_textures(&device.limits(), layers) } else { None }
}

fn too_few_textures(limits: &WgpuLimits, layers: u32) -> Option<String> {
    let (textures, samplers) = (limits.max_sampled_textures_per_shader_stage, limits.max_samplers_per_shader_stage);
    let needed = BEVY_TEXTURES + layers;
    (textures.min(samplers) < needed).then(|| {
        format!(
            "this device binds {textures} textures and {samplers} samplers per shader stage; with Bevy's features `pbr_*_texture(s)`, which \
             `material_textures` turns on, Bevy's own shaders need {needed} of each, and Bevy quits where a camera without `Restir` sees a \
             `StandardMaterial`"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::reflect::Reflect;

    #[test]
    fn a_device_with_too_few_textures_for_bevy_gets_a_warning() {
        let few = WgpuLimits::default();
        let all = LAYER_TEXTURES.len() as u32;
        let enough = WgpuLimits {
            max_sampled_textures_per_shader_stage: BEVY_TEXTURES + all,
            max_samplers_per_shader_stage: BEVY_TEXTURES + all,
            ..few.clone()
        };
        assert_eq!(too_few_textures(&enough, all), None);
        assert_eq!(too_few_textures(&few, 3), None, "clearcoat alone");
        let fewer_samplers = WgpuLimits { max_samplers_per_shader_stage: 16, ..enough };
        for limits in [few, fewer_samplers] {
            assert!(too_few_textures(&limits, all).is_some_and(|warning| warning.contains("material_textures")));
        }
    }

    #[test]
    fn layer_textures_are_counted_whoever_turns_them_on() {
        /// A material with the textures of one of Bevy's features.
        #[derive(Reflect)]
        struct Anisotropic {
            base_color_texture: u32,
            anisotropy_texture: u32,
        }
        assert_eq!(layer_textures(Anisotropic::type_info()), 1);
        assert_eq!(layer_textures(u32::type_info()), 0);
        if cfg!(feature = "material_textures") {
            assert_eq!(layer_textures(StandardMaterial::type_info()), LAYER_TEXTURES.len() as u32);
            assert_eq!(ignored_textures_warning(), None);
        }
    }

    #[test]
    fn every_need_is_checked() {
        let (limits, flags) = (WgpuLimits::default(), DownlevelFlags::all());
        assert_eq!(missing_of(&limits, flags), None, "WebGPU's limits are enough");
        for few in [
            WgpuLimits { max_storage_buffers_per_shader_stage: 7, ..limits.clone() },
            WgpuLimits { max_compute_invocations_per_workgroup: 32, ..limits.clone() },
            WgpuLimits { max_storage_buffer_binding_size: 1 << 19, ..limits.clone() },
            WgpuLimits::downlevel_webgl2_defaults(),
        ] {
            assert!(missing_of(&few, flags).is_some(), "{few:?}");
        }
        for flag in [DownlevelFlags::COMPUTE_SHADERS, DownlevelFlags::VERTEX_STORAGE] {
            assert!(missing_of(&limits, flags - flag).is_some(), "{flag:?}");
        }
    }
}
