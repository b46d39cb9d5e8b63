//! Files that appear only once they are complete.

use std::path::{Path, PathBuf};

/// Writes to a temporary file beside `path` and renames it when `write` succeeded.
pub fn complete(path: &Path, write: impl FnOnce(&Path) -> Result<(), String>) -> Result<(), String> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    let part: PathBuf = path.with_file_name(name);
    let result = write(&part).and_then(|()| std::fs::rename(&part, path).map_err(|e| e.to_string()));
    if result.is_err() {
        let _ = std::fs::remove_file(&part);
    }
    result.map_err(|e| format!("{}: {e}", path.display()))
}

/// Writes a text file, complete or not at all.
pub fn write_text(path: &Path, text: &str) -> Result<(), String> {
    complete(path, |part| std::fs::write(part, text).map_err(|e| e.to_string()))
}
