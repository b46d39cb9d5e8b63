//! The parts of the viewer: widgets for every setting, files, the viewer's own sky, animations and the camera.

mod broken_files;

use crate::support::{app::*, cli::Folder, gltf::Scene};
use bevy::{
    anti_alias::taa::TemporalAntiAliasing,
    input::{
        ButtonState,
        keyboard::{Key, KeyboardInput},
        mouse::{MouseButtonInput, MouseScrollUnit, MouseWheel},
        touch::TouchPhase,
    },
    post_process::bloom::Bloom,
    prelude::*,
    reflect::{PartialReflect, ReflectRef},
    render::camera::TemporalJitter,
    window::{CursorMoved, FileDragAndDrop, WindowEvent},
};
use bevy_egui::{EguiContext, EguiGlobalSettings, EguiPrimaryContextPass, egui};
use bevy_restir::{DebugView, Preset, Restir, RestirEnvironment, Technique};
use bevy_restir_apps::{
    look::{self, Look, TooDark},
    panel::{self, AddSection, Panel, docs::Docs, form::Form},
    viewer::{
        animation::{self, Clips},
        camera,
        light::{self, AddedSky},
        load::{self, Stage},
    },
};
use bevy_restir_support::fields;
use std::path::Path;

/// Draws the form on a tall screen and returns its widgets.
fn form(context: &egui::Context, settings: &mut Restir, events: Vec<egui::Event>) -> Vec<(String, egui::Response)> {
    let docs = Docs::default();
    let before = settings.clone();
    let range = |path: &str| fields::range(&before, path);
    let defaults = Restir::default();
    let mut form = Form::new(&docs, &range);
    form.default = Some(&defaults);
    form.open = true;
    let screen = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(420.0, 4000.0));
    let input = egui::RawInput { screen_rect: Some(screen), events, ..default() };
    let mut output = context.run_ui(input, |ui| {
        form.widgets.clear();
        form.show(ui, settings, "");
    });
    // The textures are not needed, since nothing is painted.
    output.textures_delta.clear();
    form.widgets
}

/// Clicks on the widget of a field.
fn click(context: &egui::Context, settings: &mut Restir, path: &str) {
    form(context, settings, Vec::new());
    let widgets = form(context, settings, Vec::new());
    let widget = &widgets.iter().find(|(at, _)| at == path).expect("it has a widget").1;
    let pos = widget.rect.left_center() + egui::vec2(8.0, 0.0);
    form(context, settings, vec![egui::Event::PointerMoved(pos)]);
    for pressed in [true, false] {
        let button = egui::PointerButton::Primary;
        let modifiers = egui::Modifiers::NONE;
        form(context, settings, vec![egui::Event::PointerButton { pos, button, pressed, modifiers }]);
    }
}

#[test]
fn every_field_of_restir_has_a_widget() {
    let paths: Vec<String> =
        form(&egui::Context::default(), &mut Restir::default(), Vec::new()).into_iter().map(|(path, _)| path).collect();
    assert_eq!(paths, fields::paths());
}

#[test]
fn a_click_on_a_widget_changes_its_field_and_no_other() {
    let context = egui::Context::default();
    let mut settings = Restir::default();
    for path in ["energy_compensation", "direct.reuse.temporal", "paths.reuse.shade_all"] {
        let before = settings.clone();
        click(&context, &mut settings, path);
        let changed: Vec<String> =
            fields::paths().into_iter().filter(|p| fields::shown(&settings, p) != fields::shown(&before, p)).collect();
        assert_eq!(changed, [path]);
    }
}

#[test]
fn numbers_are_limited_to_the_range_that_validation_accepts() {
    let settings = Restir::default();
    let range = |path| fields::range(&settings, path);
    assert_eq!(range("bounces"), Some([0.0, 64.0]));
    assert_eq!(range("direct.candidates"), Some([1.0, 64.0]));
    assert_eq!(range("direct.reuse.confidence_cap"), Some([0.0, 250.0]));
    assert_eq!(range("paths.reuse.normal_threshold"), Some([-1.0, 1.0]));
    assert_eq!(range("paths.jacobian_limit"), Some([1.0, f64::from(f32::MAX)]));
    assert_eq!(range("seed"), Some([0.0, f64::from(u32::MAX)]));
    assert_eq!(range("technique"), None);
}

#[test]
fn every_setting_and_every_choice_has_a_tooltip() {
    fn walk(value: &dyn PartialReflect, docs: &Docs) {
        let ty = value.get_represented_type_info().and_then(|info| info.type_path_table().ident()).unwrap_or_default();
        if let ReflectRef::Struct(group) = value.reflect_ref() {
            for (i, (_, field)) in group.iter_fields().enumerate() {
                let name = group.name_at(i).unwrap_or_default();
                let doc = docs.of(ty, name).unwrap_or_else(|| panic!("{ty}::{name} has no tooltip"));
                assert!(!doc.contains('`') && !doc.contains("]("), "{doc}");
                walk(field, docs);
            }
        } else if let Some((names, _)) = fields::choices(value) {
            for name in names {
                assert!(docs.of(ty, name).is_some(), "{ty}::{name} has no tooltip");
            }
        }
    }
    walk(&Restir::default(), &Docs::default());
    walk(&Preset::Balanced, &Docs::default());
}

/// All text that egui has laid out.
fn text_of(shapes: &[egui::epaint::ClippedShape]) -> String {
    fn collect(shape: &egui::Shape, text: &mut String) {
        match shape {
            egui::Shape::Text(line) => *text += &format!("{}\n", line.galley.text()),
            egui::Shape::Vec(shapes) => shapes.iter().for_each(|shape| collect(shape, text)),
            _ => {}
        }
    }
    let mut text = String::new();
    shapes.iter().for_each(|clipped| collect(&clipped.shape, &mut text));
    text
}

#[test]
fn the_panel_shows_its_sections_and_its_keys_change_settings() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.app.init_resource::<EguiGlobalSettings>().insert_resource(Panel::new("my own key"));
    rig.app.add_section(|InMut(ui): InMut<egui::Ui>| _ = ui.label("my own section"));
    panel::plugin(&mut rig.app);
    rig.insert(rig.camera, look::look(None));
    rig.frames(2);
    let world = rig.app.world_mut();
    let context = world.query::<&mut EguiContext>().single_mut(world).expect("the overlay has it").get_mut().clone();
    let mut text = String::new();
    for _ in 0..2 {
        let screen = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(800.0, 1200.0));
        let input = egui::RawInput { screen_rect: Some(screen), ..default() };
        let mut output = context.run_ui(input, |_| rig.app.world_mut().run_schedule(EguiPrimaryContextPass));
        output.textures_delta.clear();
        text = text_of(&output.shapes);
    }
    for part in
        ["my own section", "Balanced", "EV100", "Settings", "Environment", "Cost", "rays per pixel", "my own key"]
    {
        assert!(text.contains(part), "{part} is missing in:\n{text}");
    }

    let mut press = |key_code, text: &str| {
        rig.app.world_mut().write_message(KeyboardInput {
            key_code,
            logical_key: Key::Character(text.into()),
            state: ButtonState::Pressed,
            text: None,
            repeat: false,
            window: Entity::PLACEHOLDER,
        });
        rig.frames(1);
        rig.get_mut::<Restir>(rig.camera).clone()
    };
    assert_eq!(press(KeyCode::KeyT, "t").technique, Technique::Di);
    assert_eq!(press(KeyCode::KeyT, "T").technique, Technique::Reference, "shift steps back");
    assert_eq!(press(KeyCode::ArrowUp, "").bounces, 2);
    assert_ne!(press(KeyCode::KeyV, "v").debug_view, DebugView::Off);
    press(KeyCode::KeyH, "h");
    assert!(!rig.app.world().resource::<Panel>().visible);
}

/// An app with the parts of the viewer that load files.
fn stage() -> Option<Rig> {
    let mut rig = Rig::new(16, 16)?;
    load::plugin(&mut rig.app);
    light::plugin(&mut rig.app);
    animation::plugin(&mut rig.app);
    rig.set(|r| r.technique = Technique::Reference);
    Some(rig)
}

/// Drops a file on the window and waits until it is loaded or has failed.
fn drop_file(rig: &mut Rig, path: &Path) {
    let dropped = FileDragAndDrop::DroppedFile { window: Entity::PLACEHOLDER, path_buf: path.into() };
    rig.app.world_mut().write_message(dropped);
    for _ in 0..300 {
        rig.frame();
        if !rig.app.world().resource::<Stage>().line.starts_with("loading") {
            // The other systems react to the new scene.
            rig.frames(3);
            return;
        }
    }
    panic!("{} was neither loaded nor rejected", path.display());
}

/// The name of the current file, and the message to the user.
fn shown(rig: &Rig) -> (Option<String>, String) {
    let stage = rig.app.world().resource::<Stage>();
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    (stage.shown.as_ref().map(|shown| name(&shown.path)), stage.line.clone())
}

#[test]
fn a_dropped_file_replaces_the_scene_and_a_broken_one_gives_a_message() {
    let Some(folder) = Folder::new("viewer # 50%") else { return };
    let Some(mut rig) = stage() else { return };
    let lit = folder.gltf("a # lit.gltf", &Scene::default());
    let dark = folder.gltf("dark.gltf", &Scene { camera: false, emissive: [0.0; 3], ..Scene::default() });
    let broken = folder.path("broken.glb");
    std::fs::write(&broken, "no glTF").expect("the folder can be written");
    let text = folder.path("text.txt");
    std::fs::write(&text, "text").expect("the folder can be written");

    drop_file(&mut rig, &lit);
    assert_eq!(shown(&rig), (Some("a # lit.gltf".into()), String::new()));
    assert_eq!(rig.until_ready().instances, 1);
    let world = rig.app.world();
    let cameras = &world.resource::<Stage>().shown.as_ref().expect("it is shown").cameras;
    assert_eq!(cameras.iter().map(|c| c.0.as_str()).collect::<Vec<_>>(), ["eye"]);
    assert!(world.get::<Camera>(cameras[0].1).is_none(), "it draws to the window");
    assert!(!world.entity(rig.camera).contains::<RestirEnvironment>(), "the file has light of its own");

    for (bad, expected) in [(&broken, "broken.glb"), (&text, "neither"), (&folder.path("none.glb"), "none.glb")] {
        drop_file(&mut rig, bad);
        let (still, line) = shown(&rig);
        assert_eq!(still.as_deref(), Some("a # lit.gltf"), "the old scene stays");
        assert!(line.contains(expected) && line.lines().count() == 1, "{line}");
        assert_eq!(rig.until_ready().instances, 1);
    }

    // A file without lights gets a sky until a file with lights replaces it.
    let added = |rig: &Rig| {
        let camera = rig.app.world().entity(rig.camera);
        (camera.contains::<RestirEnvironment>(), camera.contains::<AddedSky>())
    };
    drop_file(&mut rig, &dark);
    assert_eq!(shown(&rig), (Some("dark.gltf".into()), String::new()));
    assert_eq!((rig.until_ready().instances, added(&rig)), (1, (true, true)));
    assert!(rig.picture(1).mean() > 10.0, "the picture is lit");
    drop_file(&mut rig, &lit);
    assert_eq!((rig.until_ready().instances, added(&rig)), (1, (false, false)));
    // A file whose lights do not reach the picture gets a sky, too.
    rig.app.world_mut().write_message(TooDark);
    rig.frames(2);
    assert_eq!(added(&rig), (true, true));
    drop_file(&mut rig, &lit);
    assert_eq!(added(&rig), (false, false));
    // An environment of the user stays.
    let camera = rig.camera;
    rig.insert(camera, sky(2.0));
    drop_file(&mut rig, &dark);
    assert_eq!(added(&rig), (true, false));
    rig.assert_sound();
}

#[test]
fn a_dropped_image_becomes_the_users_sky_and_a_file_that_was_written_anew_is_read_again() {
    let Some(folder) = Folder::new("viewer_sky") else { return };
    let Some(mut rig) = stage() else { return };
    let camera = rig.camera;
    rig.insert(camera, look::look(None));
    let dark = folder.gltf("dark.gltf", &Scene { emissive: [0.0; 3], ..Scene::default() });
    let lit = folder.gltf("lit.gltf", &Scene::default());
    let image = folder.path("sky.exr");
    exr::prelude::write_rgb_file(&image, 8, 4, |_, _| (0.5f32, 1.0f32, 2.0f32)).expect("the folder can be written");

    drop_file(&mut rig, &dark);
    assert!(rig.app.world().entity(camera).contains::<AddedSky>(), "the viewer adds a sky");
    rig.get_mut::<Look>(camera).measure_next = false;
    drop_file(&mut rig, &image);
    let is_users = |rig: &Rig| {
        let sky = rig.app.world().get::<RestirEnvironment>(camera);
        sky.is_some_and(|sky| sky.image.is_some()) && !rig.app.world().entity(camera).contains::<AddedSky>()
    };
    assert!(is_users(&rig));
    assert!(rig.get_mut::<Look>(camera).measure_next, "the exposure fits the new sky");
    drop_file(&mut rig, &lit);
    assert!(is_users(&rig), "a file with lights leaves it");

    let cameras = |rig: &Rig| rig.app.world().resource::<Stage>().shown.as_ref().map(|shown| shown.cameras.len());
    assert_eq!(cameras(&rig), Some(1));
    folder.gltf("lit.gltf", &Scene { camera: false, ..Scene::default() });
    drop_file(&mut rig, &lit);
    assert_eq!(cameras(&rig), Some(0), "the new content of the file");
    rig.assert_sound();
}

#[test]
fn a_preset_changes_its_own_fields_only() {
    let own = Restir {
        technique: Technique::Bdpt,
        seed: 7,
        accumulate: true,
        energy_compensation: false,
        ..Restir::default()
    };
    for preset in fields::values::<Preset>() {
        let mut settings = own.clone();
        fields::apply_preset(&mut settings, preset);
        assert_eq!(settings, own.clone().with_preset(preset));
        assert_eq!((settings.seed, settings.accumulate, settings.energy_compensation), (7, true, false));
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn every_setting_can_be_changed_at_run_time() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 60.0, ..default() }, Transform::from_xyz(0.5, 0.5, 2.0)));
    let settings = Restir { technique: Technique::Gi, bounces: 2, ..plain() };
    rig.set(|restir| *restir = settings.clone());
    let mean = rig.picture(4).mean();
    for path in fields::paths().into_iter().filter(|path| path != "debug_view") {
        for up in [true, false] {
            rig.set(|restir| {
                *restir = settings.clone();
                fields::change(restir, &path, up);
            });
            rig.until_ready();
            let picture = rig.next();
            assert!(picture.is_finite(), "{path}");
            assert!((0.3..3.0).contains(&(picture.mean() / mean)), "{path}: {} after {mean}", picture.mean());
            // The counters of a frame arrive while the tests wait for the GPU, and the next frame reports them.
            assert_eq!(rig.report().raised_guards(), [], "{path}, or the change before it");
        }
    }
    rig.assert_sound();
}

#[test]
fn bloom_and_temporal_anti_aliasing_can_be_switched_and_spare_debug_views() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.insert(rig.camera, look::look(Some(0.0)));
    rig.app.add_systems(Update, look::add_effects);
    let has = |rig: &mut Rig, wanted: bool, view: DebugView| {
        rig.set(|restir| restir.debug_view = view);
        let mut look = rig.get_mut::<Look>(rig.camera);
        (look.bloom, look.taa) = (wanted, wanted);
        rig.frames(3);
        let camera = rig.app.world().entity(rig.camera);
        let jitters = camera.contains::<TemporalJitter>();
        [camera.contains::<Bloom>(), camera.contains::<TemporalAntiAliasing>(), jitters]
    };
    assert_eq!(has(&mut rig, true, DebugView::Off), [true; 3]);
    assert_eq!(has(&mut rig, true, DebugView::Depth), [false; 3]);
    assert_eq!(has(&mut rig, true, DebugView::Off), [true; 3]);
    assert_eq!(has(&mut rig, false, DebugView::Off), [false; 3], "the plugin jitters the camera itself again");
    rig.assert_sound();
}

#[test]
fn animations_play_pause_and_seek() {
    let Some(folder) = Folder::new("viewer_animation") else { return };
    let Some(mut rig) = stage() else { return };
    drop_file(&mut rig, &folder.gltf("moves.gltf", &Scene { animated: true, ..Scene::default() }));
    let square = rig.named("square");
    let at = |rig: &mut Rig, frames: u32| {
        rig.frames(frames);
        rig.get_mut::<Transform>(square).translation.x
    };
    assert_eq!(rig.app.world().resource::<Clips>().all.len(), 1);
    assert_eq!(at(&mut rig, 5), 0.0, "it rests at first");
    let control = |rig: &mut Rig, change: fn(&mut Clips)| change(&mut rig.app.world_mut().resource_mut::<Clips>());
    // 10 m in half a second.
    control(&mut rig, |clips| (clips.time, clips.seek_requested) = (0.25, true));
    assert!((at(&mut rig, 3) - 5.0).abs() < 1e-3, "it is in the middle and rests there");
    control(&mut rig, |clips| clips.playing = true);
    let moved = at(&mut rig, 6);
    assert!((6.0..7.5).contains(&moved), "five or six frames of 1/60 s: {moved}");
    control(&mut rig, |clips| clips.playing = false);
    let held = at(&mut rig, 2);
    assert_eq!(at(&mut rig, 5), held, "it is paused");
    // Another file has its own animations.
    drop_file(&mut rig, &folder.gltf("rests.gltf", &Scene::default()));
    assert!(rig.app.world().resource::<Clips>().all.is_empty());
}

#[test]
fn a_drag_on_the_picture_turns_the_camera_even_within_one_frame() {
    let Some(mut rig) = Rig::new(40, 40) else { return };
    let (window, camera) = (Entity::PLACEHOLDER, rig.camera);
    rig.insert(camera, camera::eye());
    rig.app.add_systems(Update, camera::orbit);
    rig.frames(2);
    let moved = |x, y| WindowEvent::CursorMoved(CursorMoved { window, position: Vec2::new(x, y), delta: None });
    let button = |state| WindowEvent::MouseButtonInput(MouseButtonInput { button: MouseButton::Left, state, window });
    let drag = |rig: &mut Rig, from: f32, to: f32| {
        for event in [moved(from, 20.0), button(ButtonState::Pressed), moved(to, 20.0), button(ButtonState::Released)] {
            rig.app.world_mut().write_message(event);
        }
        rig.frames(2);
        *rig.get_mut::<Transform>(camera)
    };
    let before = *rig.get_mut::<Transform>(camera);
    assert_eq!(drag(&mut rig, 60.0, 30.0), before, "the drag began beside the picture");
    let turned = drag(&mut rig, 10.0, 30.0);
    // 20 pixels around the origin at a distance of 1 m.
    assert!((turned.translation.length() - 1.0).abs() < 1e-5, "{turned:?}");
    assert!((turned.rotation.to_euler(EulerRot::YXZ).0 + 0.12).abs() < 1e-5, "{turned:?}");
    let unit = MouseScrollUnit::Line;
    let wheel = MouseWheel { unit, x: 0.0, y: 3.0, window, phase: TouchPhase::Moved };
    rig.app.world_mut().write_message(WindowEvent::MouseWheel(wheel));
    rig.frames(2);
    let near = rig.get_mut::<Transform>(camera).translation.length();
    assert!((near - (-0.3f32).exp()).abs() < 1e-5, "{near}");
}
