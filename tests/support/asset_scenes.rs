//! Loads scenes of `assets/scenes` into the app of the tests; one app serves many restarts.

use super::{
    app::*,
    cli::{asset, reference_entry},
};
use bevy::{asset::LoadState, gltf::Gltf, prelude::*, world_serialization::WorldInstanceReady};
use bevy_restir_support::environment::{self, Environment};

/// The number of frames within which a file must be read and spawned.
const PATIENCE: u32 = 2000;

#[derive(Resource)]
struct Spawned;

impl Rig {
    /// A scene of `assets/scenes` from its own camera, with the environment of `references.json`.  Tests in one process render its
    /// references once, so a test that compares with them must not change the scene.
    pub fn load(name: &str, size: u32) -> Option<Self> {
        let mut rig = Self::new(size, size)?;
        rig.share_a_tree_at_rest();
        let file: Handle<Gltf> = rig.app.world().resource::<AssetServer>().load(format!("scenes/{name}.glb"));
        rig.wait_for(name, |world| {
            if let LoadState::Failed(error) = world.resource::<AssetServer>().load_state(&file) {
                panic!("{name}: {error}");
            }
            world.resource::<Assets<Gltf>>().contains(&file)
        });
        let scene = rig.app.world().resource::<Assets<Gltf>>().get(&file).and_then(|gltf| gltf.default_scene.clone());
        rig.app
            .world_mut()
            .spawn(WorldAssetRoot(scene.expect("the file has a scene")))
            .observe(|_: On<WorldInstanceReady>, mut commands: Commands| commands.insert_resource(Spawned));
        rig.wait_for(name, |world| world.contains_resource::<Spawned>());
        // Transforms are propagated one frame later.
        rig.frame();
        rig.take_the_camera_of_the_file();
        if let Some(wanted) = environment_of(name) {
            let environment = environment::load(rig.app.world_mut(), &wanted).expect("it can be read");
            rig.insert(rig.camera, environment);
        }
        rig.shared = Some(format!("{name}.glb"));
        Some(rig)
    }

    /// Renders frames until a file is loaded or spawned.
    pub fn wait_for(&mut self, name: &str, is_done: impl Fn(&World) -> bool) {
        for _ in 0..PATIENCE {
            if is_done(self.app.world()) {
                return;
            }
            self.frame();
        }
        panic!("{name} is not loaded after {PATIENCE} frames");
    }

    fn take_the_camera_of_the_file(&mut self) {
        let ours = self.camera;
        let world = self.app.world_mut();
        let (theirs, place, projection) = world
            .query_filtered::<(Entity, &GlobalTransform, &Projection), With<Camera>>()
            .iter(world)
            .find(|found| found.0 != ours)
            .map(|(entity, place, projection)| (entity, place.compute_transform(), projection.clone()))
            .expect("the file has a camera");
        // It would render to a window.
        world.entity_mut(theirs).remove::<(Camera3d, Camera)>();
        world.entity_mut(ours).insert((place.with_scale(Vec3::ONE), projection));
    }

    /// The entity with this name in the file.
    pub fn named(&mut self, name: &str) -> Entity {
        let world = self.app.world_mut();
        let found = world.query::<(Entity, &Name)>().iter(world).find(|found| found.1.as_str() == name);
        found.unwrap_or_else(|| panic!("{name} is in the scene")).0
    }
}

fn environment_of(name: &str) -> Option<Environment> {
    environment::of_reference(&reference_entry(name), &asset("")).expect("the entry is valid")
}
