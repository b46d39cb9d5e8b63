//! After random edits of lights and emissive objects, the shaders choose each light with its probability, and find it in the other frame.

use crate::support::{app::*, reuse_settings::paths, scenes::Random};
use bevy::{
    mesh::{Indices, VertexAttributeValues},
    platform::collections::HashMap,
    prelude::*,
};
use bevy_restir::{
    EmissiveLuminance, Paths, Restir, Reuse, ReuseOrder, Technique,
    testing::{
        gpu_layout::{LIGHT_POINT, LIGHT_SPHERE},
        replace_pass_shader,
    },
};

const SIZE: u32 = 64;
/// A lamp is named by its place along x, which is a number from here on.
const FIRST_PLACE: f32 = 1e5;

struct Lamp {
    entity: Option<Entity>,
    power: f32,
    is_black: bool,
    is_sphere: bool,
}

struct Object {
    entity: Option<Entity>,
    glow: Handle<StandardMaterial>,
    shape: usize,
    brightness: f32,
    is_black: bool,
    height: f32,
}

struct Stage {
    rig: Rig,
    shapes: [(Handle<Mesh>, Mesh); 3],
    lamps: Vec<Lamp>,
    objects: Vec<Object>,
    random: Random,
}

/// The lights of an owner in the order of their probabilities, by the first number of their names.
type Lights = HashMap<u32, (Entity, Vec<f64>)>;

impl Stage {
    fn new(seed: u64) -> Option<Self> {
        let mut rig = Rig::new(SIZE, SIZE)?;
        // It hides the backdrop and reflects nothing.
        rig.spawn(square(30.0), lambert(0.0), Transform::default());
        let shapes = [square(1.0), Cuboid::new(1.0, 0.5, 2.0).into(), Sphere::new(0.5).mesh().uv(9, 6)];
        let shapes = shapes.map(|mesh| {
            let handle = rig.add::<Mesh>(mesh.clone());
            // Meshes that nothing shows are not loaded.
            let dark = rig.add::<StandardMaterial>(lambert(0.0));
            rig.spawn_bundle((Mesh3d(handle.clone()), MeshMaterial3d(dark), Transform::from_xyz(0.0, 0.0, 40.0)));
            (handle, mesh)
        });
        let lamps = (0..6).map(|i| Lamp {
            entity: None,
            power: 50.0 + 10.0 * i as f32,
            is_black: false,
            is_sphere: i % 2 == 0,
        });
        let glows: Vec<_> = (0..6).map(|_| rig.add::<StandardMaterial>(lamp(1.0, 1.0, 1.0))).collect();
        let objects = glows.into_iter().zip(0..).map(|(glow, i)| Object {
            entity: None,
            glow,
            shape: i % 3,
            brightness: 1.0,
            is_black: false,
            height: 1.0,
        });
        let (lamps, objects) = (lamps.collect(), objects.collect());
        let mut stage = Self { rig, shapes, lamps, objects, random: Random::new(seed) };
        for i in 0..6 {
            stage.spawn_lamp(i);
            stage.spawn_object(i);
        }
        let reuse = Reuse { order: ReuseOrder::Spatiotemporal, spatial_samples: 1, ..Reuse::PATHS };
        let paths = Paths { reuse, ..paths::unified() };
        replace_pass_shader(&mut stage.rig.app, "pt_reuse", include_str!("../support/kernels/light_table.wgsl"));
        stage.rig.set(|r| *r = Restir { technique: Technique::Pt, paths, bounces: 1, ..plain() });
        stage.rig.until_ready();
        Some(stage)
    }

    fn spawn_lamp(&mut self, i: usize) {
        let place = Transform::from_xyz(FIRST_PLACE + i as f32, 0.0, 40.0);
        self.lamps[i].entity = Some(self.rig.spawn_bundle((PointLight::default(), place)));
        self.show_lamp(i);
    }

    fn show_lamp(&mut self, i: usize) {
        let lamp = &self.lamps[i];
        let intensity = if lamp.is_black { 0.0 } else { lamp.power };
        let radius = if lamp.is_sphere { 0.1 } else { 0.0 };
        if let Some(entity) = lamp.entity {
            let mut light = self.rig.get_mut::<PointLight>(entity);
            (light.intensity, light.radius) = (intensity, radius);
        }
    }

    fn spawn_object(&mut self, i: usize) {
        let object = &self.objects[i];
        let mesh = Mesh3d(self.shapes[object.shape].0.clone());
        let place = Transform::from_xyz(3.0 * i as f32, 0.0, 50.0).with_scale(Vec3::new(1.0, object.height, 1.0));
        let bundle = (mesh, MeshMaterial3d(object.glow.clone()), place);
        self.objects[i].entity = Some(self.rig.spawn_bundle(bundle));
    }

    /// Makes a random edit.
    fn edit(&mut self) {
        let (kind, i) = (self.random.below(10), self.random.below(6));
        match kind {
            0 | 1 => self.lamps[i].is_black ^= true,
            2 => self.lamps[i].power = self.random.range(10.0, 200.0),
            3 => self.lamps[i].is_sphere ^= true,
            4 => match self.lamps[i].entity.take() {
                Some(entity) => _ = self.rig.app.world_mut().despawn(entity),
                None => self.spawn_lamp(i),
            },
            5 | 6 => match self.objects[i].entity.take() {
                Some(entity) => _ = self.rig.app.world_mut().despawn(entity),
                None => self.spawn_object(i),
            },
            7 => {
                let object = &mut self.objects[i];
                match self.random.below(2) {
                    0 => object.is_black ^= true,
                    _ => object.brightness = self.random.range(0.5, 2.0),
                }
                let (glow, value) = (object.glow.clone(), if object.is_black { 0.0 } else { object.brightness });
                self.rig.edit(&glow, |m| m.emissive = LinearRgba::rgb(value, value, value));
            }
            8 => {
                self.objects[i].height = self.random.range(0.5, 2.0);
                if let Some(entity) = self.objects[i].entity {
                    self.rig.get_mut::<Transform>(entity).scale.y = self.objects[i].height;
                }
            }
            _ => {
                self.objects[i].shape = self.random.below(3);
                if let Some(entity) = self.objects[i].entity {
                    self.rig.insert(entity, Mesh3d(self.shapes[self.objects[i].shape].0.clone()));
                }
            }
        }
        if kind < 4 {
            self.show_lamp(i);
        }
    }

    /// The lights that shine, with their probabilities.
    fn expected(&self) -> Lights {
        let mut powers: Lights = HashMap::default();
        for (lamp, i) in self.lamps.iter().zip(0..) {
            let Some(entity) = lamp.entity.filter(|_| !lamp.is_black) else { continue };
            let kind = if lamp.is_sphere { LIGHT_SPHERE } else { LIGHT_POINT };
            powers.insert(FIRST_PLACE as u32 + i + 1000 * kind, (entity, vec![f64::from(lamp.power)]));
        }
        let unit = std::f64::consts::PI * f64::from(self.rig.app.world().resource::<EmissiveLuminance>().0);
        for object in self.objects.iter().filter(|object| !object.is_black) {
            let Some(entity) = object.entity else { continue };
            let areas = areas(&self.shapes[object.shape].1, object.height);
            let of_object = areas.into_iter().map(|area| unit * f64::from(object.brightness) * area).collect();
            powers.insert(entity.index_u32() + 1, (entity, of_object));
        }
        let sum: f64 = powers.values().flat_map(|(_, powers)| powers).sum();
        for (_, powers) in powers.values_mut() {
            powers.iter_mut().for_each(|power| *power /= sum);
            powers.sort_by(f64::total_cmp);
        }
        powers
    }
}

/// Areas of the triangles of a mesh of this height.
fn areas(mesh: &Mesh, height: f32) -> Vec<f64> {
    let Some(VertexAttributeValues::Float32x3(points)) = mesh.attribute(Mesh::ATTRIBUTE_POSITION) else {
        panic!("a mesh has positions")
    };
    let point = |i: usize| (Vec3::from(points[i]) * Vec3::new(1.0, height, 1.0)).as_dvec3();
    let indices: Vec<usize> = mesh.indices().map(Indices::iter).expect("a mesh has indices").collect();
    let area = |[a, b, c]: &[usize; 3]| 0.5 * (point(*b) - point(*a)).cross(point(*c) - point(*a)).length();
    indices.as_chunks::<3>().0.iter().map(area).collect()
}

/// A light as the shaders see it.
struct Shown {
    name: [u32; 2],
    probability: f64,
    in_other_frame: [u32; 2],
}

/// The lights of this frame, and those of the last frame.
fn shown(picture: &Picture) -> [Vec<Shown>; 2] {
    let (now, before) = picture.pixels.split_at(picture.pixels.len() / 2);
    [now, before].map(|pixels| {
        let pairs = pixels.as_chunks::<2>().0.iter().take_while(|[light, _]| light[0] > 0.0);
        let whole = |x: f32, y: f32| [x.round() as u32, y.round() as u32];
        pairs
            .map(|[light, other]| {
                assert_eq!(other[2], 1.0, "the way back does not lead to the light {light:?}, but {other:?}");
                let probability = f64::from(light[2]);
                Shown { name: whole(light[0], light[1]), probability, in_other_frame: whole(other[0], other[1]) }
            })
            .collect()
    })
}

/// Asserts that these are the lights of a frame, and that those are found in the other frame that exist there.  Their probabilities are those
/// of this frame.
fn assert_lights(name: &str, lights: &[Shown], of_frame: &Lights, of_other: &Lights, of_now: &Lights) {
    let count: usize = of_frame.values().map(|(_, powers)| powers.len()).sum();
    assert_eq!(lights.len(), count, "{name}: the number of lights");
    for (owner, (entity, powers)) in of_frame {
        let own: Vec<&Shown> = lights.iter().filter(|light| light.name[0] == *owner).collect();
        assert_eq!(own.len(), powers.len(), "{name}: lights of {owner}");
        let is_in = |frame: &Lights| frame.get(owner).is_some_and(|(e, p)| e == entity && p.len() == powers.len());
        let (is_in_other, is_now) = (is_in(of_other), is_in(of_now));
        for light in &own {
            let expected = if is_in_other { light.name } else { [0; 2] };
            assert_eq!(light.in_other_frame, expected, "{name}: light {:?} in the other frame", light.name);
        }
        let mut probabilities: Vec<f64> = own.iter().map(|light| light.probability).collect();
        probabilities.sort_by(f64::total_cmp);
        let none = vec![0.0; own.len()];
        let expected = of_now.get(owner).filter(|_| is_now).map_or(&none, |(_, powers)| powers);
        for (probability, expected) in probabilities.iter().zip(expected) {
            let is_near = (probability - expected).abs() <= 1e-4 * expected + 1e-9;
            assert!(is_near, "{name}: light of {owner} has the probability {probability}, not {expected}");
        }
    }
}

#[test]
fn lights_keep_their_probabilities_and_are_found_in_both_frames_after_random_edits() {
    let Some(mut stage) = Stage::new(7) else { return };
    let mut before = stage.expected();
    let mut counts = [0; 2];
    for step in 0..80 {
        // Some frames have no edit, others have several.
        for _ in 0..stage.random.below(4) {
            stage.edit();
        }
        let now = stage.expected();
        let [of_now, of_last] = shown(&stage.rig.next());
        assert_lights(&format!("step {step}, this frame"), &of_now, &now, &before, &now);
        assert_lights(&format!("step {step}, the last frame"), &of_last, &before, &now, &now);
        counts[0] += of_last.iter().filter(|light| light.in_other_frame == [0; 2]).count();
        counts[1] += of_last.iter().filter(|light| light.in_other_frame != [0; 2]).count();
        before = now;
    }
    eprintln!("{} lights were gone, {} were found", counts[0], counts[1]);
    assert!(counts[0] > 100 && counts[1] > 1000, "{counts:?}");
}
