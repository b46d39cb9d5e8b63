//! Instances that cannot be shown: some wait, for others there is a warning.

use bevy::{asset::AssetId, log::warn, mesh::Mesh, render::sync_world::MainEntity};

use super::InstancePool;
use crate::gpu_layout::GpuInstance;
use crate::scene::{
    accel::blas::Bounds,
    accel::tlas,
    extract::instances::ExtractedInstance,
    geometry::instance_record::{Absence, InstanceSources, new_record},
};

/// Reasons to warn about an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum InstanceProblem {
    UnusableTransform,
    MissingAsset,
}

impl InstancePool {
    /// Forgets the warnings about entities that are gone.
    pub(crate) fn forget_warnings(&mut self, exists: impl Fn(MainEntity) -> bool) {
        self.warned.retain(|(entity, _)| exists(*entity));
    }

    /// The record of an instance and its world bounds; `None` if its mesh or material is missing, or if it cannot be shown.
    pub(super) fn record_of(
        &mut self,
        extracted: &ExtractedInstance,
        mesh: AssetId<Mesh>,
        sources: &mut InstanceSources,
    ) -> Option<(GpuInstance, Bounds)> {
        match new_record(extracted, mesh, sources) {
            Ok(record) => return Some(record),
            Err(Absence::LeftOut) => {}
            Err(Absence::Asset) => self.wait_for_assets(extracted, sources),
            Err(Absence::Shaders) => {
                self.waiting = true;
                self.unsettled.push(extracted.entity);
            }
            Err(Absence::Transform) => {
                if self.warned.is_due((extracted.entity, InstanceProblem::UnusableTransform)) {
                    warn!(
                        "restir: entity {} has a transform that is singular, not finite, or reaches beyond {:e} m; it is left out",
                        *extracted.entity,
                        tlas::MAX_COORDINATE
                    );
                }
            }
        }
        None
    }

    /// Waits for the assets of an instance if they are being loaded or built; else warns once that one is missing.
    fn wait_for_assets(&mut self, extracted: &ExtractedInstance, sources: &mut InstanceSources) {
        let InstanceSources { meshes, materials, assets, .. } = sources;
        let mesh_will_exist = meshes.get(extracted.mesh).is_some()
            || meshes.is_building(extracted.mesh)
            || self.asset_wait.is_pending(extracted.mesh, assets);
        let is_pending = mesh_will_exist
            && (materials.slot_or_assign(extracted.material).is_some()
                || self.asset_wait.is_pending(extracted.material, assets));
        self.waiting |= is_pending;
        // Bevy sends no event when an asset begins to load, so the instance is visited again.
        self.unsettled.push(extracted.entity);
        if !is_pending && self.warned.is_due((extracted.entity, InstanceProblem::MissingAsset)) {
            warn!(
                "restir: entity {} is left out, because its {} does not exist or failed to load",
                *extracted.entity,
                if mesh_will_exist { "material" } else { "mesh" }
            );
        }
    }
}
