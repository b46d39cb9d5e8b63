//! Everything in the scene that emits: the input of the light table.

use bevy::{asset::AssetId, mesh::Mesh, render::sync_world::MainEntity};

use super::{
    analytic::{has_same_emission, has_same_placement},
    emissive_mesh::EmissiveMesh,
    luminance,
};
use crate::gpu_layout::*;
use crate::scene::{
    extract::{ExtractedScene, lights::AnalyticLight},
    geometry::meshes::MeshPool,
    geometry::{instance_record::LiveInstance, instances::InstancePool},
    material::materials::MaterialPool,
};

/// Everything that the lights of one entity depend on.
#[derive(Clone, Debug)]
pub(super) enum Emitter {
    Analytic(AnalyticLight),
    Mesh(EmissiveMesh),
}

impl Emitter {
    /// Whether the table stays valid as it is.
    pub(super) fn is_unchanged_from(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Analytic(a), Self::Analytic(b)) => has_same_placement(a, b) && has_same_emission(a, b),
            (Self::Mesh(a), Self::Mesh(b)) => a.is_unchanged_from(b),
            _ => false,
        }
    }

    /// The mesh and its version, if triangles emit.
    fn mesh(&self) -> Option<(AssetId<Mesh>, u64)> {
        match self {
            Self::Mesh(emissive) => Some((emissive.mesh, emissive.version)),
            Self::Analytic(_) => None,
        }
    }
}

/// Everything in the scene that emits: analytic lights first, then instances in the order of their entities.
pub(super) fn gather(
    scene: &ExtractedScene,
    instances: &InstancePool,
    meshes: &MeshPool,
    materials: &MaterialPool,
) -> Vec<(MainEntity, Emitter)> {
    let analytic = scene.lights.iter().map(|(entity, light)| (*entity, Emitter::Analytic(*light)));
    let emissive = instances.emitters().into_iter().filter_map(|(slot, live)| {
        Some((live.entity, Emitter::Mesh(emissive_mesh(slot, live, instances, meshes, materials)?)))
    });
    analytic.chain(emissive).collect()
}

/// The emissive meshes among these emitters, with their versions.
pub(super) fn meshes_of(emitters: &[(MainEntity, Emitter)]) -> impl Iterator<Item = (AssetId<Mesh>, u64)> {
    emitters.iter().filter_map(|(_, emitter)| emitter.mesh())
}

/// Whether the lights of an entity's instance are those that it had when these emitters were gathered.
pub(super) fn is_unchanged_mesh(
    entity: MainEntity,
    emitters: &[(MainEntity, Emitter)],
    instances: &InstancePool,
    meshes: &MeshPool,
    materials: &MaterialPool,
) -> bool {
    let new = instances
        .emitter(entity)
        .and_then(|(slot, live)| emissive_mesh(slot, live, instances, meshes, materials))
        .map(Emitter::Mesh);
    // An entity may also have a light.
    let emissive = &emitters[emitters.partition_point(|(_, emitter)| emitter.mesh().is_none())..];
    let old = emissive.binary_search_by_key(&entity, |(entity, _)| *entity).ok().map(|i| &emissive[i].1);
    match (&new, old) {
        (Some(new), Some(old)) => new.is_unchanged_from(old),
        (new, old) => new.is_none() && old.is_none(),
    }
}

/// The lights of an instance; `None` if it is black.
fn emissive_mesh(
    slot: u32,
    live: &LiveInstance,
    instances: &InstancePool,
    meshes: &MeshPool,
    materials: &MaterialPool,
) -> Option<EmissiveMesh> {
    let emission = materials.mean_emission(live.material);
    let mesh = meshes.get(live.mesh)?;
    if luminance(emission) <= 0.0 {
        return None;
    }
    let double_sided = materials.get(live.material)?.flags & MATERIAL_DOUBLE_SIDED != 0;
    let mesh = (live.mesh, mesh.version, mesh.corners.is_some());
    Some(EmissiveMesh::new(slot, mesh, instances.get(slot), emission, double_sided))
}
