//! Warns once about each lighting feature of Bevy that we do not support, and names the first entity that has it.

use bevy::{
    ecs::prelude::*,
    light::{DirectionalLight, DirectionalLightTexture, PointLight, PointLightTexture, SpotLight, SpotLightTexture},
    log::{warn, warn_once},
    mesh::Mesh3d,
    pbr::{
        ContactShadows, DistanceFog, Lightmap, MeshMaterial3d, ScreenSpaceAmbientOcclusion, ScreenSpaceReflections,
        StandardMaterial,
    },
    platform::collections::HashSet,
    render::Extract,
};

use crate::settings::Restir;

/// Warns about unsupported components, if there is a `Restir` camera.
pub(crate) fn warn_of_unsupported(
    cameras: Extract<Query<(), With<Restir>>>,
    points: Extract<Query<Entity, (With<PointLight>, With<PointLightTexture>)>>,
    spots: Extract<Query<Entity, (With<SpotLight>, With<SpotLightTexture>)>>,
    suns: Extract<Query<Entity, (With<DirectionalLight>, With<DirectionalLightTexture>)>>,
    lightmaps: Extract<Query<Entity, (With<Lightmap>, With<Mesh3d>, With<MeshMaterial3d<StandardMaterial>>)>>,
    fog: Extract<Query<Entity, (With<Restir>, With<DistanceFog>)>>,
    reflections: Extract<Query<Entity, (With<Restir>, With<ScreenSpaceReflections>)>>,
    occlusion: Extract<Query<Entity, (With<Restir>, With<ScreenSpaceAmbientOcclusion>)>>,
    shadows: Extract<Query<Entity, (With<Restir>, With<ContactShadows>)>>,
    mut warned: Local<HashSet<&'static str>>,
) {
    if cameras.is_empty() {
        return;
    }
    if let Some(entity) = points.iter().next() {
        warn_once!(
            "restir: PointLightTexture of light {entity} is not supported; the light has the same intensity in all directions"
        );
    }
    if let Some(entity) = spots.iter().next() {
        warn_once!("restir: SpotLightTexture of light {entity} is not supported; the light fills its whole cone");
    }
    if let Some(entity) = suns.iter().next() {
        warn_once!(
            "restir: DirectionalLightTexture of light {entity} is not supported; the light has the same illuminance everywhere"
        );
    }
    if let Some(entity) = lightmaps.iter().next() {
        warn_once!("restir: lightmaps are not used, because paths are traced instead (entity {entity})");
    }
    if let Some(camera) = fog.iter().next() {
        warn_once!("restir: DistanceFog of camera {camera} does not dim surfaces that this plugin lights");
    }
    for (component, camera) in [
        ("ScreenSpaceReflections", reflections.iter().next()),
        ("ScreenSpaceAmbientOcclusion", occlusion.iter().next()),
        ("ContactShadows", shadows.iter().next()),
    ] {
        if let Some(camera) = camera
            && warned.insert(component)
        {
            warn!(
                "restir: {component} of camera {camera} has no effect on surfaces that this plugin lights; remove it, because Bevy \
                 still runs its passes"
            );
        }
    }
}
