//! What Bevy's own lighting heeds and ours does not: one warning each, of the first entity that has it.

use bevy::{
    ecs::prelude::*,
    light::{DirectionalLight, DirectionalLightTexture, PointLight, PointLightTexture, SpotLight, SpotLightTexture},
    log::warn_once,
    mesh::Mesh3d,
    pbr::{Lightmap, MeshMaterial3d, StandardMaterial},
    render::Extract,
};

use crate::settings::Restir;

pub(crate) fn warn_of_unsupported(
    cameras: Extract<Query<(), With<Restir>>>,
    points: Extract<Query<Entity, (With<PointLight>, With<PointLightTexture>)>>,
    spots: Extract<Query<Entity, (With<SpotLight>, With<SpotLightTexture>)>>,
    suns: Extract<Query<Entity, (With<DirectionalLight>, With<DirectionalLightTexture>)>>,
    lightmaps: Extract<Query<Entity, (With<Lightmap>, With<Mesh3d>, With<MeshMaterial3d<StandardMaterial>>)>>,
) {
    if cameras.is_empty() {
        return;
    }
    if let Some(entity) = points.iter().next() {
        warn_once!("restir: PointLightTexture is not supported (light {entity}): the light shines the same all round");
    }
    if let Some(entity) = spots.iter().next() {
        warn_once!("restir: SpotLightTexture is not supported (light {entity}): its whole cone is lit");
    }
    if let Some(entity) = suns.iter().next() {
        warn_once!("restir: DirectionalLightTexture is not supported (light {entity}): it lights all alike");
    }
    if let Some(entity) = lightmaps.iter().next() {
        warn_once!("restir: lightmaps are not used (entity {entity}): the light that they hold is traced");
    }
}
