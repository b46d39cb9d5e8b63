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
    geometry::instances::InstancePool,
    geometry::meshes::MeshPool,
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

    /// The mesh, if triangles emit.
    pub(super) fn mesh(&self) -> Option<AssetId<Mesh>> {
        match self {
            Self::Mesh(emissive) => Some(emissive.mesh),
            Self::Analytic(_) => None,
        }
    }
}

/// Everything in the scene that emits, analytic lights first.
pub(super) fn gather(
    scene: &ExtractedScene,
    instances: &InstancePool,
    meshes: &MeshPool,
    materials: &MaterialPool,
) -> Vec<(MainEntity, Emitter)> {
    let analytic = scene.lights.iter().map(|(entity, light)| (*entity, Emitter::Analytic(*light)));
    let emissive = instances.emitters().into_iter().filter_map(|(slot, live)| {
        let emission = materials.mean_emission(live.material);
        let mesh = meshes.get(live.mesh)?;
        if luminance(emission) <= 0.0 {
            return None;
        }
        let double_sided = materials.get(live.material)?.flags & MATERIAL_DOUBLE_SIDED != 0;
        let mesh = (live.mesh, mesh.version, mesh.corners.is_some());
        let mesh = EmissiveMesh::new(slot, mesh, instances.get(slot), emission, double_sided);
        Some((live.entity, Emitter::Mesh(mesh)))
    });
    analytic.chain(emissive).collect()
}
