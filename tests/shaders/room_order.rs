//! The rooms (folders) of `src/` and `shaders/` import one another in one direction only.
//!
//! To allow a new edge, edit a table below.  The tables must stay free of cycles.

use std::{fs, path::Path};

/// The rooms of one tree, each with the rooms directly below it.  A room may import these and all rooms below them.
type Table = &'static [(&'static str, &'static [&'static str])];

/// First folder (or file) below `src/`.
const RUST: Table = &[
    ("cpu_times", &[]),
    ("device", &[]),
    ("gpu_layout", &[]),
    ("planted", &[]),
    ("settings", &[]),
    ("system_sets", &[]),
    ("warned", &[]),
    ("shader_library", &["cpu_times", "device", "gpu_layout", "planted", "settings", "system_sets", "warned"]),
    ("scene", &["shader_library"]),
    ("technique", &["scene"]),
    ("view", &["technique"]),
    ("frame", &["view"]),
    ("report", &["frame"]),
    ("budget", &["report"]),
    ("plugin", &["budget"]),
    ("lib", &["plugin"]),
];

/// Folder below `shaders/`.
const SHADERS: Table = &[
    ("common", &[]),
    ("bsdf", &["common"]),
    ("scene", &["bsdf"]),
    ("deformation", &["scene"]),
    ("view", &["scene"]),
    ("trace", &["view"]),
    ("subsurface", &["trace"]),
    ("light", &["trace"]),
    ("denoiser", &["view"]),
    ("path", &["light", "subsurface"]),
    ("restir", &["path"]),
    ("restir/connection", &["restir"]),
    ("restir/shift", &["restir/connection"]),
    ("restir/pt", &["restir/shift"]),
    ("restir/pt_indirect", &["restir/pt"]),
    ("restir/gi", &["restir/pt"]),
    ("restir/di", &["restir"]),
    ("restir/sss", &["restir"]),
    ("restir/bdpt", &["restir/pt"]),
    ("restir/splats", &["restir/bdpt"]),
    ("restir/reconnected", &["restir/bdpt"]),
    (
        "pass",
        &["deformation", "restir/gi", "restir/di", "restir/sss", "restir/splats", "restir/reconnected", "denoiser"],
    ),
];

fn below(table: Table, room: &str) -> &'static [&'static str] {
    table.iter().find(|(name, _)| *name == room).map_or(&[], |(_, below)| below)
}

/// Whether `target` can be reached from `room` by at least one step down.
fn is_below(table: Table, room: &str, target: &str) -> bool {
    let mut open = below(table, room).to_vec();
    let mut seen: Vec<&str> = Vec::new();
    while let Some(next) = open.pop() {
        if next == target {
            return true;
        }
        if !seen.contains(&next) {
            seen.push(next);
            open.extend(below(table, next));
        }
    }
    false
}

/// A path in an import: the byte where it begins, and its segments.
type Import<'t> = (usize, Vec<&'t str>);

/// Parses `a::{b, c::d}` into the paths `a::b` and `a::c::d`.  Returns the position behind it.
fn parse_tree<'t>(text: &'t str, start: usize, prefix: &[&'t str], found: &mut Vec<Import<'t>>) -> usize {
    let (mut at, mut path) = (start, prefix.to_vec());
    loop {
        let length = text[at..].find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len() - at);
        if length > 0 {
            path.push(&text[at..at + length]);
            at += length;
            if text[at..].starts_with("::") {
                at += 2;
                continue;
            }
        } else if text[at..].starts_with('{') {
            at += 1;
            while at < text.len() && !text[at..].starts_with('}') {
                at += text[at..].len() - text[at..].trim_start().len();
                at = parse_tree(text, at, &path, found);
                // An alias (`as name`) belongs to the item before it.
                at += text[at..].find([',', '}']).unwrap_or(text.len() - at);
                if text[at..].starts_with(',') {
                    at += 1;
                    at += text[at..].len() - text[at..].trim_start().len();
                }
            }
            return at + 1;
        } else if text[at..].starts_with('*') {
            path.push("*");
            at += 1;
        }
        if path.len() > prefix.len() {
            found.push((start, path));
        }
        return at;
    }
}

/// Paths that follow each occurrence of `before`, which begins a word.
fn paths_after<'t>(text: &'t str, before: &str) -> Vec<Import<'t>> {
    let mut found = Vec::new();
    for (at, _) in text.match_indices(before) {
        let is_inside_a_word = text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == '$' || c == ':');
        if !is_inside_a_word {
            parse_tree(text, at + before.len(), &[], &mut found);
        }
    }
    found
}

/// Blanks comments, so that positions stay as they are.
fn without_comments(text: &str) -> String {
    let blanked = text.split_inclusive('\n').map(|line| {
        let code = line.find("//").unwrap_or(line.len());
        let end = line.trim_end_matches('\n').len().max(code);
        format!("{}{}{}", &line[..code], " ".repeat(end - code), &line[end..])
    });
    blanked.collect()
}

/// The deepest room of the table that holds a path of folders.
fn room_of<'s>(table: Table, segments: &[&'s str]) -> Result<&'static str, &'s str> {
    let is_prefix = |room: &str| room.split('/').enumerate().all(|(i, part)| segments.get(i) == Some(&part));
    let rooms = table.iter().map(|(room, _)| *room).filter(|room| is_prefix(room));
    rooms.max_by_key(|room| room.len()).ok_or(segments.first().copied().unwrap_or(""))
}

/// One line for an import of `target` by `room` that the table does not allow.
fn fault(table: Table, place: &str, room: &str, target: Result<&str, &str>) -> Option<String> {
    match target {
        Err(unknown) => Some(format!("{place}: imports `{unknown}`, which is not a room of the table")),
        Ok(target) if target == room || is_below(table, room, target) => None,
        Ok(target) => Some(format!("{place}: `{room}` imports `{target}`, which is not below it in the table")),
    }
}

fn place(path: &str, text: &str, at: usize) -> String {
    format!("{path}:{}", text[..at].matches('\n').count() + 1)
}

/// Imports that the table forbids, in files below `src/`: (path relative to `src/`, text).  Unit tests are not checked.
fn rust_faults<'t>(files: impl IntoIterator<Item = (&'t str, &'t str)>) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in files {
        let modules = path.trim_end_matches(".rs").trim_end_matches("/mod");
        let room = modules.split('/').next().unwrap_or(modules);
        if let Err(unknown) = room_of(RUST, &[room]) {
            faults.push(format!("{path}: `{unknown}` is not a room of the table"));
            continue;
        }
        let text = without_comments(text);
        let text = text.split("#[cfg(test)]\nmod ").next().unwrap_or(&text);
        // One `super::` for each level of the module leads to the root.
        let to_root = "super::".repeat(modules.split('/').count());
        let mut imports = paths_after(text, "crate::");
        if room != "lib" {
            imports.extend(paths_after(text, &to_root));
        }
        for (at, segments) in imports {
            // The root re-exports names that begin with a capital letter.
            let target = match segments[0] {
                name if name.starts_with(char::is_uppercase) => Ok("lib"),
                name => room_of(RUST, &[name]),
            };
            faults.extend(fault(RUST, &place(path, text, at), room, target));
        }
    }
    faults.dedup();
    faults
}

/// Imports that the table forbids, in files below `shaders/`: (path relative to `shaders/`, text).
fn shader_faults<'t>(files: impl IntoIterator<Item = (&'t str, &'t str)>) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in files {
        let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
        if !SHADERS.iter().any(|(room, _)| *room == folder) {
            faults.push(format!("{path}: `{folder}` is not a room of the table"));
            continue;
        }
        let text = without_comments(text);
        for (at, segments) in paths_after(&text, "#import bevy_restir::") {
            faults.extend(fault(SHADERS, &place(path, &text, at), folder, room_of(SHADERS, &segments)));
        }
    }
    faults.dedup();
    faults
}

/// Files with this ending below a folder of the repository: (path relative to the folder, text).
fn files(folder: &str, ending: &str) -> Vec<(String, String)> {
    fn walk(root: &Path, folder: &Path, ending: &str, found: &mut Vec<(String, String)>) {
        for entry in fs::read_dir(folder).expect("the folder can be read").flatten() {
            let path = entry.path();
            if path.is_dir() {
                walk(root, &path, ending, found);
            } else if path.extension().is_some_and(|e| e == ending) {
                let name = path.strip_prefix(root).expect("the file is below the root").to_string_lossy();
                found.push((name.replace('\\', "/"), fs::read_to_string(&path).expect("the file can be read")));
            }
        }
    }
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(folder);
    let mut found = Vec::new();
    walk(&root, &root, ending, &mut found);
    found.sort();
    assert!(found.len() > 5, "only {} files below {folder}", found.len());
    found
}

fn borrowed(files: &[(String, String)]) -> impl Iterator<Item = (&str, &str)> {
    files.iter().map(|(path, text)| (path.as_str(), text.as_str()))
}

#[test]
fn rust_rooms_import_only_rooms_below_them() {
    let files = files("src", "rs");
    let faults = rust_faults(borrowed(&files));
    assert!(faults.is_empty(), "{} imports below src/:\n{}", faults.len(), faults.join("\n"));
}

#[test]
fn shader_rooms_import_only_rooms_below_them() {
    let files = files("shaders", "wgsl");
    let faults = shader_faults(borrowed(&files));
    assert!(faults.is_empty(), "{} imports below shaders/:\n{}", faults.len(), faults.join("\n"));
}

#[test]
fn the_tables_of_rooms_have_no_cycles() {
    for table in [RUST, SHADERS] {
        for (room, below) in table {
            assert!(!is_below(table, room, room), "`{room}` is below itself");
            for name in *below {
                assert!(table.iter().any(|(known, _)| known == name), "`{room}` names `{name}`, which is no room");
            }
        }
    }
    const CYCLE: Table = &[("a", &["b"]), ("b", &["c"]), ("c", &["a"])];
    assert!(is_below(CYCLE, "a", "a"), "a planted cycle is found");
}

#[test]
fn a_planted_import_of_a_higher_room_is_found() {
    let rust: [(&str, &str, &[usize]); 9] = [
        ("scene/mod.rs", "use crate::view::View;\n", &[1]),
        (
            "scene/light/mod.rs",
            "use crate::{\n    gpu_layout::*,\n    settings::{A, B as C},\n    frame::D,\n};\n",
            &[4],
        ),
        ("scene/light/sun.rs", "\nfn f() {\n    crate::report::g();\n}\n", &[3]),
        ("scene/light/sun.rs", "use super::super::super::view::View;\nuse super::super::bindings::A;\n", &[1]),
        ("report.rs", "use super::plugin::P;\n", &[1]),
        ("view/mod.rs", "use crate::{Restir, scene::A};\n", &[1]),
        ("view/mod.rs", "use crate::unheard_of::A;\n", &[1]),
        ("view/mod.rs", "// crate::frame::A\nuse crate::scene::A; // not crate::frame\npub(crate) struct S;\n", &[]),
        ("view/mod.rs", "use super::scene::A;\n#[cfg(test)]\nmod tests {\n    use crate::frame::A;\n}\n", &[]),
    ];
    for (path, text, expected) in rust {
        let faults = rust_faults([(path, text)]);
        let lines: Vec<String> = expected.iter().map(|line| format!("{path}:{line}: ")).collect();
        let is_found = lines.len() == faults.len() && faults.iter().zip(&lines).all(|(f, l)| f.starts_with(l.as_str()));
        assert!(is_found, "{text}: found {faults:?} and not {lines:?}");
    }
    let shaders: [(&str, &str, &[usize]); 6] = [
        ("path/nee.wgsl", "#define_import_path bevy_restir::path::nee\n\n#import bevy_restir::restir::mis::f\n", &[3]),
        ("restir/mis.wgsl", "#import bevy_restir::restir::{types::A, shift::hybrid::{b, c}}\n", &[1]),
        ("restir/di/sample.wgsl", "#import bevy_restir::restir::gi::sample::f\n", &[1]),
        ("light/sun.wgsl", "#import bevy_restir::{\n    common::math::f,\n    path::walk as w,\n}\n", &[3]),
        (
            "pass/reuse.wgsl",
            "#import bevy_restir::restir::di::sample as domain\n// #import bevy_restir::nothing\n",
            &[],
        ),
        ("restir/shift/hybrid.wgsl", "#import bevy_restir::restir::types::A\n#import bevy_restir::path::nee::f\n", &[]),
    ];
    for (path, text, expected) in shaders {
        let faults = shader_faults([(path, text)]);
        let lines: Vec<String> = expected.iter().map(|line| format!("{path}:{line}: ")).collect();
        let is_found = lines.len() == faults.len() && faults.iter().zip(&lines).all(|(f, l)| f.starts_with(l.as_str()));
        assert!(is_found, "{text}: found {faults:?} and not {lines:?}");
    }
    assert_eq!(shader_faults([("caustic/map.wgsl", "")]).len(), 1, "a folder that is not in the table");
    assert_eq!(rust_faults([("caustic.rs", "")]).len(), 1, "a file that is not in the table");
}
