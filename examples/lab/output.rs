//! Writes tables to files and into the documentation.

use bevy::math::UVec2;
use bevy_restir_support::{files, files::write_text, mutant};
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
    time::{Duration, SystemTime},
};

use crate::table::Table;

/// Destination of a table.
#[derive(clap::Args, Clone, Debug)]
pub struct Output {
    /// Folder for the table as markdown and as csv.
    #[arg(long, default_value = "target/lab")]
    out: PathBuf,
    /// A markdown file. The table replaces its text between `<!-- lab NAME -->` and `<!-- /lab NAME -->`.
    #[arg(long)]
    into: Option<PathBuf>,
}

impl Output {
    /// Fails before anything is measured if the table could not be written.  Creates nothing.
    pub fn check(&self, name: &str) -> Result<(), String> {
        let [csv, markdown] = file_names(name);
        files::check_in(&self.out, &[&csv, &markdown])?;
        check_into(self.into.as_deref(), name)
    }

    /// Writes a plot beside the tables.
    pub fn write_plot(&self, name: &str, svg: &str) -> Result<(), String> {
        files::create_folder(&self.out)?;
        write_text(&self.out.join(format!("{name}.svg")), svg)
    }

    /// Writes the table, each file complete or not at all.
    pub fn write(&self, name: &str, table: &Table) -> Result<(), String> {
        self.write_so_far(name, table)?;
        write_into(self.into.as_deref(), name, &table.markdown())
    }

    /// Writes a table that still lacks columns to the folder, so that an error in a later scene does not lose hours of measurements.
    pub fn write_so_far(&self, name: &str, table: &Table) -> Result<(), String> {
        let [csv, markdown] = file_names(name).map(|name| self.out.join(name));
        files::create_folder(&self.out)?;
        write_text(&csv, &table.csv())?;
        write_text(&markdown, &table.markdown())
    }
}

/// The files of a table.
fn file_names(name: &str) -> [String; 2] {
    [format!("{name}.csv"), format!("{name}.md")]
}

/// Fails where a markdown file lacks the marks of a table, or cannot be written.
pub fn check_into(into: Option<&Path>, name: &str) -> Result<(), String> {
    into.map_or(Ok(()), |path| replaced(path, name, "").and_then(|_| files::check(path)))
}

/// Replaces the text between the marks of a table in a markdown file.
pub fn write_into(into: Option<&Path>, name: &str, markdown: &str) -> Result<(), String> {
    into.map_or(Ok(()), |path| write_text(path, &replaced(path, name, markdown)?))
}

/// The text of a file with `text` between the marks.
fn replaced(path: &Path, name: &str, text: &str) -> Result<String, String> {
    let whole = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let (open, close) = (format!("<!-- lab {name} -->"), format!("<!-- /lab {name} -->"));
    let found = whole.split_once(&open).and_then(|(before, rest)| Some((before, rest.split_once(&close)?.1)));
    let (before, after) = found.ok_or(format!("{}: the marks {open} and {close} are missing", path.display()))?;
    Ok(format!("{before}{open}\n\n{}\n\n{close}{after}", text.trim_end()))
}

/// The command, the adapter, the size of the picture and the commit.
pub fn header(adapter: String, size: UVec2) -> Vec<String> {
    let mut lines = provenance(Some(adapter));
    lines.insert(2, format!("{} x {} pixels", size.x, size.y));
    lines
}

/// Writes the header of a table, if it has none.  `measured`: what its figures are, in a line.
pub fn describe(table: &mut Table, adapter: String, size: UVec2, measured: String) {
    if table.header.is_empty() {
        table.header = header(adapter, size);
        table.header.push(measured);
    }
}

/// The command, the adapter if one was used, and the commit.
pub fn provenance(adapter: Option<String>) -> Vec<String> {
    // A sweep that starts over has the same figures.
    let arguments = std::env::args().skip(1).filter(|argument| argument != "--fresh");
    let arguments: Vec<String> = arguments.map(|argument| quoted(&argument)).collect();
    // A planted fault belongs to the command.
    let planted = mutant::edits().iter().flat_map(|edit| {
        [("FILE", edit.module), ("OLD", edit.from), ("NEW", edit.to)]
            .map(|(name, text)| format!("MUTANT_{name}={} ", quoted(text)))
    });
    let planted: String = planted.collect();
    let mut lines = vec![format!("`{planted}cargo run --example lab -- {}`", arguments.join(" "))];
    lines.extend(adapter);
    if let Some(commit) = commit() {
        lines.push(format!("commit {commit}"));
    }
    lines
}

/// An argument as a shell takes it.
fn quoted(argument: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_./=,:+-@%".contains(c);
    if !argument.is_empty() && argument.chars().all(is_plain) {
        return argument.into();
    }
    format!("'{}'", argument.replace('\'', r"'\''"))
}

/// The commit of the sources when the program started, where git knows it, and whether the program is of that commit.  `main` calls this
/// first: a measurement takes hours, in which others may commit.
pub fn commit() -> Option<String> {
    static COMMIT: OnceLock<Option<String>> = OnceLock::new();
    COMMIT.get_or_init(commit_now).clone()
}

fn commit_now() -> Option<String> {
    /// Files and folders that the programs are built from.
    const SOURCES: [&str; 5] = ["src", "shaders", "examples", "Cargo.toml", "Cargo.lock"];
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(["-C", env!("CARGO_MANIFEST_DIR")]).args(arguments).output().ok()?;
        let text = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success().then_some(text)
    };
    let mut commit = git(&["rev-parse", "--short", "HEAD"])?;
    if git(&[&["diff", "--quiet", "HEAD", "--"], &SOURCES[..]].concat()).is_none() {
        commit += " with changes that are not committed";
    }
    let seconds = git(&[&["log", "-1", "--format=%ct", "--"], &SOURCES[..]].concat())?.parse().ok()?;
    let built = std::env::current_exe().and_then(fs::metadata).and_then(|program| program.modified()).ok()?;
    if built < SystemTime::UNIX_EPOCH + Duration::from_secs(seconds) {
        commit += ", but the program was built before it";
    }
    Some(commit)
}
