//! Growable GPU arrays: ranges are handed out, only changed elements are uploaded, growth copies on the GPU.

use bevy::render::{
    render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor},
    renderer::{RenderDevice, RenderQueue},
};
use bytemuck::Pod;
use std::{marker::PhantomData, ops::Range};

/// A free list of index ranges: first fit, neighbors merged.
#[derive(Debug, Default)]
pub struct RangeAllocator {
    /// Free ranges below `end`, by start.
    free: Vec<Range<u32>>,
    end: u32,
}

impl RangeAllocator {
    /// Takes `count` consecutive indices.
    pub fn allocate(&mut self, count: u32) -> Range<u32> {
        if let Some(i) = self.free.iter().position(|r| r.end - r.start >= count) {
            let start = self.free[i].start;
            self.free[i].start += count;
            if self.free[i].is_empty() {
                self.free.remove(i);
            }
            return start..start + count;
        }
        let start = self.end;
        self.end += count;
        start..self.end
    }

    /// Gives a range back.  What then lies free at the end is none of it any more, so that a request that did not fit the device leaves
    /// no trace.
    pub fn release(&mut self, range: Range<u32>) {
        if range.is_empty() {
            return;
        }
        let i = self.free.partition_point(|r| r.start < range.start);
        self.free.insert(i, range);
        if i + 1 < self.free.len() && self.free[i].end == self.free[i + 1].start {
            self.free[i].end = self.free.remove(i + 1).end;
        }
        if i > 0 && self.free[i - 1].end == self.free[i].start {
            self.free[i - 1].end = self.free.remove(i).end;
        }
        if let Some(last) = self.free.pop_if(|r| r.end == self.end) {
            self.end = last.start;
        }
    }

    /// One past the highest index in use.
    pub fn end(&self) -> u32 {
        self.end
    }
}

/// A storage buffer of `T` that grows by doubling, up to the device's binding limit.
#[derive(Debug)]
pub struct GpuArray<T> {
    label: &'static str,
    buffer: Option<Buffer>,
    capacity: u32,
    limit: u32,
    usage: BufferUsages,
    element: PhantomData<T>,
}

impl<T: Pod> GpuArray<T> {
    /// An array that does not exist on the GPU until something is written or bound.
    pub fn new(label: &'static str) -> Self {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        Self { label, buffer: None, capacity: 0, limit: u32::MAX, usage, element: PhantomData }
    }

    /// What else the buffer is for; before anything is reserved.
    pub fn add_usage(&mut self, usage: BufferUsages) {
        self.usage |= usage;
    }

    /// Elements that one binding of this device can hold.
    pub fn limit(device: &RenderDevice) -> u32 {
        let limits = device.limits();
        let bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        (bytes / size_of::<T>() as u64).min(u32::MAX as u64) as u32
    }

    /// Makes room for `count` elements and keeps what is there.  False where the device's limit forbids it.
    #[must_use]
    pub fn reserve(&mut self, count: u32, device: &RenderDevice, queue: &RenderQueue) -> bool {
        if count <= self.capacity && self.buffer.is_some() {
            return true;
        }
        self.limit = Self::limit(device);
        if count > self.limit {
            return false;
        }
        let capacity = count.max(1).checked_next_power_of_two().unwrap_or(count).min(self.limit);
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some(self.label),
            size: capacity as u64 * size_of::<T>() as u64,
            usage: self.usage,
            mapped_at_creation: false,
        });
        if let Some(old) = &self.buffer {
            let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some(self.label) });
            encoder.copy_buffer_to_buffer(old, 0, &buffer, 0, old.size());
            queue.submit([encoder.finish()]);
        }
        self.buffer = Some(buffer);
        self.capacity = capacity;
        true
    }

    /// Uploads `data` to the elements from `first` on, within what was reserved.  Returns the bytes sent.
    pub fn write(&self, first: u32, data: &[T], queue: &RenderQueue) -> u64 {
        let Some(buffer) = &self.buffer else { return 0 };
        if data.is_empty() || first as usize + data.len() > self.capacity as usize {
            return 0;
        }
        let bytes: &[u8] = bytemuck::cast_slice(data);
        queue.write_buffer(buffer, first as u64 * size_of::<T>() as u64, bytes);
        bytes.len() as u64
    }

    /// The buffer, once something was reserved.
    pub fn buffer(&self) -> Option<&Buffer> {
        self.buffer.as_ref()
    }

    /// Name and size in bytes, for the statistics.
    pub fn memory(&self) -> (&'static str, u64) {
        (self.label, self.buffer.as_ref().map_or(0, |buffer| buffer.size()))
    }
}

/// Something that does not fit the device: news once for as long as it lasts.
#[derive(Debug, Default)]
pub(crate) struct Overflow {
    told: bool,
}

impl Overflow {
    /// Whether to warn of so many that are left out; not before the scene has `settled`, so that the number is that of the whole scene.
    pub(crate) fn is_news(&mut self, left_out: u64, settled: bool) -> bool {
        if left_out == 0 {
            self.told = false;
            return false;
        }
        settled && !core::mem::replace(&mut self.told, true)
    }
}

/// Runs of elements that differ between what the GPU has and what it should have.
pub fn dirty_runs<T: PartialEq>(old: &[T], new: &[T]) -> Vec<Range<usize>> {
    joined((0..new.len()).filter(|&i| old.get(i) != Some(&new[i])))
}

/// Runs that hold some elements, which rise; runs closer than 16 elements are joined, since a transfer costs more than the bytes between.
pub fn joined(elements: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for i in elements {
        match runs.last_mut() {
            Some(last) if i < last.end + 16 => last.end = i + 1,
            _ => runs.push(i..i + 1),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn released_ranges_merge_and_are_taken_again() {
        let mut a = RangeAllocator::default();
        let (x, y, z) = (a.allocate(4), a.allocate(8), a.allocate(4));
        let _ = a.allocate(1);
        a.release(x);
        a.release(z);
        a.release(y);
        assert_eq!(a.free, vec![0..16]);
        assert_eq!(a.allocate(16), 0..16);
        assert_eq!(a.end(), 17);
    }

    #[test]
    fn what_is_free_at_the_end_is_forgotten() {
        let mut a = RangeAllocator::default();
        let _ = a.allocate(4);
        let (hole, too_large) = (a.allocate(4), a.allocate(1 << 30));
        a.release(hole);
        a.release(too_large);
        assert_eq!(a.end(), 4);
        assert_eq!(a.allocate(10), 4..14);
        assert_eq!((a.free.len(), a.end()), (0, 14));
    }

    #[test]
    fn only_what_differs_is_dirty() {
        let old = vec![0; 100];
        let mut new = old.clone();
        assert!(dirty_runs(&old, &new).is_empty());
        new[3] = 1;
        new[10] = 1;
        new[80] = 1;
        assert_eq!(dirty_runs(&old, &new), vec![3..11, 80..81]);
        new.push(0);
        assert_eq!(dirty_runs(&old, &new).last(), Some(&(100..101)));
    }
}
