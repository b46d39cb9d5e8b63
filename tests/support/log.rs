//! Warnings of the plugin, for tests that check them.

use bevy::log::{Level, tracing_subscriber};
use std::{
    io::Write,
    sync::{Mutex, OnceLock, PoisonError},
    thread::{self, ThreadId},
};

/// Recorded events, each with the thread that logged it.
static EVENTS: Mutex<Vec<(ThreadId, String)>> = Mutex::new(Vec::new());

struct Sink;

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let event = (thread::current().id(), String::from_utf8_lossy(bytes).into_owned());
        EVENTS.lock().unwrap_or_else(PoisonError::into_inner).push(event);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Starts to record the warnings of the whole process.
pub fn listen() {
    static ONCE: OnceLock<()> = OnceLock::new();
    ONCE.get_or_init(|| {
        tracing_subscriber::fmt().with_max_level(Level::WARN).with_ansi(false).with_writer(|| Sink).init();
    });
}

/// Recorded lines that contain a text, from any test.
pub fn warnings(with: &str) -> Vec<String> {
    lines(with, |_| true)
}

/// The same, from the systems of the test that asks: the app of a test runs them in the thread of the test.
pub fn own_warnings(with: &str) -> Vec<String> {
    let own = thread::current().id();
    lines(with, |thread| thread == own)
}

fn lines(with: &str, is_wanted: impl Fn(ThreadId) -> bool) -> Vec<String> {
    let events = EVENTS.lock().unwrap_or_else(PoisonError::into_inner);
    let wanted = events.iter().filter(|(thread, _)| is_wanted(*thread));
    wanted.flat_map(|(_, event)| event.lines()).filter(|line| line.contains(with)).map(str::to_owned).collect()
}
