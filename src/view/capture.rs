//! The public handle of a radiance capture: hands the linear radiance of a frame to the app at full precision.  The view target cannot serve
//! for that because it is half float and exposed.  `capture_readback` fills the handle.

use bevy::{ecs::prelude::*, math::UVec2};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Radiance of a captured frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CapturedRadiance {
    /// Size in pixels: that of the viewport, or less with [`Restir::resolution_scale`](crate::Restir::resolution_scale) below 1, or where the
    /// device cannot bind buffers for the whole viewport.
    pub size: UVec2,
    /// For each pixel, in rows from the top: the sum of linear Rec. 709 radiance over all samples in cd/m², then the number of samples.
    pub pixels: Vec<[f32; 4]>,
}

impl CapturedRadiance {
    /// Mean radiance of each pixel in linear Rec. 709, cd/m², in rows from the top.
    pub fn mean(&self) -> impl Iterator<Item = [f32; 3]> {
        self.pixels.iter().map(|&[r, g, b, n]| [r, g, b].map(|c| c / n.max(1.0)))
    }

    /// Number of samples in each pixel; 0 for an empty capture.
    pub fn samples(&self) -> u32 {
        self.pixels.first().map_or(0, |p| p[3] as u32)
    }
}

#[derive(Debug, Default)]
struct State {
    is_requested: bool,
    /// Number of requests so far.  A readback that belongs to an earlier request is dropped.
    requests: u64,
    captured: Option<CapturedRadiance>,
}

/// Captures the radiance of a [`Restir`](crate::Restir) camera.  Add it to the camera and keep a clone: call [`request`](Self::request),
/// render a frame, then call [`take`](Self::take).
///
/// A capture blocks the render world until the GPU has finished the frame.  On the web nothing can block; there the capture arrives some
/// frames later.  If the GPU cannot return the data, a warning is logged and nothing arrives.
#[derive(Component, Clone, Debug, Default)]
pub struct RadianceCapture(Arc<Mutex<State>>);

impl RadianceCapture {
    /// Requests a capture of the next rendered frame, and drops a capture that has not been taken.
    pub fn request(&self) {
        let mut state = self.state();
        state.is_requested = true;
        state.requests += 1;
        state.captured = None;
    }

    /// Takes the requested frame; `None` until it has arrived, and after it was taken.
    pub fn take(&self) -> Option<CapturedRadiance> {
        self.state().captured.take()
    }

    /// The number of the request that waits for its frame.
    pub(super) fn requested(&self) -> Option<u64> {
        let state = self.state();
        state.is_requested.then_some(state.requests)
    }

    /// Marks a request as served, unless there is a newer one, which waits for the next frame.
    pub(super) fn begin(&self, request: u64) {
        let mut state = self.state();
        state.is_requested &= state.requests != request;
    }

    /// Hands the frame to the app, unless there is a newer request.
    pub(super) fn deliver(&self, request: u64, captured: CapturedRadiance) {
        let mut state = self.state();
        if state.requests == request {
            state.captured = Some(captured);
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
