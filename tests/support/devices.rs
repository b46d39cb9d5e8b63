//! Devices that serve one test after the other, with the pipelines that were compiled on them.

use bevy::{
    app::App,
    render::{
        RenderApp,
        renderer::{RenderAdapter, RenderAdapterInfo, RenderDevice, RenderInstance, RenderQueue},
        settings::{RenderCreation, RenderResources},
    },
};
use bevy_restir::testing::{SharedPipelines, share_pipelines};
use std::sync::{Mutex, PoisonError};

/// A device with more pipelines is given up, because their code takes memory: the three devices of the first tier take 6.6 GB.
const MAX_PIPELINES: usize = 400;

#[derive(Clone)]
struct Device {
    resources: RenderResources,
    pipelines: SharedPipelines,
}

static IDLE: Mutex<Vec<Device>> = Mutex::new(Vec::new());

/// The device of an app until it is dropped.  Apps that run at the same time have different devices, so that none waits for the work of
/// another.
pub struct Lease(Option<Device>);

impl Lease {
    /// An idle device, if there is one.
    pub fn take() -> Self {
        Self(IDLE.lock().unwrap_or_else(PoisonError::into_inner).pop())
    }

    /// No device that another test uses.
    pub fn none() -> Self {
        Self(None)
    }

    /// How the renderer of an app starts on this device.
    pub fn creation(&self) -> Option<RenderCreation> {
        self.0.as_ref().map(|device| RenderCreation::Manual(device.resources.clone()))
    }

    /// Lets the app, which has started, use the pipelines of the device.  An app without a device gives its own.
    pub fn connect(&mut self, app: &mut App) {
        let device =
            self.0.get_or_insert_with(|| Device { resources: resources_of(app), pipelines: Default::default() });
        share_pipelines(app, device.pipelines.clone());
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        let Some(device) = self.0.take() else { return };
        // A device may be the reason why a test fails.
        if !std::thread::panicking() && device.pipelines.count() <= MAX_PIPELINES {
            IDLE.lock().unwrap_or_else(PoisonError::into_inner).push(device);
        }
    }
}

fn resources_of(app: &App) -> RenderResources {
    let world = app.sub_app(RenderApp).world();
    RenderResources(
        world.resource::<RenderDevice>().clone(),
        world.resource::<RenderQueue>().clone(),
        world.resource::<RenderAdapterInfo>().clone(),
        world.resource::<RenderAdapter>().clone(),
        world.resource::<RenderInstance>().clone(),
    )
}
