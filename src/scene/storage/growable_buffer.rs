//! Storage buffers that grow: growth copies the contents on the GPU, and only written elements are uploaded.

use bevy::{
    log::warn,
    render::{
        render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor},
        renderer::{RenderDevice, RenderQueue},
    },
};
use bytemuck::Pod;
use std::{marker::PhantomData, ops::Range};

use super::{allocation, uploads::Uploads};
use crate::device;

/// Greatest number of runs that are written one by one.  A write takes some microseconds, ten times as long as a copy on the GPU.
const MAX_WRITES: usize = 4;

/// A storage buffer of `T` that grows by doubling, up to the device's binding limit.
#[derive(Debug)]
pub(crate) struct GrowableBuffer<T> {
    label: &'static str,
    buffer: Option<Buffer>,
    capacity: u32,
    usage: BufferUsages,
    /// A warning has said that the device has no memory for more elements.
    warned: bool,
    element: PhantomData<T>,
}

impl<T: Pod> GrowableBuffer<T> {
    /// An empty buffer; GPU memory is allocated by the first [`Self::reserve`].
    pub(crate) fn new(label: &'static str) -> Self {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        Self { label, buffer: None, capacity: 0, usage, warned: false, element: PhantomData }
    }

    /// Adds a usage to storage and copies.  Call it before the first [`Self::reserve`].
    pub(crate) fn add_usage(&mut self, usage: BufferUsages) {
        self.usage |= usage;
    }

    /// The number of elements that one binding of this device can hold.
    pub(crate) fn limit(device: &RenderDevice) -> u32 {
        let bytes = device::binding_limit(&device.limits());
        (bytes / size_of::<T>() as u64).min(u32::MAX as u64) as u32
    }

    /// Makes room for `count` elements and keeps the contents.  Returns false if the device's limit is lower or its memory is full.
    #[must_use]
    pub(crate) fn reserve(&mut self, count: u32, device: &RenderDevice, queue: &RenderQueue) -> bool {
        if count <= self.capacity && self.buffer.is_some() {
            return true;
        }
        let limit = Self::limit(device);
        if count > limit {
            return false;
        }
        let capacity = count.max(1).checked_next_power_of_two().unwrap_or(count).min(limit);
        let buffer = match allocation::attempt(device, self.label, || self.create(capacity, device)) {
            Ok(buffer) => buffer,
            Err(error) => {
                if !core::mem::replace(&mut self.warned, true) {
                    warn!("restir: no memory for a buffer of {capacity} elements ({}): {error}", self.label);
                }
                return false;
            }
        };
        if let Some(old) = &self.buffer {
            let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some(self.label) });
            encoder.copy_buffer_to_buffer(old, 0, &buffer, 0, old.size());
            queue.submit([encoder.finish()]);
        }
        self.buffer = Some(buffer);
        self.capacity = capacity;
        true
    }

    fn create(&self, capacity: u32, device: &RenderDevice) -> Buffer {
        device.create_buffer(&BufferDescriptor {
            label: Some(self.label),
            size: capacity as u64 * size_of::<T>() as u64,
            usage: self.usage,
            mapped_at_creation: false,
        })
    }

    /// Uploads `data` to the elements from `first` on, which must be reserved.  Returns the number of bytes sent.
    pub(crate) fn write(&self, first: u32, data: &[T], queue: &RenderQueue) -> u64 {
        let Some(buffer) = &self.buffer else { return 0 };
        if data.is_empty() || first as usize + data.len() > self.capacity as usize {
            return 0;
        }
        let bytes: &[u8] = bytemuck::cast_slice(data);
        queue.write_buffer(buffer, first as u64 * size_of::<T>() as u64, bytes);
        bytes.len() as u64
    }

    /// Uploads these runs of `data`, which are in ascending order, to the same places in the buffer.  Returns the number of bytes sent.
    pub(crate) fn write_runs(&self, runs: &[Range<usize>], data: &[T], uploads: &mut Uploads) -> u64 {
        self.write_parts(runs, runs.iter().map(|run| &data[run.clone()]), uploads)
    }

    /// Uploads `packed`, one run after the other, to the places of these runs, which are in ascending order.  Returns the number of bytes
    /// sent.
    pub(crate) fn write_packed(&self, runs: &[Range<usize>], packed: &[T], uploads: &mut Uploads) -> u64 {
        let mut rest = packed;
        let parts = runs.iter().map(|run| rest.split_off(..run.len()).unwrap_or_default());
        self.write_parts(runs, parts, uploads)
    }

    /// Uploads the contents of these runs, which are in ascending order.  Returns the number of bytes sent.
    fn write_parts<'a>(
        &self,
        runs: &[Range<usize>],
        parts: impl Iterator<Item = &'a [T]>,
        uploads: &mut Uploads,
    ) -> u64 {
        let Some(buffer) = &self.buffer else { return 0 };
        if runs.last().is_none_or(|last| last.end > self.capacity as usize) {
            return 0;
        }
        let pairs = runs.iter().zip(parts);
        if runs.len() <= MAX_WRITES {
            return pairs.map(|(run, part)| self.write(run.start as u32, part, uploads.queue)).sum();
        }
        let bytes = |count: usize| (count * size_of::<T>()) as u64;
        let size = bytes(runs.iter().map(|run| run.len()).sum());
        let parts = pairs.map(|(run, part)| (bytes(run.start), bytemuck::cast_slice::<T, u8>(part)));
        uploads.scatter(self.label, buffer, size, parts);
        size
    }

    /// The buffer; `None` before the first [`Self::reserve`].
    pub(crate) fn buffer(&self) -> Option<&Buffer> {
        self.buffer.as_ref()
    }

    /// Name and size in bytes, for the report.
    pub(crate) fn memory(&self) -> (&'static str, u64) {
        (self.label, self.buffer.as_ref().map_or(0, |buffer| buffer.size()))
    }
}
