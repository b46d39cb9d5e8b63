//! Decides when to warn that a scene exceeds the device.

use crate::warned::Rate;

/// Warns once for as long as something does not fit the device.
#[derive(Debug, Default)]
pub(crate) struct OverflowWarning {
    warned: bool,
    rate: Rate,
}

impl OverflowWarning {
    /// Whether to warn that `left_out` elements do not fit; called once a frame.  The warning waits until the scene has `settled`, so that it
    /// gives the number for the complete scene.
    pub(crate) fn should_warn(&mut self, left_out: u64, settled: bool) -> bool {
        self.rate.begin_frame();
        if left_out == 0 {
            self.warned = false;
            return false;
        }
        settled && !core::mem::replace(&mut self.warned, true) && self.rate.allows()
    }
}
