//! Faults that `lab plants` plants, to show that `lab fuzz` and `lab soak` find such faults.  Only the feature `testing` can plant one; without
//! it, [`is_planted`] is constant and the compiler removes the faults.

/// A fault that can be planted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The buffers of reservoirs are never freed.
    ReservoirsLeak,
    /// A range of a shared buffer that is freed keeps its last element.
    RangeKeepsElement,
    /// Two ranges of a shared buffer have an element in common.
    RangesOverlap,
    /// A slot of an instance that is gone keeps its record.
    StaleSlot,
    /// A light of this frame is looked up in the table of the last frame by its present id.
    LightNotRemapped,
}

#[cfg(feature = "testing")]
impl Fault {
    pub const ALL: [Self; 5] =
        [Self::ReservoirsLeak, Self::RangeKeepsElement, Self::RangesOverlap, Self::StaleSlot, Self::LightNotRemapped];
}

#[cfg(feature = "testing")]
static PLANTED: std::sync::OnceLock<Fault> = std::sync::OnceLock::new();

/// Plants a fault in all apps of this process, for the rest of its life.  A process has at most one fault: the first one.
#[cfg(feature = "testing")]
pub fn plant(fault: Fault) {
    let _ = PLANTED.set(fault);
}

#[cfg(feature = "testing")]
pub(crate) fn is_planted(fault: Fault) -> bool {
    PLANTED.get() == Some(&fault)
}

#[cfg(not(feature = "testing"))]
pub(crate) const fn is_planted(_: Fault) -> bool {
    false
}
