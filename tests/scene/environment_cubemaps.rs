//! Cube textures as environments: their orientation is that of Bevy's skybox, they have no seams, and samples follow their density.
//! Also: the precedence of a camera's environment, skybox and environment map light.

use crate::support::{
    app::*,
    compose::flag,
    gpu::{Gpu, gpu, wide},
    light_scene::{EnvironmentSample, LightScene},
    log,
    oracle::environment::{luminance, solid_angle, uv},
    proof::Proof,
    reuse_settings::{di, paths},
    small_scenes::surrounded_by,
    stats::{Random, Statistical, assert_family, chi_squared},
};
use bevy::{
    asset::RenderAssetUsages,
    light::{EnvironmentMapLight, Skybox},
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat, TextureViewDescriptor, TextureViewDimension},
};
use bevy_restir::{Direct, Paths, RestirEnvironment};
use glam::DVec3;

/// The faces in world space, seen from inside: center, right and down.
const FACES: [[DVec3; 3]; 6] = [
    [DVec3::X, DVec3::Z, DVec3::NEG_Y],
    [DVec3::NEG_X, DVec3::NEG_Z, DVec3::NEG_Y],
    [DVec3::Y, DVec3::X, DVec3::NEG_Z],
    [DVec3::NEG_Y, DVec3::X, DVec3::Z],
    [DVec3::NEG_Z, DVec3::X, DVec3::NEG_Y],
    [DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y],
];

/// The direction of a point on a face; coordinates from 0 to 1, right and down.
fn direction(face: usize, x: f64, y: f64) -> DVec3 {
    let [middle, right, down] = FACES[face];
    (middle + (2.0 * x - 1.0) * right + (2.0 * y - 1.0) * down).normalize()
}

#[derive(Clone)]
struct Cube {
    side: usize,
    texels: Vec<DVec3>,
}

impl Cube {
    fn new(side: usize, texel: impl Fn(usize, usize, usize) -> DVec3) -> Self {
        let at = |i: usize| texel(i / side / side, i % side, i / side % side);
        Self { side, texels: (0..6 * side * side).map(at).collect() }
    }

    fn random(side: usize) -> Self {
        let mut random = Random(side as u64);
        Self { side, texels: (0..6 * side * side).map(|_| DVec3::splat(random.unit()) + 0.02).collect() }
    }

    fn texel(&self, face: usize, x: usize, y: usize) -> DVec3 {
        self.texels[(face * self.side + y) * self.side + x]
    }

    fn words(&self) -> Vec<[f32; 4]> {
        self.texels.iter().map(|t| t.as_vec3().extend(1.0).to_array()).collect()
    }

    /// As Bevy loads a cube texture.
    fn image(&self) -> Image {
        let size = Extent3d { width: self.side as u32, height: self.side as u32, depth_or_array_layers: 6 };
        let data = bytemuck::cast_slice(&self.words()).to_vec();
        let mut image =
            Image::new(size, TextureDimension::D2, data, TextureFormat::Rgba32Float, RenderAssetUsages::all());
        let cube = Some(TextureViewDimension::Cube);
        image.texture_view_descriptor = Some(TextureViewDescriptor { dimension: cube, ..Default::default() });
        image.sampler = bevy::image::ImageSampler::linear();
        image
    }
}

fn run(lit: &LightScene, seed: u32, samples: &[EnvironmentSample]) -> Vec<EnvironmentSample> {
    lit.sample_environment(seed, samples, &["ENVIRONMENT", "ENVIRONMENT_MAP", "ENVIRONMENT_CUBE"].map(flag))
}

/// The radiance that the shader finds in these directions.
fn seen(gpu: &Gpu, cube: &Cube, directions: &[DVec3]) -> Vec<DVec3> {
    let mut lit = LightScene::new(gpu);
    lit.set_cube(cube.side as u32, &cube.words(), 16, 8);
    let asked: Vec<EnvironmentSample> = directions
        .iter()
        .map(|d| EnvironmentSample { direction: d.as_vec3().to_array(), pdf: 1.0, ..Default::default() })
        .collect();
    run(&lit, 0, &asked).iter().map(|s| wide(s.radiance)).collect()
}

#[test]
fn cube_texels_have_the_orientation_of_the_skybox() {
    let Some(gpu) = gpu() else { return };
    for side in [1, 2, 5, 8] {
        let cube = Cube::random(side);
        let places: Vec<_> =
            (0..6).flat_map(|f| (0..side).flat_map(move |y| (0..side).map(move |x| (f, x, y)))).collect();
        let middle = |i: usize| (i as f64 + 0.5) / side as f64;
        let directions: Vec<DVec3> = places.iter().map(|&(f, x, y)| direction(f, middle(x), middle(y))).collect();
        for ((face, x, y), radiance) in places.into_iter().zip(seen(gpu, &cube, &directions)) {
            let wanted = cube.texel(face, x, y);
            assert!(
                (radiance - wanted).length() < 1e-4,
                "{side}: {radiance} at ({x}, {y}) of face {face}, not {wanted}"
            );
        }
    }
}

#[test]
fn a_cube_is_bilinear_within_its_faces_and_has_no_seams() {
    let Some(gpu) = gpu() else { return };
    let cube = Cube::random(8);
    let mut random = Random(2);
    let (mut directions, mut wanted) = (Vec::new(), Vec::new());
    for i in 0..6000 {
        let (x, y) = (0.5 + 6.999 * random.unit(), 0.5 + 6.999 * random.unit());
        let (i, (s, t)) = (i % 6, ((x - 0.5).fract(), (y - 0.5).fract()));
        let at = |dx: usize, dy: usize| cube.texel(i, (x - 0.5) as usize + dx, (y - 0.5) as usize + dy);
        wanted.push(at(0, 0).lerp(at(1, 0), s).lerp(at(0, 1).lerp(at(1, 1), s), t));
        directions.push(direction(i, x / 8.0, y / 8.0));
    }
    for (radiance, wanted) in seen(gpu, &cube, &directions).into_iter().zip(wanted) {
        assert!((radiance - wanted).length() < 2e-4, "{radiance}, not {wanted}");
    }
    // Across each edge, but not around the corners: three texels meet there, and no filter is bilinear.
    let mut pairs = Vec::new();
    for face in 0..6 {
        for edge in 0..4 {
            for i in 0..100 {
                let along = 0.07 + 0.86 * f64::from(i) / 99.0;
                let at = |out: f64| match edge {
                    0 => direction(face, out, along),
                    1 => direction(face, 1.0 - out, along),
                    2 => direction(face, along, out),
                    _ => direction(face, along, 1.0 - out),
                };
                pairs.extend([at(1e-6), at(-1e-6)]);
            }
        }
    }
    for (i, both) in seen(gpu, &cube, &pairs).chunks(2).enumerate() {
        assert!((both[0] - both[1]).length() < 1e-3, "{} and {} on two sides of edge {}", both[0], both[1], i / 100);
    }
}

/// Cubes that are hard to sample.
fn hard_cubes() -> [(&'static str, Cube); 5] {
    let spike = |side: usize, at: usize| {
        Cube::new(
            side,
            move |f, x, y| if (f * side + y) * side + x == at { DVec3::splat(1e4) } else { DVec3::splat(0.01) },
        )
    };
    [
        ("random", Cube::random(4)),
        ("one face", Cube::new(4, |face, _, _| DVec3::splat(f64::from(u8::from(face == 3))))),
        ("spike", spike(16, 4 * 256 + 37)),
        ("spike in a corner", spike(16, 0)),
        ("one texel a face", Cube::random(1)),
    ]
}

/// The size of the tables.
const TABLE: (u32, u32) = (64, 32);

/// The table approximates solid angle times mean luminance, which is integrated here from the radiance that the tests above compare with
/// the texels.  A coarse grid decides the share of a cell, so that single cells at the edge of a spike may differ.
#[test]
fn the_table_of_a_cube_is_its_light_in_each_cell() {
    let Some(gpu) = gpu() else { return };
    const STEPS: u32 = 12;
    let (width, height) = TABLE;
    for (name, cube) in hard_cubes() {
        let mut lit = LightScene::new(gpu);
        let table = lit.set_cube(cube.side as u32, &cube.words(), width, height);
        // Points that are uniform in the solid angle of their cell.
        let asked: Vec<EnvironmentSample> = (0..width * height)
            .flat_map(|cell| (0..STEPS * STEPS).map(move |i| (cell, i)))
            .map(|(cell, i)| {
                let within = |k: u32| (f64::from(k) + 0.5) / f64::from(STEPS);
                let u = (f64::from(cell % width) + within(i % STEPS)) / f64::from(width);
                let cosine = |y: u32| (std::f64::consts::PI * f64::from(y) / f64::from(height)).cos();
                let y = cell / width;
                let z = cosine(y) + within(i / STEPS) * (cosine(y + 1) - cosine(y));
                let d = crate::support::oracle::environment::direction(u, z.acos() / std::f64::consts::PI);
                EnvironmentSample { direction: d.as_vec3().to_array(), pdf: 1.0, ..Default::default() }
            })
            .collect();
        let seen = run(&lit, 0, &asked);
        let light: Vec<f64> = seen
            .chunks((STEPS * STEPS) as usize)
            .zip(0..)
            .map(|(cell, i)| {
                let mean = cell.iter().map(|s| luminance(wide(s.radiance))).sum::<f64>() / cell.len() as f64;
                mean * solid_angle(i / width as usize, width as usize, height as usize)
            })
            .collect();
        let total: f64 = light.iter().sum();
        let of_table: f64 = table.iter().map(|&t| f64::from(t)).sum();
        let moved: f64 =
            table.iter().zip(&light).map(|(&t, l)| (f64::from(t) / of_table - l / total).abs()).sum::<f64>() / 2.0;
        eprintln!(
            "{name}: total off by {:+.2} %, {:.2} % in other cells",
            100.0 * (of_table / total - 1.0),
            100.0 * moved
        );
        let limit = if name.starts_with("spike") { 0.2 } else { 0.02 };
        assert!(moved < limit && (of_table / total - 1.0).abs() < limit, "{name}: {moved} {of_table} {total}");
    }
}

#[test]
fn directions_to_a_cube_follow_their_density_and_average_to_its_irradiance() {
    let Some(gpu) = gpu() else { return };
    const SAMPLES: usize = 1 << 16;
    let (width, height) = TABLE;
    let cases: Vec<_> = hard_cubes()
        .into_iter()
        .map(|(name, cube)| {
            let mut lit = LightScene::new(gpu);
            let table = lit.set_cube(cube.side as u32, &cube.words(), width, height);
            (name, lit, table)
        })
        .collect();
    assert_family(cases.iter().flat_map(|(name, lit, table)| {
        let total: f64 = table.iter().map(|&t| f64::from(t)).sum();
        let directions = move |seed: u32| {
            let mut counts = vec![0.0; table.len()];
            for s in run(lit, seed, &vec![EnvironmentSample::default(); SAMPLES]) {
                let (u, v) = uv(wide(s.direction).normalize());
                let x = ((u * f64::from(width)) as usize).min(width as usize - 1);
                let y = ((v * f64::from(height)) as usize).min(height as usize - 1);
                counts[y * width as usize + x] += 1.0;
                let exact =
                    f64::from(table[y * width as usize + x]) / total / solid_angle(y, width as usize, height as usize);
                let edge = [u * f64::from(width), v * f64::from(height)].iter().any(|t| (t - t.round()).abs() < 1e-3);
                assert!(edge || (f64::from(s.pdf) - exact).abs() <= 5e-3 * exact + 1e-5, "{name}: {s:?}, not {exact}");
            }
            let expected: Vec<f64> = table.iter().map(|&t| f64::from(t) / total * SAMPLES as f64).collect();
            chi_squared(&counts, &expected)
        };
        // ∫ L dω by a grid of directions, compared with the mean of the samples.
        let grid: Vec<EnvironmentSample> = (0..1 << 18)
            .map(|i| {
                let (z, phi) = ((i as f64 + 0.5) / f64::from(1 << 17) - 1.0, i as f64 * 2.399_963_229_728_653);
                let r = (1.0 - z * z).sqrt();
                let d = [r * phi.cos(), r * phi.sin(), z].map(|x| x as f32);
                EnvironmentSample { direction: d, pdf: 1.0, ..Default::default() }
            })
            .collect();
        let on_grid = run(lit, 0, &grid);
        let exact = on_grid.iter().map(|s| luminance(wide(s.radiance))).sum::<f64>() / on_grid.len() as f64;
        // There is no light where no sample can fall.
        let greatest = on_grid.iter().map(|s| luminance(wide(s.radiance))).fold(0.0, f64::max);
        for s in &on_grid {
            assert!(
                s.pdf_again > 0.0 || luminance(wide(s.radiance)) < 1e-4 * greatest,
                "{name}: {s:?} is never sampled"
            );
        }
        let mean = move |seed: u32| {
            let values = run(lit, seed + 20, &vec![EnvironmentSample::default(); SAMPLES]);
            let of =
                |s: &EnvironmentSample| luminance(wide(s.radiance)) / f64::from(s.pdf) / (4.0 * std::f64::consts::PI);
            let (sum, squares) = values.iter().map(of).fold((0.0, 0.0), |(a, b), e| (a + e, b + e * e));
            let n = SAMPLES as f64;
            // The grid has a relative error of a few 1e-4 at the spike.
            crate::support::stats::z_test(sum, squares + n * n * (2e-3 * exact).powi(2), n, exact)
        };
        [
            (format!("{name}, directions"), Box::new(directions) as Box<dyn Fn(u32) -> f64>),
            (format!("{name}, mean"), Box::new(mean) as Box<dyn Fn(u32) -> f64>),
        ] as [Statistical; 2]
    }));
}

/// Six colors, with a gradient to the right and one down in each face.
fn marked() -> Cube {
    Cube::new(16, |face, x, y| {
        let base = DVec3::new((face & 1) as f64, (face >> 1 & 1) as f64, (face >> 2 & 1) as f64);
        0.1 + 0.3 * base + DVec3::new(x as f64, y as f64, 8.0) / 16.0 * 0.3
    })
}

fn sky_of(rig: &mut Rig, cube: &Cube, brightness: f32, rotation: Quat) -> Skybox {
    Skybox { image: Some(rig.add::<Image>(cube.image())), brightness, rotation }
}

#[test]
fn the_backdrop_is_the_skybox_that_bevy_draws() {
    let Some(mut rig) = Rig::new(48, 32) else { return };
    let rotation = Quat::from_euler(EulerRot::YXZ, 0.4, 0.3, -0.2);
    let skybox = sky_of(&mut rig, &marked(), 1.5, rotation);
    rig.insert(rig.camera, (skybox, bevy::core_pipeline::tonemapping::Tonemapping::None, Msaa::Off));
    let looks = [Vec3::NEG_Z, Vec3::Z, Vec3::X, Vec3::new(-1.0, 1.0, 0.3), Vec3::new(0.3, -1.0, 0.2)];
    for look in looks {
        *rig.get_mut::<Transform>(rig.camera) = Transform::from_xyz(3.0, 1.0, 2.0).looking_to(look, Vec3::Y);
        let [ours, bevys] = rig.beside_bevy();
        let far = |(a, b): &(&[u8; 4], &[u8; 4])| (0..3).any(|i| a[i].abs_diff(b[i]) > 2);
        let off = ours.iter().zip(&bevys).filter(far).count();
        let range = ours.iter().map(|c| c[0]).max().zip(ours.iter().map(|c| c[0]).min());
        assert!(range.is_some_and(|(high, low)| high > low + 20), "the picture has too little contrast: {range:?}");
        assert!(off <= 4, "{off} pixels toward {look} differ; the first are {:?} and {:?}", ours[0], bevys[0]);
    }
}

#[test]
fn a_mirror_shows_the_skybox_unmirrored_and_the_skybox_lights_the_scene() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    let skybox = sky_of(&mut rig, &marked(), 2.0, Quat::IDENTITY);
    rig.insert(rig.camera, skybox.clone());
    let mirror = StandardMaterial { metallic: 1.0, perceptual_roughness: 0.0, ..Color::WHITE.into() };
    let wall = rig.spawn(square(30.0), mirror, Transform::default());
    let picture = rig.picture(1);
    for (at, color) in picture.iter() {
        // The camera looks down -Z from +5; its mirror image looks up +Z.
        let extent = (0.5 * PerspectiveProjection::default().fov).tan();
        let ndc = (at.as_vec2() + 0.5) / 16.0 * Vec2::new(2.0, -2.0) + Vec2::new(-1.0, 1.0);
        let toward = DVec3::new(f64::from(ndc.x * extent), f64::from(ndc.y * extent), 1.0);
        // Face 5 shows +Z; its right is -X.
        let (x, y) = ((0.5 - 0.5 * toward.x) * 16.0 - 0.5, (0.5 - 0.5 * toward.y) * 16.0 - 0.5);
        let wanted = 2.0 * (0.1 + 0.3 * DVec3::new(1.0, 0.0, 1.0) + DVec3::new(x, y, 8.0) / 16.0 * 0.3);
        assert!((color.as_dvec3() - wanted).length() < 1e-2, "{color} at {at}, not {wanted}");
    }
    // A white plane shows the mean of the half space in front of it.
    let white = rig.add::<StandardMaterial>(lambert(1.0));
    rig.insert(wall, MeshMaterial3d(white));
    let lit = rig.picture(256).mean();
    let (mut sum, mut weight) = (0.0, 0.0);
    let cube = marked();
    for (face, [toward, ..]) in FACES.into_iter().enumerate() {
        for (x, y) in (0..16).flat_map(|y| (0..16).map(move |x| (x, y))) {
            let d = direction(face, (x as f64 + 0.5) / 16.0, (y as f64 + 0.5) / 16.0);
            let middle = toward.dot(d);
            sum += 2.0 * cube.texel(face, x, y).element_sum() / 3.0 * d.z.max(0.0) * middle.powi(3);
            weight += d.z.max(0.0) * middle.powi(3);
        }
    }
    assert!((lit / (sum / weight) - 1.0).abs() < 0.01, "{lit}, not {}", sum / weight);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_cameras_environment_precedes_its_skybox_and_the_skybox_its_map_light() {
    log::listen();
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, orthographic(2.0, 2.0));
    rig.spawn(square(1.0), lambert(1.0), Transform::from_xyz(-0.5, 0.0, 0.0));
    let flat = |value: f64| Cube::new(2, move |_, _, _| DVec3::splat(value));
    let of = |rig: &mut Rig, value: f64| rig.add::<Image>(flat(value).image());
    // (the radiance of the square, the backdrop beside it)
    let shown = |rig: &mut Rig| {
        let picture = rig.picture(64);
        rig.assert_sound();
        (picture.at(4, 8).x, picture.at(12, 8).x)
    };
    let near = |a: (f32, f32), b: (f32, f32)| (a.0 - b.0).abs() < 0.05 * b.0 + 1e-4 && (a.1 - b.1).abs() < 1e-3;
    let specular_map = of(&mut rig, 0.5);
    let map_light =
        EnvironmentMapLight { diffuse_map: specular_map.clone(), specular_map, intensity: 3.0, ..default() };
    rig.insert(rig.camera, map_light.clone());
    let seen = shown(&mut rig);
    assert!(near(seen, (1.5, 0.0)), "the map light lights but is not the backdrop: {seen:?}");
    let image = of(&mut rig, 0.25);
    rig.insert(rig.camera, Skybox { image: Some(image.clone()), brightness: 2.0, ..default() });
    let seen = shown(&mut rig);
    assert!(near(seen, (0.5, 0.5)), "the skybox: {seen:?}");
    // The image gets new texels.
    rig.edit(&image, |image| *image = flat(1.0).image());
    let seen = shown(&mut rig);
    assert!(near(seen, (2.0, 2.0)), "the skybox, changed: {seen:?}");
    rig.insert(rig.camera, sky(0.125));
    let seen = shown(&mut rig);
    assert!(near(seen, (0.125, 0.125)), "the camera's own environment: {seen:?}");
    rig.app.world_mut().entity_mut(rig.camera).remove::<RestirEnvironment>();
    rig.insert(rig.camera, Skybox { image: None, brightness: 2.0, ..default() });
    let seen = shown(&mut rig);
    assert!(near(seen, (1.5, 0.0)), "without an image there is no skybox: {seen:?}");
    // A texture that is not a cube is rejected with one warning.
    let image = rig.add::<Image>(texture(8, 4, |_, _| [255; 4]));
    let name = format!("{}", image.id());
    rig.insert(rig.camera, Skybox { image: Some(image), brightness: 2.0, ..default() });
    let seen = shown(&mut rig);
    assert!(near(seen, (0.0, 0.0)), "not a cube: {seen:?}");
    rig.frames(3);
    let warnings = log::warnings("is not a color cube that shaders can read");
    assert_eq!(warnings.iter().filter(|line| line.contains(&name)).count(), 1, "{warnings:?}");
    rig.insert(rig.camera, EnvironmentMapLight { intensity: f32::NAN, ..map_light.clone() });
    rig.app.world_mut().entity_mut(rig.camera).remove::<Skybox>();
    let seen = shown(&mut rig);
    assert!(near(seen, (0.0, 0.0)), "no brightness: {seen:?}");
    assert_eq!(log::warnings("the intensity of its EnvironmentMapLight is not finite").len(), 1);
    let turned = EnvironmentMapLight { rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..map_light };
    rig.insert(rig.camera, turned);
    let seen = shown(&mut rig);
    assert!(near(seen, (0.0, 0.0)), "no rotation: {seen:?}");
    assert_eq!(log::warnings("the rotation of its EnvironmentMapLight is not finite, or has the length 0").len(), 1);
}

#[test]
fn an_environment_image_that_is_being_loaded_emits_nothing() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.spawn(square(1.0), lambert(1.0), Transform::default());
    let (arrive, arrival) = std::sync::mpsc::channel();
    let server = rig.app.world().resource::<AssetServer>().clone();
    let image = server.add_async(async move { arrival.recv().map(|()| texture(4, 2, |_, _| [255; 4])) });
    rig.insert(rig.camera, RestirEnvironment { image: Some(image), ..sky(2.0) });
    rig.get_mut::<Camera>(rig.camera).clear_color = ClearColorConfig::Custom(Color::linear_rgb(0.5, 0.5, 0.5));
    rig.frames(4);
    let picture = rig.next();
    assert_eq!(picture.center(), Vec3::ZERO);
    assert!(picture.at(0, 0).x > 0.0, "the clear color");
    arrive.send(()).expect("the task waits");
    let picture = rig.picture(32);
    assert_eq!(picture.at(0, 0), Vec3::splat(2.0));
    assert!((picture.center() - 2.0).abs().max_element() < 0.4, "{}", picture.center());
    rig.assert_sound();
}

/// As in Bevy's examples: a column of six faces is loaded as a 2D image and reinterpreted as a cube frames later.
#[test]
fn a_skybox_is_shown_once_its_image_becomes_a_cube() {
    log::listen();
    let Some(mut rig) = Rig::new(8, 8) else { return };
    let cube = Cube::new(4, |_, _, _| DVec3::new(0.25, 0.5, 1.0)).image();
    let mut stacked = cube.clone();
    stacked.texture_descriptor.size = Extent3d { width: 4, height: 24, depth_or_array_layers: 1 };
    stacked.texture_view_descriptor = None;
    let image = rig.add::<Image>(stacked);
    let name = format!("{}", image.id());
    rig.insert(rig.camera, Skybox { image: Some(image.clone()), brightness: 1.0, ..default() });
    assert_eq!(rig.picture(1).center(), Vec3::ZERO);
    let warning_count = || {
        log::warnings("is not a color cube that shaders can read").iter().filter(|line| line.contains(&name)).count()
    };
    assert_eq!(warning_count(), 1);
    rig.edit(&image, |image| *image = cube);
    let got = rig.picture(1).center();
    assert!((got - Vec3::new(0.25, 0.5, 1.0)).length() < 1e-5, "{got}");
    assert_eq!(warning_count(), 1);
}

/// The frames of one camera accumulate while the sky of another camera changes.
#[test]
fn a_change_of_a_sky_resets_no_other_camera() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    let flat = |value: f64| Cube::new(2, move |_, _, _| DVec3::splat(value)).image();
    let [first, second] = [0.25, 0.5].map(|value| rig.add::<Image>(flat(value)));
    rig.insert(rig.camera, Skybox { image: Some(first.clone()), brightness: 1.0, ..default() });
    let target = rig.add::<Image>(target_image(UVec2::splat(8)));
    rig.spawn_bundle((
        Camera3d::default(),
        Camera { order: 1, ..default() },
        bevy::camera::RenderTarget::Image(bevy::camera::ImageRenderTarget::from(target)),
        unit_exposure(),
        plain(),
        Skybox { image: Some(second.clone()), brightness: 1.0, ..default() },
    ));
    let before = rig.picture(3).samples;
    rig.edit(&second, |image| *image = flat(0.75));
    rig.frames(2);
    assert_eq!(rig.next().samples, before + 3, "the sky of the other camera changed");
    rig.edit(&first, |image| *image = flat(0.75));
    rig.frames(2);
    assert!(rig.next().samples < before + 3, "its own sky changed");
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_resampled_light_of_a_cube_is_that_of_the_reference() {
    let make = |rig: &mut Rig| {
        let cube = Cube::new(8, |face, x, y| match (face, x, y) {
            (2, 5, 1) => DVec3::new(80.0, 70.0, 50.0),
            _ => DVec3::new(0.1 + 0.05 * x as f64, 0.3, 0.2 + 0.04 * face as f64),
        });
        surrounded_by(rig, |rig| {
            let skybox = sky_of(rig, &cube, 1.0, Quat::from_rotation_y(0.7));
            rig.insert(rig.camera, skybox);
        });
    };
    let Some(mut rig) = crate::support::small_scenes::scene(64, make) else { return };
    let direct: Direct = di::all_reuse();
    Proof { margin: 0.02, ..Proof::of((12, 8), (12, 24)) }.check("cube, direct", &mut rig, &[("both", direct)]);
    let paths: Paths = paths::all_reuse();
    Proof { bounces: 2, margin: 0.02, ..Proof::of((12, 8), (12, 24)) }.check(
        "cube, paths",
        &mut rig,
        &[("both", paths)],
    );
}
