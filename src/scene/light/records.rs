//! The records of lights, and which of them are in use.

use std::ops::Range;

use crate::gpu_layout::GpuLight;
use crate::scene::storage::{
    dirty_runs::{dirty_runs, joined},
    growable_buffer::GrowableBuffer,
    range_allocator::RangeAllocator,
    uploads::Uploads,
};

/// A copy of the records on the CPU, with the ranges of them that are in use.
#[derive(Debug, Default)]
pub(super) struct LightRecords {
    /// The content of the buffer, once the dirty ranges are sent.  Beyond the end of this list, the content of the buffer is unknown.
    records: Vec<GpuLight>,
    ranges: RangeAllocator,
    /// Ranges that only the table of the last frame uses.
    retired: Vec<Range<u32>>,
    /// Ranges to send, in no particular order.
    dirty: Vec<Range<usize>>,
}

impl LightRecords {
    /// Frees the ranges that were retired in the last frame.
    pub(super) fn begin_frame(&mut self) {
        self.retired.drain(..).for_each(|range| self.ranges.release(range));
    }

    /// Takes a range into use.
    pub(super) fn allocate(&mut self, count: u32) -> Range<u32> {
        self.ranges.allocate(count)
    }

    /// Keeps a range for the rest of this frame, because its shaders also read the table of the last frame.
    pub(super) fn retire(&mut self, range: Range<u32>) {
        self.retired.push(range);
    }

    /// Frees all ranges at once.
    pub(super) fn clear(&mut self) {
        self.ranges = RangeAllocator::default();
        self.retired.clear();
    }

    /// One past the last record in use.
    pub(super) fn end(&self) -> u32 {
        self.ranges.end()
    }

    pub(super) fn get(&self, range: Range<u32>) -> &[GpuLight] {
        &self.records[range.start as usize..range.end as usize]
    }

    /// Replaces the records from `first` on.
    pub(super) fn write(&mut self, first: u32, new: &[GpuLight]) {
        let (first, len) = (first as usize, self.records.len());
        if len < first {
            self.records.resize(first, GpuLight::default());
            self.dirty.push(len..first);
        }
        let known = self.records.len().min(first + new.len());
        let runs = dirty_runs(&self.records[first..known], new);
        self.dirty.extend(runs.into_iter().map(|run| first + run.start..first + run.end));
        let (replaced, added) = new.split_at(known - first);
        self.records[first..known].copy_from_slice(replaced);
        self.records.extend_from_slice(added);
    }

    /// Sends what has changed.  Returns the number of bytes; `None` if the device has no room for the records.
    pub(super) fn upload(&mut self, gpu: &mut GrowableBuffer<GpuLight>, uploads: &mut Uploads) -> Option<u64> {
        // Records that are no longer in use may never have been sent.
        let end = self.end() as usize;
        self.records.truncate(end);
        self.dirty.iter_mut().for_each(|run| run.end = run.end.min(end));
        self.dirty.retain(|run| !run.is_empty());
        if self.dirty.is_empty() {
            return Some(0);
        }
        self.dirty.sort_unstable_by_key(|run| run.start);
        let runs = joined(self.dirty.drain(..));
        if !gpu.reserve(end as u32, uploads.device, uploads.queue) {
            // The next frame tries again.  Joined runs do not pile up until there is room.
            self.dirty = runs;
            return None;
        }
        Some(gpu.write_runs(&runs, &self.records, uploads))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(index: u32) -> GpuLight {
        GpuLight { data: [index, 0], ..Default::default() }
    }

    #[test]
    fn only_records_that_differ_are_sent() {
        let mut records = LightRecords::default();
        let (first, second) = (records.allocate(64), records.allocate(40));
        // The range has more room than records.
        records.write(first.start, &[light(1), light(2)]);
        records.write(second.start, &[light(3); 40]);
        assert_eq!(records.dirty, [0..2, 2..64, 64..104], "the content of a new buffer is unknown");
        records.dirty.clear();
        let mut other = [light(3); 40];
        (other[10], other[30]) = (light(4), light(4));
        records.write(second.start, &other);
        assert_eq!(records.dirty, [74..75, 94..95]);
        assert_eq!(records.get(second), other);
    }

    #[test]
    fn a_retired_range_is_free_in_the_next_frame() {
        let mut records = LightRecords::default();
        let (first, second) = (records.allocate(8), records.allocate(8));
        records.retire(first.clone());
        assert_eq!(records.allocate(8), 16..24);
        records.begin_frame();
        assert_eq!(records.allocate(8), first);
        records.retire(second.clone());
        records.clear();
        records.begin_frame();
        assert_eq!((records.end(), records.allocate(8)), (0, first));
    }
}
