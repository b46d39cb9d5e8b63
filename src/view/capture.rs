//! Linear radiance back to the CPU, at full precision: what the view target has lost to half floats.

use bevy::{
    ecs::prelude::*,
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
    captured: Option<CapturedRadiance>,
}

/// On a [`Restir`](crate::Restir) camera: hands out the radiance of the next frame that is asked for.  A capture waits for the GPU.
#[derive(Component, Clone, Debug, Default)]
pub struct RadianceCapture(Arc<Mutex<State>>);

impl RadianceCapture {
    /// Asks for the next frame that is rendered.
    pub fn request(&self) {
        let mut state = self.state();
        state.wanted = true;
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
    for (entity, view) in &extracted.0 {
        let Some(capture) = view.capture.as_ref().filter(|c| c.state().wanted) else {
            continue;
        };
        let Some(view) = pool.views.get(entity).filter(|v| v.rendered) else {
            continue;
        };
        let bytes = read_buffer(&view.radiance, &device, &queue);
        let mut state = capture.state();
        let count = (view.size.x * view.size.y) as usize;
        state.captured = Some(CapturedRadiance {
            size: view.size,
            pixels: bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(&bytes)[..count].to_vec(),
        });
        state.wanted = false;
    }
}

/// Copies a buffer back and waits for it.
fn read_buffer(buffer: &Buffer, device: &RenderDevice, queue: &RenderQueue) -> Vec<u8> {
    let staging = device.create_buffer(&BufferDescriptor {
        label: Some("restir capture"),
        size: buffer.size(),
        usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some("restir capture") });
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
    queue.submit([encoder.finish()]);
    let slice = staging.slice(..);
    slice.map_async(MapMode::Read, |_| ());
    if device.poll(PollType::wait_indefinitely()).is_err() {
        return vec![0; buffer.size() as usize];
    }
    slice.get_mapped_range().to_vec()
}
