//! Allocations on the GPU that may fail.
//!
//! By default Bevy quits after an error that nobody caught, and a device whose memory is full reports such an error.

use bevy::render::renderer::RenderDevice;

/// Runs a function that creates buffers, textures or bind groups for something.  If the device reports an error, for example that its memory
/// is full, the function's result is dropped and the error is returned.
///
/// In a browser errors arrive later, so that they reach Bevy's handler as before.
#[cfg(not(target_arch = "wasm32"))]
#[cfg_attr(not(feature = "testing"), allow(unused_variables, reason = "tests name allocations that fail"))]
pub fn attempt<T>(device: &RenderDevice, what: &str, create: impl FnOnce() -> T) -> Result<T, String> {
    use bevy::tasks::futures::now_or_never;
    use wgpu::ErrorFilter;

    let scopes = [ErrorFilter::Validation, ErrorFilter::Internal, ErrorFilter::OutOfMemory]
        .map(|filter| device.wgpu_device().push_error_scope(filter));
    let created = create();
    // Scopes form a stack: the last one is popped first.
    let errors = scopes.into_iter().rev().filter_map(|scope| now_or_never(scope.pop()).flatten());
    let error = errors.last().map(|error| error.to_string());
    // As on a device whose memory is full, the function runs before its error is known.
    #[cfg(feature = "testing")]
    let error = error.or_else(|| planted::fails(device, what).then(|| "planted".into()));
    error.map_or(Ok(created), Err)
}

/// In a browser this only runs the function: errors arrive later, at Bevy's handler.
#[cfg(target_arch = "wasm32")]
pub fn attempt<T>(_: &RenderDevice, _: &str, create: impl FnOnce() -> T) -> Result<T, String> {
    Ok(create())
}

/// Failures that tests plant.
#[cfg(all(feature = "testing", not(target_arch = "wasm32")))]
mod planted {
    use bevy::{app::App, render::renderer::RenderDevice};
    use core::cell::RefCell;

    thread_local! {
        /// Devices with the names of the allocations that fail there.  Devices of two apps may compare equal, because each app counts its own.
        /// Tests run all systems of an app in their own thread.
        static FAILING: RefCell<Vec<(wgpu::Device, &'static str)>> = const { RefCell::new(Vec::new()) };
    }

    /// Lets allocations with these names fail on the device of an app, and no others, while its systems run in this thread.
    pub fn plant_failed_allocations(app: &App, names: &[&'static str]) {
        let Some(device) = app.world().get_resource::<RenderDevice>() else { return };
        FAILING.with_borrow_mut(|failing| {
            failing.retain(|(other, _)| other != device.wgpu_device());
            failing.extend(names.iter().map(|name| (device.wgpu_device().clone(), *name)));
        });
    }

    pub(super) fn fails(device: &RenderDevice, what: &str) -> bool {
        FAILING
            .with_borrow(|failing| failing.iter().any(|(other, name)| other == device.wgpu_device() && *name == what))
    }
}
#[cfg(all(feature = "testing", not(target_arch = "wasm32")))]
pub use planted::plant_failed_allocations;
