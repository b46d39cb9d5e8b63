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
const PATIENCE: Duration = Duration::from_secs(300);

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

/// Ends the program with an error line if no frame ends for a long time.
pub struct Watchdog {
    beats: Arc<AtomicU64>,
    subject: Arc<Mutex<String>>,
}

impl Watchdog {
    pub fn new() -> Self {
        let this = Self { beats: Arc::default(), subject: Arc::default() };
        let (beats, subject) = (this.beats.clone(), this.subject.clone());
        thread::spawn(move || {
            let mut last = 0;
            loop {
                thread::sleep(PATIENCE);
                // The command has ended.
                if Arc::strong_count(&beats) == 1 {
                    return;
                }
                if core::mem::replace(&mut last, beats.load(Ordering::Relaxed)) == beats.load(Ordering::Relaxed) {
                    let subject = subject.lock().unwrap_or_else(PoisonError::into_inner);
                    eprintln!("error: {subject} hangs: no frame ends within {} s", PATIENCE.as_secs());
                    std::process::exit(1);
                }
            }
        });
        this
    }

    /// Names what runs now.
    pub fn watch(&self, subject: impl Into<String>) {
        *self.subject.lock().unwrap_or_else(PoisonError::into_inner) = subject.into();
        self.beat();
    }

    /// A frame has ended.
    pub fn beat(&self) {
        self.beats.fetch_add(1, Ordering::Relaxed);
    }
}
