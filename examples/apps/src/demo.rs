//! Programs that show one scene: in a window, or as a picture without a window.

use bevy::{camera::Exposure, prelude::*};
use bevy_restir::prelude::*;
use bevy_restir_support::{
    files, headless,
    picture::{screenshot, write_png},
    scene::{self, CameraSetup},
};
use std::path::Path;

use crate::{look::look, window};

/// A scene and the camera that shows it.
pub struct Demo<P> {
    /// Size of the window or the picture in pixels.
    pub size: UVec2,
    /// Place of the camera.
    pub eye: Transform,
    /// Exposure value at ISO 100.
    pub ev100: f32,
    pub environment: RestirEnvironment,
    pub settings: Restir,
    /// Spawns the objects.
    pub populate: P,
}

impl<P: FnOnce(&mut App)> Demo<P> {
    /// The app of a window. `keys` describes the keys of the program itself.
    pub fn window(self, title: &str, keys: &str) -> App {
        let mut app = window::app(title, self.size, keys, RayBackend::Auto);
        let camera = (Camera3d::default(), self.eye, self.settings, self.environment, look(Some(self.ev100)));
        app.world_mut().spawn(camera);
        (self.populate)(&mut app);
        app
    }

    /// Writes a PNG file after some frames. `step` changes the scene before the frame of this number, from 0.
    pub fn picture(self, path: &Path, frames: u32, step: impl FnMut(&mut World, u32)) -> AppExit {
        match self.render(path, frames, step) {
            Ok(()) => AppExit::Success,
            Err(error) => {
                eprintln!("error: {error}");
                AppExit::error()
            }
        }
    }

    /// Renders without a window.
    fn render(self, path: &Path, frames: u32, mut step: impl FnMut(&mut World, u32)) -> Result<(), String> {
        headless::quiet_drivers();
        files::check(path)?;
        let mut app = headless::app(Path::new("."), RayBackend::Auto)?;
        (self.populate)(&mut app);
        let setup = CameraSetup {
            size: self.size,
            exposure: Exposure { ev100: self.ev100 },
            environment: Some(self.environment),
            settings: self.settings,
        };
        scene::spawn_camera(app.world_mut(), (self.eye, Projection::default()), setup);
        headless::until_ready(&mut app)?;
        for frame in 0..frames {
            step(app.world_mut(), frame);
            headless::frame(&mut app);
        }
        write_png(path, screenshot(&mut app)?)
    }
}
