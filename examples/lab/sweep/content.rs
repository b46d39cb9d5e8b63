//! Hashes of files, by which a sweep knows whether its inputs are those of an earlier one.

use serde_json::Value;
use std::{
    fs,
    hash::{DefaultHasher, Hash, Hasher},
    path::Path,
};

use crate::broken_files::glb::Glb;

/// A hash of a file's content; `None` if the file cannot be read.
pub fn of_file(path: &Path) -> Option<String> {
    let mut hasher = DefaultHasher::new();
    fs::read(path).ok()?.hash(&mut hasher);
    Some(format!("{:016x}", hasher.finish()))
}

/// Hashes of a glTF file and of the files with its buffers and images.
pub fn of_scene(path: &Path) -> Vec<Option<String>> {
    let bytes = fs::read(path).unwrap_or_default();
    let json: Value = match Glb::read(&bytes) {
        Ok(binary) => binary.json,
        Err(_) => serde_json::from_slice(&bytes).unwrap_or_default(),
    };
    let entries = ["buffers", "images"].into_iter().filter_map(|kind| json[kind].as_array()).flatten();
    let uris = entries.filter_map(|entry| entry["uri"].as_str()).filter(|uri| !uri.starts_with("data:"));
    let folder = path.parent().unwrap_or(path);
    // A space in the name of a file is %20 in a URI.
    let named = uris.map(|uri| of_file(&folder.join(uri.replace("%20", " "))));
    core::iter::once(of_file(path)).chain(named).collect()
}
