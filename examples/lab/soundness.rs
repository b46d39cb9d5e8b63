//! The checks of commands that try to break the renderer: for hangs, raised guards, overflows, and pixels that are not finite.

use bevy_restir::RestirReport;
use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::Duration,
};

/// Checks that may fail: light beyond the range of f32, and more hits of a probe than are counted.
const EXPECTED: [&str; 2] = ["float_overflow", "overflow_probe"];
/// The bit of [`RestirReport::overflow_flags`] for such a probe.
const PROBE_OVERFLOW: u32 = 1 << 19;
/// A frame may take this long, with the compilation of its pipelines.
const PATIENCE: Duration = Duration::from_secs(600);

/// The beginning of a line that names a failure.
pub const FAULT: &str = "fault: ";

/// Guards and overflows of the frames that a report counts, and pixels that are not finite.
pub fn fault(report: &RestirReport) -> Option<String> {
    let raised: Vec<String> = report
        .raised_guards()
        .iter()
        .filter(|(name, _)| !EXPECTED.contains(name))
        .map(|(name, pixels)| format!("guard {name} in {pixels} pixels"))
        .collect();
    if !raised.is_empty() {
        return Some(raised.join(", "));
    }
    let (flags, pixels) = (report.overflow_flags, report.non_finite_pixels);
    (flags & !PROBE_OVERFLOW != 0 || pixels != 0).then(|| format!("overflow {flags:#x}, {pixels} pixels not finite"))
}

/// Number of frames that have ended.
static FRAMES: AtomicU64 = AtomicU64::new(0);

/// A frame has ended.
pub fn beat() {
    FRAMES.fetch_add(1, Ordering::Relaxed);
}

/// Ends the program with an error line if no frame ends for a long time.
pub struct Watchdog {
    subject: Arc<Mutex<String>>,
}

impl Watchdog {
    pub fn new() -> Self {
        let this = Self { subject: Arc::default() };
        let subject = this.subject.clone();
        thread::spawn(move || {
            let mut last = FRAMES.load(Ordering::Relaxed);
            loop {
                thread::sleep(PATIENCE);
                // The command has ended.
                if Arc::strong_count(&subject) == 1 {
                    return;
                }
                let now = FRAMES.load(Ordering::Relaxed);
                if core::mem::replace(&mut last, now) == now {
                    let subject = subject.lock().unwrap_or_else(PoisonError::into_inner);
                    eprintln!("error: {subject} hangs: no frame ends within {} s", PATIENCE.as_secs());
                    std::process::exit(1);
                }
            }
        });
        this
    }

    /// Names the present subject, for the message of a hang.
    pub fn watch(&self, subject: impl Into<String>) {
        *self.subject.lock().unwrap_or_else(PoisonError::into_inner) = subject.into();
        beat();
    }
}

/// The text of a failure up to its first digit: two failures with the same text probably have the same cause.
pub fn kind(failure: &str) -> &str {
    failure.split(|c: char| c.is_ascii_digit()).next().unwrap_or_default()
}
