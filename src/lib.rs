//! Lights an ordinary Bevy scene by ReSTIR (spatiotemporally resampled) path tracing, on GPUs with and without ray-tracing hardware.
//!
//! ```no_run
//! use bevy::prelude::*;
//! use bevy_restir::prelude::*;
//!
//! App::new()
//!     .add_plugins((DefaultPlugins, RestirPlugin))
//!     .add_systems(Startup, |mut commands: Commands| {
//!         commands.spawn((Camera3d::default(), Restir::default()));
//!     })
//!     .run();
//! ```
//!
//! The data flows one way: ECS → scene → view → passes → Bevy's view target.  Modules are public for this crate's tests and
//! measurements; what is documented here is what apps use.  Works that are cited by author and year are listed in `docs/sources.md`.

#![warn(missing_docs, unreachable_pub)]

#[doc(hidden)]
pub mod gpu_types;
pub(crate) mod passes;
#[doc(hidden)]
pub mod scene;
mod settings;
#[doc(hidden)]
pub mod shaders;
mod statistics;
mod view;

#[doc(hidden)]
pub use passes::pipelines::plant_shader_defs;
pub use passes::{SPAN_PREFIX, pass_names, pipelines::PipelineReport};
pub use scene::SceneFeatures;
pub use settings::{
    BiasCorrection, DebugView, Direct, EmissiveLuminance, Mis, Paths, Preset, RayBackend, Reconnection,
    ReservoirLayout, Restir, RestirEnvironment, ReuseOrder, Suffix, Technique, VisibilityReuse,
};
pub use statistics::{RestirReport, RestirStatistics};
pub use view::capture::{CapturedRadiance, RadianceCapture};

use bevy::{
    app::{App, Last, Plugin},
    asset::Assets,
    ecs::prelude::*,
    log::warn,
    pbr::StandardMaterial,
    render::{
        Render, RenderApp, RenderPlugin, RenderSystems,
        render_resource::{AsBindGroup, DownlevelFlags},
        renderer::{RenderAdapter, RenderAdapterInfo, RenderDevice},
        settings::WgpuLimits,
        view::Msaa,
    },
    shader::Shader,
};

/// Everything that an app needs.
pub mod prelude {
    pub use crate::{
        BiasCorrection, DebugView, Direct, EmissiveLuminance, Mis, Paths, Preset, RayBackend, Reconnection,
        ReservoirLayout, Restir, RestirEnvironment, RestirPlugin, ReuseOrder, Suffix, Technique, VisibilityReuse,
    };
}

/// Adds ReSTIR lighting to cameras that carry [`Restir`].
///
/// Where the device cannot run compute shaders with eight storage buffers it warns once and stays off, and Bevy's own lighting stays on.
pub struct RestirPlugin;

impl Plugin for RestirPlugin {
    fn build(&self, app: &mut App) {
        app.register_type::<Restir>()
            .register_type::<RestirEnvironment>()
            .init_resource::<EmissiveLuminance>()
            .init_resource::<RayBackend>()
            .init_resource::<RestirStatistics>();
        let asked = app.get_added_plugins::<RenderPlugin>().iter().any(|p| p.synchronous_pipeline_compilation);
        if asked || cfg!(any(target_arch = "wasm32", target_os = "macos")) {
            app.insert_resource(CompilesAtOnce);
        }
    }

    fn finish(&self, app: &mut App) {
        let statistics = app.world().resource::<RestirStatistics>().clone();
        let Some(missing) = app.get_sub_app(RenderApp).map(|render_app| missing_feature(render_app.world())) else {
            warn!("restir: there is no renderer; the plugin stays off");
            return;
        };
        if let Some(missing) = missing {
            warn!("restir: this device has no {missing}; the plugin stays off and Bevy's own lighting stays on");
            return;
        }
        let textures_warning = app.get_sub_app(RenderApp).and_then(|render_app| textures_warning(render_app.world()));
        if let Some(warning) = &textures_warning {
            warn!("restir: {warning}");
        }
        let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
        let table = shaders::ShaderTable::new(&mut shaders);

        // After all that an app does in a frame, and before it is extracted.
        app.add_systems(Last, require_single_sample);
        let bevy_may_quit = textures_warning.is_some();
        let bevy_helps = !bevy_may_quit && !app.world().contains_resource::<CompilesAtOnce>();
        let backend = *app.world().resource::<RayBackend>();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        let world = render_app.world();
        let device = world.get_resource::<RenderDevice>();
        let ray_queries = match (device, world.get_resource::<RenderAdapterInfo>()) {
            (Some(device), Some(adapter)) => scene::hardware::is_chosen(backend, device, adapter),
            _ => false,
        };
        let bound_textures = device.and_then(|device| scene::bound::capacity(device, 3 + u32::from(ray_queries)));
        let pipelines = passes::pipelines::PassPipelines::new(table.clone(), ray_queries, bound_textures);
        render_app.insert_resource(pipelines).insert_resource(table).insert_resource(statistics).add_systems(
            Render,
            statistics::update_report.in_set(RenderSystems::Cleanup).before(view::capture::capture_radiance),
        );
        scene::build(render_app, ray_queries, bound_textures);
        view::build(render_app);
        view::hide::build(render_app, !bevy_helps);
        passes::build(render_app);
    }
}

/// Pipelines are there a frame after they are asked for: Bevy's own would be compiled for the sake of that frame.
#[derive(Resource)]
struct CompilesAtOnce;

/// What the device lacks for the portable tier.
fn missing_feature(render_world: &World) -> Option<&'static str> {
    let device = render_world.get_resource::<RenderDevice>()?;
    let adapter = render_world.get_resource::<RenderAdapter>()?;
    missing_of(&device.limits(), adapter.get_downlevel_capabilities().flags)
}

/// Bytes of one storage binding without which nothing worth a look fits.  Below WebGPU's 128 MiB large pictures are traced smaller, and
/// scenes are cut, with warnings.
const LEAST_BINDING: u64 = 1 << 20;

fn missing_of(limits: &WgpuLimits, flags: DownlevelFlags) -> Option<&'static str> {
    if !flags.contains(DownlevelFlags::COMPUTE_SHADERS | DownlevelFlags::VERTEX_STORAGE) {
        return Some("compute shaders and storage buffers in vertex shaders");
    }
    if limits.max_storage_buffers_per_shader_stage < 8 {
        return Some("eight storage buffers a shader stage");
    }
    if limits.max_compute_invocations_per_workgroup < 64 {
        return Some("64 compute invocations a workgroup");
    }
    if limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) < LEAST_BINDING {
        return Some("storage bindings of a MiB");
    }
    None
}

/// Sampled textures, and samplers, that Bevy's own shaders of `StandardMaterial` bind in a stage where it has all of its slots, without
/// prepasses.
const BEVY_TEXTURES: u32 = 19;

/// What Bevy's own shaders lack on this device because of the feature `material_textures`.
fn textures_warning(render_world: &World) -> Option<String> {
    let device = render_world.get_resource::<RenderDevice>()?;
    let is_bindless = StandardMaterial::bindless_supported(device);
    if cfg!(feature = "material_textures") && !is_bindless { too_few_textures(&device.limits()) } else { None }
}

fn too_few_textures(limits: &WgpuLimits) -> Option<String> {
    let (textures, samplers) = (limits.max_sampled_textures_per_shader_stage, limits.max_samplers_per_shader_stage);
    (textures.min(samplers) < BEVY_TEXTURES).then(|| {
        format!(
            "this device binds {textures} textures and {samplers} samplers a shader stage; with the feature `material_textures` Bevy's \
             own shaders need {BEVY_TEXTURES} of each, and Bevy quits where a camera without `Restir` sees a `StandardMaterial`"
        )
    })
}

/// A visibility buffer has one sample a pixel.  Bevy's cameras come with four: those are turned off silently where `Restir` is added,
/// and with a warning where an app asks for them later.
fn require_single_sample(mut cameras: Query<(Entity, Ref<Restir>, &mut Msaa), Or<(Changed<Msaa>, Added<Restir>)>>) {
    for (entity, restir, mut msaa) in &mut cameras {
        if *msaa == Msaa::Off {
            continue;
        }
        if !restir.is_added() {
            warn!("restir: camera {entity} has {:?}; multisampling is turned off", *msaa);
        }
        *msaa = Msaa::Off;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_few_textures_for_bevy_are_told() {
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
    fn every_need_is_asked_for() {
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
