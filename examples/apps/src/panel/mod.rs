//! The panel on the right of the picture: the sections of the program, then the settings that all programs share.

pub mod cost;
pub mod docs;
pub mod form;
pub mod keys;
mod sections;

use bevy::{
    anti_alias::taa::TemporalAntiAliasing,
    camera::{CameraOutputMode, Viewport, visibility::RenderLayers},
    ecs::system::SystemId,
    prelude::*,
    render::render_resource::BlendState,
    window::PrimaryWindow,
};
use bevy_egui::{EguiContext, EguiGlobalSettings, EguiPrimaryContextPass, PrimaryEguiContext, egui};
use bevy_restir::{Restir, RestirStatistics};

/// Width at first and at least, in logical pixels.
const WIDTH: f32 = 310.0;
const LEAST: f32 = 220.0;

/// State of the panel.
#[derive(Resource)]
pub struct Panel {
    pub visible: bool,
    /// Width in the last frame, in logical pixels.
    width: f32,
    /// Help text: the keys of the program.
    keys: String,
}

impl Panel {
    /// A visible panel; `keys` describes the keys of the program itself.
    pub fn new(keys: &str) -> Self {
        Self { visible: true, width: WIDTH, keys: keys.into() }
    }
}

/// A section is a system that draws into the panel.
type Section = SystemId<InMut<'static, egui::Ui>>;

/// The sections from top to bottom: those of the program and those that all programs share.
#[derive(Resource, Default)]
struct Sections {
    own: Vec<Section>,
    shared: Vec<Section>,
}

/// Adds sections to the panel.
pub trait AddSection {
    /// Adds a section below those of the program that were added before.
    fn add_section<M>(&mut self, section: impl IntoSystem<InMut<'static, egui::Ui>, (), M> + 'static) -> &mut Self;
}

impl AddSection for App {
    fn add_section<M>(&mut self, section: impl IntoSystem<InMut<'static, egui::Ui>, (), M> + 'static) -> &mut Self {
        let section = self.world_mut().register_system(section);
        self.init_resource::<Sections>();
        self.world_mut().resource_mut::<Sections>().own.push(section);
        self
    }
}

pub fn plugin(app: &mut App) {
    let world = app.world_mut();
    world.get_resource_or_init::<RestirStatistics>().count_rays(true);
    let shared = vec![
        world.register_system(sections::picture),
        world.register_system(sections::settings),
        world.register_system(sections::environment),
        world.register_system(cost::section),
    ];
    app.init_resource::<Sections>().init_resource::<docs::Docs>();
    app.world_mut().resource_mut::<Sections>().shared = shared;
    app.add_systems(Startup, spawn_overlay)
        .add_systems(EguiPrimaryContextPass, show)
        .add_systems(Update, (keys::act, leave_room));
}

/// The panel has a camera of its own that draws over the whole window.
fn spawn_overlay(mut commands: Commands, mut egui: ResMut<EguiGlobalSettings>) {
    egui.auto_create_primary_context = false;
    let blend_state = Some(BlendState::ALPHA_BLENDING);
    commands.spawn((
        PrimaryEguiContext,
        Camera2d,
        RenderLayers::none(),
        Camera {
            order: 1,
            output_mode: CameraOutputMode::Write { blend_state, clear_color: ClearColorConfig::None },
            clear_color: ClearColorConfig::Custom(Color::NONE),
            ..default()
        },
    ));
}

fn show(world: &mut World) {
    if !world.resource::<Panel>().visible {
        world.resource_mut::<Panel>().width = 0.0;
        return;
    }
    let mut contexts = world.query_filtered::<&mut EguiContext, With<PrimaryEguiContext>>();
    let Ok(context) = contexts.single_mut(world).map(|mut context| context.get_mut().clone()) else { return };
    let sections = world.resource::<Sections>();
    let sections: Vec<Section> = sections.own.iter().chain(&sections.shared).copied().collect();
    let keys = format!("{}\n{}", world.resource::<Panel>().keys, keys::HELP);

    let whole = egui::UiBuilder::new().layer_id(egui::LayerId::background()).max_rect(context.viewport_rect());
    let mut ui = egui::Ui::new(context, "panel".into(), whole);
    let side = egui::Panel::right("side").default_size(WIDTH).min_size(LEAST);
    let drawn = side.show(&mut ui, |ui| {
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            // Leaves room for the scroll bar.
            ui.set_max_width(ui.available_width() - 12.0);
            for section in sections {
                if let Err(error) = world.run_system_with(section, &mut *ui) {
                    ui.label(error.to_string());
                }
            }
            ui.add_space(4.0);
            ui.weak(keys.trim());
        });
    });
    world.resource_mut::<Panel>().width = drawn.response.rect.width();
}

/// A group of widgets that can be folded.
pub fn group(ui: &mut egui::Ui, name: &str, open: bool, inside: impl FnOnce(&mut egui::Ui)) {
    egui::CollapsingHeader::new(egui::RichText::new(name).strong()).default_open(open).show(ui, inside);
}

/// Gives the picture the part of the window beside the panel, or the whole window under temporal anti-aliasing, because Bevy's does not
/// support viewports (bevyengine/bevy#16290).
fn leave_room(
    panel: Res<Panel>,
    windows: Query<&Window, With<PrimaryWindow>>,
    mut cameras: Query<(&mut Camera, Has<TemporalAntiAliasing>), With<Restir>>,
) {
    let Ok(window) = windows.single() else { return };
    let size = window.physical_size();
    if size.x == 0 || size.y == 0 {
        return;
    }
    let taken = (panel.width * window.scale_factor()).round() as u32;
    for (mut camera, fills) in &mut cameras {
        let taken = if fills { 0 } else { taken };
        let physical_size = UVec2::new(size.x.saturating_sub(taken).max(1), size.y);
        if camera.viewport.as_ref().is_none_or(|viewport| viewport.physical_size != physical_size) {
            camera.viewport = Some(Viewport { physical_size, ..default() });
        }
    }
}
