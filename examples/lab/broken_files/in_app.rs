//! Loads copies in an app of this program, one after the other.

use bevy::prelude::*;
use bevy_restir::{RayBackend, Restir, RestirEnvironment, RestirStatistics};
use bevy_restir_support::{
    exposure::unit_exposure,
    headless::{self, captured, frame},
    panics,
    scene::{self, CameraSetup, View},
};
use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use super::{LIGHT, Outcome, Subject};
use crate::{soundness, things::spawn_everything};

/// A file must be loaded, built and shown within this time.
const PATIENCE: Duration = Duration::from_secs(120);

/// An app with a camera that stays while files come and go.
pub struct Stage {
    app: Option<App>,
    /// The folder of the copies.
    folder: PathBuf,
    subject: Subject,
}

impl Stage {
    pub fn new(folder: &Path, subject: Subject) -> Self {
        Self { app: None, folder: folder.into(), subject }
    }

    /// Loads a file and renders it; an error if no app can be created.
    pub fn load(&mut self, path: &Path) -> Result<Outcome, String> {
        let mut app = match self.app.take() {
            Some(app) => app,
            None => app_with_camera(&self.folder, self.subject)?,
        };
        // A path from the app's folder where it lies there.
        let name = path.strip_prefix(&self.folder).unwrap_or(path).to_string_lossy().into_owned();
        let size = self.subject.size;
        Ok(match panics::caught(|| (outcome(&mut app, &name, size), app)) {
            Ok((outcome, app)) => {
                // An app whose renderer failed cannot go on.
                self.app = headless::alive(&app).is_ok().then_some(app);
                outcome
            }
            Err(panic) => Outcome::Fault(panic),
        })
    }
}

fn app_with_camera(folder: &Path, subject: Subject) -> Result<App, String> {
    let mut app = headless::app(folder, RayBackend::Auto)?;
    let environment = Some(RestirEnvironment { color: LinearRgba::rgb(LIGHT, LIGHT, LIGHT), ..default() });
    let settings = subject.settings();
    let setup = CameraSetup { size: subject.size, exposure: unit_exposure(), environment, settings };
    scene::spawn_camera(app.world_mut(), (Transform::default(), Projection::default()), setup);
    spawn_everything(app.world_mut());
    Ok(app)
}

fn outcome(app: &mut App, name: &str, size: UVec2) -> Outcome {
    let result = shown(app, name, size);
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

fn shown(app: &mut App, name: &str, size: UVec2) -> Outcome {
    app.world().resource::<RestirStatistics>().reset_guards();
    // A panic of a loader is an error of the file, as in `render`.
    let camera = scene::load(app, name).and_then(|()| scene::file_camera(app.world_mut(), None, size));
    let (transform, projection) = match camera {
        Ok(camera) => camera.place,
        Err(error) => return Outcome::of_error(error),
    };
    scene::remove_file_cameras(app.world_mut());
    let camera = app.world().resource::<View>().camera;
    let mut settings = app.world().get::<Restir>(camera).cloned().unwrap_or_default();
    settings.reset = true;
    app.world_mut().entity_mut(camera).insert((transform, projection, settings));
    frame(app);
    let start = Instant::now();
    loop {
        frame(app);
        let report = app.world().resource::<RestirStatistics>().report();
        if report.ready && report.samples > 0 {
            break;
        }
        if start.elapsed() > PATIENCE {
            return Outcome::Fault(format!("the file is not shown after {} s", PATIENCE.as_secs()));
        }
    }
    frame(app);
    app.world().resource::<View>().capture.request();
    frame(app);
    let picture = match captured(app) {
        Ok(picture) => picture,
        Err(error) => return Outcome::Fault(error),
    };
    if let Outcome::Fault(fault) = Outcome::of_picture(picture.mean()) {
        return Outcome::Fault(fault);
    }
    (0..2).for_each(|_| _ = frame(app));
    if let Some(panic) = panics::take() {
        return Outcome::Fault(panic);
    }
    soundness::fault(&app.world().resource::<RestirStatistics>().report()).map_or(Outcome::Picture, Outcome::Fault)
}
