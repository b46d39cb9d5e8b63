//! Where tables go: files of their own, and the documentation.

use bevy::math::UVec2;
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::{headless::files::write_text, table::Table};

/// Where a table goes.
#[derive(clap::Args, Clone, Debug)]
pub struct Output {
    /// Folder of the table, as markdown and as csv.
    #[arg(long, default_value = "target/lab")]
    out: PathBuf,
    /// A markdown file whose text between `<!-- lab NAME -->` and `<!-- /lab NAME -->` the table replaces.
    #[arg(long)]
    into: Option<PathBuf>,
}

impl Output {
    /// Before anything is measured: whether the table can be written.
    pub fn check(&self, name: &str) -> Result<(), String> {
        fs::create_dir_all(&self.out).map_err(|e| format!("{}: {e}", self.out.display()))?;
        match &self.into {
            Some(path) => replaced(path, name, "").map(|_| ()),
            None => Ok(()),
        }
    }

    /// Writes the table, each file complete or not at all.
    pub fn write(&self, name: &str, table: &Table) -> Result<(), String> {
        let markdown = table.markdown();
        write_text(&self.out.join(format!("{name}.csv")), &table.csv())?;
        write_text(&self.out.join(format!("{name}.md")), &markdown)?;
        match &self.into {
            Some(path) => write_text(path, &replaced(path, name, &markdown)?),
            None => Ok(()),
        }
    }
}

/// A file's text with another one between the marks.
fn replaced(path: &Path, name: &str, text: &str) -> Result<String, String> {
    let whole = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let (open, close) = (format!("<!-- lab {name} -->"), format!("<!-- /lab {name} -->"));
    let found = whole.split_once(&open).and_then(|(before, rest)| Some((before, rest.split_once(&close)?.1)));
    let (before, after) = found.ok_or(format!("{}: it has no marks {open} and {close}", path.display()))?;
    Ok(format!("{before}{open}\n\n{}\n\n{close}{after}", text.trim_end()))
}

/// What was run on what, and at which size of picture.
pub fn header(adapter: String, size: UVec2) -> Vec<String> {
    let mut lines = provenance(Some(adapter));
    lines.insert(2, format!("{} x {} pixels", size.x, size.y));
    lines
}

/// What was run, and on which adapter where one takes part.
pub fn provenance(adapter: Option<String>) -> Vec<String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut lines = vec![format!("`cargo run --example lab -- {}`", arguments.join(" "))];
    lines.extend(adapter);
    let git = Command::new("git").args(["-C", env!("CARGO_MANIFEST_DIR"), "rev-parse", "--short", "HEAD"]).output();
    let git = git.ok().filter(|o| o.status.success());
    if let Some(output) = git {
        lines.push(format!("commit {}", String::from_utf8_lossy(&output.stdout).trim()));
    }
    lines
}
