//! The plugin: checks the device, then adds the scene mirror, the views and the frame to the render world.

use bevy::{
    app::{App, Last, Plugin},
    asset::Assets,
    camera::Hdr,
    core_pipeline::schedule::Core3d,
    ecs::{entity::Entities, prelude::*},
    log::warn,
    reflect::Reflect,
    render::{
        Render, RenderApp, RenderPlugin, RenderStartup, RenderSystems,
        renderer::{RenderAdapterInfo, RenderDevice},
        view::Msaa,
    },
    shader::Shader,
};

use crate::{
    budget,
    cpu_times::CpuTimes,
    device, frame,
    report::{self, RestirStatistics},
    scene,
    settings::{
        EmissiveLuminance, RayBackend, Reduction, Restir, RestirBudget, RestirEnvironment, RestirExpected,
        RestirIgnore, RestirMaterial, Subsurface,
    },
    shader_library::ShaderLibrary,
    system_sets::{IsOn, RestirSystems, is_on},
    technique::shader_templates,
    view,
    warned::Warned,
};

/// Adds ReSTIR lighting to cameras that carry [`Restir`].
///
/// The device needs compute shaders, storage buffers in vertex shaders, eight storage buffers per shader stage, 64 invocations per
/// workgroup and storage bindings of 1 MiB.  If one of these is missing, the plugin warns once and stays off, and Bevy's own lighting stays
/// on; [`RestirStatus`] has the reason.  It does not matter whether this plugin or `DefaultPlugins` is added first.
#[derive(Clone, Copy, Debug, Default)]
pub struct RestirPlugin {
    /// How rays are traced.
    pub backend: RayBackend,
}

/// Whether the plugin is on; a resource.  It is known after `App::cleanup`, and changes only where Bevy replaces a lost device.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Resource)]
#[non_exhaustive]
pub enum RestirStatus {
    /// The renderer is not ready yet.
    #[default]
    Starting,
    /// Cameras with [`Restir`] are lit by this plugin.
    On,
    /// Bevy's own lighting stays on, for this reason.
    Off(String),
}

impl Plugin for RestirPlugin {
    fn build(&self, app: &mut App) {
        app.register_type::<Restir>()
            .register_type::<RestirBudget>()
            .register_type::<RestirEnvironment>()
            .register_type::<RestirExpected>()
            .register_type::<RestirIgnore>()
            .register_type::<RestirMaterial>()
            .register_type::<Subsurface>()
            .register_type::<EmissiveLuminance>()
            .register_type::<RestirStatus>()
            .init_resource::<Reduction>()
            .init_resource::<EmissiveLuminance>()
            .init_resource::<RestirExpected>()
            .init_resource::<RestirStatus>()
            .init_resource::<RestirStatistics>();
    }

    fn finish(&self, app: &mut App) {
        // Bevy's renderer creates its device when its plugin is finished.  If that comes later, `cleanup` starts this plugin.
        let is_early = app.get_sub_app(RenderApp).is_some_and(|render_app| !has_device(render_app.world()));
        if !is_early {
            self.start(app);
        }
    }

    fn cleanup(&self, app: &mut App) {
        if *app.world().resource::<RestirStatus>() == RestirStatus::Starting {
            self.start(app);
        }
    }
}

/// Whether Bevy's renderer has a device.
fn has_device(render_world: &World) -> bool {
    render_world.contains_resource::<RenderDevice>()
}

impl RestirPlugin {
    /// Checks the device and adds everything that needs one.
    fn start(&self, app: &mut App) {
        let missing = match app.get_sub_app(RenderApp).filter(|render_app| has_device(render_app.world())) {
            None => Some("the app has no renderer (Bevy's `RenderPlugin` with a device)".to_string()),
            Some(render_app) => device::missing_feature(render_app.world()).map(reason_of),
        };
        if let Some(reason) = missing {
            warn!("restir: {reason}; the plugin stays off, and Bevy's own lighting stays on");
            app.insert_resource(RestirStatus::Off(reason));
            return;
        }
        if let Some(warning) = device::ignored_textures_warning() {
            warn!("restir: {warning}");
        }
        let textures_warning =
            app.get_sub_app(RenderApp).and_then(|render_app| device::textures_warning(render_app.world()));
        if let Some(warning) = &textures_warning {
            warn!("restir: {warning}");
        }
        let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
        let library = ShaderLibrary::new(&mut shaders, &shader_templates());
        let wants_synchronous =
            app.get_added_plugins::<RenderPlugin>().iter().any(|p| p.synchronous_pipeline_compilation);
        let synchronous = wants_synchronous || cfg!(any(target_arch = "wasm32", target_os = "macos"));
        // Bevy lights a camera until our first frame is ready, with two exceptions: where pipelines compile synchronously, because Bevy's
        // would be compiled for a single frame, and where the device cannot run Bevy's shaders.
        let bevy_lights_first = textures_warning.is_none() && !synchronous;
        // An app that waits for its pipelines may also wait for other work in the background, except on the web, where such work goes on
        // only between frames.
        let repeatable = wants_synchronous && cfg!(not(target_arch = "wasm32"));
        // After all systems of the app, before the extraction.
        app.add_systems(Last, (require_single_sample, require_hdr, budget::keep_budget, update_status));
        app.insert_resource(RestirStatus::On);
        self.build_render_app(app, library, bevy_lights_first, repeatable);
    }

    fn build_render_app(&self, app: &mut App, library: ShaderLibrary, bevy_lights_first: bool, repeatable: bool) {
        let statistics = app.world().resource::<RestirStatistics>().clone();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .insert_resource(library)
            .insert_resource(statistics.guard_run().clone())
            .insert_resource(statistics.ray_counting().clone())
            .insert_resource(statistics)
            .insert_resource(Options { backend: self.backend, repeatable })
            .insert_resource(IsOn(true))
            .init_resource::<CpuTimes>()
            .add_systems(RenderStartup, renew)
            .configure_sets(
                Render,
                (
                    RestirSystems::MirrorScene.run_if(is_on),
                    RestirSystems::PrepareEnvironments.run_if(is_on),
                    RestirSystems::SelectPipelines.run_if(is_on),
                    RestirSystems::PrepareViews.run_if(is_on),
                ),
            )
            .configure_sets(Core3d, RestirSystems::RunPasses.run_if(is_on))
            .add_systems(
                Render,
                report::update_report.in_set(RenderSystems::Cleanup).before(view::capture_readback::capture_radiance),
            );
        insert_resources(render_app.world_mut());
        scene::build(render_app);
        view::build(render_app);
        view::bevy_handoff::build(render_app, !bevy_lights_first);
        frame::build(render_app);
    }
}

/// What [`insert_resources`] needs to know about the plugin and the app.
#[derive(Resource, Clone, Copy)]
struct Options {
    backend: RayBackend,
    /// Pictures must not depend on the time that work in the background takes: the app compiles pipelines synchronously.
    repeatable: bool,
}

/// Inserts everything that belongs to a device: pipelines, and the mirror of the scene and of the cameras without any contents.
fn insert_resources(world: &mut World) {
    let device = world.get_resource::<RenderDevice>();
    let Options { backend, repeatable } = *world.resource::<Options>();
    let ray_queries = match (device, world.get_resource::<RenderAdapterInfo>()) {
        (Some(device), Some(adapter)) => scene::accel::ray_query::is_chosen(backend, device, adapter),
        _ => false,
    };
    // Passes bind the groups of the scene, the view and the pass, and with ray queries that of the acceleration structures.
    let bind_groups = 3 + u32::from(ray_queries);
    let bound_textures = device.and_then(|device| scene::texture::bindless::max_textures(device, bind_groups));
    let library = world.resource::<ShaderLibrary>().clone();
    world.insert_resource(frame::pipelines::PassPipelines::new(library, ray_queries, bound_textures));
    scene::insert_resources(world, ray_queries, bound_textures, repeatable);
    view::insert_resources(world);
}

/// Recreates everything that belonged to a lost device, once Bevy has another one.  Bevy extracts meshes and images again.
fn renew(world: &mut World, mut is_renewal: Local<bool>) {
    // The first device is that of `RestirPlugin::start`.
    if !core::mem::replace(&mut *is_renewal, true) {
        return;
    }
    let missing = device::missing_feature(world);
    match missing.map(reason_of) {
        None => warn!("restir: there is a new device; the scene is uploaded to it again"),
        Some(reason) => {
            warn!("restir: there is a new device, and {reason}; the plugin is off, and Bevy lights all cameras")
        }
    }
    world.resource::<RestirStatistics>().set_missing(missing);
    world.insert_resource(IsOn(missing.is_none()));
    insert_resources(world);
    view::bevy_handoff::forget_cameras(world, missing.is_none());
}

/// Why the plugin is off on a device that lacks something.
fn reason_of(missing: &'static str) -> String {
    format!("this device lacks {missing}")
}

/// Tells the app whether a new device has what the plugin needs.
fn update_status(statistics: Res<RestirStatistics>, mut status: ResMut<RestirStatus>) {
    let missing = statistics.missing().map(reason_of);
    status.set_if_neq(missing.map_or(RestirStatus::On, RestirStatus::Off));
}

/// Turns multisampling off, because the visibility buffer has one sample a pixel: silently when `Restir` is added, because Bevy's default is
/// four samples, and with a warning when an app turns it on later.
fn require_single_sample(
    mut cameras: Query<(Entity, Ref<Restir>, &mut Msaa), Or<(Changed<Msaa>, Added<Restir>)>>,
    entities: &Entities,
    mut warned: Local<Warned<Entity>>,
) {
    warned.begin_frame();
    warned.retain(|camera| entities.contains(*camera));
    for (entity, restir, mut msaa) in &mut cameras {
        if *msaa == Msaa::Off {
            continue;
        }
        if !restir.is_added() && warned.is_due(entity) {
            warn!(
                "restir: camera {entity} has Msaa::{:?}, which Restir does not support; it is set to Msaa::Off",
                *msaa
            );
        }
        *msaa = Msaa::Off;
    }
}

/// Inserts `Hdr` again where an app has removed it.  Only the targets of such cameras can hold light before tone mapping, and Bevy tone maps
/// only these.
fn require_hdr(
    cameras: Query<Entity, (With<Restir>, Without<Hdr>)>,
    mut commands: Commands,
    entities: &Entities,
    mut warned: Local<Warned<Entity>>,
) {
    warned.begin_frame();
    warned.retain(|camera| entities.contains(*camera));
    for camera in &cameras {
        if warned.is_due(camera) {
            warn!("restir: camera {camera} has no Hdr, which Restir needs; it is inserted again");
        }
        commands.entity(camera).insert(Hdr);
    }
}
