//! Decides which problems the log names, so that neither the log nor the memory of past warnings grows with the number of frames.

use bevy::{log::warn, platform::collections::HashSet};
use core::hash::Hash;

/// Limits warnings to a burst and then to a slow rate.
#[derive(Debug)]
pub(crate) struct Rate {
    /// Warnings that may be logged now.
    room: u32,
    frames: u32,
}

impl Rate {
    /// Warnings that may come in one frame.
    const BURST: u32 = 64;
    /// Frames after which one more warning may come.
    const FRAMES_PER_WARNING: u32 = 60;

    /// Starts a frame.
    pub(crate) fn begin_frame(&mut self) {
        self.frames = (self.frames + 1) % Self::FRAMES_PER_WARNING;
        if self.frames == 0 {
            self.room = (self.room + 1).min(Self::BURST);
        }
    }

    /// Whether a warning may be logged now.
    pub(crate) fn allows(&mut self) -> bool {
        let allowed = self.room > 0;
        self.room = self.room.saturating_sub(1);
        allowed
    }
}

impl Default for Rate {
    fn default() -> Self {
        Self { room: Self::BURST, frames: 0 }
    }
}

/// The problems that warnings have named.  A key says what the problem is, without the numbers that may change from frame to frame.
#[derive(Debug)]
pub(crate) struct Warned<K> {
    named: HashSet<K>,
    rate: Rate,
    withheld: u64,
}

impl<K> Default for Warned<K> {
    fn default() -> Self {
        Self { named: HashSet::default(), rate: Rate::default(), withheld: 0 }
    }
}

impl<K: Eq + Hash> Warned<K> {
    /// Problems that are kept in memory.  If there are more, all are forgotten, and the rate alone limits the log.
    const CAPACITY: usize = 1 << 16;

    /// Starts a frame.  Warns about the number of warnings that were withheld, as soon as the rate allows it.
    pub(crate) fn begin_frame(&mut self) {
        self.rate.begin_frame();
        if self.withheld > 0 && self.rate.allows() {
            warn!(
                "restir: {} further warnings were not logged, because too many similar ones came at once",
                self.withheld
            );
            self.withheld = 0;
        }
    }

    /// Whether the log must name this problem: it is new, and there were not too many others lately.
    #[must_use]
    pub(crate) fn is_due(&mut self, problem: K) -> bool {
        if self.named.len() >= Self::CAPACITY {
            self.named.clear();
        }
        if !self.named.insert(problem) {
            return false;
        }
        let allowed = self.rate.allows();
        self.withheld += u64::from(!allowed);
        allowed
    }

    /// Number of problems that are kept in memory.
    #[cfg(feature = "testing")]
    pub(crate) fn len(&self) -> usize {
        self.named.len()
    }

    /// Forgets a problem, so that it is named again when it comes back.
    pub(crate) fn forget(&mut self, problem: &K) {
        self.named.remove(problem);
    }

    /// Keeps these problems and forgets the others, for example those of entities that are gone.
    pub(crate) fn retain(&mut self, mut is_kept: impl FnMut(&K) -> bool) {
        if !self.named.is_empty() {
            self.named.retain(|problem| is_kept(problem));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The number of warnings in some frames, in each of which the given problems occur.
    fn count(warned: &mut Warned<u32>, frames: u32, problems: impl Fn(u32) -> core::ops::Range<u32>) -> usize {
        let in_frame = |frame| {
            warned.begin_frame();
            problems(frame).filter(|&problem| warned.is_due(problem)).count()
        };
        (0..frames).map(in_frame).sum()
    }

    #[test]
    fn a_problem_of_ten_thousand_frames_is_named_once() {
        let mut warned = Warned::default();
        assert_eq!(count(&mut warned, 10_000, |_| 0..3), 3);
        warned.forget(&1);
        assert_eq!(count(&mut warned, 10_000, |_| 0..3), 1, "a forgotten problem is new");
        warned.retain(|&problem| problem == 2);
        assert_eq!(warned.named.len(), 1);
    }

    #[test]
    fn new_problems_in_every_frame_are_named_at_a_slow_rate_and_take_bounded_memory() {
        let mut warned = Warned::default();
        let named = count(&mut warned, 10_000, |frame| 100 * frame..100 * frame + 100);
        let most = Rate::BURST + 10_000 / Rate::FRAMES_PER_WARNING;
        assert!((Rate::BURST as usize..=most as usize).contains(&named), "{named} of at most {most}");
        assert!(warned.named.len() <= Warned::<u32>::CAPACITY);
        assert!(warned.withheld > 0, "the withheld ones are counted");
    }
}
