//! Panics as errors: a loader or a system that panics must end in one line.

use std::{
    panic::{self, AssertUnwindSafe},
    sync::{Mutex, PoisonError},
};

static LAST: Mutex<Option<String>> = Mutex::new(None);

/// From now on panics are kept in memory instead of printed.
pub fn record() {
    panic::set_hook(Box::new(|info| {
        let message = info.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        *LAST.lock().unwrap_or_else(PoisonError::into_inner) = Some(message);
    }));
}

/// Takes the message of the last panic of any thread.
pub fn take() -> Option<String> {
    LAST.lock().unwrap_or_else(PoisonError::into_inner).take()
}

/// Runs a function whose state is not used again after a panic.
pub fn caught<T>(run: impl FnOnce() -> T) -> Result<T, String> {
    panic::catch_unwind(AssertUnwindSafe(run)).map_err(|_| take().unwrap_or("a panic without a message".into()))
}
