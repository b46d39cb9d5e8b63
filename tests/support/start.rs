//! How the apps of the tests start.

use bevy::{
    app::PluginGroupBuilder,
    asset::UnapprovedPathMode,
    ecs::schedule::{ScheduleLabel, Schedules, SingleThreadedExecutor},
    log::LogPlugin,
    prelude::*,
    render::{
        ExtractSchedule, RenderPlugin,
        pipelined_rendering::PipelinedRenderingPlugin,
        settings::{Backends, WgpuFeatures, WgpuLimits, WgpuSettings},
    },
    time::TimeUpdateStrategy,
    window::ExitCondition,
    winit::WinitPlugin,
};
use bevy_restir::{
    EmissiveLuminance, RayBackend, RestirPlugin, RestirStatistics,
    testing::{check_mirror, geometry::world_tree::share_a_tree_at_rest, plant_shader_edits},
};
use bevy_restir_support::mutant;
use std::time::Duration;

use super::devices::Lease;

/// Silences Mesa's device-select layer, which complains where there is no compositor.
pub fn silence_mesa() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
            // SAFETY: the C library locks its environment against its own functions only; nothing here reads it by pointer meanwhile.
            unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
        }
    });
}

/// Returns the freed memory of earlier tests to the system.  glibc would keep it: compilers of pipelines leave it in small pieces, 18 GB
/// after 350 tests.
pub fn return_freed_memory() {
    // SAFETY: it takes the locks of the allocator, and has no precondition.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    unsafe {
        libc::malloc_trim(0);
    }
}

/// Runs the systems of an app in the thread of its test.  Bevy's pool has one thread on two cores and belongs to the process: a test that
/// compiles pipelines would stop the frames of all others.  Apps that compile in the background or render in another thread keep Bevy's
/// executor, as users have it.
fn run_systems_in_this_thread(app: &mut App) {
    for sub_app in app.sub_apps_mut().iter_mut() {
        let Some(mut schedules) = sub_app.world_mut().get_resource_mut::<Schedules>() else { continue };
        for (_, schedule) in schedules.iter_mut() {
            // The render world applies the commands of the extraction.
            let applies_commands = schedule.label() != ExtractSchedule.intern();
            schedule.set_executor(SingleThreadedExecutor::new()).set_apply_final_deferred(applies_commands);
        }
    }
}

/// How an app starts.
pub struct Start {
    /// Pipelines are ready one frame after their request, instead of compiling in the background.
    pub synchronous: bool,
    /// The limits of the device; `None`: those of the adapter.
    pub limits: Option<WgpuLimits>,
    /// Features that the device must not have.
    pub lacks: WgpuFeatures,
    pub backend: RayBackend,
    /// `RestirPlugin` is added before Bevy's plugins.
    pub before_bevy: bool,
    /// The render world has a thread of its own and works on one frame while the app prepares the next, as in users' apps.  The render world
    /// cannot be reached from tests then.
    pub pipelined: bool,
}

impl Default for Start {
    fn default() -> Self {
        Self {
            synchronous: true,
            limits: None,
            lacks: WgpuFeatures::empty(),
            backend: usual_back_end(),
            before_bevy: false,
            pipelined: false,
        }
    }
}

/// An app without a window, and its device.
pub fn headless(start: Start, more: impl FnOnce(&mut App)) -> (App, Lease) {
    let Start { synchronous, limits, lacks, backend, before_bevy, pipelined } = start;
    // Tests of the compilation in the background need pipelines that are not compiled.
    let shares_device = synchronous && limits.is_none() && lacks.is_empty();
    let mut lease = if shares_device { Lease::take() } else { Lease::none() };
    let settings = || WgpuSettings {
        backends: Some(Backends::PRIMARY),
        constrained_limits: limits,
        disabled_features: Some(lacks),
        ..Default::default()
    };
    let mut app = App::new();
    if before_bevy {
        app.add_plugins(RestirPlugin { backend });
    }
    app.add_plugins(bevys_plugins(RenderPlugin {
        synchronous_pipeline_compilation: synchronous,
        render_creation: lease.creation().unwrap_or_else(|| settings().into()),
        ..Default::default()
    }));
    if !before_bevy {
        app.add_plugins(RestirPlugin { backend });
    }
    app.insert_resource(EmissiveLuminance(1.0))
        .insert_resource(ClearColor(Color::BLACK))
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 60.0)));
    more(&mut app);
    while app.plugins_state() == bevy::app::PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    if synchronous && !pipelined {
        run_systems_in_this_thread(&mut app);
    }
    if shares_device {
        lease.connect(&mut app);
    }
    app.world().resource::<RestirStatistics>().count_rays(true);
    check_mirror(&mut app, true);
    // Hits in a shared tree round differently, and which instances share one depends on the number of frames: two apps would show the same
    // scene with different bits.  Scenes of `assets/scenes` and tests of that tree share it ([`Rig::share_a_tree_at_rest`]).
    share_a_tree_at_rest(&mut app, false);
    if !mutant::edits().is_empty() {
        plant_shader_edits(&mut app, mutant::edits());
    }
    if pipelined {
        render_in_another_thread(&mut app);
    }
    (app, lease)
}

fn bevys_plugins(renderer: RenderPlugin) -> PluginGroupBuilder {
    DefaultPlugins
        .set(renderer)
        .set(AssetPlugin {
            file_path: concat!(env!("CARGO_MANIFEST_DIR"), "/../assets").into(),
            // Tests write files of their own.
            unapproved_path_mode: UnapprovedPathMode::Allow,
            ..Default::default()
        })
        .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..Default::default() })
        .disable::<LogPlugin>()
        .disable::<WinitPlugin>()
        .disable::<PipelinedRenderingPlugin>()
}

/// Adds Bevy's plugin at the end, because everything above reaches the render world.
fn render_in_another_thread(app: &mut App) {
    PipelinedRenderingPlugin.build(app);
    PipelinedRenderingPlugin.cleanup(app);
}

/// The ray back end of tests that do not choose one.  `RAY_BACKEND=hardware` runs all of them with ray queries.
fn usual_back_end() -> RayBackend {
    match std::env::var("RAY_BACKEND").as_deref() {
        Ok("hardware") => RayBackend::Hardware,
        _ => RayBackend::Auto,
    }
}
