//! The text over the picture: the list of settings on the right, the numbers on the left, the keys below.

use bevy::{input::keyboard::KeyboardInput, prelude::*, text::LineHeight};
use bevy_restir::Restir;

use crate::{cost::Numbers, fields};

const FONT: f32 = 13.0;
const LINE: f32 = 16.0;
const KEYS: &str = "Up/Down choose   Left/Right change   Backspace default   1-4 preset   T technique\n\
                    V view   R reset   Space pause   drag, WASD, Q and E fly   C circle   Tab hide";

/// The list and what is chosen in it.
#[derive(Resource)]
pub struct Panel {
    paths: Vec<String>,
    chosen: usize,
    visible: bool,
}

impl Panel {
    pub fn new(visible: bool) -> Self {
        let paths = fields::paths();
        let chosen = paths.iter().position(|path| path.starts_with("direct.")).unwrap_or(0);
        Self { paths, chosen, visible }
    }
}

/// A line of the list, by its place.
#[derive(Component)]
pub struct Row(usize);

/// A part of the panel.
#[derive(Component)]
pub struct Part;

pub fn spawn(mut commands: Commands, panel: Res<Panel>) {
    let font = TextFont { font_size: FontSize::Px(FONT), ..default() };
    let line = LineHeight::Px(LINE);
    let shade = BackgroundColor(Color::srgba(0.0, 0.0, 0.0, 0.8));
    let part = |left: Val, right: Val, top: Val, bottom: Val| Node {
        position_type: PositionType::Absolute,
        flex_direction: FlexDirection::Column,
        padding: UiRect::all(px(6)),
        left,
        right,
        top,
        bottom,
        ..default()
    };
    commands.spawn((Part, Numbers, Text::default(), font.clone(), line, shade, part(px(6), auto(), px(6), auto())));
    commands.spawn((Part, Text::new(KEYS), font.clone(), line, shade, part(px(6), auto(), auto(), px(6))));
    commands.spawn((Part, shade, part(auto(), px(6), px(6), auto()))).with_children(|list| {
        for i in 0..panel.paths.len() {
            list.spawn((Row(i), Text::default(), font.clone(), line, BackgroundColor::default(), Node::default()));
        }
    });
}

/// The keys that work on the list; those that are held act again.
pub fn choose(mut events: MessageReader<KeyboardInput>, mut panel: ResMut<Panel>, mut cameras: Query<&mut Restir>) {
    let defaults = Restir::default();
    // Every press counts, also where several come in one long frame.
    for event in events.read().filter(|event| event.state.is_pressed()) {
        let count = panel.paths.len();
        match event.key_code {
            KeyCode::Tab if !event.repeat => panel.visible = !panel.visible,
            KeyCode::ArrowUp => panel.chosen = (panel.chosen + count - 1) % count,
            KeyCode::ArrowDown => panel.chosen = (panel.chosen + 1) % count,
            _ => (),
        }
        let path = &panel.paths[panel.chosen];
        for mut settings in &mut cameras {
            match event.key_code {
                KeyCode::ArrowLeft => fields::change(&mut settings, path, false),
                KeyCode::ArrowRight => fields::change(&mut settings, path, true),
                KeyCode::Backspace => fields::copy(&mut settings, path, &defaults),
                _ => (),
            }
        }
    }
}

/// Writes the list as it is, scrolled to what is chosen, as large as the window allows.
pub fn show(
    panel: Res<Panel>,
    cameras: Query<&Restir>,
    windows: Query<&Window>,
    mut scale: ResMut<UiScale>,
    mut parts: Query<&mut Visibility, With<Part>>,
    mut rows: Query<(&Row, &mut Text, &mut TextColor, &mut BackgroundColor, &mut Node)>,
) {
    let (Ok(settings), Ok(window)) = (cameras.single(), windows.single()) else { return };
    let wanted = (window.height() / 560.0).clamp(0.7, 2.0);
    if scale.0 != wanted {
        scale.0 = wanted;
    }
    let visibility = if panel.visible { Visibility::Inherited } else { Visibility::Hidden };
    for mut part in &mut parts {
        part.set_if_neq(visibility);
    }

    let fitting = ((window.height() / wanted - 84.0) / LINE).max(3.0) as usize;
    let first = panel.chosen.saturating_sub(fitting / 2).min(panel.paths.len().saturating_sub(fitting));
    let defaults = Restir::default();
    for (row, mut text, mut color, mut background, mut node) in &mut rows {
        let display = if (first..first + fitting).contains(&row.0) { Display::Flex } else { Display::None };
        if node.display != display {
            node.display = display;
        }
        let (path, chosen) = (&panel.paths[row.0], row.0 == panel.chosen);
        let value = fields::shown(settings, path);
        let changed = value != fields::shown(&defaults, path);
        let sign = if chosen { '>' } else { ' ' };
        text.set_if_neq(Text(format!("{sign} {path:<25} {value:<25}")));
        color.set_if_neq(TextColor(if changed { Color::srgb(1.0, 0.8, 0.4) } else { Color::WHITE }));
        let behind = if chosen { Color::srgba(0.25, 0.45, 0.9, 0.6) } else { Color::NONE };
        background.set_if_neq(BackgroundColor(behind));
    }
}
