//! Meshes that are being built, and those that are built and wait for their upload.
//!
//! A level that loads brings many meshes at once.  They are uploaded over several frames, so that no frame stalls.

use bevy::{
    asset::AssetId,
    mesh::Mesh,
    platform::collections::HashSet,
    tasks::{Task, futures::check_ready},
};

use super::MeshPool;
use crate::scene::geometry::{
    mesh_build::{Built, build},
    triangulate::Dropped,
};

/// A frame begins to upload another mesh only while it has sent at most this many bytes of meshes.
const MOST_BYTES: u64 = 16 << 20;

/// A mesh that is being built or waits for its upload.
pub(super) struct Build {
    /// `None` when it has ended; its result is then among [`MeshPool::arrivals`].
    task: Option<Task<Built>>,
    /// The newest version of the mesh, if it has changed since the build began; it is built next.
    pub newest: Option<Mesh>,
}

impl Build {
    /// Starts the build of a mesh.
    pub(super) fn start(mesh: Mesh) -> Self {
        Self { task: Some(build(mesh)), newest: None }
    }
}

impl MeshPool {
    /// Queues the meshes whose build has ended, and the built ones that instances have begun to show.
    pub(super) fn queue_arrivals(&mut self, newly_shown: HashSet<AssetId<Mesh>>) {
        let mut arrivals = Vec::new();
        for (id, running) in &mut self.building {
            if let Some(built) = running.task.as_mut().and_then(check_ready) {
                running.task = None;
                arrivals.push((*id, built));
            }
        }
        for id in newly_shown {
            // If a newer version is being built, the instances wait for that one.
            let unused = self.unused.remove(&id).filter(|_| !self.building.contains_key(&id));
            let Some(blas) = unused else { continue };
            self.building.insert(id, Build { task: None, newest: None });
            arrivals.push((id, (Ok(Some(*blas)), Dropped::default())));
        }
        // Sorted, so that the layout of the buffers does not depend on the order in which the tasks of a frame end.
        arrivals.sort_unstable_by_key(|(id, _)| *id);
        self.arrivals.extend(arrivals);
    }

    /// Takes the mesh that has waited longest; `None` if no mesh waits, or if this frame has sent enough.
    pub(super) fn next_arrival(&mut self) -> Option<(AssetId<Mesh>, Built)> {
        if self.uploaded > MOST_BYTES {
            return None;
        }
        let (id, built) = self.arrivals.pop_front()?;
        let newest = self.building.remove(&id).and_then(|ended| ended.newest);
        if let Some(mesh) = newest {
            self.building.insert(id, Build::start(mesh));
        }
        Some((id, built))
    }
}
