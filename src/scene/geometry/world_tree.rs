//! A tree over the triangles of the instances that rest, in world space.
//!
//! A ray enters the tree of each instance whose bounds it crosses, with a transform of its own.  Where the bounds of many instances overlap,
//! for example in a building that is split by material, most of these visits find nothing.  One tree over all their triangles is entered
//! once, and without a transform.  It holds copies of the triangles, so its size is limited.  It serves as long as none of its instances
//! changes; then the top level has single instances again, until they have rested for a while.

#[cfg(feature = "testing")]
use bevy::app::App;
use bevy::{
    asset::AssetId,
    mesh::Mesh,
    platform::collections::{HashMap, HashSet},
    render::renderer::{RenderDevice, RenderQueue},
};
use std::ops::Range;

use crate::gpu_layout::{
    GpuInstance, INSTANCE_APPEARED, INSTANCE_DEFORMED, INSTANCE_GONE, NODE_STRIDE, Rows, WORLD_TREE,
};
use crate::scene::{
    accel::blas::{Bounds, bake, build_triangle_tree, joined},
    geometry::{
        background::{BUILD_FRAMES, Background},
        instance_record::LiveInstance,
        instances::InstancePool,
        meshes::{MeshEntry, MeshPool},
    },
};

/// Greatest number of triangles in the tree: 17 MB with their nodes, and a third of a second to build.
const MAX_TRIANGLES: usize = 1 << 18;
/// Scenes with more instances have no such tree: choosing among them would take too long.
const MAX_INSTANCES: u64 = 1 << 14;
/// Frames in which an instance must not have moved.
const REST_FRAMES: u64 = 64;
/// Greatest number of frames before the next build.  The wait doubles after each tree that was given up early.
const MAX_WAIT: u64 = 1024;

/// An instance whose triangles the tree holds.
#[derive(Clone, Debug)]
pub struct Part {
    /// Its slot.
    pub slot: u32,
    /// The place of its first triangle in the buffer of triangles.
    pub first_triangle: u32,
    pub world_from_object: Rows,
    /// Corners of its triangles in object space.
    pub positions: Vec<[[f32; 3]; 3]>,
}

/// A tree over triangles in world space.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldTree {
    nodes: Vec<[u32; 4]>,
    /// Corners, in the order of the leaves.  The fourth components of the first two are the instance and the triangle.
    triangles: Vec<[[u32; 4]; 3]>,
}

impl WorldTree {
    /// Builds the tree; `None` if the parts have no triangles.
    pub fn build(parts: &[Part]) -> Option<Self> {
        let (corners, owners): (Vec<_>, Vec<_>) = parts.iter().flat_map(world_triangles).unzip();
        let tree = build_triangle_tree(&corners)?;
        let packed = |&i: &u32| {
            let ([a, b, c], [slot, triangle]) = (corners[i as usize], owners[i as usize]);
            let word = |[x, y, z]: [f32; 3], w| [x.to_bits(), y.to_bits(), z.to_bits(), w];
            [word(a, slot), word(b, triangle), word(c, 0)]
        };
        Some(Self { triangles: tree.order.iter().map(packed).collect(), nodes: tree.nodes })
    }

    /// The words of the tree for a place in the buffer of nodes, whose unit is a node: nodes, then triangles.
    pub fn words(&self, start: u32) -> Vec<[u32; 4]> {
        let mut words = self.nodes.clone();
        // Triangles have three elements each, and their index counts from the beginning of the buffer.
        let end = start * NODE_STRIDE + words.len() as u32;
        let first = end.div_ceil(3);
        bake(&mut words, start, first);
        words.resize(words.len() + (3 * first - end) as usize, [0; 4]);
        words.extend(self.triangles.as_flattened());
        words.resize((self.node_count() * NODE_STRIDE) as usize, [0; 4]);
        words
    }

    /// Size in the buffer of nodes.
    pub fn node_count(&self) -> u32 {
        let padding = 2;
        ((self.nodes.len() + padding + 3 * self.triangles.len()) as u32).div_ceil(NODE_STRIDE)
    }
}

/// Corners of the triangles of a part in world space, with its slot and the places of the triangles.
fn world_triangles(part: &Part) -> impl Iterator<Item = ([[f32; 3]; 3], [u32; 2])> {
    let rows = part.world_from_object.map(|row| row.map(f64::from));
    let world = move |[x, y, z]: [f32; 3]| -> [f32; 3] {
        let row = |[a, b, c, d]: [f64; 4]| (a * f64::from(x) + b * f64::from(y) + c * f64::from(z) + d) as f32;
        rows.map(row)
    };
    let triangles = part.first_triangle..;
    part.positions.iter().zip(triangles).map(move |(corners, triangle)| (corners.map(world), [part.slot, triangle]))
}

/// The properties of an instance that the tree contains.  If one of them changes, the tree is given up.
#[derive(Clone, Copy, PartialEq)]
struct Placement {
    world_from_object: Rows,
    first_triangle: u32,
}

impl Placement {
    fn of(instance: &GpuInstance) -> Self {
        Self { world_from_object: instance.world_from_object, first_triangle: instance.first_triangle }
    }
}

/// The instances of a tree by slot, and the bounds of all of them.
struct Members {
    placements: HashMap<u32, Placement>,
    bounds: Bounds,
}

impl Members {
    /// Whether all changed slots that are members have the placement that they had.
    fn stay(&self, changed: &[u32], instances: &InstancePool) -> bool {
        changed.iter().all(|slot| {
            let Some(placement) = self.placements.get(slot) else { return true };
            let instance = instances.get(*slot);
            instances.live_in(*slot).is_some_and(|live| live.ray_mask != 0)
                && instance.flags & INSTANCE_GONE == 0
                && Placement::of(instance) == *placement
        })
    }
}

/// A tree that is being built.
struct Pending {
    build: Background<Option<WorldTree>>,
    members: Members,
}

/// The tree on the GPU.
struct Current {
    members: Members,
    /// Its range in the buffer of nodes.
    range: Range<u32>,
    /// The frame in which it was uploaded.
    since: u64,
}

/// The instances that rest, and the tree over them.
#[derive(Default)]
pub(super) struct RestingInstances {
    frame: u64,
    current: Option<Current>,
    pending: Option<Pending>,
    /// The frames in which instances last moved, or appeared after the first choice of members, by slot; 0 for the others.
    moved: Vec<u64>,
    /// Members must be chosen again: instances have come or moved since the last choice, or the chosen tree could not be used or kept.
    has_changed: bool,
    /// The first frame in which members may be chosen again, and the wait after that.
    next: u64,
    wait: u64,
    /// Ranges of trees that the top level on the GPU has, or had in the last frame.
    outdated: Vec<Range<u32>>,
    /// No instances share a tree.
    is_off: bool,
    /// Pictures must be repeatable ([`Background::take`]).
    waits: bool,
}

impl RestingInstances {
    /// `waits`: pictures must be repeatable.
    pub(super) fn new(waits: bool) -> Self {
        Self { waits, ..Default::default() }
    }

    /// Gives up the tree if one of its instances has changed, and builds one for instances that have rested.  Returns whether the entries of
    /// the top level have changed, and the number of bytes sent.
    pub(super) fn update(
        &mut self,
        instances: &mut InstancePool,
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> (bool, u64) {
        self.frame += 1;
        let changed = instances.changed_slots();
        self.note_motion(changed, instances);
        if self.pending.as_ref().is_some_and(|pending| !pending.members.stay(changed, instances)) {
            self.pending = None;
            self.has_changed = true;
        }
        let is_outdated = |current: &Current| self.is_off || !current.members.stay(changed, instances);
        let was_given_up = self.current.as_ref().is_some_and(is_outdated);
        if was_given_up {
            self.give_up();
        }
        // Only the first tree waits for the rest of the scene: an app may load or edit something in every frame.
        let is_loaded = self.next > 0 || !instances.waiting && meshes.were_built();
        let is_small = instances.totals.instances <= MAX_INSTANCES;
        let is_due = self.has_changed && self.pending.is_none() && self.frame >= self.next;
        if is_due && is_loaded && is_small && !self.is_off {
            instances.sort();
            self.choose(instances, meshes);
        }
        let uploaded = match self.take_built() {
            Some((tree, members)) => self.adopt(&tree, members, meshes, device, queue),
            None => 0,
        };
        (was_given_up || uploaded > 0, uploaded)
    }

    fn note_motion(&mut self, changed: &[u32], instances: &InstancePool) {
        for &slot in changed {
            let instance = instances.get(slot);
            let has_moved = instance.world_from_object != instance.previous_world_from_object;
            let has_appeared = instance.flags & INSTANCE_APPEARED != 0;
            self.has_changed |= has_moved || has_appeared;
            // An instance that is edited appears in another slot, and an app may edit it in every frame.
            if has_moved || has_appeared && self.next > 0 {
                let slot = slot as usize;
                self.moved.resize(self.moved.len().max(slot + 1), 0);
                self.moved[slot] = self.frame;
            }
        }
    }

    fn give_up(&mut self) {
        let Some(old) = self.current.take() else { return };
        self.outdated.push(old.range);
        self.has_changed = true;
        // Trees that do not live long are not worth their builds.
        let lived = self.frame - old.since;
        self.wait = if lived < 4 * REST_FRAMES { (2 * self.wait).clamp(REST_FRAMES, MAX_WAIT) } else { REST_FRAMES };
        self.next = self.frame + self.wait;
    }

    /// Chooses the instances of the next tree, and starts its build if they are worth it.
    fn choose(&mut self, instances: &InstancePool, meshes: &MeshPool) {
        let is_first = self.next == 0;
        self.next = self.frame + REST_FRAMES;
        let frame = self.frame;
        let is_recent = |moved: &u64| *moved > 0 && *moved + REST_FRAMES > frame;
        // Those that do not rest yet are looked at again.
        self.has_changed = self.moved.iter().any(is_recent);
        let at_rest = |slot: &u32| !self.moved.get(*slot as usize).is_some_and(is_recent);
        let is_wanted = |live: &LiveInstance| live.ray_mask != 0 && is_in_range(live.bounds);
        let all = instances.in_order().filter(|(slot, live)| is_wanted(live) && at_rest(slot));
        let resting: Vec<_> = all.filter(|(slot, live)| has_known_triangles(*slot, live, instances, meshes)).collect();
        let chosen = within_budget(&resting);
        let count = |list: &[(u32, &LiveInstance)]| list.iter().map(|(_, live)| live.triangles).sum::<u32>();
        let is_new = |(slot, _): &(u32, &LiveInstance)| {
            self.current.as_ref().is_none_or(|current| !current.members.placements.contains_key(slot))
        };
        let added: Vec<_> = chosen.iter().copied().filter(is_new).collect();
        if chosen.len() < 2 || 4 * count(&added) < count(&chosen) {
            return;
        }
        let part = |&(slot, live): &(u32, &LiveInstance)| {
            let instance = instances.get(slot);
            let copy = meshes.get(live.mesh).and_then(|mesh| mesh.corners.as_ref());
            let positions = copy.map(|copy| copy.corners().collect()).unwrap_or_default();
            let Placement { world_from_object, first_triangle } = Placement::of(instance);
            Part { slot, first_triangle, world_from_object, positions }
        };
        let parts: Vec<Part> = chosen.iter().map(part).collect();
        let bounds = chosen.iter().map(|(_, live)| live.bounds).reduce(joined).unwrap_or_default();
        let placements = chosen.iter().map(|&(slot, _)| (slot, Placement::of(instances.get(slot)))).collect();
        // The first frames of a scene wait for its meshes anyway.
        let due = frame + if is_first { 0 } else { BUILD_FRAMES };
        let build = Background::start(due, move || WorldTree::build(&parts));
        self.pending = Some(Pending { build, members: Members { placements, bounds } });
    }

    /// Takes the tree that is used from this frame on, with its members.
    fn take_built(&mut self) -> Option<(WorldTree, Members)> {
        let built = self.pending.as_mut()?.build.take(self.frame, self.waits)?;
        let Pending { members, .. } = self.pending.take()?;
        Some((built?, members))
    }

    /// Uploads a tree in place of the current one.  Returns the number of bytes sent, 0 if there is no room for it.
    fn adopt(
        &mut self,
        tree: &WorldTree,
        members: Members,
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> u64 {
        let Some(range) = meshes.allocate_nodes(tree.node_count(), device, queue) else {
            self.next = self.frame + MAX_WAIT;
            self.has_changed = true;
            return 0;
        };
        let bytes = meshes.nodes.write(range.start, bytemuck::cast_slice(&tree.words(range.start)), queue);
        let current = Current { members, range, since: self.frame };
        self.outdated.extend(self.current.replace(current).map(|old| old.range));
        bytes
    }

    /// Whether the tree has the instance in a slot.
    pub(super) fn contains(&self, slot: u32) -> bool {
        self.current.as_ref().is_some_and(|current| current.members.placements.contains_key(&slot))
    }

    /// Number of instances in the tree.
    #[cfg(feature = "testing")]
    pub(super) fn len(&self) -> usize {
        self.current.as_ref().map_or(0, |current| current.members.placements.len())
    }

    /// The tree as an entry of the top level, with its bounds.
    pub(super) fn entry(&self) -> Option<(u32, Bounds)> {
        self.current.as_ref().map(|current| (WORLD_TREE | current.range.start, current.members.bounds))
    }

    /// Ranges of trees that are free once a new top level is on the GPU and a frame has passed.
    pub(super) fn take_outdated(&mut self) -> Vec<Range<u32>> {
        core::mem::take(&mut self.outdated)
    }
}

/// Whether the triangles in these bounds can be intersected in world space: the intersection multiplies three lengths.
fn is_in_range((min, max): Bounds) -> bool {
    const FARTHEST: f32 = 1e12;
    min.iter().chain(&max).all(|coordinate| coordinate.abs() < FARTHEST)
}

/// Whether the CPU has a copy of the triangles of an instance.  They must be those of its mesh, so the instance must not bend, and its mesh must
/// not be built again.
fn has_known_triangles(slot: u32, live: &LiveInstance, instances: &InstancePool, meshes: &MeshPool) -> bool {
    let instance = instances.get(slot);
    let mesh = meshes.get(live.mesh).filter(|_| !meshes.is_building(live.mesh));
    let is_known = |mesh: &MeshEntry| mesh.corners.is_some() && mesh.triangles.start == instance.first_triangle;
    instance.flags & INSTANCE_DEFORMED == 0 && mesh.is_some_and(is_known)
}

/// The instances of as many meshes as fit [`MAX_TRIANGLES`], from the mesh whose instances together have the fewest triangles upwards.
fn within_budget<'a>(resting: &[(u32, &'a LiveInstance)]) -> Vec<(u32, &'a LiveInstance)> {
    let mut totals: HashMap<AssetId<Mesh>, usize> = HashMap::default();
    for (_, live) in resting {
        *totals.entry(live.mesh).or_default() += live.triangles as usize;
    }
    let mut sorted: Vec<_> = totals.iter().map(|(mesh, total)| (*total, *mesh)).collect();
    sorted.sort_unstable();
    let mut sum = 0;
    let fits = |(total, mesh): &(usize, AssetId<Mesh>)| {
        sum += total;
        (sum <= MAX_TRIANGLES).then_some(*mesh)
    };
    let meshes: HashSet<_> = sorted.iter().map_while(fits).collect();
    resting.iter().copied().filter(|(_, live)| meshes.contains(&live.mesh)).collect()
}

/// Whether instances that rest share a tree, as they do unless this is called.
#[cfg(feature = "testing")]
pub fn share_a_tree_at_rest(app: &mut App, enabled: bool) {
    let world = app.get_sub_app_mut(bevy::render::RenderApp).map(|render| render.world_mut());
    if let Some(mut instances) = world.and_then(|world| world.get_resource_mut::<InstancePool>()) {
        instances.top.resting.is_off = !enabled;
    }
}
