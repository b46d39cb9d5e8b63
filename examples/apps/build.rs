//! Joins the sources that declare the settings, so that `panel::docs` finds their documentation wherever they lie.

use std::{
    env, fs,
    path::{Path, PathBuf},
};

fn main() {
    // Read at run time: a target folder may outlive the checkout that compiled this program.
    let package = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it"));
    let src = package.join("../../src");
    let mut files = vec![src.join("settings.rs")];
    collect(&src.join("settings"), &mut files);
    files.retain(|file| file.is_file());
    files.sort();
    let text: String = files.iter().filter_map(|file| fs::read_to_string(file).ok()).collect();
    assert!(!text.is_empty(), "{} has no settings", src.display());
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it"));
    fs::write(out.join("settings.rs"), text).expect("the output folder can be written");
    for path in [src.join("settings.rs"), src.join("settings")].iter().filter(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
}

/// Adds all Rust files below a folder.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        match path.is_dir() {
            true => collect(&path, files),
            false if path.extension().is_some_and(|e| e == "rs") => files.push(path),
            false => {}
        }
    }
}
