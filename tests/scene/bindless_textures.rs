//! Images with mip levels of their own are bound directly where the device has texture arrays, and copied into the atlas elsewhere.  Both
//! look the same, except that the atlas drops the author's levels and bits beyond eight.

use super::texture_levels::seen;
use crate::support::{
    app::*,
    oracle::texture::{Level, Texture, Wrap, linear_to_srgb, srgb_to_linear},
    scenes::Random,
};
use bevy::{
    image::{ImageAddressMode, ImageSampler, ImageSamplerDescriptor},
    math::{Affine2, DVec4},
    prelude::*,
    render::{
        render_resource::{TextureFormat, TextureUsages, WgpuFeatures},
        renderer::RenderDevice,
    },
};
use bevy_restir::{DebugView, Restir, RestirExpected, SceneFeatures};

/// Like [`Rig::new`].  `None`, with a message, where the adapter has no texture arrays; with `TEXTURE_ARRAYS=required` that is a failure.
fn binding(width: u32, height: u32) -> Option<Rig> {
    let rig = Rig::new(width, height)?;
    if !has_arrays(&rig) {
        assert!(std::env::var("TEXTURE_ARRAYS").is_err(), "the adapter has no texture arrays, and they are required");
        eprintln!("skipped: the adapter has no texture arrays");
        return None;
    }
    Some(rig)
}

fn has_arrays(rig: &Rig) -> bool {
    let needed = WgpuFeatures::TEXTURE_BINDING_ARRAY
        | WgpuFeatures::SAMPLED_TEXTURE_AND_STORAGE_BUFFER_ARRAY_NON_UNIFORM_INDEXING
        | WgpuFeatures::PARTIALLY_BOUND_BINDING_ARRAY;
    rig.app.world().resource::<RenderDevice>().features().contains(needed)
}

/// An app that binds textures, and one that cannot.
fn both(width: u32, height: u32) -> Option<[Rig; 2]> {
    Some([binding(width, height)?, Rig::lacking(WgpuFeatures::TEXTURE_BINDING_ARRAY, width, height)?])
}

fn atlas(rig: &Rig) -> u64 {
    rig.report().memory.iter().find(|(name, _)| *name == "texture atlas").map_or(0, |(_, bytes)| *bytes)
}

fn binds(rig: &Rig) -> bool {
    rig.report().features.contains(SceneFeatures::BOUND_TEXTURES)
}

fn repeated(mut image: Image) -> Image {
    image.sampler = ImageSampler::Descriptor(ImageSamplerDescriptor {
        address_mode_u: ImageAddressMode::Repeat,
        address_mode_v: ImageAddressMode::MirrorRepeat,
        ..ImageSamplerDescriptor::linear()
    });
    image
}

/// 16 x 16 texels and four levels; each texel is exactly the mean of the four below it, as the atlas computes levels.
fn exact_means() -> Vec<Vec<u8>> {
    fn value(level: u32, x: u32, y: u32, channel: u32) -> i32 {
        if level == 4 {
            return 128 + 10 * channel as i32;
        }
        let part = (x / 2 * 73 + y / 2 * 151 + channel * 57 + level * 31) as i32;
        let (a, b) = (part % 23, part % 19);
        value(level + 1, x / 2, y / 2, channel) + [a, b, -b, -a][(x % 2 + 2 * (y % 2)) as usize]
    }
    let of_level = |level: u32| {
        let side = 16 >> level;
        let texels = (0..side * side).flat_map(move |i| (0..4).map(move |c| value(level, i % side, i / side, c) as u8));
        texels.collect()
    };
    (0..5).map(of_level).collect()
}

/// A textured floor, a lamp and a pane with holes.  Each has its own image, so that neighboring rays read different images.
fn room(rig: &mut Rig, format: TextureFormat, levels: &[Vec<u8>]) {
    let mut image = || Some(rig.add::<Image>(repeated(image_with_levels(format, 16, 16, levels))));
    let (ground, glow, holes) = (image(), image(), image());
    let uv_transform = Affine2::from_scale_angle_translation(Vec2::new(6.0, 4.0), 0.4, Vec2::new(0.1, 0.7));
    let flat = Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2);
    let floor = StandardMaterial { base_color_texture: ground, uv_transform, ..lambert(0.9) };
    rig.spawn(square(12.0), floor, Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(flat));
    let lamp = StandardMaterial { emissive_texture: glow, uv_transform, ..lamp(3.0, 4.0, 5.0) };
    let toward = Transform::from_xyz(-1.2, 0.9, 0.6).looking_to(Vec3::new(-1.0, 0.6, 0.5), Vec3::Y);
    rig.spawn(square(0.9), lamp, toward);
    let pane = StandardMaterial {
        base_color_texture: holes,
        alpha_mode: AlphaMode::Mask(0.62),
        double_sided: true,
        cull_mode: None,
        uv_transform,
        ..lambert(0.8)
    };
    rig.spawn(square(1.2), pane, Transform::from_xyz(0.5, -0.3, 0.5));
    rig.insert(rig.camera, sky(0.1));
}

#[test]
fn bound_textures_give_the_same_picture_as_the_atlas() {
    let Some(mut rigs) = both(32, 32) else { return };
    for rig in &mut rigs {
        room(rig, TextureFormat::Rgba8Unorm, &exact_means());
    }
    let [a, b] = rigs.each_mut().map(|rig| {
        rig.set(|restir| *restir = Restir { bounces: 3, ..plain() });
        let picture = rig.picture(4);
        rig.assert_sound();
        picture
    });
    let other = a.iter().zip(b.iter()).filter(|(a, b)| a != b).count();
    eprintln!("{other} of 1024 pixels differ, mean {:.4}", a.mean());
    assert!(other == 0 && a.mean() > 0.05, "{other}");
    assert_eq!(rigs.each_ref().map(binds), [true, false]);
    // The atlas takes pages of 256 with their levels; bound textures take none.
    let page = (0..9).map(|level| (256u64 >> level).pow(2) * 4).sum();
    assert_eq!(rigs.each_ref().map(atlas), [0, page]);
}

/// With ray queries, the bind group of textures follows that of the acceleration structures.
#[test]
fn bound_textures_work_with_ray_queries() {
    let Some(mut software) = binding(32, 32) else { return };
    let Some(mut hardware) = Rig::tracing_by_ray_queries(32, 32) else { return };
    let [a, b] = [&mut software, &mut hardware].map(|rig| {
        room(rig, TextureFormat::Rgba8Unorm, &exact_means());
        rig.set(|restir| *restir = Restir { bounces: 2, ..plain() });
        let picture = rig.picture(1);
        assert!(binds(rig));
        picture
    });
    let far = |a: Vec3, b: Vec3| (a - b).abs().max_element() > 1e-4 * (1.0 + a.max_element());
    let other = a.iter().zip(b.iter()).filter(|((_, a), (_, b))| far(*a, *b)).count();
    eprintln!("{other} of 1024 pixels differ, mean {:.4}", b.mean());
    // Rays that pass an edge within rounding may differ.
    assert!(other <= 10 && b.mean() > 0.05, "{other}");
}

/// The levels are computed like those of the atlas; this compares the device's sRGB curve with ours.
#[test]
fn bound_textures_are_decoded_like_those_of_the_atlas() {
    let Some(mut rigs) = both(32, 32) else { return };
    let curve = |c: u8| srgb_to_linear(f64::from(c) / 255.0);
    let finest = exact_means().remove(0);
    let level = Level::new(16, 16, |x, y| {
        let at = 4 * (16 * y + x);
        DVec4::new(curve(finest[at]), curve(finest[at + 1]), curve(finest[at + 2]), f64::from(finest[at + 3]) / 255.0)
    });
    let stored = |c: f64| (c * 255.0).round() as u8;
    let bytes = |level: &Level| -> Vec<u8> {
        let texel = |t: &DVec4| [linear_to_srgb(t.x), linear_to_srgb(t.y), linear_to_srgb(t.z), t.w].map(stored);
        level.texels.iter().flat_map(texel).collect()
    };
    let levels: Vec<_> = Texture::new(level, [Wrap::Repeat; 2], false).levels.iter().map(bytes).collect();
    let [a, b] = rigs.each_mut().map(|rig| {
        room(rig, TextureFormat::Rgba8UnormSrgb, &levels);
        rig.debug(DebugView::Albedo)
    });
    let worst = a.iter().zip(b.iter()).map(|((_, a), (_, b))| (a - b).abs().max_element()).fold(0.0, f32::max);
    eprintln!("worst difference of an albedo: {worst:.1e}, mean {:.3}", a.mean());
    // One step of eight bits, where a mean lies between two of them.
    assert!(worst < 1.0 / 255.0 && a.mean() > 0.05, "{worst}");
}

#[test]
fn a_bound_image_shows_its_own_levels() {
    let Some(mut rigs) = both(8, 8) else { return };
    let colors: [[u8; 4]; 4] = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 0, 255]];
    let levels: Vec<_> =
        colors.iter().enumerate().map(|(level, color)| color.repeat((8usize >> level).pow(2))).collect();
    let handles = rigs.each_mut().map(|rig| {
        let image = image_with_levels(TextureFormat::Rgba8Unorm, 8, 8, &levels);
        rig.add::<Image>(image)
    });
    for (level, pixel) in [0.125, 0.25, 0.5, 1.0].into_iter().enumerate() {
        let [bound, copied] = [0, 1].map(|i| {
            let material = StandardMaterial { base_color_texture: Some(handles[i].clone()), ..lambert(1.0) };
            seen(&mut rigs[i], material, pixel).center()
        });
        let [r, g, b, _] = colors[level].map(|c| f32::from(c) / 255.0);
        assert!((bound - Vec3::new(r, g, b)).length() < 1e-5, "{pixel}: {bound}");
        assert!((copied - Vec3::X).length() < 1e-5, "the atlas computes its own levels: {pixel}: {copied}");
    }
}

#[test]
fn bound_textures_keep_the_precision_of_their_format() {
    let Some(mut rigs) = both(9, 9) else { return };
    // Two levels of the same color.
    let flat = |texel: &[u8], side: usize| texel.repeat(side * side);
    let halves = |values: [f32; 4]| -> Vec<u8> {
        // Powers of two and their sums, which half floats represent exactly.
        values.iter().flat_map(|v| half(*v).to_le_bytes()).collect()
    };
    let shorts = |values: [u16; 4]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let floats = |values: [f32; 4]| bytemuck::cast_slice(&values).to_vec();
    // Both end points of a block: red in sixteenths, green in 32nds, blue in eighths.
    let block = [(16u16 << 11 | 32 << 5 | 8).to_le_bytes(); 2].concat().into_iter().chain([0; 4]).collect::<Vec<u8>>();
    let exact = |r: f32, g: f32, b: f32| Vec3::new(r, g, b);
    use TextureFormat as F;
    let cases = [
        ("half floats", F::Rgba16Float, halves([1024.0, 0.5, 0.0625, 1.0]), exact(1024.0, 0.5, 0.0625)),
        ("floats", F::Rgba32Float, floats([1000.0, 0.123, 3e-5, 1.0]), exact(1000.0, 0.123, 3e-5)),
        ("NaN and infinity", F::Rgba32Float, floats([f32::NAN, 1.0, f32::INFINITY, 1.0]), Vec3::ZERO),
        ("below 0", F::Rgba16Float, halves([-1.0, 0.5, -2.0, 1.0]), exact(0.0, 0.5, 0.0)),
        ("16 bits", F::Rgba16Unorm, shorts([40000, 100, 3, 65535]), exact(40000.0, 100.0, 3.0) / 65535.0),
        ("compressed", F::Bc1RgbaUnorm, block, exact(16.0 / 31.0, 32.0 / 63.0, 8.0 / 31.0)),
    ];
    for (what, format, texel, expected) in cases {
        let compressed = format == F::Bc1RgbaUnorm;
        let levels = [flat(&texel, if compressed { 1 } else { 4 }), flat(&texel, if compressed { 1 } else { 2 })];
        let needed = format.required_features();
        let [bound, copied] = rigs.each_mut().map(|rig| {
            if !rig.app.world().resource::<RenderDevice>().features().contains(needed) {
                eprintln!("{what}: skipped, the adapter has no {format:?}");
                return expected;
            }
            let image = rig.add::<Image>(image_with_levels(format, 4, 4, &levels));
            let material = StandardMaterial { emissive_texture: Some(image), ..lamp(1.0, 1.0, 1.0) };
            let entity = rig.spawn(square(4.0), material, Transform::default());
            rig.set(|restir| restir.bounces = 0);
            let got = rig.picture(1).center();
            rig.app.world_mut().despawn(entity);
            got
        });
        let error = |got: Vec3| ((got - expected).abs() / expected.max(Vec3::splat(1e-6))).max_element();
        eprintln!("{what}: relative error bound {:.1e}, copied {:.1e}", error(bound), error(copied));
        // BC1 does not define values between its end points exactly: drivers may round.
        assert!(error(bound) < if compressed { 5e-3 } else { 1e-5 }, "{what}: {bound}, not {expected}");
    }
    assert_eq!(atlas(&rigs[0]), 0, "nothing was copied to the atlas");
}

/// The bits of a half float, for values that it represents exactly.
fn half(v: f32) -> u16 {
    let bits = v.to_bits();
    if v == 0.0 { 0 } else { (bits >> 16 & 0x8000 | ((bits >> 23 & 255) - 112) << 10 | bits >> 13 & 0x3ff) as u16 }
}

/// Images change their colors, sizes and levels, disappear and come back.
#[test]
fn images_may_change_come_and_go_while_they_are_bound() {
    let Some(mut rig) = binding(24, 4) else { return };
    rig.insert(rig.camera, orthographic(24.0, 4.0));
    let mut random = Random::new(11);
    let flat = |random: &mut Random, levels: u32| {
        let color: [u8; 4] = [0; 4].map(|_: u8| random.bits() as u8);
        let log = levels.max(1) - 1 + random.bits() % 3;
        let of_level = |l: u32| color.repeat(4usize.pow(log - l));
        let levels: Vec<_> = (0..levels).map(of_level).collect();
        let expected = Vec3::new(color[0].into(), color[1].into(), color[2].into()) / 255.0;
        let mut image = image_with_levels(TextureFormat::Rgba8Unorm, 1 << log, 1 << log, &levels);
        // When an image is edited, Bevy writes its finest level over the old one and leaves the other levels as they were.
        image.texture_descriptor.usage.set(TextureUsages::COPY_DST, random.below(2) == 0);
        (image, expected)
    };
    let mut things = Vec::new();
    for i in 0..6 {
        let (image, expected) = flat(&mut random, 1 + i % 3);
        let handle = rig.add::<Image>(image);
        let material = StandardMaterial { base_color_texture: Some(handle.clone()), ..lambert(1.0) };
        let place = Transform::from_xyz(4.0 * i as f32 - 10.0, 0.0, 0.0);
        things.push((rig.spawn(square(4.0), material, place), Some(handle), expected));
    }
    for edit in 0..120 {
        let which = random.below(6);
        let levels = 1 + random.bits() % 4;
        let (new, color) = flat(&mut random, levels);
        let (entity, handle, expected) = &mut things[which];
        let material = rig.material_of(*entity);
        (*handle, *expected) = match (random.below(4), handle.take()) {
            // The last handle is dropped, and the image with it.
            (0, _) => {
                rig.edit(&material, |m| m.base_color_texture = None);
                (None, Vec3::ONE)
            }
            // The content of the asset is replaced.
            (1 | 2, Some(handle)) => {
                rig.edit(&handle, |image| *image = new);
                (Some(handle), color)
            }
            // The material gets another image.
            _ => {
                let handle = rig.add::<Image>(new);
                rig.edit(&material, |m| m.base_color_texture = Some(handle.clone()));
                (Some(handle), color)
            }
        };
        if random.below(3) == 0 {
            rig.frame();
        }
        if edit % 5 != 4 {
            continue;
        }
        let picture = rig.debug(DebugView::Albedo);
        for (i, (_, _, expected)) in things.iter().enumerate() {
            let got = picture.at(4 * i as u32 + 2, 2);
            assert!((got - expected).length() < 1e-5, "edit {edit}, thing {i}: {got}, not {expected}");
        }
    }
    rig.frames(3);
    assert_eq!(rig.report().uploaded_bytes, 0, "a still scene");
    rig.assert_sound();
    for (_, handle, _) in &things {
        if let Some(handle) = handle {
            let (flat, _) = flat(&mut random, 1);
            rig.edit(handle, |image| *image = flat);
        }
    }
    rig.until_ready();
    rig.assert_sound();
}

/// Each pixel shows its own image, so that all neighbors read different images.
#[test]
fn images_beyond_the_array_go_to_the_atlas() {
    let Some(mut rig) = binding(65, 64) else { return };
    rig.insert(rig.camera, orthographic(65.0, 64.0));
    let mesh = rig.add::<Mesh>(square(1.0));
    let color = |i: u32| [i as u8, (i >> 6) as u8, (i * 37) as u8, 255];
    for i in 0..65 * 64 {
        let levels = [color(i).repeat(4), color(i).to_vec()];
        let image = rig.add::<Image>(image_with_levels(TextureFormat::Rgba8Unorm, 2, 2, &levels));
        let material = StandardMaterial { base_color_texture: Some(image), ..lambert(1.0) };
        let material = rig.add::<StandardMaterial>(material);
        let place = Transform::from_xyz((i % 65) as f32 - 32.0, 31.5 - (i / 65) as f32, 0.0);
        rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material), place));
    }
    let picture = rig.debug(DebugView::Albedo);
    let wrong = picture.iter().filter(|(at, got)| {
        let [r, g, b, _] = color(at.y * 65 + at.x).map(|c| f32::from(c) / 255.0);
        (got - Vec3::new(r, g, b)).length() > 1e-5
    });
    assert_eq!(wrong.count(), 0);
    // 4096 images are bound; the other 64 take a page of the atlas.
    assert!(atlas(&rig) > 0 && binds(&rig));
}

/// Pipelines that read bound textures become ready frames later, both when the feature appears and when it disappears.
#[test]
fn a_bound_texture_is_right_or_missing_until_it_is_ready() {
    let Some(mut rig) = Rig::compiling_in_background(8, 8) else { return };
    if !has_arrays(&rig) {
        eprintln!("skipped: the adapter has no texture arrays");
        return;
    }
    // An image in the atlas, so that textures are already in use.
    let plain = rig.add::<Image>(texture(2, 2, |_, _| [255; 4]));
    let material = StandardMaterial { emissive_texture: Some(plain.clone()), ..lamp(1.0, 1.0, 1.0) };
    let entity = rig.spawn(square(8.0), material, Transform::default());
    assert_eq!(rig.picture(1).center(), Vec3::ONE);
    let image = image_with_levels(TextureFormat::Rgba8Unorm, 2, 2, &[[255, 0, 0, 255].repeat(4), vec![255, 0, 0, 255]]);
    let red = rig.add::<Image>(image);
    let material = rig.material_of(entity);
    for (image, expected) in [(red, Vec3::X), (plain, Vec3::ONE)] {
        rig.edit(&material, |m| m.emissive_texture = Some(image.clone()));
        for _ in 0..20 {
            let got = rig.next().center();
            assert!(got == Vec3::ONE || got == Vec3::X, "{got}");
        }
        rig.until_ready();
        assert!(binds(&rig), "the feature is kept for a while after the image");
        assert_eq!(rig.picture(1).center(), expected);
    }
}

/// An app may announce textures before it loads the first image.
#[test]
fn textures_that_are_expected_before_the_first_image_leave_the_scene_lit() {
    let Some(mut rig) = binding(16, 16) else { return };
    rig.app.insert_resource(RestirExpected { textures: true, ..default() });
    rig.set(|restir| *restir = Restir { bounces: 1, ..plain() });
    rig.insert(rig.camera, sky(1.0));
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    let picture = rig.picture(16);
    assert!(binds(&rig), "the pipelines bind textures");
    assert!((picture.center().x - 0.5).abs() < 0.2, "{}", picture.center());
    rig.assert_sound();
}
