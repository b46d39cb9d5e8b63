//! Progress of a long computation.

use indicatif::{ProgressBar, ProgressStyle};
use std::{
    cell::Cell,
    io::{IsTerminal, Write, stdout},
};

/// A bar on a terminal; elsewhere a line after every tenth of the frames.
pub struct Progress {
    bar: Option<ProgressBar>,
    done: Cell<u64>,
    total: u64,
}

impl Progress {
    pub fn new(frames: u64) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{bar:40} {pos}/{len} frames, {eta} left");
            ProgressBar::new(frames).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self { bar, done: Cell::new(0), total: frames }
    }

    /// Shows nothing.
    pub fn hidden() -> Self {
        Self { bar: None, done: Cell::new(0), total: 0 }
    }

    /// Counts one frame.
    pub fn step(&self) {
        let before = self.done.get();
        let frame = before + 1;
        self.done.set(frame);
        match &self.bar {
            Some(bar) => bar.set_position(frame),
            None if frame <= self.total && frame * 10 / self.total != before * 10 / self.total => {
                // The work goes on where nobody reads the lines, as behind `| head`.
                let _ = writeln!(stdout(), "frame {frame} of {}", self.total);
            }
            None => {}
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
