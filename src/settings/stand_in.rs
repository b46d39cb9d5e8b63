//! Objects that Bevy draws, with another material for rays or without any.

use bevy::{
    asset::Handle,
    ecs::{component::Component, reflect::ReflectComponent},
    pbr::StandardMaterial,
    reflect::{Reflect, std_traits::ReflectDefault},
};

/// Gives an object that Bevy draws, such as one with a custom material, a stand-in for rays: it casts shadows, and mirrors and light that
/// bounces see it with this `StandardMaterial`.
///
/// Put it on the entity of the mesh.  The camera sees what Bevy draws, lit by Bevy's lights; this also holds if the entity has a
/// `MeshMaterial3d<StandardMaterial>` of its own.  It costs as much as any other object.  With
/// [`Technique::Bdpt`](crate::Technique::Bdpt), caustics are found from the camera only (noisier; those of lights without a size
/// are missing), with a warning.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_restir::prelude::*;
/// # fn setup(mut commands: Commands, mesh: Handle<Mesh>, mut materials: ResMut<Assets<StandardMaterial>>) {
/// let bark = materials.add(Color::srgb(0.3, 0.2, 0.1));
/// // Beside `MeshMaterial3d<SwayingTree>`, or any other material of the app.
/// commands.spawn((Mesh3d(mesh), RestirMaterial(bark)));
/// # }
/// ```
#[derive(Component, Clone, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Component, Default)]
pub struct RestirMaterial(pub Handle<StandardMaterial>);

/// Excludes an object from path tracing: Bevy draws and lights it, and rays pass through it, so that it casts no shadow and no mirror shows
/// it.  For gizmos, ghosts and interfaces in the scene.
///
/// Put it on the entity of the mesh: it does not reach children, so that on the root of a scene, such as a glTF file, it has no effect.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Component, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RestirIgnore;
