//! Calls the programs `render` and `lab` in a temporary folder and reads the files that they wrote.

use exr::prelude::{ReadChannels, ReadLayers, read};
use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// The outcome of a call.
#[derive(Debug)]
pub struct Run {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Run {
    pub fn succeeded(&self) {
        assert_eq!(self.code, 0, "{self:?}");
    }

    /// Asserts this exit code and exactly one line of error.
    pub fn failed(&self, code: i32, what: &str) {
        assert_eq!(self.code, code, "{what}: {self:?}");
        assert!(self.stderr.starts_with("error: "), "{what}: {}", self.stderr);
        assert_eq!(self.stderr.trim_end().lines().count(), 1, "{what}: one line: {}", self.stderr);
    }
}

/// Arguments for direct light without spatial reuse and denoiser, so that few shaders are compiled.
pub const FEW_PASSES: [&str; 4] = ["--set", "denoiser.iterations=0", "--set", "direct.reuse.spatial_samples=0"];

/// A scene of `assets/scenes`.
pub fn asset(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("assets/scenes").join(name)
}

/// The entry of a scene in `references.json`.
pub fn reference_entry(scene: &str) -> serde_json::Value {
    let text = fs::read_to_string(asset("references.json")).expect("the references are there");
    let mut all: serde_json::Value = serde_json::from_str(&text).expect("the file is JSON");
    all[scene].take()
}

/// A program that was built beside the tests.
fn program(name: &str) -> PathBuf {
    let tests = std::env::current_exe().expect("this program is a file");
    let program = tests.parent().and_then(Path::parent).expect("tests lie in deps").join("examples").join(name);
    let program = program.with_extension(std::env::consts::EXE_EXTENSION);
    assert!(program.is_file(), "{} is missing: run `cargo build --examples` first", program.display());
    program
}

/// An empty folder that is removed when dropped.
pub struct Folder(PathBuf);

impl Folder {
    /// `None`, with a message, if there is no adapter; with `CI=true` that is a failure.
    pub fn new(name: &str) -> Option<Self> {
        super::gpu::gpu()?;
        Some(Self::without_gpu(name))
    }

    /// For programs that need no adapter.
    pub fn without_gpu(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("bevy_restir_{}_{name}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).expect("the temporary folder can be created");
        Self(path)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes a scene as a glTF file.
    pub fn gltf(&self, name: &str, scene: &super::gltf::Scene) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, scene.json()).expect("the folder can be written");
        path
    }

    /// The names of all files in the folder, sorted.
    pub fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).expect("the folder exists");
        let mut names: Vec<_> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        names.sort_unstable();
        names
    }

    /// Calls `render` in the folder.
    pub fn render(&self, scene: &Path, arguments: &[&str]) -> Run {
        self.call("render", [scene.as_os_str()].into_iter().chain(arguments.iter().map(OsStr::new)))
    }

    /// Calls `lab` in the folder.
    pub fn lab(&self, arguments: &[&str]) -> Run {
        self.call("lab", arguments.iter().map(OsStr::new))
    }

    fn call<'a>(&self, name: &str, arguments: impl Iterator<Item = &'a OsStr>) -> Run {
        let output = Command::new(program(name))
            .args(arguments)
            .current_dir(&self.0)
            .stdin(Stdio::null())
            .output()
            .expect("the program starts");
        Run {
            code: output.status.code().expect("the program exits by itself"),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A picture with 32-bit float channels.
pub struct Exr {
    pub width: usize,
    pub height: usize,
    /// The names of the channels, in the order of the file.
    pub channels: Vec<String>,
    pub pixels: Vec<[f32; 3]>,
}

impl Exr {
    pub fn read(path: &Path) -> Self {
        let file = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let layer = file.layer_data;
        let floats: Vec<(String, Vec<f32>)> = layer
            .channel_data
            .list
            .iter()
            .map(|channel| match &channel.sample_data {
                exr::prelude::FlatSamples::F32(samples) => (channel.name.to_string(), samples.clone()),
                other => panic!("{}: {} is not a 32-bit float: {other:?}", path.display(), channel.name),
            })
            .collect();
        let channel = |name: &str| &floats.iter().find(|c| c.0 == name).expect("R, G and B are there").1;
        let (r, g, b) = (channel("R"), channel("G"), channel("B"));
        Self {
            width: layer.size.width(),
            height: layer.size.height(),
            pixels: (0..r.len()).map(|i| [r[i], g[i], b[i]]).collect(),
            channels: floats.into_iter().map(|c| c.0).collect(),
        }
    }

    pub fn at(&self, x: usize, y: usize) -> [f32; 3] {
        self.pixels[y * self.width + x]
    }
}
