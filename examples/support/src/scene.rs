//! Loads a scene from a glTF file and places the `Restir` camera.

use bevy::{
    asset::{LoadState, RenderAssetUsages},
    camera::{Exposure, Hdr, ImageRenderTarget, RenderTarget, primitives::Aabb, visibility::VisibilitySystems},
    gltf::Gltf,
    prelude::*,
    render::render_resource::{TextureFormat, TextureUsages},
    world_serialization::WorldInstanceReady,
};
use bevy_restir::{RadianceCapture, Restir, RestirEnvironment};
use std::path::Path;

use crate::{
    framing,
    headless::{frame, until},
    subsurface,
};

/// State of the loading.
#[derive(Resource, Default, PartialEq)]
enum Loading {
    #[default]
    File,
    Instance,
    Done,
    Failed(String),
}

/// The file of the scene.
#[derive(Resource)]
pub struct SceneFile(pub Handle<Gltf>);

/// The root of the spawned scene.
#[derive(Resource)]
struct Root(Entity);

/// The camera that renders.
#[derive(Resource)]
pub struct View {
    pub camera: Entity,
    pub capture: RadianceCapture,
}

/// The beginning of the error for a file whose loader does not end.
pub const NOT_LOADED: &str = "it is not loaded";

/// Loads a glTF file from the app's folder and spawns its scene in place of the last one.
pub fn load(app: &mut App, name: &str) -> Result<(), String> {
    unload(app.world_mut());
    if !app.world().contains_resource::<Loading>() {
        app.add_systems(Update, (spawn_when_loaded, subsurface::read_extras));
    }
    let handle = app.world().resource::<AssetServer>().load(name.replace('#', "%23"));
    app.insert_resource(SceneFile(handle)).insert_resource(Loading::File);
    until(app, NOT_LOADED, |app| matches!(app.world().resource::<Loading>(), Loading::Done | Loading::Failed(_)))?;
    match app.world().resource::<Loading>() {
        Loading::Failed(error) => Err(error.clone()),
        _ => {
            // Transforms are propagated in the frame after the scene was spawned.
            frame(app);
            Ok(())
        }
    }
}

/// Removes the scene and its file.
pub fn unload(world: &mut World) {
    world.remove_resource::<SceneFile>();
    if let Some(Root(root)) = world.remove_resource::<Root>() {
        world.despawn(root);
    }
}

/// Splits a path into its folder and the name of the file.
pub fn split(path: &Path) -> Result<(&Path, &str), String> {
    match (path.parent(), path.file_name().and_then(|n| n.to_str())) {
        (Some(folder), Some(name)) => Ok((folder, name)),
        _ => Err("it is not a file".into()),
    }
}

/// Spawns the scene once its file is loaded.
fn spawn_when_loaded(
    mut commands: Commands,
    mut loading: ResMut<Loading>,
    file: Option<Res<SceneFile>>,
    assets: Res<AssetServer>,
    gltfs: Res<Assets<Gltf>>,
) {
    let Some(file) = file.filter(|_| *loading == Loading::File) else { return };
    if let LoadState::Failed(error) = assets.load_state(&file.0) {
        *loading = Loading::Failed(error.to_string());
        return;
    }
    // A missing texture does not stop the scene: its material is shown without it.
    let Some(gltf) = gltfs.get(&file.0) else { return };
    let Some(scene) = gltf.default_scene.clone().or_else(|| gltf.scenes.first().cloned()) else {
        *loading = Loading::Failed("it contains no scene".into());
        return;
    };
    *loading = Loading::Instance;
    let mut root = commands.spawn(WorldAssetRoot(scene));
    root.observe(|_: On<WorldInstanceReady>, mut loading: ResMut<Loading>| *loading = Loading::Done);
    let root = root.id();
    commands.insert_resource(Root(root));
}

/// Components of the camera besides its transform and projection.
pub struct CameraSetup {
    pub size: UVec2,
    pub exposure: Exposure,
    pub environment: Option<RestirEnvironment>,
    pub settings: Restir,
}

/// Spawns the camera that renders and inserts the resource [`View`].
pub fn spawn_camera(world: &mut World, (transform, projection): (Transform, Projection), setup: CameraSetup) {
    remove_file_cameras(world);
    let target = world.resource_mut::<Assets<Image>>().add(target(setup.size));
    let capture = RadianceCapture::default();
    let mut camera = world.spawn((
        Camera3d::default(),
        Camera { clear_color: ClearColorConfig::Custom(Color::BLACK), ..Default::default() },
        RenderTarget::Image(ImageRenderTarget::from(target)),
        Hdr,
        transform,
        projection,
        setup.exposure,
        setup.settings,
        capture.clone(),
    ));
    if let Some(environment) = setup.environment {
        camera.insert(environment);
    }
    let camera = camera.id();
    world.insert_resource(View { camera, capture });
}

/// An image that a camera renders to.
pub fn target(size: UVec2) -> Image {
    let mut image = Image::new_target_texture(size.x, size.y, TextureFormat::Rgba8UnormSrgb, None);
    image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
    image.asset_usage = RenderAssetUsages::all();
    image
}

/// Gives the target of a camera another size.
pub fn resize(world: &mut World, camera: Entity, size: UVec2) {
    let Some(RenderTarget::Image(image)) = world.get::<RenderTarget>(camera).cloned() else { return };
    if let Some(mut image) = world.resource_mut::<Assets<Image>>().get_mut(&image.handle) {
        *image = target(size);
    }
}

/// Spawns an object.
pub fn spawn(world: &mut World, mesh: impl Into<Mesh>, material: StandardMaterial, place: Transform) -> Entity {
    let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
    world.spawn((Mesh3d(mesh), MeshMaterial3d(material), place)).id()
}

/// The file's cameras would draw to a window.
pub fn remove_file_cameras(world: &mut World) {
    let others = world.query_filtered::<Entity, (With<Camera>, Without<Restir>)>().iter(world).collect::<Vec<_>>();
    for camera in others {
        world.entity_mut(camera).remove::<(Camera3d, Camera)>();
    }
}

/// A camera of a file.
pub struct FileCamera {
    /// `None`: the file has no camera.
    pub node: Option<Entity>,
    pub place: (Transform, Projection),
}

/// The camera of the file with this name, or its first one; a camera in front of the scene, for a picture of this size, where the file has none.
pub fn file_camera(world: &mut World, name: Option<&str>, size: UVec2) -> Result<FileCamera, String> {
    type Found<'w> = (Entity, &'w Camera, Option<&'w Name>, &'w GlobalTransform, &'w Projection);
    let mut cameras: Vec<((bool, u32), Entity, String, Transform, Projection)> = world
        .query_filtered::<Found, (With<Camera>, Without<Restir>)>()
        .iter(world)
        .map(|(entity, camera, name, transform, projection)| {
            // The loader makes the first camera of the file the active one. Where that belongs to another scene of the file, the first
            // one was spawned first. Entities themselves are not ordered by their index.
            let order = (!camera.is_active, entity.index_u32());
            let name = name.map(|name| name.to_string()).unwrap_or_default();
            (order, entity, name, unscaled(transform), projection.clone())
        })
        .collect();
    cameras.sort_by_key(|c| c.0);
    let found = match name {
        Some(name) => {
            let names = cameras.iter().map(|c| c.2.as_str()).collect::<Vec<_>>().join(", ");
            let names = if names.is_empty() { "it has none with a name".into() } else { format!("it has {names}") };
            let found = cameras.into_iter().find(|c| c.2 == name);
            Some(found.ok_or_else(|| format!("it has no camera named {name}; {names}"))?)
        }
        None => cameras.into_iter().next(),
    };
    if let Some((_, node, _, transform, projection)) = found {
        let clip_from_view = projection.get_clip_from_view();
        let matrices = [clip_from_view, clip_from_view.inverse(), transform.to_matrix()];
        if !matrices.iter().all(Mat4::is_finite) {
            return Err("the transform or the projection of its camera is not finite or has no inverse".into());
        }
        return Ok(FileCamera { node: Some(node), place: (transform, projection) });
    }
    warn!("restir: the file has no camera; one is placed in front of the scene");
    let (center, radius) = framing::bounding_sphere(world.query::<(&GlobalTransform, &Aabb)>().iter(world));
    Ok(FileCamera { node: None, place: framing::in_front(center, radius, size.x as f32 / size.y.max(1) as f32) })
}

fn unscaled(transform: &GlobalTransform) -> Transform {
    Transform { scale: Vec3::ONE, ..transform.compute_transform() }
}

/// The node of the file that the camera moves with.
#[derive(Resource)]
struct Followed(Entity);

/// Moves the camera with this node of the file from the next frame on.
pub fn follow(app: &mut App, node: Entity) {
    let moves = move_with_node.after(TransformSystems::Propagate).before(VisibilitySystems::UpdateFrusta);
    app.insert_resource(Followed(node)).add_systems(PostUpdate, moves);
}

fn move_with_node(
    followed: Res<Followed>,
    view: Option<Res<View>>,
    mut places: Query<(&mut Transform, &mut GlobalTransform)>,
) {
    let Ok(place) = places.get(followed.0).map(|(_, place)| unscaled(place)) else { return };
    let Some((mut own, mut global)) = view.and_then(|view| places.get_mut(view.camera).ok()) else { return };
    if *own != place {
        *own = place;
        *global = place.into();
    }
}
