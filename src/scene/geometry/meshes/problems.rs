//! Warnings about meshes.

use bevy::{
    asset::{AssetId, AssetServer},
    log::warn,
    mesh::Mesh,
};

use super::MeshPool;
use crate::scene::extract::instances::InstanceList;

/// Reasons to warn about a mesh.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum MeshProblem {
    /// Some triangles are unusable and left out.
    UnusableTriangles,
    TooLarge,
    RigTooLarge,
    NoUsableTriangle,
    LinesOrPoints,
    Unreadable,
    BuildFailed,
}

impl MeshPool {
    /// Warns about a mesh once while the asset exists, because it may be built again in every frame.
    pub(super) fn warn(&mut self, id: AssetId<Mesh>, problem: MeshProblem, text: &str, assets: Option<&AssetServer>) {
        if !self.warned.is_due((id, problem)) {
            return;
        }
        let name = assets.and_then(|a| a.get_path(id)).map_or_else(|| id.to_string(), |path| path.to_string());
        let warning = format!("restir: mesh {name} {text}");
        match problem {
            MeshProblem::LinesOrPoints => _ = self.lines_and_points.insert(id, warning),
            _ => warn!("{warning}"),
        }
    }

    /// Warns about instances whose mesh consists of lines or points.
    pub(crate) fn warn_of_lines_and_points(&mut self, instances: &InstanceList) {
        let is_used = |id: &AssetId<Mesh>| instances.users_of_mesh(*id).next().is_some();
        for (_, warning) in self.lines_and_points.extract_if(|id, _| is_used(id)) {
            warn!("{warning}");
        }
    }
}
