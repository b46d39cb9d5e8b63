//! Images that appear, disappear, are edited and resized, and are written by the GPU: the atlas stays as small as its content, and the output
//! of cameras is visible on surfaces, lamps and environments.

use crate::support::{app::*, oracle::texture::srgb_to_linear, reuse_settings::di};
use bevy::{
    camera::{ImageRenderTarget, RenderTarget},
    core_pipeline::tonemapping::Tonemapping,
    prelude::*,
    render::render_resource::{TextureFormat, TextureUsages, WgpuFeatures},
};
use bevy_restir::{DebugView, Restir, RestirEnvironment, Technique, testing::lengths::table_lengths};

fn atlas(rig: &Rig) -> u64 {
    rig.report().memory.iter().find(|(name, _)| *name == "texture atlas").map_or(0, |(_, bytes)| *bytes)
}

fn page(side: u64) -> u64 {
    (0..=side.ilog2()).map(|level| (side >> level).pow(2) * 4).sum()
}

#[test]
fn an_image_that_is_replaced_again_and_again_does_not_grow_the_atlas() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    let image = |i: u32| texture(90 + i % 20, 120, move |_, _| [(10 * i) as u8, 100, 50, 255]);
    let still = rig.add::<Image>(texture(60, 60, |_, _| [0, 255, 0, 255]));
    let green = StandardMaterial { base_color_texture: Some(still), ..lambert(1.0) };
    rig.spawn(square(2.0), green, Transform::from_xyz(-1.0, 0.0, 0.0));
    rig.insert(rig.camera, orthographic(4.0, 2.0));
    let first = rig.add::<Image>(image(0));
    let entity = rig.spawn(
        square(2.0),
        StandardMaterial { base_color_texture: Some(first), ..lambert(1.0) },
        Transform::from_xyz(1.0, 0.0, 0.0),
    );
    let material = rig.material_of(entity);
    rig.until_ready();
    for i in 1..30 {
        if i % 3 == 0 {
            // The same image asset with another size.
            let handle = rig.app.world().resource::<Assets<StandardMaterial>>().get(&material).cloned();
            let handle = handle.and_then(|m| m.base_color_texture).expect("the material has an image");
            rig.edit(&handle, |old| *old = image(i));
        } else {
            let new = rig.add::<Image>(image(i));
            rig.edit(&material, |m| m.base_color_texture = Some(new));
        }
        let picture = rig.debug(DebugView::Albedo);
        let expected = srgb_to_linear(f64::from((10 * i) as u8) / 255.0) as f32;
        assert!((picture.at(6, 4).x - expected).abs() < 0.004, "{i}: {}", picture.at(6, 4));
        assert!((picture.at(2, 4) - Vec3::Y).length() < 1e-5, "{i}: {}", picture.at(2, 4));
        assert!(atlas(&rig) <= 2 * page(256), "{i}: {} bytes", atlas(&rig));
    }
}

/// The color of a frame of a film.
fn film_color(frame: u32) -> [u8; 4] {
    [(37 * frame) as u8, (11 * frame) as u8, 100, 255]
}

/// A frame of a film, as an image with mip levels of its own.
fn film_with_levels(frame: u32) -> Image {
    let levels = [16, 4, 1].map(|count| film_color(frame).repeat(count));
    image_with_levels(TextureFormat::Rgba8UnormSrgb, 4, 4, &levels)
}

/// The kinds of films.
const FILMS: [(&str, fn(u32) -> Image); 4] = [
    ("small", |frame| texture(60, 40, |_, _| film_color(frame))),
    ("as large as a page of the atlas", |frame| texture(250, 250, |_, _| film_color(frame))),
    ("in new textures", film_with_levels),
    ("in a texture that Bevy overwrites", |frame| {
        let mut image = film_with_levels(frame);
        image.texture_descriptor.usage |= TextureUsages::COPY_DST;
        image
    }),
];

/// Histories may restart where the film begins: where Bevy overwrites a bound texture for the first time, or where the atlas gets another page.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_film_keeps_histories_and_takes_no_more_memory_with_each_frame() {
    let devices = [Rig::new(8, 8), Rig::lacking(WgpuFeatures::TEXTURE_BINDING_ARRAY, 8, 8)];
    for mut rig in devices.into_iter().flatten() {
        rig.set(|restir| restir.technique = Technique::Di);
        for (what, film) in FILMS {
            let image = rig.add::<Image>(film(0));
            let glow = StandardMaterial { emissive_texture: Some(image.clone()), ..lamp(1.0, 1.0, 1.0) };
            let screen = rig.spawn(square(8.0), glow, Transform::default());
            rig.until_ready();
            let kept = |rig: &Rig| {
                let report = rig.report();
                let bound = table_lengths(&rig.app).into_iter().find(|(name, _)| *name == "bound textures");
                (report.history_resets.clone(), report.memory_bytes(), bound.expect("it is in the list"))
            };
            let mut early = None;
            for frame in 1..=110 {
                rig.edit(&image, |image| *image = film(frame));
                let got = rig.next().center();
                let [r, g, b, _] = film_color(frame).map(|c| srgb_to_linear(f64::from(c) / 255.0) as f32);
                assert!((got - Vec3::new(r, g, b)).length() < 0.01, "{what}, frame {frame}: {got}");
                if frame == 10 {
                    early = Some(kept(&rig));
                }
            }
            assert_eq!(Some(kept(&rig)), early, "{what}");
            rig.app.world_mut().despawn(screen);
        }
        rig.assert_sound();
    }
}

/// The sampling weight of a lamp depends on the mean of its image, which is computed once a material needs it.
#[test]
fn an_image_that_later_becomes_emissive_gives_the_same_picture() {
    let bright = || texture(8, 8, |x, y| [(20 * x) as u8, (30 * y) as u8, 10, 255]);
    let glowing =
        |image: &Handle<Image>| StandardMaterial { emissive_texture: Some(image.clone()), ..lamp(2.0, 3.0, 4.0) };
    let room = |rig: &mut Rig| {
        rig.spawn(square(8.0), lambert(1.0), Transform::default());
        rig.spawn_bundle((PointLight { intensity: 20.0, ..default() }, Transform::from_xyz(0.0, 0.0, 2.0)));
        Transform::from_xyz(1.0, 0.0, 1.0).looking_to(Vec3::Z, Vec3::Y)
    };
    let Some(mut fresh) = Rig::new(8, 8) else { return };
    let place = room(&mut fresh);
    let image = fresh.add::<Image>(bright());
    fresh.spawn(square(1.0), glowing(&image), place);
    let expected = fresh.picture(4);
    let Some(mut rig) = Rig::new(8, 8) else { return };
    let place = room(&mut rig);
    let image = rig.add::<Image>(texture(8, 8, |_, _| [0, 0, 0, 255]));
    let surface = StandardMaterial { base_color_texture: Some(image.clone()), ..lambert(1.0) };
    let entity = rig.spawn(square(1.0), surface, place);
    rig.until_ready();
    rig.edit(&image, |image| *image = bright());
    rig.until_ready();
    let material = rig.material_of(entity);
    let new = glowing(&image);
    rig.edit(&material, |m| *m = new);
    assert_eq!(rig.picture(4), expected);
    // Edit the image while the lamp uses it.
    rig.edit(&image, |image| *image = texture(8, 8, |_, _| [0, 0, 0, 255]));
    rig.until_ready();
    rig.edit(&image, |image| *image = bright());
    assert_eq!(rig.picture(4), expected);
}

/// An image, and a camera without `Restir` that clears it to a color before ours renders.
fn screen(rig: &mut Rig, format: TextureFormat, view: Option<TextureFormat>) -> (Handle<Image>, Entity) {
    let image = rig.add::<Image>(Image::new_target_texture(64, 32, format, view));
    let camera = rig.spawn_bundle((
        Camera3d::default(),
        Camera { order: -1, ..default() },
        RenderTarget::Image(ImageRenderTarget::from(image.clone())),
        Tonemapping::None,
        Msaa::Off,
    ));
    (image, camera)
}

fn clear(rig: &mut Rig, camera: Entity, color: Vec3) {
    let [r, g, b] = color.to_array();
    rig.get_mut::<Camera>(camera).clear_color = ClearColorConfig::Custom(Color::linear_rgb(r, g, b));
}

const COLORS: [Vec3; 3] = [Vec3::new(1.0, 0.2, 0.0), Vec3::new(0.0, 0.5, 1.0), Vec3::new(0.1, 1.0, 0.3)];

#[test]
fn the_output_of_a_camera_is_visible_as_a_texture() {
    let devices = [Rig::new(8, 8), Rig::lacking(WgpuFeatures::TEXTURE_BINDING_ARRAY, 8, 8)];
    for mut rig in devices.into_iter().flatten() {
        use TextureFormat::{Rgba8Unorm, Rgba8UnormSrgb, Rgba16Float};
        for (format, view) in [(Rgba8UnormSrgb, None), (Rgba8Unorm, Some(Rgba8UnormSrgb)), (Rgba16Float, None)] {
            let (image, camera) = screen(&mut rig, format, view);
            let glow = StandardMaterial { emissive_texture: Some(image.clone()), ..lamp(2.0, 2.0, 2.0) };
            let entity = rig.spawn(square(8.0), glow, Transform::default());
            rig.set(|restir| restir.bounces = 0);
            for color in COLORS {
                clear(&mut rig, camera, color);
                // One frame draws the color, and the next one shows it.
                rig.until_ready();
                let got = rig.next();
                assert!((got.center() - 2.0 * color).length() < 0.03, "{format:?}: {} not {color}", got.center());
                assert_eq!(got.samples, 1, "frames with different colors never accumulate");
                let visited = rig.report().visited;
                let draws = visited.iter().find(|(name, _)| *name == "draws");
                assert_eq!(draws, Some(&("draws", 0)), "another picture on a screen changes no draw call: {visited:?}");
            }
            let surface = StandardMaterial { base_color_texture: Some(image), ..lambert(1.0) };
            let surface = rig.add::<StandardMaterial>(surface);
            rig.insert(entity, MeshMaterial3d(surface));
            for color in COLORS {
                clear(&mut rig, camera, color);
                let got = rig.debug(DebugView::Albedo).center();
                assert!((got - color).length() < 0.015, "{format:?}: {got} not {color}");
            }
            rig.app.world_mut().despawn(entity);
            rig.app.world_mut().despawn(camera);
        }
        rig.assert_sound();
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_lamp_with_the_output_of_a_camera_lights_its_surroundings() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    let (image, camera) = screen(&mut rig, TextureFormat::Rgba16Float, None);
    rig.spawn(square(8.0), lambert(1.0), Transform::default());
    let toward = Transform::from_xyz(0.0, 0.0, 6.0).looking_to(Vec3::Z, Vec3::Y);
    let glow = StandardMaterial { emissive_texture: Some(image), ..lamp(1.0, 1.0, 1.0) };
    rig.spawn(square(4.0), glow, toward);
    // Another light is always on, so that both share the samples.
    rig.spawn_bundle((PointLight { intensity: 1.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    rig.insert(rig.camera, orthographic(2.0, 2.0));
    rig.set(|restir| {
        *restir = Restir { technique: Technique::Di, direct: di::all_reuse(), bounces: 1, ..restir.clone() }
    });
    let mean = |rig: &mut Rig, color: Vec3| {
        clear(rig, camera, color);
        rig.frames(3);
        // Frames do not accumulate here; the mean is over seeds.
        let sum: Vec3 = (0..32)
            .map(|seed| {
                rig.set(|restir| restir.seed = seed);
                let picture = rig.next();
                picture.iter().map(|(_, c)| c).sum::<Vec3>() / 64.0
            })
            .sum();
        sum / 32.0
    };
    let dark = mean(&mut rig, Vec3::ZERO);
    let lit = mean(&mut rig, Vec3::new(0.0, 1.0, 0.0)) - dark;
    let half = mean(&mut rig, Vec3::new(0.5, 0.0, 0.0)) - dark;
    eprintln!("dark {dark}, green {lit}, half as much red {half}");
    assert!(lit.y > 0.05 && lit.x.abs() < 0.01 && lit.z.abs() < 0.01, "{lit}");
    assert!((half.x / lit.y - 0.5).abs() < 0.03 && half.y.abs() < 0.01, "{half} and {lit}");
}

#[test]
fn an_environment_with_the_output_of_a_camera_lights_the_scene() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, orthographic(2.0, 2.0));
    rig.spawn(square(1.0), lambert(1.0), Transform::from_xyz(-0.5, 0.0, 0.0));
    let (image, camera) = screen(&mut rig, TextureFormat::Rgba16Float, None);
    rig.insert(rig.camera, RestirEnvironment { image: Some(image), ..sky(1.0) });
    rig.until_ready();
    for color in COLORS {
        clear(&mut rig, camera, color);
        rig.frames(3);
        let mut lit = Vec3::ZERO;
        for seed in 0..16 {
            rig.set(|restir| restir.seed = seed);
            let picture = rig.next();
            assert_eq!(picture.samples, 1);
            assert!((picture.at(12, 8) - color).length() < 2e-3, "the sky is {} and not {color}", picture.at(12, 8));
            let square = picture.iter().filter(|(at, _)| (1..7).contains(&at.x) && (5..11).contains(&at.y));
            lit += square.map(|(_, c)| c).sum::<Vec3>() / 36.0 / 16.0;
        }
        assert!((lit - color).length() < 0.05, "the lit surface is {lit} and not {color}");
    }
    rig.assert_sound();
}

#[test]
fn a_hidden_screen_restarts_no_history() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    rig.spawn(square(8.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -1.0));
    let (image, _) = screen(&mut rig, TextureFormat::Rgba8UnormSrgb, None);
    let surface = StandardMaterial { base_color_texture: Some(image), ..lambert(1.0) };
    let entity = rig.spawn(square(1.0), surface, Transform::default());
    rig.set(|restir| restir.technique = Technique::Di);
    let restarts = |rig: &mut Rig| {
        rig.until_ready();
        rig.frames(3);
        let before = rig.report().history_resets;
        rig.frames(4);
        rig.report().history_resets != before
    };
    assert!(restarts(&mut rig), "a screen that is seen");
    rig.insert(entity, Visibility::Hidden);
    assert!(!restarts(&mut rig), "a hidden screen");
    rig.insert(entity, Visibility::Visible);
    assert!(restarts(&mut rig), "a screen that is seen again");
}
