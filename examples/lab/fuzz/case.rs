//! A random scene, camera and settings, with random edits, as data: a case that fails can be repeated and made smaller.

use bevy::{
    camera::ScalingMode,
    math::{Affine2, Vec3Swizzles},
    prelude::*,
    render::render_resource::Face,
};
use bevy_restir::{
    Direct, Jitter, LightTechniques, Mis, Preset, Reconnection, Restir, RestirEnvironment, Reuse, ReuseOrder,
    Subsurface, SubsurfaceShift, SuffixRetrace, Technique,
};
use bevy_restir_support::{fields, scenes::Random, skinned};

use crate::things::{PICTURES, Shape, Thing, picture};

/// Numbers at the edges of what an app may write.
const EDGES: [f32; 14] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-40,
    1e-30,
    1e-6,
    1e6,
    1e20,
    3e38,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
    f32::MIN_POSITIVE,
];

/// Fields that [`Source::settings`] chooses by itself, and fields that keep their defaults: values of debug views may be negative.
const NOT_DRAWN: [&str; 6] = ["technique", "bounces", "seed", "reset", "debug_view", "debug_scale"];

/// Frames after those that wait for the scene; edits are before one of them.
pub const LAST_FRAME: u32 = 7;

#[derive(Clone, Debug)]
pub struct Case {
    /// Size of the picture.
    pub size: UVec2,
    pub things: Vec<Thing>,
    pub camera: (Transform, Projection),
    pub environment: Option<RestirEnvironment>,
    pub settings: Restir,
    /// Edits, and the frames (1 to [`LAST_FRAME`]) before which they are made.
    pub edits: Vec<(u32, Edit)>,
    /// No number is at an edge of what an app may write.
    pub is_ordinary: bool,
}

#[derive(Clone, Debug)]
pub enum Edit {
    Move(usize, Transform),
    Despawn(usize),
    Paint(usize, Box<StandardMaterial>),
    /// Joints of a tube or weights of a sheet.
    Pose(usize, Vec<Transform>, [f32; 2]),
    MoveCamera(Transform),
    Environment(RestirEnvironment),
    Settings(Box<Restir>),
    Resize(UVec2),
}

impl Case {
    /// The case of a seed, with a picture of at most this size.
    pub fn new(seed: u64, largest: UVec2) -> Self {
        let mut source = Source::new(seed, largest);
        let size = source.size();
        let mut things = vec![source.floor()];
        things.extend((0..1 + source.random.below(8)).map(|_| source.thing()));
        let camera = (source.eye(), source.projection());
        let environment = source.chance(0.5).then(|| source.environment());
        let settings = source.settings();
        let edits = (0..source.random.below(5))
            .map(|_| (1 + source.random.below(LAST_FRAME as usize) as u32, source.edit(things.len(), &settings)))
            .collect();
        Self { size, things, camera, environment, settings, edits, is_ordinary: source.edges == 0.0 }
    }

    /// Smaller cases: each lacks one thing or one edit of this case, or has a simpler one in its place.
    pub fn smaller(&self) -> Vec<Self> {
        let mut all = Vec::new();
        for i in 0..self.edits.len() {
            let mut edits = self.edits.clone();
            edits.remove(i);
            all.push(Self { edits, ..self.clone() });
        }
        for i in 0..self.things.len() {
            let mut things = self.things.clone();
            things.remove(i);
            let touches = |edit: &Edit| matches!(edit, Edit::Move(t, _) | Edit::Despawn(t) | Edit::Paint(t, _) | Edit::Pose(t, ..) if *t >= i);
            if !self.edits.iter().any(|(_, edit)| touches(edit)) {
                all.push(Self { things, ..self.clone() });
            }
        }
        for (i, thing) in self.things.iter().enumerate() {
            for simpler in thing.simpler() {
                let mut things = self.things.clone();
                things[i] = simpler;
                all.push(Self { things, ..self.clone() });
            }
        }
        if self.environment.is_some() {
            all.push(Self { environment: None, ..self.clone() });
        }
        if self.size != UVec2::ONE {
            all.push(Self { size: UVec2::ONE, ..self.clone() });
        }
        let simpler =
            [Technique::Reference, self.settings.technique].map(|technique| Restir { technique, ..default() });
        for settings in simpler {
            if self.settings != settings {
                all.push(Self { settings, ..self.clone() });
            }
        }
        all
    }
}

impl Thing {
    /// Variants of this object, each with one property less.
    fn simpler(&self) -> Vec<Self> {
        let Self::Object { shape, material, subsurface, at } = self else { return Vec::new() };
        let object = |shape: &Shape, material: StandardMaterial, subsurface, at| Self::Object {
            shape: shape.clone(),
            material: Box::new(material),
            subsurface,
            at,
        };
        let mut all: Vec<_> = simpler_materials(material)
            .into_iter()
            .filter(|simpler| format!("{simpler:?}") != format!("{material:?}"))
            .map(|material| object(shape, material, *subsurface, *at))
            .collect();
        let material = || (**material).clone();
        if subsurface.is_some() {
            all.push(object(shape, material(), None, *at));
        }
        match shape {
            Shape::Soup(corners) if corners.len() > 3 => {
                all.push(object(&Shape::Soup(corners[..corners.len() / 6 * 3].to_vec()), material(), *subsurface, *at));
                all.push(object(&Shape::Cube, material(), *subsurface, *at));
            }
            Shape::Ball | Shape::Tube(_) | Shape::Sheet(_) => {
                all.push(object(&Shape::Cube, material(), *subsurface, *at));
            }
            _ => {}
        }
        if at.scale != Vec3::ONE {
            all.push(object(shape, material(), *subsurface, at.with_scale(Vec3::ONE)));
        }
        if at.rotation != Quat::IDENTITY {
            all.push(object(shape, material(), *subsurface, at.with_rotation(Quat::IDENTITY)));
        }
        all
    }
}

/// Materials that have one property less.
fn simpler_materials(material: &StandardMaterial) -> Vec<StandardMaterial> {
    let (from, plain) = (|| material.clone(), StandardMaterial::default());
    vec![
        plain.clone(),
        StandardMaterial { base_color: plain.base_color, ..from() },
        StandardMaterial {
            base_color_texture: None,
            emissive_texture: None,
            metallic_roughness_texture: None,
            normal_map_texture: None,
            ..from()
        },
        StandardMaterial { uv_transform: plain.uv_transform, ..from() },
        StandardMaterial { emissive: plain.emissive, ..from() },
        StandardMaterial { perceptual_roughness: plain.perceptual_roughness, ..from() },
        StandardMaterial { metallic: plain.metallic, ..from() },
        StandardMaterial { reflectance: plain.reflectance, ..from() },
        StandardMaterial { specular_transmission: plain.specular_transmission, ..from() },
        StandardMaterial { ior: plain.ior, ..from() },
        StandardMaterial { thickness: plain.thickness, ..from() },
        StandardMaterial {
            attenuation_color: plain.attenuation_color,
            attenuation_distance: plain.attenuation_distance,
            ..from()
        },
        StandardMaterial { diffuse_transmission: plain.diffuse_transmission, ..from() },
        StandardMaterial { clearcoat: plain.clearcoat, ..from() },
        StandardMaterial { clearcoat_perceptual_roughness: plain.clearcoat_perceptual_roughness, ..from() },
        StandardMaterial { anisotropy_strength: plain.anisotropy_strength, ..from() },
        StandardMaterial { anisotropy_rotation: plain.anisotropy_rotation, ..from() },
        StandardMaterial { alpha_mode: plain.alpha_mode, ..from() },
        StandardMaterial { double_sided: plain.double_sided, cull_mode: plain.cull_mode, ..from() },
    ]
}

/// Source of random values; in some cases a few of them are at the edges of what an app may write ([`EDGES`]).
struct Source {
    random: Random,
    /// Share of numbers that are at an edge.
    edges: f32,
    /// The greatest size of a picture.
    largest: UVec2,
}

impl Source {
    fn new(seed: u64, largest: UVec2) -> Self {
        let mut random = Random::new(seed);
        let edges = [0.0, 0.0, 0.005, 0.03][random.below(4)];
        Self { random, edges, largest }
    }

    /// The greatest size, or a random one.
    fn size(&mut self) -> UVec2 {
        if self.chance(0.5) {
            return self.largest;
        }
        let UVec2 { x, y } = self.largest;
        UVec2::new(1 + self.random.below(x as usize) as u32, 1 + self.random.below(y as usize) as u32)
    }

    /// Mostly none.
    fn texture(&mut self) -> Option<Handle<Image>> {
        self.chance(0.3).then(|| self.picture())
    }

    fn picture(&mut self) -> Handle<Image> {
        let last = PICTURES - 1;
        picture(if self.chance(self.edges) { last } else { self.random.below(last) })
    }

    fn chance(&mut self, probability: f32) -> bool {
        self.random.unit() < probability
    }

    fn number(&mut self, low: f32, high: f32) -> f32 {
        if self.chance(self.edges) { EDGES[self.random.below(EDGES.len())] } else { self.random.range(low, high) }
    }

    fn vector(&mut self, low: f32, high: f32) -> Vec3 {
        Vec3::from_array(core::array::from_fn(|_| self.number(low, high)))
    }

    fn color(&mut self, high: f32) -> LinearRgba {
        let [r, g, b] = self.vector(0.0, high).to_array();
        LinearRgba::rgb(r, g, b)
    }

    fn rotation(&mut self) -> Quat {
        Quat::from_euler(EulerRot::XYZ, self.number(-3.2, 3.2), self.number(-1.6, 1.6), self.number(-3.2, 3.2))
    }

    fn place(&mut self) -> Transform {
        let scale = match self.random.below(4) {
            0 => self.vector(0.1, 2.0),
            // Mirrored, or flat.
            1 => self.vector(-1.5, 1.5),
            _ => Vec3::splat(self.number(0.2, 1.5)),
        };
        Transform { translation: self.vector(-2.0, 2.0), rotation: self.rotation(), scale }
    }

    fn eye(&mut self) -> Transform {
        // The position is always legal: cameras that cannot render are not tested here.
        let [x, y, z] = self.random.point(3.0);
        Transform::from_xyz(x, y.abs() + 0.2, z + 4.0).looking_at(Vec3::ZERO, Vec3::Y)
    }

    fn projection(&mut self) -> Projection {
        if self.chance(0.2) {
            let scaling_mode = ScalingMode::FixedVertical { viewport_height: self.random.range(1.0, 6.0) };
            return Projection::Orthographic(OrthographicProjection {
                scaling_mode,
                ..OrthographicProjection::default_3d()
            });
        }
        Projection::Perspective(PerspectiveProjection { fov: self.random.range(0.2, 2.0), ..default() })
    }

    fn material(&mut self) -> Box<StandardMaterial> {
        let emissive = if self.chance(0.2) { self.color(20.0) } else { LinearRgba::BLACK };
        let mut material = StandardMaterial {
            base_color: Color::LinearRgba(self.color(1.0).with_alpha(self.number(0.0, 1.0))),
            emissive,
            perceptual_roughness: self.number(0.0, 1.0),
            reflectance: self.number(0.0, 1.0),
            double_sided: self.chance(0.5),
            cull_mode: [None, Some(Face::Back), Some(Face::Front)][self.random.below(3)],
            unlit: self.chance(0.05),
            ..default()
        };
        if self.chance(0.3) {
            material.metallic = self.number(0.0, 1.0);
        }
        if self.chance(0.3) {
            material.base_color_texture = self.texture();
            material.emissive_texture = self.texture();
            material.metallic_roughness_texture = self.texture();
            material.normal_map_texture = self.texture();
            let (scale, turn, offset) = (self.vector(-3.0, 3.0), self.number(-3.2, 3.2), self.vector(-1.0, 1.0));
            material.uv_transform = Affine2::from_scale_angle_translation(scale.xy(), turn, offset.xy());
        }
        if self.chance(0.2) {
            material.alpha_mode =
                [AlphaMode::Mask(self.number(0.0, 1.0)), AlphaMode::Blend, AlphaMode::Add][self.random.below(3)];
        }
        if self.chance(0.2) {
            (material.specular_transmission, material.ior) = (self.number(0.0, 1.0), self.number(1.0, 2.0));
            material.thickness = if self.chance(0.5) { self.number(0.0, 1.0) } else { 0.0 };
            (material.attenuation_color, material.attenuation_distance) =
                (Color::LinearRgba(self.color(1.0)), self.number(0.1, 2.0));
        }
        if self.chance(0.15) {
            material.diffuse_transmission = self.number(0.0, 1.0);
        }
        if self.chance(0.15) {
            (material.clearcoat, material.clearcoat_perceptual_roughness) =
                (self.number(0.0, 1.0), self.number(0.0, 1.0));
        }
        if self.chance(0.15) {
            (material.anisotropy_strength, material.anisotropy_rotation) =
                (self.number(0.0, 1.0), self.number(0.0, 6.0));
        }
        Box::new(material)
    }

    fn floor(&mut self) -> Thing {
        let at = Transform::from_xyz(0.0, -1.0, 0.0)
            .with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2))
            .with_scale(Vec3::splat(8.0));
        Thing::Object { shape: Shape::Square, material: self.material(), subsurface: None, at }
    }

    fn thing(&mut self) -> Thing {
        let at = self.place();
        match self.random.below(10) {
            0 => Thing::Point(
                PointLight {
                    intensity: self.number(0.0, 1e3),
                    color: Color::LinearRgba(self.color(1.0)),
                    radius: if self.chance(0.5) { self.number(0.0, 0.5) } else { 0.0 },
                    ..default()
                },
                at,
            ),
            1 => Thing::Spot(
                SpotLight {
                    intensity: self.number(0.0, 1e3),
                    outer_angle: self.number(0.0, 1.5),
                    inner_angle: self.number(0.0, 1.0),
                    radius: if self.chance(0.5) { self.number(0.0, 0.3) } else { 0.0 },
                    ..default()
                },
                at,
            ),
            2 => Thing::Rect(
                RectLight {
                    intensity: self.number(0.0, 1e3),
                    width: self.number(0.0, 1.0),
                    height: self.number(0.0, 1.0),
                    ..default()
                },
                at,
            ),
            3 => {
                let disk = self.chance(0.5).then(|| self.number(0.0, 0.5));
                Thing::Sun(DirectionalLight { illuminance: self.number(0.0, 20.0), ..default() }, disk, at)
            }
            _ => {
                let subsurface = self
                    .chance(0.15)
                    .then(|| Subsurface { mean_free_path: self.vector(0.0, 0.3), weight: self.number(0.0, 1.0) });
                Thing::Object { shape: self.shape(), material: self.material(), subsurface, at }
            }
        }
    }

    fn joints(&mut self) -> Vec<Transform> {
        if self.chance(0.1) {
            return (0..skinned::JOINTS).map(|_| self.place()).collect();
        }
        let (foot, time) = (self.place(), self.random.range(0.0, 9.0));
        skinned::swaying(foot, time, self.random.range(0.0, 3.0))
    }

    fn weights(&mut self) -> [f32; 2] {
        [self.number(-1.0, 1.0), self.number(-1.0, 1.0)]
    }

    fn shape(&mut self) -> Shape {
        match self.random.below(7) {
            5 => Shape::Tube(self.joints()),
            6 => Shape::Sheet(self.weights()),
            0 => Shape::Square,
            1 => Shape::Cube,
            2 => {
                let corners = 3 * (1 + self.random.below(20));
                Shape::Soup((0..corners).map(|_| self.vector(-0.7, 0.7).to_array()).collect())
            }
            _ => Shape::Ball,
        }
    }

    fn environment(&mut self) -> RestirEnvironment {
        RestirEnvironment {
            color: self.color(1.0),
            // A picture of one color stands for no picture, because fewer kinds of environments compile fewer pipelines.
            image: Some(self.picture()),
            intensity: self.number(0.0, 2.0),
            rotation: self.rotation(),
        }
    }

    fn settings(&mut self) -> Restir {
        let mut settings = Restir {
            technique: Technique::ALL[self.random.below(Technique::ALL.len())],
            ..Restir::preset(Preset::ALL[self.random.below(Preset::ALL.len())])
        };
        settings.bounces = self.random.below(9) as u32;
        settings.seed = self.random.bits();
        settings.jitter = [Jitter::Auto, Jitter::Always, Jitter::Never][self.random.below(3)];
        settings.energy_compensation = self.chance(0.8);
        settings.direct.candidates = 1 + self.random.below(16) as u32;
        settings.paths.candidates = 1 + self.random.below(16) as u32;
        settings.paths.separate_direct_light = self.chance(0.2);
        settings.paths.reconnection = [
            Reconnection::Footprints,
            Reconnection::BlackBox,
            Reconnection::BlackBoxPrinted,
            Reconnection::JacobianBound,
            Reconnection::PathFootprint,
            Reconnection::Distance,
        ][self.random.below(6)];
        settings.paths.suffix_retrace =
            [SuffixRetrace::BothWays, SuffixRetrace::ForwardOnly, SuffixRetrace::Off][self.random.below(3)];
        settings.paths.jacobian_limit = self.number(1.0, 20.0);
        settings.paths.footprint = self.number(0.0, 1.0);
        settings.paths.roughness = self.number(0.0, 1.0);
        settings.direct = Direct { subset_count: [0, 16, 128][self.random.below(3)], ..settings.direct.clone() };
        settings.bdpt.techniques =
            [LightTechniques::Full, LightTechniques::Lightweight, LightTechniques::NoLightTracing]
                [self.random.below(3)];
        settings.subsurface.shift = [
            SubsurfaceShift::Reconnection,
            SubsurfaceShift::Delayed,
            SubsurfaceShift::Hybrid,
            SubsurfaceShift::Sequential,
        ][self.random.below(4)];
        // All other fields, including those that future versions add.
        for path in fields::paths().iter().filter(|path| !NOT_DRAWN.contains(&path.as_str())) {
            if self.chance(0.04) {
                fields::draw(&mut settings, path, self.random.unit());
            }
        }
        for reuse in [&mut settings.direct.reuse, &mut settings.paths.reuse, &mut settings.subsurface.reuse] {
            *reuse = self.reuse(reuse);
        }
        settings
    }

    fn reuse(&mut self, preset: &Reuse) -> Reuse {
        Reuse {
            order: [ReuseOrder::Spatiotemporal, ReuseOrder::TemporalThenSpatial][self.random.below(2)],
            temporal: self.chance(0.8),
            bilinear: self.chance(0.3),
            spatial_samples: self.random.below(6) as u32,
            spatial_iterations: 1 + self.random.below(3) as u32,
            paired: self.chance(0.5),
            radius: self.number(0.0, 400.0),
            confidence_cap: self.number(0.0, 30.0),
            mis: [Mis::OneOverZ, Mis::Balance, Mis::Pairwise, Mis::DefensivePairwise, Mis::DefensivePairwiseGris]
                [self.random.below(5)],
            normal_threshold: self.number(-1.0, 1.0),
            depth_threshold: self.number(0.0, 0.5),
            ..preset.clone()
        }
    }

    fn edit(&mut self, things: usize, settings: &Restir) -> Edit {
        let thing = self.random.below(things);
        match self.random.below(10) {
            9 => Edit::Resize(self.size()),
            7 | 8 => Edit::Pose(thing, self.joints(), self.weights()),
            0 | 1 => Edit::Move(thing, self.place()),
            2 => Edit::Despawn(thing),
            3 => Edit::Paint(thing, self.material()),
            4 => Edit::MoveCamera(self.eye()),
            5 => Edit::Environment(self.environment()),
            _ => Edit::Settings(Box::new(Restir { technique: settings.technique, ..self.settings() })),
        }
    }
}
