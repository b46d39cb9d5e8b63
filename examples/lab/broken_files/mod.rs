//! Broken copies of glTF files: each must give an error or a picture.

mod by_render;
pub mod glb;
mod images;
mod in_app;
mod mutation;
mod sources;

use bevy::math::UVec2;
use bevy_restir::{Preset, Restir, Technique};
use bevy_restir_support::{arguments, files::create_folder, progress::Progress, scene};
use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::soundness::{FAULT, Watchdog};
use sources::Sources;

/// Radiance of the sky in which files are shown.
const LIGHT: f32 = 0.3;
/// Bounces of the pictures.
const BOUNCES: u32 = 3;

/// Loads broken copies of glTF files: bits that flip, ends that are cut off, changes of the JSON, such as accessors beyond their data,
/// cyclic nodes, unknown extensions, numbers without a meaning, and images without size or of another type than stated. Each must give an
/// error or a finite picture; a panic, an error of the renderer, a hang or a number that the shaders should never meet fails. Copies that
/// fail are kept in the folder.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; without any, the scenes of the project and a small file with a bit of everything.
    files: Vec<PathBuf>,
    /// A folder whose glTF files, with those of the folders in it, take the place of FILES. The first copies are these files themselves,
    /// unchanged and in the order of their paths; those after them are broken.
    #[arg(long, value_name = "DIR", conflicts_with = "files")]
    folder: Option<PathBuf>,
    /// Number of copies.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,
    /// Number of the first copy; the others follow it.  `--seed N --count 1` repeats copy N.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// What loads the copies. `app`: an app of this program, which checks guards, too. `render`: the program `render`, in a process of its
    /// own for each copy, which must end with a finite picture or one line of error. `nothing`: the copies are kept for other programs.
    #[arg(long, value_enum, default_value = "app")]
    loader: LoaderKind,
    /// The technique that renders.
    #[arg(long, default_value = "reference", value_parser = arguments::choice::<Technique>())]
    technique: Technique,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "16x16", value_parser = arguments::size)]
    size: UVec2,
    /// Folder of the copies that fail.
    #[arg(long, default_value = "target/lab/broken-files")]
    out: PathBuf,
    /// Keeps all copies, for other programs.
    #[arg(long)]
    keep: bool,
    /// Prints a line for each copy.
    #[arg(long)]
    list: bool,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
enum LoaderKind {
    App,
    Render,
    Nothing,
}

impl Args {
    /// The command that repeats a copy.
    fn command(&self, seed: u64) -> String {
        let mut text = "lab broken-files".to_owned();
        for file in &self.files {
            text += &format!(" {}", file.display());
        }
        if let Some(folder) = &self.folder {
            text += &format!(" --folder {}", folder.display());
        }
        if self.loader != LoaderKind::App {
            text += &format!(" --loader {:?}", self.loader).to_lowercase();
        }
        let technique = format!("{:?}", self.technique).to_lowercase();
        let UVec2 { x, y } = self.size;
        text + &format!(" --count 1 --seed {seed} --technique {technique} --size {x}x{y}")
    }

    fn sources(&self) -> Result<Sources, String> {
        match &self.folder {
            Some(folder) => Sources::of_folder(folder),
            None if self.files.is_empty() => Sources::of_project(),
            None => Sources::of_files(&self.files),
        }
    }
}

/// How files are shown.
#[derive(Clone, Copy)]
pub struct Subject {
    technique: Technique,
    size: UVec2,
}

impl Subject {
    fn settings(self) -> Restir {
        Restir { technique: self.technique, bounces: BOUNCES, ..Restir::preset(Preset::Performance) }
    }
}

/// What loads the copies.
enum Loader {
    App(Box<in_app::Stage>),
    Render(by_render::Render),
    Nothing,
}

impl Loader {
    fn new(args: &Args, folder: &Path) -> Result<Self, String> {
        let subject = Subject { technique: args.technique, size: args.size };
        Ok(match args.loader {
            LoaderKind::App => Self::App(Box::new(in_app::Stage::new(folder, subject))),
            LoaderKind::Render => Self::Render(by_render::Render::new(folder, subject)?),
            LoaderKind::Nothing => Self::Nothing,
        })
    }

    /// Loads a file; `None` if nothing loads files.
    fn load(&mut self, path: &Path) -> Result<Option<Outcome>, String> {
        match self {
            Self::App(stage) => stage.load(path).map(Some),
            Self::Render(render) => render.load(path).map(Some),
            Self::Nothing => Ok(None),
        }
    }
}

/// What has become of a file.
pub enum Outcome {
    Picture,
    Error(String),
    Fault(String),
}

impl Outcome {
    /// A picture, unless a pixel is no light.
    fn of_picture(pixels: impl Iterator<Item = [f32; 3]>) -> Self {
        match pixels.flatten().find(|channel| !channel.is_finite() || *channel < 0.0) {
            Some(channel) => Self::Fault(format!("a pixel is {channel}")),
            None => Self::Picture,
        }
    }

    /// An error of the file.  A panic in our own code is a fault, and so is a loader that does not end.
    fn of_error(error: String) -> Self {
        // Only files of the workspace have relative paths in the messages of panics.
        let is_ours = ["panicked at src/", "panicked at examples/"].iter().any(|own| error.contains(own));
        match is_ours || error.contains(scene::NOT_LOADED) {
            true => Self::Fault(error),
            false => Self::Error(error),
        }
    }
}

pub fn run(args: &Args) -> Result<(), String> {
    let mut sources = args.sources()?;
    create_folder(&args.out)?;
    let folder = args.out.canonicalize().map_err(|e| format!("{}: {e}", args.out.display()))?;
    let mut loader = Loader::new(args, &folder)?;
    let watchdog = Watchdog::new();
    let progress = Progress::new(args.count.into());
    let (mut failed, mut shown) = (0, 0);
    for seed in (args.seed..).take(args.count as usize) {
        let copy = sources.copy(seed, &folder)?;
        watchdog.watch(copy.path.display().to_string());
        let outcome = loader.load(&copy.path)?;
        progress.step();
        let line = match &outcome {
            Some(Outcome::Fault(fault)) => {
                failed += 1;
                println!("{FAULT}copy {seed} of {}: {fault}; it is repeated by: {}", copy.name, args.command(seed));
                continue;
            }
            Some(Outcome::Picture) => {
                shown += 1;
                "a picture"
            }
            Some(Outcome::Error(error)) => error.lines().next().unwrap_or_default(),
            None => "not loaded",
        };
        if args.list {
            println!("copy {seed} of {}: {line}", copy.name);
        }
        if copy.is_ours && !args.keep && outcome.is_some() {
            let _ = fs::remove_file(&copy.path);
        }
    }
    sources.clean_up(&folder);
    if failed > 0 {
        return Err(format!("{failed} of {} copies fail; {} has them", args.count, args.out.display()));
    }
    match args.loader {
        LoaderKind::Nothing => println!("{} copies are in {}", args.count, args.out.display()),
        _ => println!("{} copies, none fails: {shown} pictures, {} errors", args.count, args.count - shown),
    }
    Ok(())
}
