//! Finds the runs of elements to upload, so that a small change of a large array sends few bytes.

use std::ops::Range;

/// A gap of fewer unchanged elements is uploaded too: another transfer costs more than the bytes of the gap.
const MIN_GAP: usize = 16;

/// Runs of elements that differ between the uploaded array and the new one.
pub(crate) fn dirty_runs<T: PartialEq>(uploaded: &[T], new: &[T]) -> Vec<Range<usize>> {
    joined_runs((0..new.len()).filter(|&i| uploaded.get(i) != Some(&new[i])))
}

/// Runs that contain the given ascending indices.
pub(crate) fn joined_runs(indices: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    joined(indices.map(|i| i..i + 1))
}

/// Runs that contain the given ranges, which are sorted by their starts.
pub(crate) fn joined(ranges: impl Iterator<Item = Range<usize>>) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for range in ranges {
        match runs.last_mut() {
            Some(last) if range.start < last.end + MIN_GAP => last.end = last.end.max(range.end),
            _ => runs.push(range),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_contain_every_difference_and_join_over_small_gaps() {
        let old = vec![0; 100];
        let mut new = old.clone();
        assert!(dirty_runs(&old, &new).is_empty());
        new[3] = 1;
        new[10] = 1;
        new[80] = 1;
        assert_eq!(dirty_runs(&old, &new), vec![3..11, 80..81]);
        new.push(0);
        assert_eq!(dirty_runs(&old, &new).last(), Some(&(100..101)));
        assert_eq!(joined([1..9, 2..4, 20..21, 60..70].into_iter()), vec![1..21, 60..70]);
    }
}
