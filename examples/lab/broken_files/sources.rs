//! The files of which broken copies are made.

use bevy_restir_support::{files::create_folder, scenes::Random};
use serde_json::{Value, json};
use std::{
    collections::BTreeSet,
    fs,
    path::{Component, Path, PathBuf},
};

use super::{
    glb::{self, Glb},
    mutation,
};

/// A file that can be broken.
struct Model {
    name: String,
    glb: Glb,
    /// Files with its images and buffers: their paths from the file, and where they are.
    parts: Vec<(PathBuf, PathBuf)>,
}

/// A file to load.
pub struct FileCopy {
    /// Which file it is, and how it was broken, for messages.
    pub name: String,
    pub path: PathBuf,
    /// It was written for this run.
    pub is_ours: bool,
}

pub struct Sources {
    /// Files that are loaded as they are, before the broken copies.
    unchanged: Vec<PathBuf>,
    models: Vec<Model>,
    /// Folders of the models that refer to other files, by the numbers of the models.
    own_folders: BTreeSet<usize>,
}

impl Sources {
    /// The scenes of the project and a small file with a bit of everything, which is chosen as often as all others.
    pub fn of_project() -> Result<Self, String> {
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes");
        let paths = gltf_files(&scenes, false)?;
        let mut sources = Self::of_files(&paths)?;
        // It breaks in more ways.
        let rich = || Model { name: "a small file".into(), glb: glb::rich(), parts: Vec::new() };
        sources.models.extend(paths.iter().map(|_| rich()));
        Ok(sources)
    }

    /// These files.  Each must be readable.
    pub fn of_files(paths: &[PathBuf]) -> Result<Self, String> {
        let models = paths.iter().map(|path| Model::read(path)).collect::<Result<Vec<_>, String>>()?;
        Ok(Self { unchanged: Vec::new(), models, own_folders: BTreeSet::new() })
    }

    /// All glTF files of a folder and of those in it, which are also loaded as they are.  Those that cannot be read have no broken copies.
    pub fn of_folder(folder: &Path) -> Result<Self, String> {
        let folder = folder.canonicalize().map_err(|e| format!("{}: {e}", folder.display()))?;
        let unchanged = gltf_files(&folder, true)?;
        if unchanged.is_empty() {
            return Err(format!("{}: it has neither .glb nor .gltf files", folder.display()));
        }
        let models = unchanged.iter().filter_map(|path| Model::read(path).ok()).collect();
        Ok(Self { unchanged, models, own_folders: BTreeSet::new() })
    }

    /// The file of a number, counted from 1: an unchanged file, or else a broken copy, which is written to the folder.
    pub fn copy(&mut self, number: u64, folder: &Path) -> Result<FileCopy, String> {
        let unchanged = number.checked_sub(1).and_then(|index| self.unchanged.get(usize::try_from(index).ok()?));
        if let Some(path) = unchanged {
            return Ok(FileCopy { name: format!("{}, unchanged", path.display()), path: path.clone(), is_ours: false });
        }
        let mut random = Random::new(number);
        if self.models.is_empty() {
            return Err("no file can be read, so that there is nothing to break".into());
        }
        let index = random.below(self.models.len());
        let (changes, bytes) = mutation::mutant(&self.models[index].glb, &mut random);
        let path = self.place_of(index, folder)?.join(format!("broken-{number}.glb"));
        fs::write(&path, bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(FileCopy { name: format!("{} ({changes})", self.models[index].name), path, is_ours: true })
    }

    /// The folder for copies of a model.  It has the files that the model refers to.
    fn place_of(&mut self, index: usize, folder: &Path) -> Result<PathBuf, String> {
        let model = &self.models[index];
        if model.parts.is_empty() {
            return Ok(folder.into());
        }
        let folder = own_folder(folder, index);
        if self.own_folders.insert(index) {
            for (to, from) in &model.parts {
                let to = folder.join(to);
                create_folder(to.parent().unwrap_or(&folder))?;
                fs::copy(from, &to).map_err(|e| format!("{}: {e}", from.display()))?;
            }
        }
        Ok(folder)
    }

    /// Removes the folders of models that have no copies any more.
    pub fn clean_up(&self, folder: &Path) {
        for index in &self.own_folders {
            let folder = own_folder(folder, *index);
            let is_copy = |name: &str| name.starts_with("broken-");
            let has_copies = fs::read_dir(&folder)
                .is_ok_and(|entries| entries.flatten().any(|entry| entry.file_name().to_str().is_some_and(is_copy)));
            if !has_copies {
                let _ = fs::remove_dir_all(&folder);
            }
        }
    }
}

/// The folder for copies of a model that refers to other files.
fn own_folder(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("model-{index}"))
}

impl Model {
    fn read(path: &Path) -> Result<Self, String> {
        let with_path = |error: String| format!("{}: {error}", path.display());
        let bytes = fs::read(path).map_err(|error| with_path(error.to_string()))?;
        let mut glb = match has_ending(path, "gltf") {
            true => {
                let json = serde_json::from_slice(&bytes).map_err(|error| with_path(error.to_string()))?;
                Glb { json, bytes: Vec::new() }
            }
            false => Glb::read(&bytes).map_err(with_path)?,
        };
        let folder = path.parent().unwrap_or(path);
        take_buffer_in(&mut glb, folder);
        let parts = parts(&glb.json, folder);
        Ok(Self { name: path.display().to_string(), glb, parts })
    }
}

/// The glTF files of a folder, in the order of their paths.  `deep`: also those of the folders in it.
fn gltf_files(folder: &Path, deep: bool) -> Result<Vec<PathBuf>, String> {
    let entries = fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut files = Vec::new();
    for entry in entries.flatten() {
        let path = entry.path();
        // Links to folders are not followed, because they may form circles.
        if deep && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            files.extend(gltf_files(&path, deep)?);
        } else if ["glb", "gltf"].iter().any(|ending| has_ending(&path, ending)) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending))
}

/// Takes the data of the only buffer out of their file into the glTF file, so that they can be broken, too.
fn take_buffer_in(glb: &mut Glb, folder: &Path) {
    let Some([buffer]) = glb.json.get_mut("buffers").and_then(Value::as_array_mut).map(Vec::as_mut_slice) else {
        return;
    };
    let file = buffer["uri"].as_str().and_then(relative).map(|part| folder.join(part));
    if let Some(bytes) = file.and_then(|file| fs::read(file).ok())
        && glb.bytes.is_empty()
    {
        *buffer = json!({"byteLength": bytes.len()});
        glb.bytes = bytes;
    }
}

/// The files with the buffers and images of a glTF file: their paths from the file, and where they are.
fn parts(gltf: &Value, folder: &Path) -> Vec<(PathBuf, PathBuf)> {
    let entries = ["buffers", "images"].into_iter().filter_map(|kind| gltf[kind].as_array()).flatten();
    let named = entries.filter_map(|entry| relative(entry["uri"].as_str()?));
    named.map(|part| (part.clone(), folder.join(part))).filter(|(_, file)| file.is_file()).collect()
}

/// The path of a URI that leads to a file in the same folder or below it.
fn relative(uri: &str) -> Option<PathBuf> {
    // A space in the name of a file is %20 in a URI.
    let path = PathBuf::from(uri.replace("%20", " "));
    let is_below = path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    (!uri.starts_with("data:") && is_below && !uri.is_empty()).then_some(path)
}
