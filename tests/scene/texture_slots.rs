//! Every texture slot of a material, its transform and its texture coordinates affect the right parameter.

use crate::support::{
    app::*,
    compose::{Def, flag},
    gpu::{Bound, Gpu, gpu},
    light_scene::{IDENTITY, LightScene},
    oracle::texture::srgb_to_linear,
    stats::Random,
};
use bevy::{math::Affine2, mesh::UvChannel, prelude::*};
use bevy_restir::{
    DebugView, SceneFeatures,
    testing::{
        gpu_layout::*,
        shared_numbers::{LEVELS_SHIFT, NEAREST, SECOND_UV, TWO_COMPONENTS},
    },
};
use bytemuck::{Pod, Zeroable};

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct At {
    barycentrics: [f32; 2],
    width: f32,
    pad: f32,
    wo: [f32; 3],
    pad_b: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
struct Point {
    base_color: [f32; 3],
    metallic: f32,
    emission: [f32; 3],
    perceptual_roughness: f32,
    dielectric_reflectance: [f32; 3],
    specular_transmission: f32,
    normal: [f32; 3],
    alpha: f32,
    emission_of_light: [f32; 3],
    diffuse_transmission: f32,
    coat_normal: [f32; 3],
    thickness: f32,
    anisotropy_direction: [f32; 2],
    anisotropy_strength: f32,
    clearcoat: f32,
    clearcoat_perceptual_roughness: f32,
    pad: [f32; 7],
}

fn points(lit: &LightScene, at: &[At], defs: &[&'static str]) -> Vec<Point> {
    let (input, output) = (lit.gpu.storage(at), lit.gpu.zeroed::<Point>(at.len()));
    let bound = [(2, 0, Bound::Buffer(&input)), (2, 1, Bound::Buffer(&output))];
    let defs: Vec<Def> = defs.iter().copied().map(flag).collect();
    let kernel = include_str!("../support/kernels/material_point.wgsl");
    lit.run("material_point", kernel, &defs, at.len() as u32, &bound);
    lit.gpu.read(&output)
}

/// A triangle whose texture coordinates are its barycentric coordinates.
fn triangle(gpu: &Gpu) -> LightScene<'_> {
    let mut lit = LightScene::new(gpu);
    lit.set_triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    lit.instances = vec![GpuInstance {
        world_from_object: IDENTITY,
        object_from_world: IDENTITY,
        triangle_count: 1,
        ..Default::default()
    }];
    lit
}

fn factors() -> GpuMaterial {
    GpuMaterial {
        base_color: [0.9, 0.8, 0.7],
        alpha: 0.6,
        emissive: [10.0, 20.0, 30.0],
        perceptual_roughness: 0.9,
        dielectric_reflectance: [0.16, 0.08, 0.04],
        metallic: 0.8,
        specular_transmission: 0.7,
        diffuse_transmission: 0.6,
        thickness: 0.5,
        clearcoat: 0.9,
        clearcoat_perceptual_roughness: 0.4,
        anisotropy_direction: [0.6, 0.8],
        anisotropy_strength: 0.7,
        ..Default::default()
    }
}

/// The parameters of a material with the slots of `mask`, whose texels are `texel`.
fn expected_point(factors: &GpuMaterial, mask: u32, texel: impl Fn(u32) -> [f32; 4]) -> Point {
    let has = |kind: u32| mask & kind != 0;
    let mut expected = Point {
        base_color: factors.base_color,
        metallic: factors.metallic,
        emission: factors.emissive,
        perceptual_roughness: factors.perceptual_roughness,
        dielectric_reflectance: factors.dielectric_reflectance,
        specular_transmission: factors.specular_transmission,
        normal: [0.0, 0.0, 1.0],
        alpha: factors.alpha,
        emission_of_light: factors.emissive,
        diffuse_transmission: factors.diffuse_transmission,
        coat_normal: [0.0, 0.0, 1.0],
        thickness: factors.thickness,
        anisotropy_direction: factors.anisotropy_direction,
        anisotropy_strength: factors.anisotropy_strength,
        clearcoat: factors.clearcoat,
        clearcoat_perceptual_roughness: factors.clearcoat_perceptual_roughness,
        pad: [0.0; 7],
    };
    let times = |a: [f32; 3], b: [f32; 4]| core::array::from_fn(|i| a[i] * b[i]);
    if has(SLOT_BASE_COLOR) {
        expected.base_color = times(expected.base_color, texel(SLOT_BASE_COLOR));
        expected.alpha *= texel(SLOT_BASE_COLOR)[3];
    }
    if has(SLOT_METALLIC_ROUGHNESS) {
        expected.metallic *= texel(SLOT_METALLIC_ROUGHNESS)[2];
        expected.perceptual_roughness *= texel(SLOT_METALLIC_ROUGHNESS)[1];
    }
    if has(SLOT_NORMAL) {
        let [x, y, z, _] = texel(SLOT_NORMAL);
        expected.normal = [x, y, z].map(|c| 2.0 * c - 1.0);
    }
    if has(SLOT_EMISSIVE) {
        expected.emission = times(expected.emission, texel(SLOT_EMISSIVE));
        expected.emission_of_light = expected.emission;
    }
    if has(SLOT_SPECULAR_TRANSMISSION) {
        expected.specular_transmission *= texel(SLOT_SPECULAR_TRANSMISSION)[0];
    }
    if has(SLOT_DIFFUSE_TRANSMISSION) {
        expected.diffuse_transmission *= texel(SLOT_DIFFUSE_TRANSMISSION)[3];
    }
    if has(SLOT_THICKNESS) {
        expected.thickness *= texel(SLOT_THICKNESS)[1];
    }
    if has(SLOT_CLEARCOAT) {
        expected.clearcoat *= texel(SLOT_CLEARCOAT)[0];
    }
    if has(SLOT_CLEARCOAT_ROUGHNESS) {
        expected.clearcoat_perceptual_roughness *= texel(SLOT_CLEARCOAT_ROUGHNESS)[1];
    }
    if has(SLOT_CLEARCOAT_NORMAL) {
        let [x, y, z, _] = texel(SLOT_CLEARCOAT_NORMAL);
        expected.coat_normal = [x, y, z].map(|c| 2.0 * c - 1.0);
    }
    if has(SLOT_ANISOTROPY) {
        // The angles add up.
        let [x, y, strength, _] = texel(SLOT_ANISOTROPY);
        let angle = (2.0 * y - 1.0).atan2(2.0 * x - 1.0) + 0.8f32.atan2(0.6);
        expected.anisotropy_direction = [angle.cos(), angle.sin()];
        expected.anisotropy_strength *= strength;
    }
    if has(SLOT_SPECULAR) {
        let reflectance = 0.5 * texel(SLOT_SPECULAR)[3];
        expected.dielectric_reflectance = expected.dielectric_reflectance.map(|f| f * reflectance * reflectance);
    }
    if has(SLOT_SPECULAR_TINT) {
        let tint = texel(SLOT_SPECULAR_TINT);
        expected.dielectric_reflectance = times(times(expected.dielectric_reflectance, tint), tint);
    }
    expected
}

/// Every slot alone and all together: each slot scales its own parameter by its own channels.
#[test]
fn every_texture_slot_scales_its_own_parameter() {
    let Some(gpu) = gpu() else { return };
    let mut lit = triangle(gpu);
    for (i, texel) in lit.atlas.iter_mut().enumerate() {
        let i = i as u8;
        *texel = [40 + 10 * i, 200 - 7 * i, 90 + 9 * i, 130 + 5 * i];
    }
    let factors = factors();
    let kinds: [u32; 13] = core::array::from_fn(|i| 1 << i);
    // Each slot reads one texel of the atlas.
    let slot = |i: u32| [1 << LEVELS_SHIFT, (i % 4) | ((i / 4) << 16), 1 | 1 << 16, 0];
    let all = kinds.iter().fold(0, |all, kind| all | kind);
    for mask in kinds.into_iter().chain([0, all, all & !SLOT_NORMAL, SLOT_EMISSIVE | SLOT_SPECULAR_TINT]) {
        let texel = |kind: u32| lit.atlas[kind.trailing_zeros() as usize].map(|c| f32::from(c) / 255.0);
        // The record of the slot is not the first of the table.
        let mut table = vec![[u32::MAX; 4]; 3];
        table.extend((0..32).filter(|i| mask >> i & 1 != 0).map(slot));
        let expected = expected_point(&factors, mask, texel);
        lit.table = table;
        lit.materials = vec![GpuMaterial { textures: mask, texture_record: 3, ..factors }];
        let at = At { barycentrics: [0.3, 0.2], wo: [0.0, 0.0, 1.0], ..Default::default() };
        let got = points(&lit, &[at], &["TEXTURES", "LAYER_TEXTURES"])[0];
        let numbers = |p: &Point| bytemuck::cast::<Point, [f32; 36]>(*p);
        let (a, b) = (numbers(&got), numbers(&expected));
        let worst = a.iter().zip(b).map(|(a, b)| (a - b).abs() / b.abs().max(1.0)).fold(0.0, f32::max);
        assert!(worst < 1e-5, "{mask:b}: {got:?}, not {expected:?}");
    }

    // Two components of a normal determine the third.
    let mut pair = slot(2);
    pair[0] |= TWO_COMPONENTS;
    lit.table = vec![pair];
    lit.materials = vec![GpuMaterial { textures: SLOT_NORMAL, flags: MATERIAL_FLIP_NORMAL_MAP_Y, ..factors }];
    let [x, y, ..] = lit.atlas[2].map(|c| f32::from(c) / 127.5 - 1.0);
    let expected = Vec3::new(x, -y, (1.0 - x * x - y * y).sqrt());
    let at = At { barycentrics: [0.3, 0.2], wo: [0.0, 0.0, 1.0], ..Default::default() };
    let got = Vec3::from(points(&lit, &[at], &["TEXTURES"])[0].normal);
    assert!((got - expected).length() < 1e-5, "{got}, not {expected}");
}

/// The nearest texel of a 4 x 4 image with transformed coordinates of either channel, for surfaces, lights and alpha.
#[test]
fn transforms_and_second_coordinates_choose_the_texel() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random(7);
    let mut lit = triangle(gpu);
    for (i, texel) in lit.atlas.iter_mut().enumerate() {
        *texel = [10 * i as u8, 15 * i as u8, 255 - 10 * i as u8, 100 + 10 * i as u8];
    }
    let second = [[0.4, 0.9], [-1.3, 0.2], [0.7, 2.1f32]];
    lit.second_uvs = vec![second];
    let (mut checked, mut skipped) = (0, 0);
    for case in 0..16 {
        let (transforms, by_second, has_second) = (case & 1 != 0, case & 2 != 0, case & 4 != 0);
        let transform = Affine2::from_scale_angle_translation(
            Vec2::new(1.0 + random.unit() as f32, -0.7),
            6.0 * random.unit() as f32,
            Vec2::new(random.unit() as f32, 3.0),
        );
        let mut slot = [NEAREST | 1 << LEVELS_SHIFT, 0, 4 | 4 << 16, 0];
        slot[0] |= if by_second { SECOND_UV } else { 0 };
        let kinds = SLOT_BASE_COLOR | SLOT_EMISSIVE;
        lit.table = vec![slot; 2];
        let mut textures = kinds;
        if transforms {
            let [a, b, c, d] = transform.matrix2.to_cols_array().map(f32::to_bits);
            lit.table =
                vec![[a, b, c, d], [transform.translation.x.to_bits(), transform.translation.y.to_bits(), 0, 0]];
            lit.table.extend([slot; 2]);
            textures |= SLOT_TRANSFORM;
        }
        lit.materials = vec![GpuMaterial { textures, emissive: [1.0; 3], ..Default::default() }];
        lit.instances[0].flags = if has_second { INSTANCE_SECOND_UV } else { 0 };
        let at: Vec<At> = (0..256)
            .map(|_| {
                let (a, b) = (random.unit() as f32, random.unit() as f32);
                let barycentrics = if a + b < 1.0 { [a, b] } else { [1.0 - a, 1.0 - b] };
                At { barycentrics, wo: [0.0, 0.6, 0.8], ..Default::default() }
            })
            .collect();
        for (at, got) in at.iter().zip(points(&lit, &at, &["TEXTURES", "SECOND_UVS"])) {
            let [b, c] = at.barycentrics;
            let corners = if by_second && has_second { second } else { [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] };
            let [p, q, r] = corners.map(Vec2::from);
            let mut uv = (1.0 - b - c) * p + b * q + c * r;
            if transforms {
                uv = transform.transform_point2(uv);
            }
            let cell = 4.0 * uv;
            if (cell - cell.round()).abs().min_element() < 1e-3 {
                skipped += 1;
                continue;
            }
            let (x, y) = (cell.x.floor().rem_euclid(4.0) as usize, cell.y.floor().rem_euclid(4.0) as usize);
            let texel = lit.atlas[4 * y + x].map(|c| f32::from(c) / 255.0);
            let expected = Vec3::new(texel[0], texel[1], texel[2]);
            assert!((Vec3::from(got.base_color) - expected).length() < 1e-5, "case {case}: {got:?}, not {texel:?}");
            assert!((Vec3::from(got.emission_of_light) - expected).length() < 1e-5, "case {case}: {got:?}");
            assert!((got.alpha - texel[3]).abs() < 1e-5, "case {case}: {got:?}");
            checked += 1;
        }
    }
    assert!(checked > 3000 && skipped < 200, "{checked} and {skipped}");
}

fn albedo(rig: &mut Rig) -> Vec3 {
    rig.debug(DebugView::Albedo).center()
}

fn bytes(rig: &Rig, name: &str) -> u64 {
    rig.report().memory.iter().find(|(item, _)| *item == name).map_or(0, |(_, bytes)| *bytes)
}

#[test]
fn a_material_may_change_its_uv_transform_and_uv_channel() {
    let Some(mut rig) = Rig::new(17, 17) else { return };
    let image = rig.add::<Image>(texture(2, 2, |x, y| [100 * x as u8, 200 * y as u8, 50, 255]));
    let linear = |x: u8, y: u8| {
        Vec3::new(100.0 * f32::from(x), 200.0 * f32::from(y), 50.0).map(|c| srgb_to_linear(f64::from(c) / 255.0) as f32)
    };
    // The second coordinates choose the lower right texel everywhere.
    let mesh = square(4.0).with_inserted_attribute(Mesh::ATTRIBUTE_UV_1, vec![[0.75f32, 0.75]; 4]);
    let material = StandardMaterial { base_color_texture: Some(image), ..lambert(1.0) };
    let entity = rig.spawn(mesh, material, Transform::from_xyz(0.5, 0.5, 0.0));
    let material = rig.material_of(entity);
    let check = |rig: &mut Rig, what: &str, expected: Vec3| {
        let got = albedo(rig);
        assert!((got - expected).length() < 0.004, "{what}: {got}, not {expected}");
    };
    check(&mut rig, "lower left", linear(0, 1));
    assert_eq!(bytes(&rig, "second texture coordinates"), 0);
    rig.edit(&material, |m| m.base_color_channel = UvChannel::Uv1);
    check(&mut rig, "second coordinates", linear(1, 1));
    assert!(bytes(&rig, "second texture coordinates") > 0);
    assert!(rig.report().features.contains(SceneFeatures::SECOND_UVS));
    rig.edit(&material, |m| m.uv_transform = Affine2::from_translation(Vec2::new(-0.5, 0.0)));
    check(&mut rig, "second coordinates, moved", linear(0, 1));
    // The frame that first does without them still shades the surfaces of the frame before.
    rig.edit(&material, |m| m.uv_transform = Affine2::IDENTITY);
    check(&mut rig, "second coordinates", linear(1, 1));
    rig.set(|restir| restir.debug_view = DebugView::Albedo);
    rig.frames(3);
    rig.edit(&material, |m| m.base_color_channel = UvChannel::Uv0);
    let shows_first = |rig: &mut Rig| (rig.next().center() - linear(0, 1)).length() < 0.004;
    let waited = (0..10).take_while(|_| !shows_first(&mut rig)).count();
    assert!(waited < 10 && bytes(&rig, "second texture coordinates") > 0, "after {waited} frames");
    rig.frame();
    assert_eq!(bytes(&rig, "second texture coordinates"), 0);
    check(&mut rig, "first coordinates", linear(0, 1));
    rig.edit(&material, |m| m.uv_transform = Affine2::from_translation(Vec2::new(-0.5, 0.0)));
    rig.edit(&material, |m| m.uv_transform = StandardMaterial::FLIP_VERTICAL);
    check(&mut rig, "flipped", linear(0, 0));
    rig.edit(&material, |m| m.uv_transform = Affine2::from_scale(Vec2::splat(f32::NAN)));
    check(&mut rig, "no transform", linear(0, 1));
    // A turn in the other direction would choose a texel on the right.
    let turn = Affine2::from_angle_translation(core::f32::consts::FRAC_PI_2, Vec2::new(1.0, 0.0));
    rig.edit(&material, |m| m.uv_transform = turn);
    check(&mut rig, "turned", linear(0, 0));
    rig.edit(&material, |m| m.uv_transform = Affine2::IDENTITY);
    // A mesh without second coordinates uses its first.
    let mesh = rig.add::<Mesh>(square(4.0));
    rig.insert(entity, Mesh3d(mesh));
    rig.edit(&material, |m| m.base_color_channel = UvChannel::Uv1);
    check(&mut rig, "another mesh", linear(0, 1));
    rig.frames(3);
    assert_eq!(rig.report().uploaded_bytes, 0, "a still scene");
}
