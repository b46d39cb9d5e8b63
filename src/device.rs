//! Requirements on the device.  If one is not met, the plugin warns, names it, and stays off.

use bevy::{
    ecs::world::World,
    pbr::StandardMaterial,
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

/// Sampled textures, and samplers, that Bevy's own shaders of a `StandardMaterial` with all texture slots bind in a stage, without prepasses.
const BEVY_TEXTURES: u32 = 19;

/// A warning if Bevy's own shaders do not run on this device because of the feature `material_textures`.
pub(crate) fn textures_warning(render_world: &World) -> Option<String> {
    let device = render_world.get_resource::<RenderDevice>()?;
    let is_bindless = StandardMaterial::bindless_supported(device);
    if cfg!(feature = "material_textures") && !is_bindless { too_few_textures(&device.limits()) } else { None }
}

fn too_few_textures(limits: &WgpuLimits) -> Option<String> {
    let (textures, samplers) = (limits.max_sampled_textures_per_shader_stage, limits.max_samplers_per_shader_stage);
    (textures.min(samplers) < BEVY_TEXTURES).then(|| {
        format!(
            "this device binds {textures} textures and {samplers} samplers per shader stage; with the feature `material_textures` Bevy's \
             own shaders need {BEVY_TEXTURES} of each, and Bevy quits where a camera without `Restir` sees a `StandardMaterial`"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_with_too_few_textures_for_bevy_gets_a_warning() {
        let few = WgpuLimits::default();
        let enough = WgpuLimits {
            max_sampled_textures_per_shader_stage: BEVY_TEXTURES,
            max_samplers_per_shader_stage: BEVY_TEXTURES,
            ..few.clone()
        };
        assert_eq!(too_few_textures(&enough), None);
        let fewer_samplers = WgpuLimits { max_samplers_per_shader_stage: 16, ..enough };
        for limits in [few, fewer_samplers] {
            assert!(too_few_textures(&limits).is_some_and(|warning| warning.contains("material_textures")));
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
