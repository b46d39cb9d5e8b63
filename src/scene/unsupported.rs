//! Warns once about each lighting feature of Bevy that we do not support, and names the first entity that has it.

use bevy::{
    core_pipeline::prepass::{DeferredPrepass, NormalPrepass},
    ecs::prelude::*,
    light::{
        AmbientLight, DirectionalLight, DirectionalLightTexture, PointLight, PointLightTexture, SpotLight,
        SpotLightTexture, VolumetricFog,
    },
    log::warn,
    mesh::Mesh3d,
    pbr::{
        AtmosphereSettings, ContactShadows, DistanceFog, Lightmap, MeshMaterial3d, ScreenSpaceAmbientOcclusion,
        ScreenSpaceReflections, StandardMaterial,
    },
    platform::collections::HashSet,
    render::Extract,
};

use crate::settings::Restir;

// The ends of warnings.
const DRAWN_OVER: &str = "does not dim or color the light that this plugin traces, and reflections do not show it; Bevy draws it over \
                          the picture";
const WITHOUT_EFFECT: &str =
    "has no effect on surfaces that this plugin lights; remove it, because Bevy still runs its passes";
const NOT_FILLED: &str = "is not filled by surfaces that this plugin lights";

/// Warns about unsupported components, if there is a `Restir` camera.
pub(crate) fn warn_of_unsupported(
    cameras: Extract<Query<(), With<Restir>>>,
    points: Extract<Query<Entity, (With<PointLight>, With<PointLightTexture>)>>,
    spots: Extract<Query<Entity, (With<SpotLight>, With<SpotLightTexture>)>>,
    suns: Extract<Query<Entity, (With<DirectionalLight>, With<DirectionalLightTexture>)>>,
    lightmaps: Extract<Query<Entity, (With<Lightmap>, With<Mesh3d>, With<MeshMaterial3d<StandardMaterial>>)>>,
    fog: Extract<Query<Entity, (With<Restir>, With<DistanceFog>)>>,
    volumes: Extract<Query<Entity, (With<Restir>, With<VolumetricFog>)>>,
    air: Extract<Query<Entity, (With<Restir>, With<AtmosphereSettings>)>>,
    ambient: Extract<Query<Entity, (With<Restir>, With<AmbientLight>)>>,
    reflections: Extract<Query<Entity, (With<Restir>, With<ScreenSpaceReflections>)>>,
    occlusion: Extract<Query<Entity, (With<Restir>, With<ScreenSpaceAmbientOcclusion>)>>,
    shadows: Extract<Query<Entity, (With<Restir>, With<ContactShadows>)>>,
    // Screen-space effects need these prepasses, and have a warning of their own.
    normals: Extract<Query<Entity, (With<Restir>, With<NormalPrepass>, Without<ScreenSpaceAmbientOcclusion>)>>,
    deferred: Extract<Query<Entity, (With<Restir>, With<DeferredPrepass>, Without<ScreenSpaceReflections>)>>,
    mut warned: Local<HashSet<&'static str>>,
) {
    if cameras.is_empty() {
        return;
    }
    for (component, entity, problem) in [
        (
            "PointLightTexture",
            points.iter().next(),
            "is not supported; the light has the same intensity in all directions",
        ),
        ("SpotLightTexture", spots.iter().next(), "is not supported; the light fills its whole cone"),
        (
            "DirectionalLightTexture",
            suns.iter().next(),
            "is not supported; the light has the same illuminance everywhere",
        ),
        ("Lightmap", lightmaps.iter().next(), "is not used, because paths are traced instead"),
        ("DistanceFog", fog.iter().next(), "does not dim surfaces that this plugin lights"),
        ("VolumetricFog", volumes.iter().next(), DRAWN_OVER),
        ("AtmosphereSettings", air.iter().next(), DRAWN_OVER),
        ("AmbientLight", ambient.iter().next(), "is ignored, because light that bounces takes its place"),
        ("ScreenSpaceReflections", reflections.iter().next(), WITHOUT_EFFECT),
        ("ScreenSpaceAmbientOcclusion", occlusion.iter().next(), WITHOUT_EFFECT),
        ("ContactShadows", shadows.iter().next(), WITHOUT_EFFECT),
        ("NormalPrepass", normals.iter().next(), NOT_FILLED),
        ("DeferredPrepass", deferred.iter().next(), NOT_FILLED),
    ] {
        if let Some(entity) = entity
            && warned.insert(component)
        {
            warn!("restir: {component} of entity {entity} {problem}");
        }
    }
}
