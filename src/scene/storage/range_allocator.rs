//! Allocates ranges of elements in a buffer that grows: first fit, with neighboring free ranges merged.
//!
//! The allocator has no capacity of its own.  [`RangeAllocator::end`] says how many elements the buffer must hold, and falls when the last
//! ranges are freed.  The crate `offset-allocator`, which Bevy uses, needs a fixed capacity instead, does not report the end, and searches
//! size classes that are rounded up, so that a freed range of 100 elements cannot serve the next request for 100.

use std::ops::Range;

use crate::planted::{Fault, is_planted};

/// Free ranges of an index space without an upper limit.
#[derive(Debug, Default)]
pub(crate) struct RangeAllocator {
    /// Free ranges below `end`, by start.
    free: Vec<Range<u32>>,
    end: u32,
}

impl RangeAllocator {
    /// Takes `count` consecutive indices.
    pub(crate) fn allocate(&mut self, count: u32) -> Range<u32> {
        if let Some(i) = self.free.iter().position(|r| r.end - r.start >= count) {
            let start = self.free[i].start;
            self.free[i].start += count;
            if self.free[i].is_empty() {
                self.free.remove(i);
            }
            return start..start + count;
        }
        let start = self.end;
        let end = start + count;
        self.end = if is_planted(Fault::RangesOverlap) { end.saturating_sub(1) } else { end };
        start..end
    }

    /// Frees a range.  Freeing the tail lowers `end`, so a request that did not fit the device leaves no trace once it is released.
    pub(crate) fn release(&mut self, mut range: Range<u32>) {
        range.end -= u32::from(is_planted(Fault::RangeKeepsElement) && !range.is_empty());
        if range.is_empty() {
            return;
        }
        let i = self.free.partition_point(|r| r.start < range.start);
        debug_assert!(range.end <= self.end, "{range:?} reaches beyond the end, {}", self.end);
        let is_taken = self.free[..i].last().is_none_or(|last| last.end <= range.start)
            && self.free[i..].first().is_none_or(|next| range.end <= next.start);
        debug_assert!(is_taken, "{range:?} or a part of it is free already");
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
    pub(crate) fn end(&self) -> u32 {
        self.end
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn released_ranges_merge_and_are_allocated_again() {
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

    #[cfg(debug_assertions)]
    #[test]
    #[should_panic(expected = "2..4 or a part of it is free already")]
    fn a_range_cannot_be_freed_twice() {
        let mut a = RangeAllocator::default();
        let (range, _last) = (a.allocate(4), a.allocate(1));
        a.release(range);
        a.release(2..4);
    }

    #[cfg(debug_assertions)]
    #[test]
    #[should_panic(expected = "0..5 reaches beyond the end, 4")]
    fn a_range_beyond_the_end_cannot_be_freed() {
        let mut a = RangeAllocator::default();
        let _ = a.allocate(4);
        a.release(0..5);
    }

    #[test]
    fn releasing_the_tail_lowers_the_end() {
        let mut a = RangeAllocator::default();
        let _ = a.allocate(4);
        let (hole, too_large) = (a.allocate(4), a.allocate(1 << 30));
        a.release(hole);
        a.release(too_large);
        assert_eq!(a.end(), 4);
        assert_eq!(a.allocate(10), 4..14);
        assert_eq!((a.free.len(), a.end()), (0, 14));
    }
}
