//! Serves the requests of [`RadianceCapture`]: copies radiance from the GPU after the frame was submitted.

use bevy::{
    ecs::prelude::*,
    log::warn_once,
    math::UVec2,
    render::{
        render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor, MapMode, PollType},
        renderer::{RenderDevice, RenderQueue},
    },
};

use core::sync::atomic::Ordering;

use crate::scene::storage::allocation;

use super::{
    ViewPool,
    capture::{CapturedRadiance, RadianceCapture},
    extract::ExtractedViews,
};

/// Runs after the frame was submitted.
pub(crate) fn capture_radiance(
    extracted: Res<ExtractedViews>,
    pool: Res<ViewPool>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let mut is_reading = false;
    for (entity, view) in &extracted.0 {
        let Some((capture, request)) = &view.capture else {
            continue;
        };
        let Some(view) = pool.views.get(entity).filter(|v| v.rendered && v.ran.load(Ordering::Relaxed)) else {
            continue;
        };
        capture.begin(*request);
        read_radiance((capture.clone(), *request), &view.radiance, view.size, &device, &queue);
        is_reading = true;
    }
    // Browsers cannot block; they run the callback on their own.
    if is_reading && let Err(error) = device.poll(PollType::wait_indefinitely()) {
        warn_once!("restir: waiting for the GPU failed, so that a radiance capture may not arrive: {error}");
    }
}

/// Copies radiance to the CPU; a callback delivers it.
fn read_radiance(
    (capture, request): (RadianceCapture, u64),
    radiance: &Buffer,
    size: UVec2,
    device: &RenderDevice,
    queue: &RenderQueue,
) {
    let create = || {
        device.create_buffer(&BufferDescriptor {
            label: Some("restir capture"),
            size: radiance.size(),
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        })
    };
    let staging = match allocation::attempt(device, "capture", create) {
        Ok(staging) => staging,
        Err(error) => {
            warn_once!("restir: a radiance capture fails, because there is no memory to read it back: {error}");
            return;
        }
    };
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some("restir capture") });
    encoder.copy_buffer_to_buffer(radiance, 0, &staging, 0, radiance.size());
    queue.submit([encoder.finish()]);
    let mapped = staging.clone();
    staging.slice(..).map_async(MapMode::Read, move |result| {
        if let Err(error) = result {
            warn_once!("restir: a radiance capture fails, because it could not be read back: {error}");
            return;
        }
        let mut pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec::<u8, _>(&mapped.slice(..).get_mapped_range());
        mapped.unmap();
        pixels.truncate((size.x * size.y) as usize);
        capture.deliver(request, CapturedRadiance { size, pixels });
    });
}
