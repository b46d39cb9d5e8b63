//! An app that renders cases, one after the other.

use bevy::{
    asset::RenderAssetUsages, light::SunDisk, mesh::morph::MeshMorphWeights, prelude::*,
    render::render_resource::TextureFormat,
};
use bevy_restir::{RayBackend, Restir, RestirEnvironment, RestirStatistics, Subsurface, testing::check_mirror};
use bevy_restir_support::{
    exposure::unit_exposure,
    headless::{self, captured, frame},
    scene::{self, CameraSetup, View},
    skinned,
};
use std::path::Path;

use super::case::{Case, Edit, LAST_FRAME, Shape, Thing};

/// Frames in which a scene must be loaded, built and compiled.
const PATIENCE: u32 = 200;
/// Frames until the counters of a frame have arrived from the GPU.
const LATE: u32 = 3;
/// Checks that may fail: light beyond the range of f32, and more hits of a probe than are counted.
const EXPECTED: [&str; 2] = ["float_overflow", "overflow_probe"];
/// The bit of [`RestirReport::overflow_flags`](bevy_restir::RestirReport) for such a probe.
const PROBE_OVERFLOW: u32 = 1 << 19;

pub struct Stage {
    app: App,
    /// What the last case has spawned.
    spawned: Vec<Entity>,
}

impl Stage {
    /// `everything`: the scene always has an object or a light with each feature, so that shaders are compiled once.
    pub fn new(size: UVec2, everything: bool) -> Result<Self, String> {
        let mut app = headless::app(Path::new("."), RayBackend::Auto)?;
        check_mirror(&mut app, true);
        let setup = CameraSetup { size, exposure: unit_exposure(), environment: None, settings: Restir::default() };
        let place = (Transform::default(), Projection::default());
        scene::spawn_camera(app.world_mut(), place, setup);
        if everything {
            spawn_everything(app.world_mut());
        }
        Ok(Self { app, spawned: Vec::new() })
    }

    pub fn run(&mut self, case: &Case) -> Result<(), String> {
        self.set_up(case);
        let ready = |app: &App| {
            let report = app.world().resource::<RestirStatistics>().report();
            report.ready && report.samples > 0
        };
        // A change is extracted in the first frame and reported in the second.
        self.frame()?;
        for waited in 0.. {
            self.frame()?;
            if ready(&self.app) {
                break;
            }
            if waited > PATIENCE {
                return Err(format!("the scene is not ready after {PATIENCE} frames"));
            }
        }
        for number in 1..=LAST_FRAME {
            for (_, edit) in case.edits.iter().filter(|(frame, _)| *frame == number) {
                self.edit(edit);
            }
            self.frame()?;
        }
        self.app.world().resource::<View>().capture.request();
        self.frame()?;
        let picture = captured(&self.app)?;
        if let Some(pixel) = picture.mean().flatten().find(|c| !c.is_finite() || *c < 0.0) {
            return Err(format!("a pixel is {pixel}"));
        }
        for _ in 0..LATE {
            self.frame()?;
        }
        self.check()
    }

    pub fn has_failed(&self) -> bool {
        self.app.should_exit().is_some()
    }

    /// Guards, overflows and pixels of the frames since the start of the case.
    fn check(&self) -> Result<(), String> {
        let report = self.app.world().resource::<RestirStatistics>().report();
        let raised: Vec<String> = report
            .raised_guards()
            .iter()
            .filter(|(name, _)| !EXPECTED.contains(name))
            .map(|(name, pixels)| format!("guard {name} in {pixels} pixels"))
            .collect();
        if !raised.is_empty() {
            return Err(raised.join(", "));
        }
        if report.overflow_flags & !PROBE_OVERFLOW != 0 || report.non_finite_pixels != 0 {
            return Err(format!(
                "overflow {:#x}, {} pixels not finite",
                report.overflow_flags, report.non_finite_pixels
            ));
        }
        Ok(())
    }

    fn frame(&mut self) -> Result<(), String> {
        frame(&mut self.app);
        match self.app.should_exit() {
            Some(_) => Err("the renderer failed".into()),
            None => Ok(()),
        }
    }

    fn set_up(&mut self, case: &Case) {
        let world = self.app.world_mut();
        for entity in self.spawned.drain(..) {
            world.despawn(entity);
        }
        self.spawned = case.things.iter().map(|thing| spawn(world, thing)).collect();
        let camera = world.resource::<View>().camera;
        let mut camera = world.entity_mut(camera);
        camera.insert((case.camera.0, case.camera.1.clone(), Restir { reset: true, ..case.settings.clone() }));
        match &case.environment {
            Some(environment) => camera.insert(environment.clone()),
            None => camera.remove::<RestirEnvironment>(),
        };
        world.resource::<RestirStatistics>().reset_guards();
    }

    fn edit(&mut self, edit: &Edit) {
        let world = self.app.world_mut();
        let camera = world.resource::<View>().camera;
        match edit {
            Edit::MoveCamera(to) => _ = world.entity_mut(camera).insert(*to),
            Edit::Environment(environment) => _ = world.entity_mut(camera).insert(environment.clone()),
            Edit::Settings(settings) => _ = world.entity_mut(camera).insert((**settings).clone()),
            Edit::Move(thing, to) => {
                if let Ok(mut thing) = world.get_entity_mut(self.spawned[*thing]) {
                    thing.insert(*to);
                }
            }
            Edit::Despawn(thing) => {
                if let Ok(thing) = world.get_entity_mut(self.spawned[*thing]) {
                    thing.despawn();
                }
            }
            Edit::Pose(thing, joints, weights) => {
                let body = self.spawned[*thing];
                skinned::set_joints(world, body, joints);
                if let Some(mut morph) = world.get_mut::<MeshMorphWeights>(body) {
                    *morph = MeshMorphWeights::Value { weights: weights.to_vec() };
                }
            }
            Edit::Paint(thing, material) => {
                let entity = self.spawned[*thing];
                let painted = world.get::<MeshMaterial3d<StandardMaterial>>(entity).map(|painted| painted.id());
                if let Some(id) = painted
                    && let Some(mut asset) = world.resource_mut::<Assets<StandardMaterial>>().get_mut(id)
                {
                    *asset = (**material).clone();
                }
            }
        }
    }
}

fn spawn(world: &mut World, thing: &Thing) -> Entity {
    match thing {
        Thing::Object { shape, material, subsurface, at } => {
            let entity = spawn_object(world, shape, (**material).clone(), *at);
            if let Some(subsurface) = subsurface {
                world.entity_mut(entity).insert(*subsurface);
            }
            entity
        }
        Thing::Point(light, at) => world.spawn((*light, *at)).id(),
        Thing::Spot(light, at) => world.spawn((*light, *at)).id(),
        Thing::Rect(light, at) => world.spawn((*light, *at)).id(),
        Thing::Sun(light, disk, at) => {
            let mut sun = world.spawn((*light, *at));
            if let Some(angular_size) = *disk {
                sun.insert(SunDisk { angular_size, ..SunDisk::EARTH });
            }
            sun.id()
        }
    }
}

fn spawn_object(world: &mut World, shape: &Shape, material: StandardMaterial, at: Transform) -> Entity {
    let mesh = world.resource_mut::<Assets<Mesh>>().add(shape.mesh());
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
    let object = world.spawn((Mesh3d(mesh), MeshMaterial3d(material), at)).id();
    match shape {
        Shape::Tube(joints) => {
            let skin = skinned::skin(world);
            world.entity_mut(object).insert(skin);
            skinned::set_joints(world, object, joints);
        }
        Shape::Sheet(weights) => {
            world.entity_mut(object).insert(MeshMorphWeights::Value { weights: weights.to_vec() });
        }
        _ => {}
    }
    object
}

/// Small objects and faint lights with all features, far away.
fn spawn_everything(world: &mut World) {
    let texture = Image::new_fill(
        bevy::render::render_resource::Extent3d { width: 2, height: 2, ..default() },
        bevy::render::render_resource::TextureDimension::D2,
        &[128, 128, 255, 255],
        TextureFormat::Rgba8Unorm,
        RenderAssetUsages::all(),
    );
    let texture = world.resource_mut::<Assets<Image>>().add(texture);
    let tinted = StandardMaterial {
        base_color_texture: Some(texture.clone()),
        normal_map_texture: Some(texture),
        alpha_mode: AlphaMode::Mask(0.5),
        specular_transmission: 0.5,
        diffuse_transmission: 0.2,
        attenuation_color: Color::linear_rgb(0.5, 0.9, 0.5),
        attenuation_distance: 1.0,
        clearcoat: 0.5,
        anisotropy_strength: 0.5,
        ..default()
    };
    let materials = [
        tinted.clone(),
        StandardMaterial { thickness: 0.1, ..tinted },
        StandardMaterial { unlit: true, ..default() },
        StandardMaterial { emissive: LinearRgba::rgb(0.01, 0.01, 0.01), ..default() },
    ];
    let place = |i: usize| Transform::from_xyz(50.0 + 2.0 * i as f32, 80.0, 0.0).with_scale(Vec3::splat(0.1));
    for (i, material) in materials.into_iter().enumerate() {
        let object = spawn_object(world, &Shape::Ball, material, place(i));
        if i == 3 {
            world.entity_mut(object).insert(Subsurface::default());
        }
    }
    let joints = skinned::swaying(place(4), 0.0, 1.0);
    spawn_object(world, &Shape::Tube(joints), StandardMaterial::default(), place(4));
    world.spawn((PointLight { intensity: 0.01, radius: 0.0, ..default() }, place(5)));
    world.spawn((PointLight { intensity: 0.01, radius: 0.1, ..default() }, place(6)));
    world.spawn((RectLight { intensity: 0.01, ..default() }, place(7)));
    world.spawn((DirectionalLight { illuminance: 1e-4, ..default() }, SunDisk::EARTH, place(8)));
}
