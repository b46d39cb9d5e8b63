//! The top-level tree over the instances that rays can hit, of this frame and of the last one.

#[cfg(feature = "testing")]
mod check;

use bevy::{
    log::warn_once,
    platform::collections::HashSet,
    render::renderer::{RenderDevice, RenderQueue},
};

use std::ops::Range;

use crate::gpu_layout::{INSTANCE_ALPHA, NODE_STRIDE, NONE, WORLD_TREE};
use crate::scene::{
    accel::blas::{Bounds, joined},
    accel::ray_query::{AccelerationStructures, Placed},
    accel::refit::{self, Refit},
    accel::tlas::{self, Tlas},
    geometry::bodies::BodyPool,
    geometry::gpu_tlas::TlasPair,
    geometry::meshes::MeshPool,
    geometry::world_tree::RestingInstances,
    geometry::{instance_record::LiveInstance, instances::InstancePool},
    storage::uploads::Uploads,
};

#[cfg(feature = "testing")]
pub use check::{TopLevels, read_top_levels};

/// Cost of a tree that is refitted, relative to its cost when it was built, beyond which it is built again.
const MAX_COST: f64 = 1.2;

/// The top level.
#[derive(Default)]
pub(crate) struct TopLevel {
    /// The tree has lost or gained an instance since it was built.
    changed: bool,
    /// Slots of instances in the tree whose bounds have changed in this frame.
    moved: Vec<u32>,
    /// Entries of the tree with their world bounds: slots of instances, in the order of their entities, and the tree over those that rest.
    bounds: Vec<(u32, Bounds)>,
    /// Memory for the bounds of the next tree.
    new_bounds: Vec<(u32, Bounds)>,
    /// Places of instances in `bounds`, by slot; `NONE` for slots that the tree does not have.
    places: Vec<u32>,
    /// The tree, and its cost when it was built.
    tree: Tlas,
    built_cost: f64,
    /// `None` until an instance moves.
    refit: Option<Refit>,
    gpu: TlasPair,
    /// The instances that rest, which have a tree of their own.
    pub(super) resting: RestingInstances,
    /// Ranges of such trees that only the last frame's top level has.
    outdated: Vec<Range<u32>>,
    /// Replaces both when rays are traced by ray queries.
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
    /// A top level that we build.  `waits`: pictures must be repeatable, so frames wait for the tree over instances that rest.
    pub(crate) fn for_software_rays(waits: bool) -> Self {
        Self { resting: RestingInstances::new(waits), ..Default::default() }
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

    /// Takes note of an instance whose bounds in the tree were `before` and are `after`; `None` where it is not in the tree.
    pub(super) fn note(&mut self, slot: u32, before: Option<Bounds>, after: Option<Bounds>) {
        if before.is_some() != after.is_some() {
            self.changed = true;
        } else if before != after {
            self.moved.push(slot);
        }
    }

    /// Refits or rebuilds the tree if its entries or their bounds changed.  Returns whether an instance appeared, disappeared or moved; another
    /// grouping of instances at rest does not count.  The tree of the last frame stays on the GPU for one frame.
    pub(super) fn rebuild(&mut self, instances: &InstancePool, meshes: &mut MeshPool, uploads: &mut Uploads) -> bool {
        let (device, queue) = (uploads.device, uploads.queue);
        self.gpu.begin_frame(meshes);
        self.outdated.drain(..).for_each(|range| meshes.release_nodes(range));
        let (is_regrouped, uploaded) = self.resting.update(instances, meshes, device, queue);
        self.uploaded_nodes = uploaded;
        let scene_changed = self.changed || !self.moved.is_empty();
        // A tree that lacks instances is not refitted.
        self.changed |= is_regrouped || self.tree.order.len() != self.bounds.len();
        let (is_outdated, refitted) = match self.changed {
            true => (self.update_bounds(instances), None),
            false => self.refit(instances),
        };
        if !is_outdated {
            return false;
        }
        let sent = match refitted {
            Some(nodes) => self.gpu.refit(&self.tree, nodes, meshes, uploads),
            None => {
                self.build();
                self.gpu.replace(&self.tree, meshes, device, queue)
            }
        };
        let Some(bytes) = sent else {
            warn_once!(
                "restir: the top-level tree over {} instances does not fit this device; rays use the last tree that fit",
                self.bounds.len()
            );
            // The next frame tries again: memory may have become free.
            self.bounds.clear();
            self.changed = true;
            return false;
        };
        self.uploaded_nodes += bytes;
        self.outdated = self.resting.take_outdated();
        scene_changed
    }

    /// Builds the tree over `bounds`.
    fn build(&mut self) {
        self.tree = tlas::build_tlas(&self.bounds);
        self.built_cost = refit::cost(&self.tree.nodes);
        self.refit = None;
        self.places.clear();
        for (place, (slot, _)) in self.bounds.iter().enumerate().filter(|(_, (slot, _))| slot & WORLD_TREE == 0) {
            if self.places.len() <= *slot as usize {
                self.places.resize(*slot as usize + 1, NONE);
            }
            self.places[*slot as usize] = place as u32;
        }
    }

    /// Fits the tree to instances that have moved.  Returns whether any has, and the nodes that may have changed; `None` if the tree is not
    /// good any more.
    fn refit(&mut self, instances: &InstancePool) -> (bool, Option<Vec<usize>>) {
        let mut moved = Vec::with_capacity(self.moved.len());
        for slot in self.moved.drain(..) {
            let place = self.places.get(slot as usize).copied().unwrap_or(NONE);
            let known = self.bounds.get_mut(place as usize);
            let new = instances.live_in(slot).and_then(LiveInstance::traced_bounds);
            if let (Some((_, bounds)), Some(new)) = (known, new)
                && *bounds != new
            {
                *bounds = new;
                moved.push(place);
            }
        }
        if moved.is_empty() {
            return (false, None);
        }
        let all_nodes = 0..self.tree.nodes.len() / NODE_STRIDE as usize;
        let (refit, nodes) = match self.refit.take() {
            Some(mut refit) => {
                let nodes = refit.update(&mut self.tree, &self.bounds, &moved);
                (refit, nodes)
            }
            None => (Refit::new(&mut self.tree, &self.bounds), all_nodes.collect()),
        };
        (self.center, self.radius) = bounding_sphere(refit.bounds());
        let is_good = refit.cost(&self.tree) <= MAX_COST * self.built_cost;
        self.refit = Some(refit);
        (true, is_good.then_some(nodes))
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
        self.update_bounds(instances);
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

    /// Takes over the bounds of all instances of this frame and returns whether any changed.
    fn update_bounds(&mut self, instances: &InstancePool) -> bool {
        let has_moved = !self.moved.is_empty();
        self.moved.clear();
        if !core::mem::take(&mut self.changed) && !has_moved {
            return false;
        }
        self.new_bounds.clear();
        let single = instances.in_order().filter(|(slot, _)| !self.resting.contains(*slot));
        self.new_bounds.extend(single.filter_map(|(slot, live)| Some((slot, live.traced_bounds()?))));
        self.new_bounds.extend(self.resting.entry());
        let changed = self.new_bounds != self.bounds;
        if changed {
            core::mem::swap(&mut self.bounds, &mut self.new_bounds);
            let all = self.bounds.iter().map(|(_, bounds)| *bounds).reduce(joined);
            (self.center, self.radius) = all.map_or_else(Default::default, bounding_sphere);
        }
        changed
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
