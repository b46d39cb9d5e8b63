//! The top-level trees over the instances that rays can hit, of this frame and of the last one.

#[cfg(feature = "testing")]
mod check;

use bevy::{
    log::warn_once,
    platform::collections::HashSet,
    render::renderer::{RenderDevice, RenderQueue},
};

use std::ops::Range;

use crate::gpu_layout::{INSTANCE_ALPHA, NONE};
use crate::scene::{
    accel::blas::{Bounds, joined},
    accel::ray_query::{AccelerationStructures, Placed},
    geometry::bodies::BodyPool,
    geometry::gpu_tlas::TlasPair,
    geometry::instance_trees::{Change, InstanceTrees},
    geometry::meshes::MeshPool,
    geometry::world_tree::RestingInstances,
    geometry::{instance_record::LiveInstance, instances::InstancePool},
    storage::uploads::Uploads,
};

#[cfg(feature = "testing")]
pub use check::{TopLevels, read_top_levels};

/// The top level.
#[derive(Default)]
pub(crate) struct TopLevel {
    /// Slots of instances that have come, moved or gone in this frame, as far as rays can hit them.
    changed: Vec<u32>,
    trees: InstanceTrees,
    /// The device had no room for the trees, so that the next frame builds them again.
    is_missing: bool,
    gpu: TlasPair,
    /// The instances that rest, which have a tree of their own.
    pub(super) resting: RestingInstances,
    /// Ranges of such trees that only the last frame's top level has.
    outdated: Vec<Range<u32>>,
    /// The device's own top level, in place of `trees` and `resting`, when rays are traced by ray queries.
    pub structures: Option<AccelerationStructures>,
    /// The instances for `structures`.
    placed: Vec<Placed>,
    /// Bounding sphere of all instances that rays can hit.
    pub center: [f32; 3],
    pub radius: f32,
    /// `center` and `radius` in the last frame.
    pub previous_sphere: ([f32; 3], f32),
    /// Bytes of the top level sent in this frame.
    pub uploaded_nodes: u64,
}

/// Center and radius of a sphere around a box.
fn bounding_sphere((low, high): Bounds) -> ([f32; 3], f32) {
    let half: [f64; 3] = core::array::from_fn(|i| 0.5 * (high[i] as f64 - low[i] as f64));
    let radius = half.iter().map(|h| h * h).sum::<f64>().sqrt().min(1e18) as f32;
    (core::array::from_fn(|i| 0.5 * low[i] + 0.5 * high[i]), radius)
}

/// An instance as the device's own acceleration structures have it.
fn placed(
    slot: u32,
    live: &LiveInstance,
    instances: &InstancePool,
    meshes: &MeshPool,
    bodies: &BodyPool,
) -> Option<Placed> {
    let (mesh, instance) = (meshes.get(live.mesh)?, instances.get(slot));
    let body = bodies.get(live.entity);
    Some(Placed {
        slot,
        version: body.map_or(mesh.version, |body| body.version()),
        rebuild: body.is_some_and(|body| body.moved),
        triangles: instance.first_triangle..instance.first_triangle + instance.triangle_count,
        vertices_end: body.map_or(mesh.vertices.end, |body| body.vertices().end),
        world_from_object: instance.world_from_object,
        opaque: instance.flags & INSTANCE_ALPHA == 0,
        mask: live.ray_mask as u8,
    })
}

impl TopLevel {
    /// A top level that this crate builds.  `waits`: pictures must be repeatable, so frames wait for trees that are built in the background.
    pub(crate) fn for_software_rays(waits: bool) -> Self {
        Self { resting: RestingInstances::new(waits), trees: InstanceTrees::new(waits), ..Default::default() }
    }

    /// A top level that the device builds.
    pub(crate) fn for_ray_queries() -> Self {
        Self { structures: Some(AccelerationStructures::default()), ..Default::default() }
    }

    /// Whether the device has no memory for its own acceleration structures.
    pub(crate) fn lacks_memory(&self) -> bool {
        self.structures.as_ref().is_some_and(|structures| structures.lacks_memory)
    }

    pub(super) fn begin_frame(&mut self) {
        self.uploaded_nodes = 0;
        self.previous_sphere = (self.center, self.radius);
    }

    /// Takes note of an instance whose bounds in the trees were `before` and are `after`; `None` where it is not in them.
    pub(super) fn note(&mut self, slot: u32, before: Option<Bounds>, after: Option<Bounds>) {
        if before != after {
            self.changed.push(slot);
        }
    }

    /// Updates the trees for the instances.  Returns whether one appeared, disappeared or moved; another grouping of instances does not count.
    /// The trees of the last frame stay on the GPU for one frame.
    pub(super) fn update(
        &mut self,
        instances: &mut InstancePool,
        meshes: &mut MeshPool,
        uploads: &mut Uploads,
    ) -> bool {
        self.gpu.begin_frame(meshes);
        self.outdated.drain(..).for_each(|range| meshes.release_nodes(range));
        let (is_regrouped, uploaded) = self.resting.update(instances, meshes, uploads.device, uploads.queue);
        self.uploaded_nodes = uploaded;
        let changed = core::mem::take(&mut self.changed);
        // The trees on the GPU lack changes of earlier frames.
        let was_missing = self.is_missing;
        let change = self.follow(&changed, is_regrouped, instances);
        let has_changed = change != Change::Nothing;
        if has_changed {
            self.set_sphere(self.trees.bounds());
            self.send(change, meshes, uploads);
        }
        if self.trees.needs_main_tree() {
            instances.sort();
            let entries = self.entries(instances).collect();
            self.trees.build_main_tree(entries);
        }
        has_changed && !self.is_missing && (was_missing || !changed.is_empty())
    }

    /// Brings the trees up to date on the CPU.
    fn follow(&mut self, changed: &[u32], is_regrouped: bool, instances: &mut InstancePool) -> Change {
        if !is_regrouped && !core::mem::take(&mut self.is_missing) {
            let resting = &self.resting;
            let bounds_in = |slot: u32| {
                let single = instances.live_in(slot).filter(|_| !resting.contains(slot));
                single.and_then(LiveInstance::traced_bounds)
            };
            if let Some(change) = self.trees.update(changed, bounds_in) {
                return change;
            }
        }
        instances.sort();
        let entries = self.entries(instances).collect();
        self.trees.rebuild(entries);
        Change::All
    }

    /// The entries of the trees: the instances in the order of their entities, and the tree over those that rest.
    fn entries(&self, instances: &InstancePool) -> impl Iterator<Item = (u32, Bounds)> {
        let single = instances.in_order().filter(move |(slot, _)| !self.resting.contains(*slot));
        single.filter_map(|(slot, live)| Some((slot, live.traced_bounds()?))).chain(self.resting.entry())
    }

    /// Sends what has changed to the GPU, if there is room.
    fn send(&mut self, change: Change, meshes: &mut MeshPool, uploads: &mut Uploads) {
        let trees = self.trees.joined();
        let sent = match change {
            Change::Nothing => return,
            Change::Parts { nodes, newcomers } => {
                let units = trees.changed_units(&nodes, newcomers);
                self.gpu.update(&trees, units, meshes, uploads)
            }
            Change::All => self.gpu.replace(&trees, meshes, uploads),
        };
        self.is_missing = sent.is_none();
        let Some(bytes) = sent else {
            warn_once!(
                "restir: the top-level tree over {} instances does not fit this device; rays use the last tree that fit",
                self.trees.len()
            );
            return;
        };
        self.uploaded_nodes += bytes;
        self.outdated = self.resting.take_outdated();
    }

    fn set_sphere(&mut self, all: Option<Bounds>) {
        (self.center, self.radius) = all.map_or_else(Default::default, bounding_sphere);
    }

    /// Rebuilds the device's own acceleration structures if an instance changed, and returns whether it did.
    pub(super) fn update_structures(
        &mut self,
        instances: &InstancePool,
        meshes: &mut MeshPool,
        bodies: &BodyPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> bool {
        if !core::mem::take(&mut self.changed).is_empty() {
            self.set_sphere(self.entries(instances).map(|(_, bounds)| bounds).reduce(joined));
        }
        if instances.visited > 0 {
            self.placed.clear();
            let traced = instances.in_order().filter(|(_, live)| live.ray_mask != 0);
            self.placed.extend(traced.filter_map(|(slot, live)| placed(slot, live, instances, meshes, bodies)));
        }
        let Some(structures) = &mut self.structures else { return false };
        // A body that bends where no ray can hit it, because it casts no shadows, leaves its trees behind.
        let rebuilt = self.placed.iter().filter(|placed| placed.rebuild).map(|placed| placed.version);
        let rebuilt = rebuilt.collect::<HashSet<_>>();
        let is_outdated = |version: &u64| !rebuilt.contains(version);
        bodies.moved().filter(is_outdated).for_each(|version| structures.forget(version));
        if instances.visited == 0 && structures.top_levels().is_some() {
            structures.keep();
            return false;
        }
        if !(meshes.triangles.reserve(1, device, queue) && meshes.vertices.reserve(1, device, queue)) {
            return false;
        }
        let (Some(triangles), Some(vertices)) = (meshes.triangles.buffer(), meshes.vertices.buffer()) else {
            return false;
        };
        let before = structures.revision;
        self.uploaded_nodes = structures.update(&self.placed, [triangles, vertices], device, queue);
        if structures.revision == before {
            return false;
        }
        let versions = meshes.versions().into_iter().chain(bodies.versions()).collect::<HashSet<_>>();
        structures.retain(|mesh| versions.contains(&mesh));
        self.uploaded_nodes > 0
    }

    /// Root and position of the instance indices for the top level of this frame, then for that of the last frame.
    pub(crate) fn top_levels(&self) -> [u32; 4] {
        if let Some([current, previous]) = self.structures.as_ref().map(AccelerationStructures::roots) {
            return [current, NONE, previous, NONE];
        }
        let [current, previous] = self.gpu.both();
        [current.root(), current.indices(), previous.root(), previous.indices()]
    }
}
