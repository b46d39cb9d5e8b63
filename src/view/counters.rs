//! Counters that shaders keep for each view (rays, pixels that are not finite, overflows), read back a few frames later without blocking.

use bevy::render::{
    render_resource::*,
    renderer::{RenderContext, RenderDevice},
};
use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicBool, Ordering},
};

use crate::gpu_layout::GpuCounters;

/// Counters of a view on the GPU, and their newest values on the CPU.
pub(crate) struct CounterReadback {
    pub buffer: Buffer,
    staging: Buffer,
    in_flight: Arc<AtomicBool>,
    newest: Arc<Mutex<GpuCounters>>,
    copied: AtomicBool,
}

impl CounterReadback {
    pub(crate) fn new(device: &RenderDevice) -> Self {
        let buffer = |label, usage| {
            let size = size_of::<GpuCounters>() as u64;
            device.create_buffer(&BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
        };
        Self {
            buffer: buffer("counters", BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC),
            staging: buffer("counters read-back", BufferUsages::MAP_READ | BufferUsages::COPY_DST),
            in_flight: Arc::default(),
            newest: Arc::default(),
            copied: AtomicBool::new(false),
        }
    }

    /// Records a copy of the counters within the frame, unless the last copy is still being read.
    pub(crate) fn copy(&self, context: &mut RenderContext) {
        if self.in_flight.load(Ordering::Acquire) {
            return;
        }
        let size = self.buffer.size();
        context.command_encoder().copy_buffer_to_buffer(&self.buffer, 0, &self.staging, 0, size);
        self.copied.store(true, Ordering::Release);
    }

    /// Maps the copy after the frame was submitted.  The counters arrive when the GPU has finished the frame.
    pub(crate) fn read(&self) {
        if !self.copied.swap(false, Ordering::AcqRel) {
            return;
        }
        self.in_flight.store(true, Ordering::Release);
        let (staging, in_flight, newest) = (self.staging.clone(), self.in_flight.clone(), self.newest.clone());
        self.staging.slice(..).map_async(MapMode::Read, move |result| {
            if result.is_ok() {
                let counters = *bytemuck::from_bytes::<GpuCounters>(&staging.slice(..).get_mapped_range());
                *newest.lock().unwrap_or_else(PoisonError::into_inner) = counters;
                staging.unmap();
            }
            in_flight.store(false, Ordering::Release);
        });
    }

    /// Counters of the newest frame that was read back.
    pub(crate) fn newest(&self) -> GpuCounters {
        *self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
