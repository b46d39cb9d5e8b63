//! Opens files: a glTF scene replaces the current one, an image becomes the environment.

use bevy::{
    asset::{AssetPath, LoadState},
    camera::primitives::Aabb,
    gltf::Gltf,
    prelude::*,
    window::FileDragAndDrop,
    world_serialization::WorldInstanceReady,
};
use bevy_restir::{Restir, RestirEnvironment};
use bevy_restir_support::{environment, framing, subsurface};
use std::path::PathBuf;

use super::light::AddedSky;
use crate::look::Look;

/// Asks to open a file.
#[derive(Message, Clone, Debug)]
pub struct Open(pub PathBuf);

/// The current scene and the one that is loading.
#[derive(Resource, Default)]
pub struct Stage {
    /// One line for the user: the file that is loading, or why it failed.
    pub line: String,
    coming: Option<Coming>,
    pub shown: Option<Shown>,
}

struct Coming {
    path: PathBuf,
    file: Handle<Gltf>,
    /// Whether the file has not been read anew yet.
    reloads: bool,
}

/// A loaded scene.
pub struct Shown {
    pub path: PathBuf,
    pub file: Handle<Gltf>,
    pub root: Entity,
    /// Cameras of the file, by name.
    pub cameras: Vec<(String, Entity)>,
    /// Center and radius of a sphere around the scene.
    pub center: Vec3,
    pub radius: f32,
}

/// A new scene is loaded and its transforms are up to date.
#[derive(Message, Clone, Copy, Debug)]
pub struct Arrived;

impl Stage {
    /// Shows the first line of a message.
    pub fn say(&mut self, text: impl ToString) {
        self.line = text.to_string().lines().next().unwrap_or_default().into();
    }

    pub fn is_loading(&self) -> bool {
        self.coming.is_some()
    }
}

pub fn plugin(app: &mut App) {
    app.add_message::<Open>()
        .add_message::<Arrived>()
        .init_resource::<Stage>()
        .add_systems(Update, ((drop_files, open, spawn_when_loaded, measure).chain(), subsurface::read_extras));
}

/// Opens files that are dropped on the window.
fn drop_files(mut dropped: MessageReader<FileDragAndDrop>, mut open: MessageWriter<Open>) {
    for event in dropped.read() {
        if let FileDragAndDrop::DroppedFile { path_buf, .. } = event {
            open.write(Open(path_buf.clone()));
        }
    }
}

fn open(
    mut commands: Commands,
    mut asked: MessageReader<Open>,
    mut stage: ResMut<Stage>,
    assets: Res<AssetServer>,
    mut images: ResMut<Assets<Image>>,
    mut cameras: Query<(Entity, Option<&mut RestirEnvironment>, Has<AddedSky>, Option<&mut Look>), With<Restir>>,
) {
    for Open(path) in asked.read() {
        let full = match path.canonicalize() {
            Ok(full) => full,
            Err(error) => {
                stage.say(format!("{}: {error}", path.display()));
                continue;
            }
        };
        if environment::is_image(&full) {
            match environment::read(&full) {
                Ok(image) => {
                    let image = Some(images.add(image));
                    for (camera, environment, is_added, look) in &mut cameras {
                        match environment {
                            // Its color was that of a sky without an image.
                            Some(mut environment) if !is_added => {
                                environment.image = image.clone();
                                environment.color = LinearRgba::WHITE;
                            }
                            // The sky is the user's from now on, and no file takes it away.
                            _ => {
                                let sky = RestirEnvironment { image: image.clone(), ..default() };
                                commands.entity(camera).insert(sky).remove::<AddedSky>();
                            }
                        }
                        // It may be a thousand times darker than the light before it.
                        if let Some(mut look) = look {
                            look.measure_next = look.auto_exposure;
                        }
                    }
                    stage.say(format!("{} is the environment", path.display()));
                }
                Err(error) => stage.say(error),
            }
            continue;
        }
        if !environment::has_extension(&full, &["glb", "gltf"]) {
            stage.say(format!("{}: neither .glb, .gltf, .hdr nor .exr", path.display()));
            continue;
        }
        stage.say(format!("loading {} ...", path.display()));
        // A path instead of text, because the name may contain characters with a meaning in asset paths.
        let asset = AssetPath::from_path_buf(full.clone());
        // A file that is opened again may have been written anew. Loading it would give the scene that is in memory.
        let reloads = stage.shown.as_ref().is_some_and(|shown| shown.path == full);
        let file = assets.load(asset.clone());
        if reloads {
            assets.reload(asset);
        }
        stage.coming = Some(Coming { path: full, file, reloads });
    }
}

/// Replaces the scene once the new file is loaded. Where that fails, the old scene stays.
fn spawn_when_loaded(
    mut commands: Commands,
    mut stage: ResMut<Stage>,
    mut changes: MessageReader<AssetEvent<Gltf>>,
    assets: Res<AssetServer>,
    gltfs: Res<Assets<Gltf>>,
) {
    for change in changes.read() {
        if let (AssetEvent::Modified { id }, Some(coming)) = (change, &mut stage.coming)
            && *id == coming.file.id()
        {
            coming.reloads = false;
        }
    }
    let Some(coming) = &stage.coming else { return };
    if let LoadState::Failed(error) = assets.load_state(&coming.file) {
        let line = format!("{}: {error}", coming.path.display());
        stage.say(line);
        stage.coming = None;
        return;
    }
    if coming.reloads {
        return;
    }
    // The scene does not wait for its textures, which may be missing.
    let Some(gltf) = gltfs.get(&coming.file) else { return };
    let Some(scene) = gltf.default_scene.clone().or_else(|| gltf.scenes.first().cloned()) else {
        let line = format!("{}: it contains no scene", coming.path.display());
        stage.say(line);
        stage.coming = None;
        return;
    };
    let Some(Coming { path, file, .. }) = stage.coming.take() else { return };
    if let Some(old) = stage.shown.take() {
        commands.entity(old.root).despawn();
    }
    let root =
        commands.spawn((WorldAssetRoot(scene), Transform::default(), Visibility::default())).observe(take_cameras).id();
    stage.shown = Some(Shown { path, file, root, cameras: Vec::new(), center: Vec3::ZERO, radius: 1.0 });
}

/// Marks a spawned scene whose transforms are not up to date yet.
#[derive(Component)]
pub struct Settling(u32);

/// Keeps the transforms of the file's cameras, and removes the cameras, which would draw to the window.
fn take_cameras(
    ready: On<WorldInstanceReady>,
    mut commands: Commands,
    mut stage: ResMut<Stage>,
    children: Query<&Children>,
    cameras: Query<Option<&Name>, With<Camera>>,
) {
    let mut found = Vec::new();
    for entity in children.iter_descendants(ready.entity) {
        if let Ok(name) = cameras.get(entity) {
            let name = name.map_or_else(|| format!("camera {}", found.len() + 1), |name| name.to_string());
            found.push((name, entity));
            commands.entity(entity).remove::<(Camera3d, Camera)>();
        }
    }
    if let Some(shown) = stage.shown.as_mut().filter(|shown| shown.root == ready.entity) {
        shown.cameras = found;
        commands.entity(ready.entity).insert(Settling(0));
    }
}

/// Waits a frame for transforms and bounding boxes, then measures the scene.
pub fn measure(
    mut commands: Commands,
    mut stage: ResMut<Stage>,
    mut settling: Query<(Entity, &mut Settling)>,
    children: Query<&Children>,
    parts: Query<(&GlobalTransform, &Aabb)>,
    mut looks: Query<&mut Look>,
    mut arrived: MessageWriter<Arrived>,
) {
    for (root, mut settling) in &mut settling {
        settling.0 += 1;
        if settling.0 < 2 {
            continue;
        }
        commands.entity(root).remove::<Settling>();
        let Some(shown) = stage.shown.as_mut().filter(|shown| shown.root == root) else { continue };
        (shown.center, shown.radius) =
            framing::bounding_sphere(children.iter_descendants(root).filter_map(|entity| parts.get(entity).ok()));
        for mut look in &mut looks {
            look.adapt(shown.center, shown.radius);
        }
        arrived.write(Arrived);
        if !stage.is_loading() {
            stage.line.clear();
        }
    }
}
