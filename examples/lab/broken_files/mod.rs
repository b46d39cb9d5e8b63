//! Broken copies of glTF files: each must give an error or a picture.

pub mod glb;
mod mutation;

use bevy::prelude::*;
use bevy_restir::{Preset, RayBackend, Restir, RestirEnvironment, RestirStatistics, Technique};
use bevy_restir_support::{
    arguments,
    exposure::unit_exposure,
    files::create_folder,
    headless::{self, captured, frame},
    panics,
    progress::Progress,
    scene::{self, CameraSetup, View},
    scenes::Random,
};
use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    soundness::{self, FAULT, Watchdog},
    things::spawn_everything,
};
use glb::Glb;

/// Frames in which a file must be loaded, built and shown.
const PATIENCE: u32 = 300;

/// Loads broken copies of glTF files: bits that flip, ends that are cut off, and changes of the JSON, such as accessors beyond their data,
/// cyclic nodes, unknown extensions, numbers without a meaning. Each must give an error or a finite picture; a panic, an error of the
/// renderer, a hang or a number that the shaders should never meet fails. Copies that fail are kept in the folder.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Binary glTF files; without any, the scenes of the project and a small file with a bit of everything.
    files: Vec<PathBuf>,
    /// Number of copies.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,
    /// Number of the first copy; the others follow it.  `--seed N --count 1` repeats copy N.
    #[arg(long, default_value_t = 1)]
    seed: u64,
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

impl Args {
    /// The command that repeats a copy.
    fn command(&self, seed: u64) -> String {
        let files: String = self.files.iter().map(|file| format!(" {}", file.display())).collect();
        let technique = format!("{:?}", self.technique).to_lowercase();
        let UVec2 { x, y } = self.size;
        format!("lab broken-files{files} --count 1 --seed {seed} --technique {technique} --size {x}x{y}")
    }
}

pub fn run(args: &Args) -> Result<(), String> {
    let files = sources(args)?;
    create_folder(&args.out)?;
    let folder = args.out.canonicalize().map_err(|e| format!("{}: {e}", args.out.display()))?;
    let watchdog = Watchdog::new();
    let progress = Progress::new(args.count.into());
    let (mut app, mut failed, mut shown) = (None, 0, 0);
    for seed in (args.seed..).take(args.count as usize) {
        let mut random = Random::new(seed);
        let (name, sound) = &files[random.below(files.len())];
        let (changes, bytes) = mutation::mutant(sound, &mut random);
        let path = folder.join(format!("broken-{seed}.glb"));
        fs::write(&path, bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        watchdog.watch(path.display().to_string());
        let mut current = match app.take() {
            Some(app) => app,
            None => stage(&folder, args)?,
        };
        let tried = panics::caught(|| (outcome(&mut current, &path, args.size), current));
        let result = tried.map(|(outcome, current)| {
            // An app whose renderer failed cannot go on.
            app = headless::alive(&current).is_ok().then_some(current);
            outcome
        });
        match result {
            Ok(Outcome::Picture) => {
                shown += 1;
                if args.list {
                    println!("copy {seed} of {name} ({changes}): a picture");
                }
            }
            Ok(Outcome::Error(error)) => {
                if args.list {
                    println!("copy {seed} of {name} ({changes}): {}", error.lines().next().unwrap_or_default());
                }
            }
            Ok(Outcome::Fault(fault)) | Err(fault) => {
                failed += 1;
                println!(
                    "{FAULT}copy {seed} of {name} ({changes}): {fault}; it is repeated by: {}",
                    args.command(seed)
                );
                progress.step();
                continue;
            }
        }
        if !args.keep {
            let _ = fs::remove_file(&path);
        }
        progress.step();
    }
    if failed > 0 {
        return Err(format!("{failed} of {} copies fail; {} has them", args.count, args.out.display()));
    }
    println!("{} copies, none fails: {shown} pictures, {} errors", args.count, args.count - shown);
    Ok(())
}

/// The valid files, of which broken copies are made.
fn sources(args: &Args) -> Result<Vec<(String, Glb)>, String> {
    let mut paths = args.files.clone();
    if paths.is_empty() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes");
        let entries = fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        paths.extend(
            entries.flatten().map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "glb")),
        );
        paths.sort();
    }
    let read = |path: &PathBuf| {
        let with_path = |error: String| format!("{}: {error}", path.display());
        let bytes = fs::read(path).map_err(|error| with_path(error.to_string()))?;
        Ok((path.display().to_string(), Glb::read(&bytes).map_err(with_path)?))
    };
    let mut files = paths.iter().map(read).collect::<Result<Vec<_>, String>>()?;
    if args.files.is_empty() {
        // It is small and breaks in more ways, so it is chosen as often as all others.
        let rich = ("a small file".to_owned(), glb::rich());
        files.extend(core::iter::repeat_n(rich, files.len()));
    }
    Ok(files)
}

/// An app with a camera that stays while files come and go.
fn stage(folder: &Path, args: &Args) -> Result<App, String> {
    let mut app = headless::app(folder, RayBackend::Auto)?;
    let environment = Some(RestirEnvironment { color: LinearRgba::rgb(0.3, 0.3, 0.3), ..default() });
    let settings = Restir { technique: args.technique, bounces: 3, ..Restir::preset(Preset::Performance) };
    let setup = CameraSetup { size: args.size, exposure: unit_exposure(), environment, settings };
    scene::spawn_camera(app.world_mut(), (Transform::default(), Projection::default()), setup);
    spawn_everything(app.world_mut());
    Ok(app)
}

enum Outcome {
    Picture,
    Error(String),
    Fault(String),
}

/// Loads a file and renders it.
fn outcome(app: &mut App, path: &Path, size: UVec2) -> Outcome {
    let result = shown(app, path, size);
    let alive = headless::alive(app);
    let is_alive = alive.is_ok();
    let result = alive.map_or_else(Outcome::Fault, |()| result);
    scene::unload(app.world_mut());
    if is_alive {
        // Frames in which the file's objects and assets are removed, before the next file is loaded.
        (0..3).for_each(|_| _ = frame(app));
    }
    result
}

fn shown(app: &mut App, path: &Path, size: UVec2) -> Outcome {
    app.world().resource::<RestirStatistics>().reset_guards();
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    // A panic of a loader is an error of the file, as in `render`.
    let camera = scene::load(app, &name).and_then(|()| scene::file_camera(app.world_mut(), None, size));
    let (transform, projection) = match camera {
        Ok(camera) => camera.place,
        // A panic in our own code is a fault, not an error of the file. Only files of the workspace have relative paths in such messages.
        Err(error) if ["panicked at src/", "panicked at examples/"].iter().any(|own| error.contains(own)) => {
            return Outcome::Fault(error);
        }
        Err(error) if error.contains(scene::NOT_LOADED) => return Outcome::Fault(error),
        Err(error) => return Outcome::Error(error),
    };
    scene::remove_file_cameras(app.world_mut());
    let camera = app.world().resource::<View>().camera;
    let mut settings = app.world().get::<Restir>(camera).cloned().unwrap_or_default();
    settings.reset = true;
    app.world_mut().entity_mut(camera).insert((transform, projection, settings));
    frame(app);
    for waited in 0.. {
        frame(app);
        let report = app.world().resource::<RestirStatistics>().report();
        if report.ready && report.samples > 0 {
            break;
        }
        if waited > PATIENCE {
            return Outcome::Fault(format!("the file is not shown after {PATIENCE} frames"));
        }
    }
    frame(app);
    app.world().resource::<View>().capture.request();
    frame(app);
    let picture = match captured(app) {
        Ok(picture) => picture,
        Err(error) => return Outcome::Fault(error),
    };
    if let Some(pixel) = picture.mean().flatten().find(|c| !c.is_finite() || *c < 0.0) {
        return Outcome::Fault(format!("a pixel is {pixel}"));
    }
    (0..2).for_each(|_| _ = frame(app));
    if let Some(panic) = panics::take() {
        return Outcome::Fault(panic);
    }
    soundness::fault(&app.world().resource::<RestirStatistics>().report()).map_or(Outcome::Picture, Outcome::Fault)
}
