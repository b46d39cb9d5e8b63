//! Records the result of each proof, so that `./run rows` can write them as a table into `docs/proof-rows.md`.
//!
//! `./run test` names a file in `PROOF_ROWS`; every proof appends one line to it, with tabs between the fields.

use super::equivalence::Comparison;
use std::{fs::OpenOptions, io::Write};

/// Appends the row of one technique in one scene.  `first` is the comparison at the first length, if that failed.
pub fn record(scene: &str, what: &str, margin: f64, result: &Comparison, first: Option<&Comparison>) {
    let Some(path) = std::env::var_os("PROOF_ROWS") else { return };
    let first = first.map(|first| format!("{:+.3} % ({:+.1} σ)", 100.0 * first.difference, first.sigma()));
    let row = format!(
        "{scene}\t{what}\t{} %\t{:+.3} %\t{:+.1}\t{:.3}\t{:.1e}\t{:.1e}\t{:.1e}\t{}\t{}\n",
        100.0 * margin,
        100.0 * result.difference,
        result.sigma(),
        result.power,
        result.tost,
        result.regions,
        result.tiles,
        first.unwrap_or_default(),
        // The test harness gives the thread of a test the test's name.
        std::thread::current().name().unwrap_or_default(),
    );
    // One write for each row: tests run in parallel and append to one file.
    let file = OpenOptions::new().create(true).append(true).open(&path);
    let written = file.and_then(|mut file| file.write_all(row.as_bytes()));
    if let Err(error) = written {
        eprintln!("{}: {error}", path.display());
    }
}
