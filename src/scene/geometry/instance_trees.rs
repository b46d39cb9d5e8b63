//! The two trees of the top level.  The main tree has the instances that were there when it was built.  Those that have come since are in a
//! small tree of their own, which is built again whenever one of them comes, moves or goes: the cost of a new instance depends on the size of
//! the small tree, not on that of the scene.
//!
//! Where instances of the main tree move, it is refitted, and those that go are taken out of it (`accel/refit.rs`).  When newcomers have become
//! many, or have rested for a while, a main tree over all instances is built in the background.

use std::collections::BTreeMap;

use crate::gpu_layout::{NONE, WORLD_TREE};
use crate::scene::{
    accel::blas::{Bounds, joined},
    accel::refit::Refit,
    accel::tlas::{Tlas, build_tlas},
    geometry::background::{BUILD_FRAMES, Background},
    geometry::joined_trees::JoinedTrees,
};

/// Greatest cost of a refitted tree, relative to its cost when it was built.  Beyond it, the tree is built again in the same frame, because a
/// ray that visits too many nodes ends with an error.
const MAX_COST: f64 = 1.2;
/// Up to this number of instances, there is only one tree, which is built again when one of them comes or goes.
const FEW_INSTANCES: usize = 64;
/// Share of the instances, as its reciprocal, beyond which newcomers are many.
const MANY: usize = 8;
/// Least and greatest number of newcomers that this share stands for.
const LEAST_MANY: usize = 64;
const MOST_MANY: usize = 512;
/// Frames after which newcomers that have not changed enter the main tree, however few they are.
const SETTLE_FRAMES: u64 = 128;

/// A tree over entries: slots of instances, and the tree over those that rest (`WORLD_TREE`).
#[derive(Default)]
struct MainTree {
    /// In the order of the build, with their bounds in the world; also those that have gone.
    entries: Vec<(u32, Bounds)>,
    /// Places of instances in `entries`, by slot; `NONE` for slots that the tree does not have.
    places: Vec<u32>,
    /// Number of entries that have gone.
    gone: usize,
    tree: Tlas,
    built_cost: f64,
    /// `None` if the tree lacks an entry, so that it cannot be refitted.
    refit: Option<Refit>,
    /// The box around all entries; `None` if there are none.
    bounds: Option<Bounds>,
}

/// Builds a tree, with what it takes to refit it unless it lacks an entry.
fn build_fitted(entries: &[(u32, Bounds)]) -> (Tlas, Option<Refit>) {
    let mut tree = build_tlas(entries);
    let is_complete = tree.order.len() == entries.len();
    let refit = is_complete.then(|| Refit::new(&mut tree, entries));
    (tree, refit)
}

impl MainTree {
    fn build(entries: Vec<(u32, Bounds)>) -> Self {
        let (tree, refit) = build_fitted(&entries);
        let mut places = Vec::new();
        for (place, (slot, _)) in entries.iter().enumerate().filter(|(_, (slot, _))| slot & WORLD_TREE == 0) {
            if places.len() <= *slot as usize {
                places.resize(*slot as usize + 1, NONE);
            }
            places[*slot as usize] = place as u32;
        }
        Self {
            bounds: entries.iter().map(|(_, bounds)| *bounds).reduce(joined),
            built_cost: refit.as_ref().map_or(0.0, |refit| refit.cost(&tree)),
            entries,
            places,
            gone: 0,
            tree,
            refit,
        }
    }

    /// Number of entries that rays can reach.
    fn len(&self) -> usize {
        self.entries.len() - self.gone
    }

    /// Place of an instance in `entries`.
    fn place(&self, slot: u32) -> Option<u32> {
        self.places.get(slot as usize).copied().filter(|place| *place != NONE)
    }

    /// Bounds of an instance that the tree has.
    fn bounds_of(&self, slot: u32) -> Option<Bounds> {
        self.place(slot).map(|place| self.entries[place as usize].1)
    }

    /// Forgets the place of an instance that has gone.
    fn forget(&mut self, slot: u32) {
        self.places[slot as usize] = NONE;
        self.gone += 1;
    }

    /// Fits the tree to the entries at the places `moved`, and takes those at the places `gone` out of it.  Returns the nodes that may have
    /// changed, in ascending order; `None` if the tree must be built again.
    fn fit(&mut self, moved: &[u32], gone: &[u32]) -> Option<Vec<usize>> {
        let refit = self.refit.as_mut()?;
        if moved.is_empty() && gone.is_empty() {
            return Some(Vec::new());
        }
        let nodes = refit.update(&mut self.tree, &self.entries, moved, gone);
        self.bounds = Some(refit.bounds());
        (refit.cost(&self.tree) <= MAX_COST * self.built_cost).then_some(nodes)
    }
}

/// A main tree that is being built.
struct Pending {
    build: Background<MainTree>,
    /// By slot: its instance has come, moved or gone since the build began.
    is_outdated: Vec<bool>,
}

impl Pending {
    fn note(&mut self, slot: u32) {
        let slot = slot as usize;
        self.is_outdated.resize(self.is_outdated.len().max(slot + 1), false);
        self.is_outdated[slot] = true;
    }
}

/// What has changed in a frame.
#[derive(Default)]
struct Edits {
    /// Places of entries of the main tree.
    moved: Vec<u32>,
    gone: Vec<u32>,
    /// A newcomer has come, moved or gone.
    newcomers: bool,
}

/// What the copy on the GPU lacks.
#[derive(Debug, PartialEq)]
pub(super) enum Change {
    Nothing,
    /// These nodes of the main tree, in ascending order; and the whole tree over newcomers, if it was built again.
    Parts {
        nodes: Vec<usize>,
        newcomers: bool,
    },
    /// The main tree was replaced.
    All,
}

/// The trees over the instances that rays can hit.
#[derive(Default)]
pub(super) struct InstanceTrees {
    frame: u64,
    main: MainTree,
    /// The instances that have come since the main tree was built: their bounds by slot.
    newcomers: BTreeMap<u32, Bounds>,
    newcomers_tree: Tlas,
    newcomers_bounds: Option<Bounds>,
    /// The last frame in which a newcomer came, moved or went.
    newcomers_changed: u64,
    /// Newcomers that stayed out of the last main tree, because they moved during its build.
    left_out: usize,
    pending: Option<Pending>,
    /// Pictures must be repeatable ([`Background::take`]).
    waits: bool,
}

impl InstanceTrees {
    /// `waits`: pictures must be repeatable.
    pub(super) fn new(waits: bool) -> Self {
        Self { waits, ..Default::default() }
    }

    /// Builds one tree over all entries.
    pub(super) fn rebuild(&mut self, entries: Vec<(u32, Bounds)>) {
        let (frame, waits) = (self.frame, self.waits);
        *self = Self { frame, waits, main: MainTree::build(entries), ..Default::default() };
    }

    /// Updates the trees for the slots in which an instance has come, moved or gone.  `bounds_in`: the bounds of the instance that is in a slot
    /// in this frame, if rays can hit it.  Returns `None` if the trees must be built again.
    pub(super) fn update(&mut self, changed: &[u32], bounds_in: impl Fn(u32) -> Option<Bounds>) -> Option<Change> {
        self.frame += 1;
        let edits = self.take_over(changed, bounds_in);
        let has_changed = edits.newcomers || !edits.moved.is_empty() || !edits.gone.is_empty();
        if has_changed && self.should_be_one() {
            return None;
        }
        if let Some((built, is_outdated)) = self.take_built() {
            self.adopt(built, &is_outdated)?;
            return Some(Change::All);
        }
        if !has_changed {
            return Some(Change::Nothing);
        }
        let nodes = self.main.fit(&edits.moved, &edits.gone)?;
        if edits.newcomers {
            self.build_newcomers()?;
        }
        Some(Change::Parts { nodes, newcomers: edits.newcomers })
    }

    /// Takes over the bounds of the instances in these slots.
    fn take_over(&mut self, changed: &[u32], bounds_in: impl Fn(u32) -> Option<Bounds>) -> Edits {
        let mut edits = Edits::default();
        for &slot in changed {
            if let Some(pending) = &mut self.pending {
                pending.note(slot);
            }
            match (self.main.place(slot), bounds_in(slot)) {
                (Some(place), Some(bounds)) => {
                    let known = &mut self.main.entries[place as usize].1;
                    if core::mem::replace(known, bounds) != bounds {
                        edits.moved.push(place);
                    }
                }
                (Some(place), None) => {
                    self.main.forget(slot);
                    edits.gone.push(place);
                }
                (None, Some(bounds)) => edits.newcomers |= self.newcomers.insert(slot, bounds) != Some(bounds),
                (None, None) => edits.newcomers |= self.newcomers.remove(&slot).is_some(),
            }
        }
        self.left_out = self.left_out.min(self.newcomers.len());
        edits
    }

    /// Whether a new tree over all instances is better than the trees, and not much more work than one over the newcomers.
    fn should_be_one(&self) -> bool {
        let (main, newcomers) = (self.main.len(), self.newcomers.len());
        let is_one = newcomers == 0 && self.main.gone == 0;
        !is_one && (main + newcomers <= FEW_INSTANCES || newcomers >= main)
    }

    fn build_newcomers(&mut self) -> Option<()> {
        let entries: Vec<_> = self.newcomers.iter().map(|(slot, bounds)| (*slot, *bounds)).collect();
        let (tree, refit) = build_fitted(&entries);
        self.newcomers_bounds = Some(refit?.bounds()).filter(|_| !entries.is_empty());
        self.newcomers_tree = tree;
        self.newcomers_changed = self.frame;
        Some(())
    }

    /// Whether a main tree over all entries should be built in the background.
    pub(super) fn needs_main_tree(&self) -> bool {
        let newcomers = self.newcomers.len();
        let many = (self.main.len() / MANY).clamp(LEAST_MANY, MOST_MANY) + self.left_out;
        let have_settled = newcomers > 0 && self.frame >= self.newcomers_changed + SETTLE_FRAMES;
        let is_sparse = 2 * self.main.gone > self.main.entries.len();
        self.pending.is_none() && (newcomers > many || have_settled || is_sparse)
    }

    /// Builds a main tree over all entries of this frame in the background.
    pub(super) fn build_main_tree(&mut self, entries: Vec<(u32, Bounds)>) {
        let build = Background::start(self.frame + BUILD_FRAMES, move || MainTree::build(entries));
        self.pending = Some(Pending { build, is_outdated: Vec::new() });
    }

    /// Takes the main tree that is used from this frame on, and which of its slots are outdated.
    fn take_built(&mut self) -> Option<(MainTree, Vec<bool>)> {
        let built = self.pending.as_mut()?.build.take(self.frame, self.waits)?;
        let Pending { is_outdated, .. } = self.pending.take()?;
        Some((built, is_outdated)).filter(|(built, _)| built.refit.is_some())
    }

    /// Puts another main tree in place of the present one.
    fn adopt(&mut self, mut built: MainTree, is_outdated: &[bool]) -> Option<()> {
        let (mut moved, mut gone) = (Vec::new(), Vec::new());
        let outdated = (0..is_outdated.len() as u32).filter(|slot| is_outdated[*slot as usize]);
        for slot in outdated {
            let Some(place) = built.place(slot) else { continue };
            match self.main.bounds_of(slot) {
                Some(bounds) => {
                    built.entries[place as usize].1 = bounds;
                    moved.push(place);
                }
                // Its instance has gone, or the slot holds a newcomer that moved or came after the build began.
                None => {
                    built.forget(slot);
                    gone.push(place);
                }
            }
        }
        built.fit(&moved, &gone)?;
        self.newcomers.retain(|slot, _| built.place(*slot).is_none());
        self.main = built;
        self.left_out = self.newcomers.len();
        self.build_newcomers()
    }

    /// Number of instances.
    pub(super) fn len(&self) -> usize {
        self.main.len() + self.newcomers.len()
    }

    /// The box around all instances; `None` if there are none.
    pub(super) fn bounds(&self) -> Option<Bounds> {
        self.main.bounds.into_iter().chain(self.newcomers_bounds).reduce(joined)
    }

    /// Both trees.
    pub(super) fn joined(&self) -> JoinedTrees<'_> {
        match (self.main.bounds, self.newcomers_bounds) {
            (Some(main), Some(newcomers)) => JoinedTrees::two(&self.main.tree, &self.newcomers_tree, [main, newcomers]),
            _ => JoinedTrees::single(&self.main.tree),
        }
    }

    /// Number of instances in the tree over newcomers.
    #[cfg(any(test, feature = "testing"))]
    pub(super) fn newcomers(&self) -> usize {
        self.newcomers.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::tasks::{AsyncComputeTaskPool, TaskPool};

    /// Instances in slots, and the trees that follow them.
    #[derive(Default)]
    struct Scene {
        instances: BTreeMap<u32, Bounds>,
        trees: InstanceTrees,
        changed: Vec<u32>,
        state: u32,
        /// Numbers of trees over all instances that were built in a frame, and in the background.
        rebuilt: usize,
        adopted: usize,
    }

    impl Scene {
        fn new(count: usize) -> Self {
            AsyncComputeTaskPool::get_or_init(TaskPool::new);
            let mut scene = Self { trees: InstanceTrees::new(true), ..Default::default() };
            (0..count).for_each(|_| _ = scene.come());
            scene.frame();
            scene
        }

        /// A number below `end`.
        fn random(&mut self, end: usize) -> usize {
            self.state = self.state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (self.state >> 8) as usize % end
        }

        /// An instance comes into the first free slot.
        fn come(&mut self) -> u32 {
            let slot = (0..).find(|slot| !self.instances.contains_key(slot)).expect("there are enough");
            let low: [f32; 3] = core::array::from_fn(|_| 0.01 * self.random(10_000) as f32);
            self.instances.insert(slot, (low, low.map(|x| x + 1.0)));
            self.changed.push(slot);
            slot
        }

        fn any(&mut self) -> u32 {
            let index = self.random(self.instances.len());
            *self.instances.keys().nth(index).expect("there are enough")
        }

        fn go(&mut self, slot: u32) {
            self.instances.remove(&slot);
            self.changed.push(slot);
        }

        fn shift(&mut self, slot: u32) {
            let (low, high) = self.instances.get_mut(&slot).expect("it is there");
            (low[1], high[1]) = (low[1] + 0.25, high[1] + 0.25);
            self.changed.push(slot);
        }

        fn entries(&self) -> Vec<(u32, Bounds)> {
            self.instances.iter().map(|(slot, bounds)| (*slot, *bounds)).collect()
        }

        /// Ends a frame, and checks the trees.
        fn frame(&mut self) -> Change {
            let changed = core::mem::take(&mut self.changed);
            let instances = &self.instances;
            let change = self.trees.update(&changed, |slot| instances.get(&slot).copied());
            self.adopted += usize::from(change == Some(Change::All));
            if change.is_none() {
                self.rebuilt += 1;
                self.trees.rebuild(self.entries());
            }
            if self.trees.needs_main_tree() {
                self.trees.build_main_tree(self.entries());
            }
            let entries = self.entries();
            self.trees.joined().reached(3).assert_holds(&entries);
            assert_eq!(self.trees.bounds(), entries.iter().map(|(_, bounds)| *bounds).reduce(joined));
            change.unwrap_or(Change::All)
        }
    }

    #[test]
    fn rays_reach_every_instance_once_whatever_comes_moves_and_goes() {
        for count in [3, 100, 1000] {
            let mut scene = Scene::new(count);
            for frame in 0..300 {
                // At times many come, and later many go.
                let (comers, goers) = match frame % 90 {
                    30 => (count / 5, 0),
                    60 => (0, scene.instances.len() / 2),
                    _ => (frame % 3, frame % 2),
                };
                (0..comers).for_each(|_| _ = scene.come());
                for _ in 0..goers {
                    let slot = scene.any();
                    scene.go(slot);
                }
                for _ in 0..frame % 4 {
                    let slot = scene.any();
                    scene.shift(slot);
                }
                scene.frame();
            }
            assert!(count < 1000 || scene.rebuilt <= 10 && scene.adopted >= 2, "{}, {}", scene.rebuilt, scene.adopted);
        }
    }

    #[test]
    fn a_change_of_one_in_a_thousand_instances_changes_a_few_nodes() {
        let mut scene = Scene::new(1000);
        for _ in 0..20 {
            scene.come();
            assert_eq!(scene.frame(), Change::Parts { nodes: Vec::new(), newcomers: true });
            let slot = 7 * scene.random(100) as u32;
            if !scene.instances.contains_key(&slot) || scene.trees.newcomers.contains_key(&slot) {
                continue;
            }
            scene.go(slot);
            let Change::Parts { nodes, newcomers: false } = scene.frame() else { panic!("more has changed") };
            assert!((1..=12).contains(&nodes.len()), "{} nodes", nodes.len());
        }
        assert_eq!((scene.rebuilt, scene.adopted), (1, 0));
    }

    #[test]
    fn newcomers_enter_the_main_tree_when_they_are_many_or_rest() {
        let mut scene = Scene::new(1000);
        let mover = scene.come();
        (0..200).for_each(|_| _ = scene.come());
        scene.frame();
        assert_eq!(scene.trees.newcomers(), 201);
        // During the build one comes, one moves, and one that was there goes.
        for frame in 1..=BUILD_FRAMES {
            match frame {
                2 => _ = scene.come(),
                3 => scene.go(mover + 1),
                4 => scene.go(5),
                _ => scene.shift(mover),
            }
            let change = scene.frame();
            assert_eq!(change == Change::All, frame == BUILD_FRAMES, "frame {frame}");
        }
        assert_eq!(scene.trees.newcomers(), 2, "the one that has come, and the one that moves");
        for _ in 1..SETTLE_FRAMES + BUILD_FRAMES {
            assert_eq!(scene.frame(), Change::Nothing);
        }
        assert_eq!((scene.frame(), scene.trees.newcomers()), (Change::All, 0));
        assert_eq!((scene.rebuilt, scene.adopted), (1, 2));
    }

    #[test]
    fn few_instances_and_those_that_nearly_all_go_are_in_one_tree() {
        let mut scene = Scene::new(FEW_INSTANCES - 1);
        scene.come();
        assert_eq!((scene.frame(), scene.trees.newcomers()), (Change::All, 0));
        scene.come();
        assert_eq!((scene.frame() == Change::All, scene.trees.newcomers()), (false, 1));
        for slot in 0..=FEW_INSTANCES as u32 {
            scene.go(slot);
        }
        scene.frame();
        assert_eq!((scene.trees.newcomers(), scene.trees.bounds()), (0, None));
        scene.frame();
        assert_eq!(scene.rebuilt, 3);
    }
}
