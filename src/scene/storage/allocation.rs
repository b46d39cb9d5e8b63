//! Allocations on the GPU that may fail.
//!
//! By default Bevy quits after an error that nobody caught, and a device whose memory is full reports such an error.

use bevy::render::renderer::RenderDevice;

/// Runs a function that creates buffers, textures or bind groups.  If the device reports an error, for example that its memory is full, the
/// function's result is dropped and the error is returned.
///
/// In a browser errors arrive later, so that they reach Bevy's handler as before.
#[cfg(not(target_arch = "wasm32"))]
pub fn attempt<T>(device: &RenderDevice, create: impl FnOnce() -> T) -> Result<T, String> {
    use bevy::tasks::futures::now_or_never;
    use wgpu::ErrorFilter;

    let device = device.wgpu_device();
    let scopes = [ErrorFilter::Validation, ErrorFilter::Internal, ErrorFilter::OutOfMemory]
        .map(|filter| device.push_error_scope(filter));
    let created = create();
    // Scopes form a stack: the last one is popped first.
    let errors = scopes.into_iter().rev().filter_map(|scope| now_or_never(scope.pop()).flatten());
    errors.last().map_or(Ok(created), |error| Err(error.to_string()))
}

/// In a browser this only runs the function: errors arrive later, at Bevy's handler.
#[cfg(target_arch = "wasm32")]
pub fn attempt<T>(_: &RenderDevice, create: impl FnOnce() -> T) -> Result<T, String> {
    Ok(create())
}
