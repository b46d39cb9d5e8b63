//! Linear radiance back to the CPU, at full precision: what the view target has lost to half floats.

use bevy::{
    ecs::prelude::*,
    log::warn_once,
    math::UVec2,
    render::{
        render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor, MapMode, PollType},
        renderer::{RenderDevice, RenderQueue},
    },
};
use std::sync::{Arc, Mutex, PoisonError};

use super::{ViewPool, extract::ExtractedViews};

/// A frame's radiance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CapturedRadiance {
    /// Pixels of the viewport, or fewer where the device cannot bind as much.
    pub size: UVec2,
    /// Sum of linear Rec. 709 radiance, cd/m², over the samples of a pixel, and their number; rows from the top.
    pub pixels: Vec<[f32; 4]>,
}

impl CapturedRadiance {
    /// Mean radiance of every pixel, cd/m².
    pub fn mean(&self) -> impl Iterator<Item = [f32; 3]> {
        self.pixels.iter().map(|&[r, g, b, n]| [r, g, b].map(|c| c / n.max(1.0)))
    }

    /// Samples that a pixel holds.
    pub fn samples(&self) -> u32 {
        self.pixels.first().map_or(0, |p| p[3] as u32)
    }
}

#[derive(Debug, Default)]
struct State {
    wanted: bool,
    /// Counts requests: what comes late is no answer to the next one.
    requests: u64,
    captured: Option<CapturedRadiance>,
}

/// On a [`Restir`](crate::Restir) camera: hands out the radiance of the next frame that is asked for.  A capture waits for the GPU; on the
/// web, where nothing can, it comes some frames later.
#[derive(Component, Clone, Debug, Default)]
pub struct RadianceCapture(Arc<Mutex<State>>);

impl RadianceCapture {
    /// Asks for the next frame that is rendered.
    pub fn request(&self) {
        let mut state = self.state();
        state.wanted = true;
        state.requests += 1;
        state.captured = None;
    }

    /// The frame that was asked for, once it is there.
    pub fn take(&self) -> Option<CapturedRadiance> {
        self.state().captured.take()
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// After the frame was submitted: answers requests.
pub(crate) fn capture_radiance(
    extracted: Res<ExtractedViews>,
    pool: Res<ViewPool>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let mut reading = false;
    for (entity, view) in &extracted.0 {
        let Some(capture) = view.capture.as_ref().filter(|c| c.state().wanted) else {
            continue;
        };
        let Some(view) = pool.views.get(entity).filter(|v| v.rendered) else {
            continue;
        };
        capture.state().wanted = false;
        read_radiance(capture, &view.radiance, view.size, &device, &queue);
        reading = true;
    }
    // Browsers do not wait: they call back on their own.
    if reading && let Err(error) = device.poll(PollType::wait_indefinitely()) {
        warn_once!("restir: the GPU was not waited for: {error}");
    }
}

/// Copies radiance back and hands it out as soon as it is there.
fn read_radiance(
    capture: &RadianceCapture,
    radiance: &Buffer,
    size: UVec2,
    device: &RenderDevice,
    queue: &RenderQueue,
) {
    let staging = device.create_buffer(&BufferDescriptor {
        label: Some("restir capture"),
        size: radiance.size(),
        usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some("restir capture") });
    encoder.copy_buffer_to_buffer(radiance, 0, &staging, 0, radiance.size());
    queue.submit([encoder.finish()]);
    let (mapped, capture, request) = (staging.clone(), capture.clone(), capture.state().requests);
    staging.slice(..).map_async(MapMode::Read, move |result| {
        if let Err(error) = result {
            warn_once!("restir: a capture does not come back: {error}");
            return;
        }
        let mut pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec::<u8, _>(&mapped.slice(..).get_mapped_range());
        mapped.unmap();
        pixels.truncate((size.x * size.y) as usize);
        let mut state = capture.state();
        if state.requests == request {
            state.captured = Some(CapturedRadiance { size, pixels });
        }
    });
}
