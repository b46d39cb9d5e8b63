//! Mip levels: the atlas stores means in linear light, the footprint of a pixel chooses the level (also through mirrors), and all
//! techniques agree.

use crate::support::{
    app::*,
    oracle::texture::{Level, Texture, Wrap, linear_to_srgb, srgb_to_linear},
    proof::{AllLight, Proof},
    small_scenes::{scene, textured},
};
use bevy::{
    image::{ImageAddressMode, ImageSampler, ImageSamplerDescriptor},
    math::{Affine2, DVec4},
    prelude::*,
    render::render_resource::TextureFormat,
};
use bevy_restir::{DebugView, Direct, Jitter, Paths};

/// A square of side 1 in the middle of the image, in pixels of this width.
pub fn seen(rig: &mut Rig, material: StandardMaterial, pixel: f32) -> Picture {
    let width = 8.0 * pixel;
    rig.insert(rig.camera, orthographic(width, width));
    // The image has an even number of pixels, so a large pixel is centered beside the middle.
    let place = if pixel < 1.0 { Vec3::ZERO } else { Vec3::new(0.5, -0.5, 0.0) };
    let entity = rig.spawn(square(1.0), material, Transform::from_translation(place));
    let picture = rig.debug(DebugView::Albedo);
    rig.app.world_mut().despawn(entity);
    picture
}

/// Bytes without a pattern.
fn byte(x: u32, y: u32, channel: u32) -> u8 {
    ((x * 73 + y * 151 + channel * 57 + x * y * 29) % 256) as u8
}

#[test]
fn levels_are_means_in_linear_light() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    for (width, height, srgb) in
        [(8, 8, true), (8, 8, false), (7, 5, true), (6, 9, false), (64, 64, true), (16, 4, true)]
    {
        let mut image = texture(width, height, |x, y| [byte(x, y, 0), byte(x, y, 1), byte(x, y, 2), 255]);
        if !srgb {
            image.texture_descriptor.format = TextureFormat::Rgba8Unorm;
        }
        image.sampler = ImageSampler::linear();
        let curve = |c: f64| if srgb { srgb_to_linear(c) } else { c };
        let level = Level::new(width as usize, height as usize, |x, y| {
            let c = |channel| curve(f64::from(byte(x as u32, y as u32, channel)) / 255.0);
            DVec4::new(c(0), c(1), c(2), 1.0)
        });
        let oracle = Texture::new(level, [Wrap::Clamp; 2], false);
        let handle = rig.add::<Image>(image);
        for pixel in [1.0, 0.5, 0.25] {
            let material = StandardMaterial { base_color_texture: Some(handle.clone()), ..lambert(1.0) };
            let picture = seen(&mut rig, material, pixel);
            // The pixels that the square covers entirely.
            let across = (1.0 / pixel) as u32;
            for y in 0..across {
                for x in 0..across {
                    let got = picture.at(4 - across / 2 + x, 4 - across / 2 + y);
                    let uv = (bevy::math::DVec2::new(x.into(), y.into()) + 0.5) * f64::from(pixel);
                    let axes = [bevy::math::DVec2::X, bevy::math::DVec2::Y].map(|a| a * f64::from(pixel));
                    let expected = oracle.sample_area(uv, axes);
                    for i in 0..3 {
                        let stored = |c: f64| if srgb { linear_to_srgb(c) } else { c };
                        let error = stored(f64::from(got[i])) - stored(expected[i]);
                        assert!(error.abs() < 2.5 / 255.0, "{width} x {height}, {x} {y}: {got}, not {expected}");
                    }
                }
            }
        }
    }
    let atlas = rig.report().memory.iter().find(|(name, _)| *name == "texture atlas").map_or(0, |(_, bytes)| *bytes);
    assert_eq!(atlas, (0..9).map(|level| (256u64 >> level).pow(2) * 4).sum::<u64>(), "one page of 256 with its levels");
}

/// Black and white squares of two texels, eight per side.
fn checks(rig: &mut Rig) -> Option<Handle<Image>> {
    let mut image = texture(16, 16, |x, y| if (x / 2 + y / 2) % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] });
    image.sampler = ImageSampler::Descriptor(ImageSamplerDescriptor {
        address_mode_u: ImageAddressMode::Repeat,
        address_mode_v: ImageAddressMode::Repeat,
        ..ImageSamplerDescriptor::linear()
    });
    Some(rig.add::<Image>(image))
}

/// A floor of squares of 1 m, up to the horizon.
fn floor(rig: &mut Rig, material: StandardMaterial) {
    let material = StandardMaterial { uv_transform: Affine2::from_scale(Vec2::splat(100.0)), ..material };
    let flat = Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2);
    rig.spawn(square(800.0), material, Transform::from_rotation(flat));
}

/// For every row: the standard deviation between frames, the mean, and the standard deviation along the row of the mean frame.
fn rows(pictures: &[Picture]) -> Vec<[f32; 3]> {
    let size = pictures[0].size;
    let n = pictures.len() as f32;
    (0..size.y)
        .map(|y| {
            let of_pixel = |x: u32| {
                let values: Vec<f32> = pictures.iter().map(|p| p.at(x, y).x).collect();
                let mean = values.iter().sum::<f32>() / n;
                (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / (n - 1.0))
            };
            let pixels: Vec<_> = (0..size.x).map(of_pixel).collect();
            let average = |of: &dyn Fn(&(f32, f32)) -> f32| pixels.iter().map(of).sum::<f32>() / size.x as f32;
            let mean = average(&|p| p.0);
            [average(&|p| p.1).sqrt(), mean, average(&|p| (p.0 - mean).powi(2)).sqrt()]
        })
        .collect()
}

/// Frames with different jitter.
fn frames(rig: &mut Rig, count: u32) -> Vec<Picture> {
    rig.set(|restir| restir.jitter = Jitter::Always);
    (0..count)
        .map(|seed| {
            rig.set(|restir| restir.seed = seed);
            rig.picture(1)
        })
        .collect()
}

#[test]
fn a_checkered_floor_is_sharp_nearby_and_does_not_flicker_at_the_horizon() {
    let Some(mut rig) = Rig::new(48, 48) else { return };
    let image = checks(&mut rig);
    floor(&mut rig, StandardMaterial { base_color_texture: image, ..lambert(1.0) });
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3, 1.0, 0.2).looking_to(Vec3::new(0.1, -0.35, -1.0), Vec3::Y);
    rig.set(|restir| restir.debug_view = DebugView::Albedo);
    rig.until_ready();
    let rows = rows(&frames(&mut rig, 24));
    let horizon = rows.iter().position(|row| row[1] > 0.3).expect("there is a floor");
    for (i, row) in rows.iter().enumerate().skip(horizon + 1).take(5) {
        eprintln!("row {i}: between frames {:.3}, mean {:.3}, along the row {:.3}", row[0], row[1], row[2]);
    }
    // Without levels, every pixel of these rows would be black or white by chance: a deviation of 0.5.
    for row in &rows[horizon + 1..horizon + 4] {
        assert!(row[0] < 0.06 && (row[1] - 0.5).abs() < 0.05, "{row:?}");
    }
    let near = rows.iter().map(|row| row[2]).fold(0.0, f32::max);
    assert!(near > 0.4, "nearby squares: {near}");
}

#[test]
fn a_mirror_shows_the_levels_of_distant_reflections() {
    let Some(mut rig) = Rig::new(48, 48) else { return };
    let image = checks(&mut rig);
    let emissive = LinearRgba::WHITE;
    floor(&mut rig, StandardMaterial { emissive_texture: image, emissive, ..lamp(1.0, 1.0, 1.0) });
    let mirror = StandardMaterial { metallic: 1.0, perceptual_roughness: 0.0, ..default() };
    // The camera sees only this mirror.
    rig.spawn(square(10.0), mirror, Transform::from_xyz(0.0, 1.0, -2.0));
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3, 1.0, 0.2).looking_to(Vec3::new(0.1, -0.3, -1.0), Vec3::Y);
    rig.until_ready();
    let rows = rows(&frames(&mut rig, 24));
    let horizon = rows.iter().position(|row| row[1] > 0.3).expect("there is a floor in the mirror");
    for row in &rows[horizon + 1..horizon + 4] {
        eprintln!("between frames {:.3}, mean {:.3}", row[0], row[1]);
        assert!(row[0] < 0.06 && (row[1] - 0.5).abs() < 0.05, "{row:?}");
    }
}

/// An orthographic camera, so that the footprint before the mirror is the whole footprint: pixels of 1 m, squares of 1/16 m.
#[test]
fn a_mirror_passes_the_footprint_of_a_pixel_on() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.insert(rig.camera, orthographic(8.0, 8.0));
    let turned = |degrees: f32| Quat::from_rotation_y(degrees.to_radians());
    let mirror = StandardMaterial { metallic: 1.0, perceptual_roughness: 0.0, ..Color::WHITE.into() };
    rig.spawn(square(20.0), mirror, Transform::from_rotation(turned(45.0)));
    let image = checks(&mut rig);
    let screen = StandardMaterial {
        emissive_texture: image,
        uv_transform: Affine2::from_scale(Vec2::splat(80.0)),
        ..lamp(1.0, 1.0, 1.0)
    };
    rig.spawn(square(40.0), screen, Transform::from_xyz(10.0, 0.0, 0.0).with_rotation(turned(-90.0)));
    rig.until_ready();
    for row in rows(&frames(&mut rig, 16)) {
        assert!(row[0] < 0.06 && (row[1] - 0.5).abs() < 0.05, "{row:?}");
    }
}

/// Textured emitters that are sampled by NEE and hit by BSDF rays of rough surfaces and mirrors, and alpha masks.
#[test]
#[ignore = "second tier: ./run test --more"]
fn techniques_agree_on_textures() {
    let Some(mut rig) = scene(64, textured) else { return };
    let proof = Proof { bounces: 3, margin: 0.03, ..Proof::of((12, 4), (12, 16)) };
    proof.check("textured", &mut rig, &[("ReSTIR PT", AllLight::Pt(Paths::default()))]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_techniques_agree_on_textures() {
    // Two regions per axis: the residual of a single one is too small to test within 3 %.
    let Some(mut rig) = scene(64, textured) else { return };
    let direct = || Direct { subset_count: 32, subset_size: 256, ..Direct::default() };
    let proof = Proof { bounces: 1, margin: 0.01, ..Proof::of((40, 12), (40, 40)) };
    proof.check("textured, one bounce", &mut rig, &[("ReSTIR DI", direct())]);
    let proof = Proof { bounces: 3, margin: 0.01, ..Proof::of((40, 16), (40, 64)) };
    let all = [("ReSTIR PT", AllLight::Pt(Paths::default())), ("DI + GI", AllLight::Gi(direct(), Paths::default()))];
    proof.check("textured", &mut rig, &all);
}
