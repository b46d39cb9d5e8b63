//! Files that appear only once they are complete.

use std::path::{Path, PathBuf};

/// Fails if no file can be written at `path`, so that a program can say so before it works for an hour.
pub fn check(path: &Path) -> Result<(), String> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(format!("the folder of {} does not exist", path.display()));
    }
    if path.is_dir() {
        return Err(format!("{} is a folder", path.display()));
    }
    let part = part_of(path);
    std::fs::write(&part, "").and_then(|()| std::fs::remove_file(&part)).map_err(|e| format!("{}: {e}", path.display()))
}

/// Fails if files with these names cannot be written in `folder`, which may be missing.  Creates nothing that stays.
pub fn check_in(folder: &Path, names: &[&str]) -> Result<(), String> {
    let missing: Vec<&Path> =
        folder.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists()).collect();
    let result = create_folder(folder).and_then(|()| names.iter().try_for_each(|name| check(&folder.join(name))));
    for folder in missing {
        // Only empty folders are removed.
        let _ = std::fs::remove_dir(folder);
    }
    result
}

/// Creates a folder and those around it.
pub fn create_folder(folder: &Path) -> Result<(), String> {
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))
}

/// The temporary file beside `path`.
fn part_of(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    path.with_file_name(name)
}

/// Writes to a temporary file beside `path` and renames it when `write` succeeded.
pub fn complete(path: &Path, write: impl FnOnce(&Path) -> Result<(), String>) -> Result<(), String> {
    let part = part_of(path);
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
