//! Texture sampling equals the f64 oracle: wrap modes, filters, levels and encodings.

use crate::support::{
    app::*,
    gpu::{Bound, Gpu, gpu},
    light_scene::texture as gpu_texture,
    oracle::texture::{Level, Texture, Wrap, srgb_to_linear},
    stats::Random,
};
use bevy::{prelude::*, render::render_resource::TextureFormat};
use bevy_restir::{
    DebugView,
    testing::shared_numbers::{CLAMP_U, CLAMP_V, LEVELS_SHIFT, MIRROR_U, MIRROR_V, NEAREST, SHARED_EXPONENT, SRGB},
};
use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3, DVec4};

/// Kinds of wrapping and their flags of both axes.
const WRAPS: [(Wrap, u32, u32); 3] =
    [(Wrap::Repeat, 0, 0), (Wrap::Clamp, CLAMP_U, CLAMP_V), (Wrap::Mirror, MIRROR_U, MIRROR_V)];

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Query {
    slot: [u32; 4],
    uv: [f32; 2],
    axis_a: [f32; 2],
    axis_b: [f32; 2],
    pad: [f32; 2],
}

fn decoded(bytes: [u8; 4], flags: u32) -> DVec4 {
    let [r, g, b, a] = bytes.map(|c| f64::from(c) / 255.0);
    if flags & SHARED_EXPONENT != 0 {
        return (DVec3::new(r, g, b) * (a * 255.0 - 128.0).exp2()).extend(1.0);
    }
    let curve = |c| if flags & SRGB != 0 { srgb_to_linear(c) } else { c };
    DVec4::new(curve(r), curve(g), curve(b), a)
}

/// A page of noise of 64 x 64 texels with its levels; any part of it serves as a texture, and the rest surrounds it.
struct Page {
    levels: Vec<Vec<[u8; 4]>>,
}

impl Page {
    const SIDE: usize = 64;

    fn new(random: &mut Random) -> Self {
        let side = |level: usize| Self::SIDE >> level;
        let mut byte = || (random.unit() * 256.0) as u8;
        // Shared exponents in the range of real pictures.
        let levels = (0..7).map(|l| (0..side(l).pow(2)).map(|_| [byte(), byte(), byte(), byte() / 16 + 124]).collect());
        Self { levels: levels.collect() }
    }

    /// The texture at this place of the page.
    fn texture(&self, corner: [usize; 2], size: [usize; 2], wrap: [Wrap; 2], flags: u32) -> Texture {
        let count = size[0].min(size[1]).ilog2() as usize + 1;
        let level = |l: usize| {
            Level::new(size[0] >> l, size[1] >> l, |x, y| {
                let at = ((corner[1] >> l) + y) * (Self::SIDE >> l) + (corner[0] >> l) + x;
                decoded(self.levels[l][at], flags)
            })
        };
        Texture { levels: (0..count).map(level).collect(), wrap, nearest: flags & NEAREST != 0 }
    }
}

fn run(gpu: &Gpu, page: &Page, queries: &[Query]) -> Vec<[DVec4; 2]> {
    let levels = page.levels.iter().enumerate().map(|(l, texels)| (64 >> l, 64 >> l, bytemuck::cast_slice(texels)));
    let levels: Vec<_> = levels.collect();
    let atlas = gpu_texture(gpu, wgpu::TextureFormat::Rgba8Unorm, &levels).create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    });
    let (input, output) = (gpu.storage(queries), gpu.zeroed::<[[f32; 4]; 2]>(queries.len()));
    let bound = [(0, 7, Bound::Texture(&atlas)), (1, 0, Bound::Buffer(&input)), (1, 1, Bound::Buffer(&output))];
    let kernel = gpu.kernel("texture_sample", include_str!("../support/kernels/texture_sample.wgsl"), &[]);
    kernel.run([queries.len().div_ceil(64) as u32, 1, 1], &bound);
    let wide = |c: [f32; 4]| DVec4::from_array(c.map(f64::from));
    gpu.read::<[[f32; 4]; 2]>(&output).into_iter().map(|both| both.map(wide)).collect()
}

#[test]
fn textures_are_sampled_as_the_oracle_samples_them() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random(5);
    let page = Page::new(&mut random);
    let mut queries = Vec::new();
    let mut expected = Vec::new();
    for case in 0..20_000 {
        let mut below = |n: usize| (random.unit() * n as f64) as usize;
        let (size, wraps) = ([1 + below(24), 1 + below(24)], [WRAPS[below(3)], WRAPS[below(3)]]);
        let corner = [below(Page::SIDE - size[0]), below(Page::SIDE - size[1])];
        let flags = [0, NEAREST, SRGB, SHARED_EXPONENT][case % 4];
        let levels = size[0].min(size[1]).ilog2() + 1;
        let mut vector = |scale: f64| [0, 1].map(|_| ((random.unit() - 0.5) * scale) as f32);
        let uv = vector(6.0);
        // Footprints from a thousandth of the texture to all of it, isotropic and stretched.
        let axes = [vector(10f64.powi(case as i32 / 4 % 4 - 3)), vector(10f64.powi(case as i32 / 16 % 4 - 3))];
        queries.push(Query {
            slot: [
                flags | wraps[0].1 | wraps[1].2 | levels << LEVELS_SHIFT,
                (corner[0] | corner[1] << 16) as u32,
                (size[0] | size[1] << 16) as u32,
                0,
            ],
            uv,
            axis_a: axes[0],
            axis_b: axes[1],
            pad: [0.0; 2],
        });
        let texture = page.texture(corner, size, wraps.map(|w| w.0), flags);
        let wide = |v: [f32; 2]| DVec2::from_array(v.map(f64::from));
        expected.push([texture.sample_level(0, wide(uv)), texture.sample_area(wide(uv), axes.map(wide))]);
    }
    let mut off = [0; 2];
    for (got, expected) in run(gpu, &page, &queries).iter().zip(&expected) {
        for i in 0..2 {
            let scale = expected[i].max_element().max(1.0);
            off[i] += u32::from((got[i] - expected[i]).abs().max_element() >= 2e-4 * scale || !got[i].is_finite());
        }
    }
    // Within rounding of a border, the nearest texel and the number of taps may differ.
    eprintln!("off: {off:?} of {}", queries.len());
    assert!(off[0] <= 10 && off[1] <= 20, "{off:?}");
}

/// The recipe for footprints, which shader and oracle share, blurs about as much as the mean over an ellipse of twice the footprint, as
/// trilinear filters do.  Waves show it: a filter of another width or direction passes too much or too little of them.
#[test]
fn the_recipe_for_footprints_is_near_the_mean_over_an_ellipse() {
    const SIDE: usize = 64;
    let mut random = Random(8);
    let (mut errors, mut mean) = ([0.0f64; 3], 0.0f64);
    for _ in 0..10 {
        // Whole waves across the texture, so that it repeats without a seam.
        let wave = [0, 1].map(|_| (random.unit() * 11.0).floor() - 5.0);
        let wave = if wave == [0.0; 2] { [3.0, 2.0] } else { wave };
        let phase =
            |x: usize, y: usize| std::f64::consts::TAU / SIDE as f64 * (wave[0] * x as f64 + wave[1] * y as f64);
        let level = Level::new(SIDE, SIDE, |x, y| DVec4::splat(phase(x, y).cos()));
        let texture = Texture::new(level, [Wrap::Repeat; 2], false);
        for _ in 0..30 {
            // An ellipse at most four times as long as wide, of 2 to 16 texels, and two of its conjugate diameters.
            let long = (2.0 + 14.0 * random.unit()) / SIDE as f64;
            let turn = DVec2::from_angle(6.3 * random.unit());
            let short = turn.perp() * long * (0.25 + 0.75 * random.unit());
            let (s, c) = (6.3 * random.unit()).sin_cos();
            let axes = [c * turn * long + s * short, c * short - s * turn * long];
            let uv = DVec2::new(random.unit(), random.unit());
            let wanted = texture.mean_over_ellipse(uv, axes).x;
            mean += wanted * wanted / 300.0;
            for (i, scale) in [0.5, 1.0, 0.1].into_iter().enumerate() {
                errors[i] += (texture.sample_area(uv, axes.map(|a| scale * a)).x - wanted).powi(2) / 300.0;
            }
        }
    }
    let [half, whole, narrow] = errors.map(f64::sqrt);
    let mean = mean.sqrt();
    eprintln!("errors: {half:.3} of {mean:.3}; of a footprint as large: {whole:.3}; of a tenth: {narrow:.3}");
    assert!(half < 0.2 * mean && whole > 1.5 * half && narrow > 1.5 * half, "{half} {whole} {narrow}");
}

#[test]
fn extreme_coordinates_and_footprints_give_finite_colors() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random(6);
    let page = Page::new(&mut random);
    let extremes = [0.0, 1e-30, 1.0, 1e6, 3e38, -3e38];
    let mut queries = Vec::new();
    for u in extremes {
        for a in extremes {
            for slot in [[3 << LEVELS_SHIFT, 0, 4 | 4 << 16, 0], [0xff_0000, 5, 1 | 7 << 16, 0], [0; 4]] {
                queries.push(Query { slot, uv: [u, -u], axis_a: [a, u], axis_b: [-a, a], pad: [0.0; 2] });
            }
        }
    }
    for (query, colors) in queries.iter().zip(run(gpu, &page, &queries)) {
        assert!(colors.iter().all(|c| c.is_finite() && c.abs().max_element() <= 65536.0), "{query:?}: {colors:?}");
    }
}

/// An image of any format.
fn image(format: TextureFormat, width: u32, height: u32, data: Vec<u8>) -> Image {
    let mut image = texture(width, height, |_, _| [0; 4]);
    image.texture_descriptor.format = format;
    image.data = Some(data);
    image
}

#[test]
fn linear_and_float_images_keep_their_values() {
    let Some(mut rig) = Rig::new(9, 9) else { return };
    // 128 is 0.502 without a transfer curve.
    let linear = image(TextureFormat::Rgba8Unorm, 1, 1, vec![128, 64, 0, 255]);
    let linear = rig.add::<Image>(linear);
    let entity = rig.spawn(
        square(4.0),
        StandardMaterial { base_color_texture: Some(linear), ..lambert(1.0) },
        Transform::default(),
    );
    let got = rig.debug(DebugView::Albedo).center();
    assert!((got - Vec3::new(128.0, 64.0, 0.0) / 255.0).length() < 1e-5, "{got}");

    // Values far above and far below 1, each in its own texel.
    let hot = [1000.0, 0.5, 20.0, 1.0f32];
    let values = [hot, [3e-5, 2e-5, 1e-5, 1.0], [f32::NAN, 1.0, f32::INFINITY, 1.0], [0.0, 0.0, 0.0, 1.0]];
    let data = bytemuck::cast_slice(&values).to_vec();
    let lights = rig.add::<Image>(image(TextureFormat::Rgba32Float, 2, 2, data));
    let material = rig.material_of(entity);
    rig.edit(&material, |m| {
        m.emissive_texture = Some(lights);
        m.emissive = LinearRgba::rgb(2.0, 2.0, 2.0);
        m.base_color_texture = None;
        m.base_color = Color::BLACK;
    });
    rig.set(|restir| restir.bounces = 0);
    for (corner, value) in
        [(Vec2::new(1.0, -1.0), values[0]), (Vec2::new(-1.0, -1.0), values[1]), (Vec2::new(1.0, 1.0), [0.0; 4])]
    {
        *rig.get_mut::<Transform>(entity) = Transform::from_translation(corner.extend(0.0));
        let got = rig.picture(1).center();
        let expected = 2.0 * Vec3::new(value[0], value[1], value[2]);
        // The shared exponent leaves eight bits below the largest component.
        let error = (got - expected).abs().max_element();
        assert!(error <= expected.max_element() / 250.0, "{got}, not {expected}");
    }
    rig.assert_sound();
}

/// A texel of a float texture may be above 1, but a surface reflects at most the light that it receives.
#[test]
fn texels_above_one_do_not_leave_the_ranges_of_a_material() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, (orthographic(1.0, 1.0), sky(1.0)));
    let texel = [10.0, 0.5, 2.0, 1.0f32];
    let floats = rig.add::<Image>(image(TextureFormat::Rgba32Float, 1, 1, bytemuck::cast_slice(&texel).to_vec()));
    // Roughness and metallic are in the green and the blue channel.
    let metal = StandardMaterial { metallic: 1.0, perceptual_roughness: 1.0, ..lambert(0.5) };
    let textured = StandardMaterial { metallic_roughness_texture: Some(floats.clone()), ..metal.clone() };
    let lit = StandardMaterial { base_color_texture: Some(floats), ..lambert(1.0) };
    for (name, textured, wanted) in [
        ("metallic", textured, StandardMaterial { perceptual_roughness: 0.5, ..metal }),
        ("base color", lit, StandardMaterial { base_color: Color::linear_rgb(1.0, 0.5, 1.0), ..lambert(1.0) }),
    ] {
        let [got, wanted] = [textured, wanted].map(|m| {
            let object = rig.spawn(square(4.0), m, Transform::default());
            let seen = rig.picture(16).center();
            rig.app.world_mut().despawn(object);
            seen
        });
        // The texture atlas has eight bits for each channel.
        assert!((got - wanted).abs().max_element() < 3e-3, "{name}: {got}, not {wanted}");
    }
    rig.assert_sound();
}
