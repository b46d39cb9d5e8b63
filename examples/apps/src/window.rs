//! An app with a window, the plugin and the panel.

use bevy::{
    asset::UnapprovedPathMode, diagnostic::FrameTimeDiagnosticsPlugin, prelude::*,
    render::diagnostic::RenderDiagnosticsPlugin, window::PresentMode,
};
use bevy_egui::EguiPlugin;
use bevy_restir::prelude::*;

use crate::{look, panel};

/// An app that shows the cameras with `Restir` beside the panel. `keys` describes the keys of the program itself.
pub fn app(title: &str, size: UVec2, keys: &str, backend: RayBackend) -> App {
    let window = Window {
        title: format!("bevy_restir: {title}"),
        resolution: size.into(),
        // Frames as fast as possible, since the panel shows their time.
        present_mode: PresentMode::AutoNoVsync,
        ..default()
    };
    let mut app = App::new();
    app.add_plugins((
        DefaultPlugins
            .set(WindowPlugin { primary_window: Some(window), ..default() })
            // The user may open files outside of the asset folder.
            .set(AssetPlugin { unapproved_path_mode: UnapprovedPathMode::Allow, ..default() }),
        RestirPlugin { backend },
        FrameTimeDiagnosticsPlugin::default(),
        RenderDiagnosticsPlugin,
        EguiPlugin::default(),
    ))
    .insert_resource(ClearColor(Color::BLACK))
    .insert_resource(panel::Panel::new(keys))
    .add_plugins((panel::plugin, look::plugin));
    app
}
