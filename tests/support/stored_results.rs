//! Results of long tests, one file a row.  They lie in the target folder by commit, so that a run continues where the last one stopped;
//! their tables are published in `docs/proof-matrix.md`.

use serde_json::Value;
use std::{
    env, fs,
    hash::{DefaultHasher, Hash, Hasher},
    path::{Path, PathBuf},
    process::Command,
};

/// The folder of the results of a test at this commit.
pub fn folder_of(name: &str, commit: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name.replace(' ', "_")).join(commit);
    fs::create_dir_all(&folder).expect("the target folder can be written");
    folder
}

pub fn read(path: &Path) -> Option<Value> {
    serde_json::from_str(&fs::read_to_string(path).ok()?).ok()
}

pub fn write(path: &Path, value: &Value) {
    // A run may be killed at any time: write to a temporary name and rename.
    let unfinished = path.with_extension("unfinished");
    fs::write(&unfinished, value.to_string()).expect("the target folder can be written");
    fs::rename(unfinished, path).expect("the target folder can be written");
}

/// The last commit that changed a measured file; uncommitted changes add a hash.
pub fn commit() -> String {
    let git = |arguments: &[&str]| {
        let measured = ["--", "src", "shaders", "assets", "tests", "Cargo.lock"];
        let output = Command::new("git")
            .args(arguments)
            .args(measured)
            .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
            .output()
            .ok()
            .filter(|output| output.status.success());
        output.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned()).unwrap_or_default()
    };
    let (head, changes) = (git(&["log", "-1", "--format=%h"]), git(&["diff", "HEAD"]));
    if changes.is_empty() {
        return head;
    }
    let mut hasher = DefaultHasher::new();
    changes.hash(&mut hasher);
    format!("{head} with changes {:08x}", hasher.finish() as u32)
}

/// The rows that a process measures: every one of them, or one in `of`, so that several processes share the work.
pub struct Part {
    number: usize,
    of: usize,
}

impl Part {
    /// The part that a variable of the environment names, such as `MATRIX_PART=0/2`.  Without it: all rows.
    pub fn from_environment(variable: &str) -> Self {
        let Ok(text) = env::var(variable) else { return Self { number: 0, of: 1 } };
        let numbers = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
        let (number, of) = numbers.unwrap_or_else(|| panic!("{variable} is two numbers such as 0/2, and not {text}"));
        Self { number, of }
    }

    pub fn has(&self, row: usize) -> bool {
        row % self.of == self.number
    }
}

/// Writes a table into `docs/proof-matrix.md`, between the marks of this name.
pub fn publish(name: &str, table: &str) {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("docs/proof-matrix.md");
    let text = fs::read_to_string(&path).expect("the document is there");
    let (begin, end) = (format!("<!-- {name} -->\n"), format!("<!-- /{name} -->"));
    let (before, rest) = text.split_once(&begin).expect("the document has the begin mark");
    let (_, after) = rest.split_once(&end).expect("the document has the end mark");
    fs::write(&path, format!("{before}{begin}{table}{end}{after}")).expect("the document can be written");
}
