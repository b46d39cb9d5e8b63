//! Small scenes for direct lighting: what each is there for is said where it is made.

use super::{
    app::*,
    equivalence::{Length, Restarts},
};
use bevy::prelude::*;
use bevy_restir::{BiasCorrection, Direct, Mis, RestirEnvironment, Technique};

/// Independent restarts a technique.
pub const RESTARTS: u32 = 40;
/// Frames a restart.
pub const FRAMES: u32 = 8;

/// What most claims run: few candidates, so that a wrong weight shows, and every reuse.
pub fn both() -> Direct {
    Direct { candidates: 8, subset_count: 32, subset_size: 256, spatial_taps: 2, radius: 6.0, ..Default::default() }
}

pub fn candidates_only() -> Direct {
    Direct { temporal: false, spatial_taps: 0, ..both() }
}

pub fn temporal() -> Direct {
    Direct { spatial_taps: 0, ..both() }
}

pub fn spatial() -> Direct {
    Direct { temporal: false, spatial_taps: 3, ..both() }
}

pub fn with_mis(mis: Mis) -> Direct {
    Direct { mis, ..both() }
}

/// Neighbours across edges too, so that only MIS weights keep the picture right.  Long histories would make rare bright pixels of
/// those, and of the mean of few restarts a skewed number.
pub fn careless(mis: Mis) -> Direct {
    Direct {
        mis,
        bias_correction: BiasCorrection::UnbiasedMis,
        spatial_taps: 3,
        radius: 10.0,
        confidence_cap: 4.0,
        ..both()
    }
}

/// A metal or a plastic.
pub fn shiny(color: Color, roughness: f32, metallic: f32) -> StandardMaterial {
    StandardMaterial { base_color: color, perceptual_roughness: roughness, metallic, ..default() }
}

fn facing(from: Vec3, to: Vec3) -> Transform {
    // A square faces +Z.
    Transform::from_translation(from)
        .looking_to(from - to, if (to - from).normalize().y.abs() > 0.9 { Vec3::X } else { Vec3::Y })
}

/// A room without a ceiling lamp's symmetry: walls, blocks that throw shadows, one area light.
pub fn room(rig: &mut Rig) -> Entity {
    let floor = Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(4.0), lambert(0.7), floor);
    rig.spawn(square(4.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -1.2));
    let red = StandardMaterial { base_color: Color::linear_rgb(0.8, 0.1, 0.1), ..lambert(0.0) };
    rig.spawn(
        square(4.0),
        red,
        Transform::from_xyz(-1.7, 0.0, 0.0).with_rotation(Quat::from_rotation_y(core::f32::consts::FRAC_PI_2)),
    );
    rig.spawn(square(0.8), lamp(6.0, 5.0, 4.0), facing(Vec3::new(0.5, 1.4, 0.3), Vec3::new(0.2, -1.0, 0.0)));
    rig.spawn(Cuboid::new(0.7, 0.7, 0.7), lambert(0.6), Transform::from_xyz(-0.6, -0.8, 0.2));
    rig.spawn(
        Cuboid::new(0.9, 0.1, 0.9),
        lambert(0.4),
        Transform::from_xyz(0.6, 0.1, 0.0).with_rotation(Quat::from_rotation_z(0.3)),
    )
}

/// A glossy floor with an emitter that almost touches it, a smooth ball and a rough one: the BSDF finds what lights do not.
pub fn glossy(rig: &mut Rig) {
    let floor = Transform::from_xyz(0.0, -1.0, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(5.0), shiny(Color::linear_rgb(0.5, 0.6, 0.7), 0.45, 0.8), floor);
    let up = Transform::from_xyz(0.0, -0.6, -1.0);
    let both_sides = StandardMaterial { double_sided: true, cull_mode: None, ..lamp(0.6, 0.8, 1.2) };
    rig.spawn(square(0.7), both_sides, up);
    rig.spawn(
        Sphere::new(0.4).mesh().uv(16, 10),
        shiny(Color::linear_rgb(0.9, 0.7, 0.3), 0.3, 1.0),
        Transform::from_xyz(-0.9, -0.5, 0.3),
    );
    rig.spawn(
        Sphere::new(0.4).mesh().uv(16, 10),
        shiny(Color::linear_rgb(0.3, 0.7, 0.3), 0.5, 0.0),
        Transform::from_xyz(0.9, -0.5, 0.3),
    );
    rig.spawn(square(1.0), lamp(8.0, 8.0, 8.0), facing(Vec3::new(1.0, 1.5, 1.0), Vec3::ZERO));
}

/// Deltas in position and in direction, and a cone, with shadows.
pub fn punctual(rig: &mut Rig) {
    room_without_lamp(rig);
    let point = |intensity| PointLight { intensity, ..default() };
    rig.spawn_bundle((point(40.0), Transform::from_xyz(0.9, 1.0, 0.9)));
    rig.spawn_bundle((point(10.0), Transform::from_xyz(-1.0, 0.6, 1.0)));
    let sun = Quat::from_euler(EulerRot::YXZ, 0.6, -0.8, 0.0);
    rig.spawn_bundle((DirectionalLight { illuminance: 2.0, ..default() }, Transform::from_rotation(sun)));
    let spot = SpotLight { intensity: 60.0, outer_angle: 0.6, inner_angle: 0.2, ..default() };
    rig.spawn_bundle((spot, Transform::from_xyz(0.0, 1.8, 1.0).looking_at(Vec3::new(-0.3, -1.0, 0.0), Vec3::Z)));
}

fn room_without_lamp(rig: &mut Rig) {
    let floor = Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(4.0), lambert(0.7), floor);
    rig.spawn(square(4.0), shiny(Color::linear_rgb(0.5, 0.5, 0.5), 0.4, 0.3), Transform::from_xyz(0.0, 0.0, -1.2));
    rig.spawn(Cuboid::new(0.7, 0.7, 0.7), lambert(0.6), Transform::from_xyz(-0.6, -0.8, 0.2));
    rig.spawn(Cuboid::new(0.6, 0.1, 0.6), lambert(0.4), Transform::from_xyz(0.6, 0.1, 0.0));
}

/// Light from all round, of one colour or by a map with a sun in it, and one lamp.
pub fn surrounded(rig: &mut Rig, with_map: bool) {
    room_without_lamp(rig);
    rig.spawn(square(0.5), lamp(2.0, 2.0, 2.0), facing(Vec3::new(0.9, 1.0, 0.9), Vec3::ZERO));
    let mut environment = sky(0.4);
    if with_map {
        let mut map =
            texture(
                16,
                8,
                |x, y| if (x, y) == (11, 1) { [255; 4] } else { [20 + 4 * x as u8, 30, 60 - 5 * y as u8, 255] },
            );
        map.texture_descriptor.format = bevy::render::render_resource::TextureFormat::Rgba8Unorm;
        let image = Some(rig.add::<Image>(map));
        environment = RestirEnvironment { image, rotation: Quat::from_rotation_y(0.7), ..sky(3.0) };
    }
    rig.insert(rig.camera, environment);
}

/// Twenty-four small emitters of many powers.
pub fn many(rig: &mut Rig) {
    room_without_lamp(rig);
    for i in 0..24 {
        let (a, b) = (i as f32 * 2.399, (i as f32 * 0.618).fract());
        let place = Vec3::new(1.4 * a.cos() * b.sqrt(), 0.7 + 0.8 * b, 0.3 + 0.8 * a.sin());
        let power = 1.0 + 30.0 * ((i * 7 % 24) as f32 / 24.0).powi(3);
        rig.spawn(
            Cuboid::new(0.08, 0.08, 0.08),
            lamp(power, 0.7 * power, 0.3 * power + i as f32 * 0.3),
            Transform::from_translation(place),
        );
    }
}

/// A mirror, a lacquer (a delta over a diffuse body), a lamp that the mirror shows, and an unlit square.
pub fn mirrors(rig: &mut Rig) {
    room(rig);
    let mirror = shiny(Color::linear_rgb(0.9, 0.9, 0.9), 0.0, 1.0);
    rig.spawn(
        square(1.2),
        mirror,
        Transform::from_xyz(0.8, -0.3, -0.8).with_rotation(Quat::from_euler(EulerRot::YXZ, -0.5, -0.5, 0.0)),
    );
    rig.spawn(
        Sphere::new(0.4).mesh().uv(16, 10),
        shiny(Color::linear_rgb(0.2, 0.5, 0.8), 0.0, 0.0),
        Transform::from_xyz(-0.2, -0.8, 0.8),
    );
    let unlit = StandardMaterial { unlit: true, ..Color::linear_rgb(0.2, 0.1, 0.3).into() };
    rig.spawn(square(0.4), unlit, Transform::from_xyz(-1.0, 0.7, 0.0));
}

/// Shadows of blended panes, and an emitter that is itself half there, beside a glossy wall.
pub fn blended(rig: &mut Rig) {
    glossy(rig);
    let pane = |alpha| StandardMaterial {
        base_color: Color::linear_rgba(0.5, 0.5, 0.5, alpha),
        alpha_mode: AlphaMode::Blend,
        double_sided: true,
        cull_mode: None,
        ..lambert(0.0)
    };
    rig.spawn(square(1.4), pane(0.5), facing(Vec3::new(0.4, 0.5, 0.4), Vec3::ZERO));
    let lamp = StandardMaterial {
        emissive: LinearRgba::rgb(2.0, 1.5, 1.0),
        base_color: Color::linear_rgba(0.0, 0.0, 0.0, 0.4),
        ..pane(0.4)
    };
    rig.spawn(square(0.8), lamp, Transform::from_xyz(-0.5, -0.5, -0.4).with_rotation(Quat::from_rotation_y(0.6)));
}

/// A camera and a made scene.
pub fn scene(size: u32, make: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = Rig::new(size, size)?;
    make(&mut rig);
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3, 0.2, 4.0).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
    Some(rig)
}

/// How a scene's techniques are held against its reference.
#[derive(Clone, Copy, Debug)]
pub struct Proof {
    pub ours: Length,
    pub truth: Length,
    /// Relative difference of the images that is allowed.
    pub margin: f64,
    /// Share of the pixels that is left out: those that are noisiest in a run of their own.
    pub left_out: f64,
    /// Chance decides whether the camera sees an emitter, so that each restart has an emission of its own.
    pub blended: bool,
}

impl Proof {
    /// Of a small scene without much noise.
    pub const DEFAULT: Self = Self {
        ours: Length { restarts: RESTARTS, frames: FRAMES },
        truth: Length { restarts: RESTARTS, frames: 64 },
        margin: 0.01,
        left_out: 0.0,
        blended: false,
    };

    /// Holds techniques against the reference of one scene; one that fails is run once more on other seeds.
    pub fn check(self, name: &str, rig: &mut Rig, techniques: &[(&str, Direct)]) {
        let compared = self.quiet_pixels(rig);
        let truth = |rig: &mut Rig, seed| self.restarts(rig, None, &compared, seed);
        let ours = |rig: &mut Rig, direct: &Direct, seed| self.restarts(rig, Some(direct), &compared, seed);
        let reference = truth(rig, 1000);
        for (what, direct) in techniques {
            let first = ours(rig, direct, 2000).compare(&reference, self.margin);
            eprintln!("{name}, {what}: {first}");
            if !first.is_equal() {
                let again = truth(rig, 3000);
                let second = ours(rig, direct, 4000).compare(&again, self.margin);
                eprintln!("{name}, {what}, again: {second}");
                assert!(second.is_equal(), "{name}, {what}: {first}, then {second}");
            }
        }
        rig.assert_sound();
    }

    /// Of direct lighting, or of the reference.
    pub fn restarts(
        &self,
        rig: &mut Rig,
        direct: Option<&Direct>,
        compared: &Option<Vec<bool>>,
        first_seed: u32,
    ) -> Restarts {
        let length = if direct.is_some() { self.ours } else { self.truth };
        let mut emissions = vec![emission(rig)];
        if self.blended {
            rig.set(|r| r.bounces = 0);
            emissions = pictures(rig, first_seed, length).collect();
            rig.set(|r| r.bounces = 1);
        }
        rig.set(|r| {
            r.technique = if direct.is_some() { Technique::Di } else { Technique::Reference };
            r.direct = direct.cloned().unwrap_or_default();
        });
        let mut restarts = Restarts::new(emissions[0].clone());
        restarts.compared.clone_from(compared);
        for (i, picture) in pictures(rig, first_seed, length).enumerate() {
            restarts.add_without(&picture, emissions[i % emissions.len()].clone());
        }
        restarts
    }

    /// All but the noisiest pixels of the reference: a few next to an emitter can have most of an image's noise.
    pub fn quiet_pixels(&self, rig: &mut Rig) -> Option<Vec<bool>> {
        if self.left_out <= 0.0 {
            return None;
        }
        rig.set(|r| r.technique = Technique::Reference);
        let mut sums: Vec<[f64; 2]> = Vec::new();
        let length = Length { restarts: 64, frames: 8 };
        for picture in pictures(rig, 500, length) {
            sums.resize(picture.pixels.len(), [0.0; 2]);
            for (sum, pixel) in sums.iter_mut().zip(&picture.pixels) {
                let value = f64::from(pixel.iter().sum::<f32>());
                *sum = [sum[0] + value, sum[1] + value * value];
            }
        }
        let n = f64::from(length.restarts);
        let variance = |s: &[f64; 2]| s[1] / n - (s[0] / n).powi(2);
        let mut order: Vec<usize> = (0..sums.len()).collect();
        order.sort_by(|&a, &b| variance(&sums[b]).total_cmp(&variance(&sums[a])));
        let mut quiet = vec![true; sums.len()];
        for &i in &order[..(self.left_out * sums.len() as f64) as usize] {
            quiet[i] = false;
        }
        Some(quiet)
    }
}

/// Restarts of the reference, one bounce.
pub fn truth(rig: &mut Rig, first_seed: u32, frames: u32) -> Restarts {
    let truth = Length { restarts: RESTARTS, frames };
    Proof { truth, ..Proof::DEFAULT }.restarts(rig, None, &None, first_seed)
}

/// Restarts of direct lighting: the mean of all frames from the reset on.
pub fn resampled(rig: &mut Rig, direct: &Direct, first_seed: u32, frames: u32) -> Restarts {
    let ours = Length { restarts: RESTARTS, frames };
    Proof { ours, ..Proof::DEFAULT }.restarts(rig, Some(direct), &None, first_seed)
}

/// A picture a restart: the mean of its frames.
fn pictures(rig: &mut Rig, first_seed: u32, length: Length) -> impl Iterator<Item = Picture> {
    rig.set(|r| r.accumulate = true);
    rig.until_ready();
    (0..length.restarts).map(move |i| {
        // Another seed forgets what was gathered.
        rig.set(|r| r.seed = first_seed + i);
        rig.frames(length.frames - 1);
        let picture = rig.next();
        assert_eq!(picture.samples, length.frames);
        picture
    })
}

/// What the camera sees emit, in any technique: it would hide errors of the light that is scattered.
pub fn emission(rig: &mut Rig) -> Picture {
    rig.set(|r| (r.technique, r.bounces, r.seed) = (Technique::Reference, 0, 1));
    let picture = rig.picture(1);
    rig.set(|r| r.bounces = 1);
    picture
}
