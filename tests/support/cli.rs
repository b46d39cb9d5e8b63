//! Calls the examples `render` and `lab`, which `cargo build --examples` makes, in a folder of its own, and reads what they wrote.

use exr::prelude::{ReadChannels, ReadLayers, read};
use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// What a call left behind.
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

    /// With this code and exactly one line.
    pub fn failed(&self, code: i32, what: &str) {
        assert_eq!(self.code, code, "{what}: {self:?}");
        assert!(self.stderr.starts_with("error: "), "{what}: {}", self.stderr);
        assert_eq!(self.stderr.trim_end().lines().count(), 1, "{what}: one line: {}", self.stderr);
    }
}

/// A scene of `assets/scenes`.
pub fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes").join(name)
}

/// A program beside the tests.
fn program(name: &str) -> PathBuf {
    let tests = std::env::current_exe().expect("this program is a file");
    let program = tests.parent().and_then(Path::parent).expect("tests lie in deps").join("examples").join(name);
    let program = program.with_extension(std::env::consts::EXE_EXTENSION);
    assert!(program.is_file(), "{} is missing: run `cargo build --examples` first", program.display());
    program
}

/// An empty folder that goes when it is dropped.
pub struct Folder(PathBuf);

impl Folder {
    /// `None`, with a message, where there is no adapter; under `CI=true` that fails.
    pub fn new(name: &str) -> Option<Self> {
        super::gpu::gpu()?;
        Some(Self::without_gpu(name))
    }

    /// For what needs no adapter.
    pub fn without_gpu(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("bevy_restir_{}_{name}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).expect("the temporary folder can be written");
        Self(path)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes a scene.
    pub fn gltf(&self, name: &str, scene: &super::gltf::Scene) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, scene.json()).expect("the folder can be written");
        path
    }

    /// Names of all that lies in it, sorted.
    pub fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).expect("the folder is there");
        let mut names: Vec<_> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        names.sort_unstable();
        names
    }

    /// Calls `render` from within the folder.
    pub fn render(&self, scene: &Path, arguments: &[&str]) -> Run {
        self.call("render", [scene.as_os_str()].into_iter().chain(arguments.iter().map(OsStr::new)))
    }

    /// Calls `lab` from within the folder.
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
            code: output.status.code().expect("it ends by itself"),
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

/// A picture in 32-bit floats.
pub struct Exr {
    pub width: usize,
    pub height: usize,
    /// Names of the channels, all of 32-bit floats, as the file has them.
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
                other => panic!("{}: {} is no 32-bit float: {other:?}", path.display(), channel.name),
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
