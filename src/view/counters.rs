//! Counters that shaders keep for each view (rays, overflows, raised guards), read back a few frames later without blocking.

use bevy::{
    ecs::prelude::*,
    render::{render_resource::*, renderer::RenderDevice},
};
use std::{
    mem::offset_of,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
};

use crate::gpu_layout::GpuCounters;

/// The run that guards are counted for: a number that grows when the app starts a new run.  Clones share it.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct GuardRun(Arc<AtomicU32>);

impl GuardRun {
    pub(crate) fn start_next(&self) {
        self.0.fetch_add(1, Ordering::AcqRel);
    }

    pub(crate) fn current(&self) -> u32 {
        self.0.load(Ordering::Acquire)
    }
}

/// Whether cameras count their rays.  Clones share it.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct RayCounting(Arc<AtomicBool>);

impl RayCounting {
    pub(crate) fn set(&self, is_on: bool) {
        self.0.store(is_on, Ordering::Release);
    }

    pub(crate) fn is_on(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}

/// The run that counts the guards of this frame.  A run that the app starts while the frame is rendered counts from the next frame on.
#[derive(Resource, Default)]
pub(crate) struct RunOfFrame(pub u32);

pub(crate) fn extract_run(run: Res<GuardRun>, mut of_frame: ResMut<RunOfFrame>) {
    of_frame.0 = run.current();
}

/// Counters of a view on the GPU, and their newest values on the CPU.
pub(crate) struct CounterReadback {
    pub buffer: Buffer,
    staging: Buffer,
    in_flight: Arc<AtomicBool>,
    newest: Arc<Mutex<Counted>>,
    copied: AtomicBool,
    /// The run that the buffer counts.
    run: AtomicU32,
}

/// Counters that were read back.
#[derive(Clone, Copy, Default)]
struct Counted {
    run: u32,
    counters: GpuCounters,
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
            run: AtomicU32::new(0),
        }
    }

    /// Records the clearing of the counters of the last frame, and of those of the whole run if `run` is a new one.
    pub(crate) fn begin_frame(&self, run: u32, encoder: &mut CommandEncoder) {
        let restarts = self.run.swap(run, Ordering::AcqRel) != run;
        let of_frame = offset_of!(GpuCounters, guards) as u64;
        encoder.clear_buffer(&self.buffer, 0, (!restarts).then_some(of_frame));
    }

    /// Records a copy of the counters within the frame, unless the last copy is still being read.
    pub(crate) fn copy(&self, encoder: &mut CommandEncoder) {
        if self.in_flight.load(Ordering::Acquire) {
            return;
        }
        let size = self.buffer.size();
        encoder.copy_buffer_to_buffer(&self.buffer, 0, &self.staging, 0, size);
        self.copied.store(true, Ordering::Release);
    }

    /// Maps the copy after the frame was submitted.  The counters arrive when the GPU has finished the frame.
    pub(crate) fn read(&self) {
        if !self.copied.swap(false, Ordering::AcqRel) {
            return;
        }
        self.in_flight.store(true, Ordering::Release);
        let (staging, in_flight, newest) = (self.staging.clone(), self.in_flight.clone(), self.newest.clone());
        let run = self.run.load(Ordering::Acquire);
        self.staging.slice(..).map_async(MapMode::Read, move |result| {
            if result.is_ok() {
                let counters = *bytemuck::from_bytes::<GpuCounters>(&staging.slice(..).get_mapped_range());
                *newest.lock().unwrap_or_else(PoisonError::into_inner) = Counted { run, counters };
                staging.unmap();
            }
            in_flight.store(false, Ordering::Release);
        });
    }

    /// Counters of the newest frame that was read back.  Those of the whole run are 0 until a frame of this run is read back.
    pub(crate) fn newest(&self, run: u32) -> GpuCounters {
        let newest = *self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        let guards = if newest.run == run { newest.counters.guards } else { Default::default() };
        GpuCounters { guards, ..newest.counters }
    }
}
