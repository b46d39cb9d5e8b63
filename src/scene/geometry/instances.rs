//! Keeps a [`GpuInstance`] in a stable slot for each mesh instance of the scene.
//!
//! Temporal reuse traces rays through the scene of the last frame.  So each record has the transform of the last frame, the top level of the
//! last frame is kept beside the new one, and everything else about a slot never changes: an instance that is edited gets another slot.  The
//! slot of an instance that has disappeared, or that was edited, keeps its record for one frame with the flag [`INSTANCE_GONE`], and a slot
//! that the last frame did not have carries [`INSTANCE_APPEARED`].
//!
//! A frame visits the instances that are due: those that have changed, those whose mesh or material has, and those that the last frame left
//! unsettled, because they moved, appeared or wait for something.

use bevy::{
    asset::{AssetId, AssetServer},
    ecs::resource::Resource,
    log::{warn, warn_once},
    math::Affine3A,
    mesh::Mesh,
    render::{
        renderer::{RenderDevice, RenderQueue},
        sync_world::{MainEntity, MainEntityHashMap, MainEntityHashSet},
    },
};

use crate::gpu_layout::*;
use crate::scene::{
    accel::blas::Bounds,
    accel::tlas,
    asset_wait::AssetWait,
    extract::{
        ExtractedScene,
        instances::{ExtractedInstance, InstanceList},
    },
    features::SceneFeatures,
    geometry::bodies::{Body, BodyPool},
    geometry::meshes::{MeshEntry, MeshPool},
    geometry::render_layers::MAX_LAYER_SETS,
    geometry::top_level::TopLevel,
    geometry::totals::Totals,
    material::{materials::MaterialPool, subsurface::SubsurfacePool},
    storage::{dirty_runs::joined_runs, growable_buffer::GrowableBuffer, overflow_warning::OverflowWarning},
};
use crate::warned::Warned;

/// An instance that at least one camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LiveInstance {
    pub entity: MainEntity,
    pub mesh: AssetId<Mesh>,
    pub material: u32,
    /// Bits of the cameras that see it directly: 0 for a `RestirMaterial`.
    pub camera_mask: u32,
    /// Bits of the cameras whose other rays can hit it: 0 for a `NotShadowCaster`.
    pub ray_mask: u32,
    pub triangles: u32,
    /// Features that shaders need for it.
    pub features: SceneFeatures,
    /// Its triangles are lights.
    pub emits: bool,
    /// World bounds.
    pub bounds: Bounds,
}

impl LiveInstance {
    /// Its bounds in the top level, if rays can hit it.
    pub(super) fn traced_bounds(&self) -> Option<Bounds> {
        (self.ray_mask != 0).then_some(self.bounds)
    }
}

/// Reasons to warn about an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum InstanceProblem {
    UnusableTransform,
    MissingAsset,
}

/// The instances of the scene.
#[derive(Resource)]
pub(crate) struct InstancePool {
    slots: MainEntityHashMap<u32>,
    free: Vec<u32>,
    /// Slots of instances that the last frame had and this one does not.
    gone: Vec<u32>,
    /// By slot.
    records: Vec<GpuInstance>,
    /// By slot; `None` for free slots and those of instances that are gone.
    live: Vec<Option<LiveInstance>>,
    /// The live instances with their slots, in the order of their entities.
    order: Vec<(MainEntity, u32)>,
    /// The instances that are not in `order` yet.
    newcomers: Vec<(MainEntity, u32)>,
    pub totals: Totals,
    /// The records that the GPU has.
    uploaded: Vec<GpuInstance>,
    /// Slots whose records may differ from those that the GPU has; some more than once.
    dirty: Vec<u32>,
    /// Instances to visit in the next frame even if nothing changes.
    unsettled: Vec<MainEntity>,
    /// Instances whose triangles are lights.
    emitters: MainEntityHashSet,
    /// An instance whose triangles are lights was visited since [`Self::take_emitters_changed`].
    emitters_changed: bool,
    /// Instances that were visited in this frame.
    pub visited: u64,
    /// An instance has moved, appeared or disappeared in this frame.
    moved: bool,
    appeared: bool,
    left_out: u64,
    pub gpu: GrowableBuffer<GpuInstance>,
    pub top: TopLevel,
    /// Entities that a warning has named.
    warned: Warned<(MainEntity, InstanceProblem)>,
    asset_wait: AssetWait,
    overflow: OverflowWarning,
    /// Some instance waits for its mesh or material.
    pub waiting: bool,
    /// Counts the frames in which instances moved, appeared or disappeared.
    pub motion_revision: u64,
    /// Counts the frames in which instances appeared or disappeared, or were edited.
    pub membership_revision: u64,
    /// Counts edits of instances that had to keep their slot, because the device binds no more slots.
    pub edit_revision: u64,
}

impl Default for InstancePool {
    fn default() -> Self {
        Self {
            slots: MainEntityHashMap::default(),
            free: Vec::new(),
            gone: Vec::new(),
            records: Vec::new(),
            live: Vec::new(),
            order: Vec::new(),
            newcomers: Vec::new(),
            totals: Totals::default(),
            uploaded: Vec::new(),
            dirty: Vec::new(),
            unsettled: Vec::new(),
            emitters: MainEntityHashSet::default(),
            emitters_changed: false,
            visited: 0,
            moved: false,
            appeared: false,
            left_out: 0,
            gpu: GrowableBuffer::new("instances"),
            top: TopLevel::default(),
            warned: Warned::default(),
            asset_wait: AssetWait::default(),
            overflow: OverflowWarning::default(),
            waiting: true,
            motion_revision: 0,
            membership_revision: 0,
            edit_revision: 0,
        }
    }
}

/// What the records of instances depend on.
pub(crate) struct InstanceSources<'a> {
    pub meshes: &'a MeshPool,
    pub bodies: &'a BodyPool,
    pub materials: &'a mut MaterialPool,
    pub subsurface: &'a mut SubsurfacePool,
    pub assets: &'a AssetServer,
    /// Number of instances that the device can bind.
    pub limit: u32,
}

/// The record of a free slot.
const EMPTY_SLOT: GpuInstance = GpuInstance {
    world_from_object: [[0.0; 4]; 3],
    object_from_world: [[0.0; 4]; 3],
    previous_world_from_object: [[0.0; 4]; 3],
    blas_root: NONE,
    first_triangle: 0,
    triangle_count: 0,
    material: 0,
    first_light: NONE,
    flags: 0,
    layers: 0,
    entity: 0,
};

/// The record without its transforms, its place in the table of lights, and whether the last frame had it.  The rest must not change: temporal
/// reuse has the transforms of both frames and maps light ids from one table to the other, but it has one material and one mesh for a slot.
fn without_placement(instance: &GpuInstance) -> GpuInstance {
    let zero = Rows::default();
    GpuInstance {
        world_from_object: zero,
        object_from_world: zero,
        previous_world_from_object: zero,
        first_light: NONE,
        flags: instance.flags & !(INSTANCE_APPEARED | INSTANCE_GONE),
        ..*instance
    }
}

fn flags_of(world_from_object: &Affine3A, mesh: &MeshEntry, material: &GpuMaterial) -> u32 {
    let mut flags = 0;
    if world_from_object.matrix3.determinant() < 0.0 {
        flags |= INSTANCE_MIRRORED;
    }
    if material.flags & (MATERIAL_ALPHA_MASK | MATERIAL_ALPHA_BLEND) != 0 {
        flags |= INSTANCE_ALPHA;
    }
    if !mesh.second_uvs.is_empty() {
        flags |= INSTANCE_SECOND_UV;
    }
    flags
}

/// Bits of the cameras that see an instance directly.
fn seen_by(extracted: &ExtractedInstance) -> u32 {
    if extracted.is_stand_in { 0 } else { extracted.camera_mask }
}

impl InstancePool {
    /// Lengths of the pool's tables.
    #[cfg(feature = "testing")]
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("instances", self.slots.len()),
            ("slots of instances", self.records.len()),
            ("warnings of instances", self.warned.len()),
        ]
    }

    /// A pool that uses the device's own acceleration structures.
    pub(crate) fn for_ray_queries() -> Self {
        Self { top: TopLevel::for_ray_queries(), ..Default::default() }
    }

    /// Takes the instances that must be visited although nothing about them has changed.
    pub(crate) fn take_unsettled(&mut self) -> Vec<MainEntity> {
        core::mem::take(&mut self.unsettled)
    }

    /// Visits the instances that are due, in the order of their entities.  Materials are packed before this call, and light ids are set after
    /// it.
    pub(crate) fn update(&mut self, due: &[MainEntity], scene: &ExtractedScene, sources: &mut InstanceSources) {
        self.begin_frame();
        self.visited = due.len() as u64;
        for &entity in due {
            let shown = scene.instances.get(entity).and_then(|extracted| self.show(extracted, sources));
            match shown {
                Some((slot, live)) => self.enter(slot, live),
                None => self.leave(entity),
            }
        }
        self.retire();
        let membership_changed = self.appeared || !self.gone.is_empty();
        self.membership_revision += u64::from(membership_changed);
        self.motion_revision += u64::from(self.moved || membership_changed);
        if self.overflow.should_warn(self.left_out, sources.meshes.idle() && !self.waiting) {
            let (left_out, limit) = (self.left_out, sources.limit);
            warn!("restir: {left_out} meshes are left out, because this device binds at most {limit} instances");
        }
    }

    fn begin_frame(&mut self) {
        (self.waiting, self.moved, self.appeared, self.left_out) = (false, false, false, 0);
        self.asset_wait.begin_frame();
        self.warned.begin_frame();
        for slot in self.gone.drain(..) {
            self.records[slot as usize] = EMPTY_SLOT;
            self.dirty.push(slot);
            self.free.push(slot);
        }
    }

    /// Writes the record of an instance; `None` if it is not shown.
    fn show(&mut self, extracted: &ExtractedInstance, sources: &mut InstanceSources) -> Option<(u32, LiveInstance)> {
        let entity = extracted.entity;
        let (mut instance, bounds) = self.record_of(extracted, sources)?;
        let mut features = sources.materials.features(instance.material);
        // Probes do not find an instance that casts no shadows.
        if let Some(component) = extracted.subsurface.filter(|_| extracted.casts_shadows) {
            instance.flags |= sources.subsurface.flags_of(entity, component);
            features.set(SceneFeatures::SUBSURFACE, instance.flags & INSTANCE_SUBSURFACE != 0);
        }
        let Some(slot) = self.slot_of(entity, &mut instance, sources.limit) else {
            self.left_out += 1;
            self.unsettled.push(entity);
            return None;
        };
        let mut moved = instance.world_from_object != instance.previous_world_from_object;
        if instance.flags & INSTANCE_DEFORMED != 0 {
            features |= SceneFeatures::DEFORMATION;
            moved |= sources.bodies.get(entity).is_some_and(|body| body.moved);
        }
        self.moved |= moved;
        if moved || instance.flags & INSTANCE_APPEARED != 0 {
            self.unsettled.push(entity);
        }
        self.records[slot as usize] = instance;
        self.dirty.push(slot);
        // A `NotShadowCaster` is not in the tree.  The camera still sees it, because the visibility pass rasterizes it.
        let ray_mask = if extracted.casts_shadows { extracted.camera_mask } else { 0 };
        let live = LiveInstance {
            entity,
            mesh: extracted.mesh,
            material: instance.material,
            camera_mask: seen_by(extracted),
            ray_mask,
            triangles: instance.triangle_count,
            features,
            // An instance that no ray can hit lights nothing.
            emits: ray_mask != 0 && sources.materials.emits(instance.material),
            bounds,
        };
        Some((slot, live))
    }

    /// Takes over an instance that is shown.
    fn enter(&mut self, slot: u32, live: LiveInstance) {
        let old = self.live[slot as usize].replace(live);
        self.top.changed |= old.and_then(|old| old.traced_bounds()) != live.traced_bounds();
        self.emitters_changed |= live.emits || old.is_some_and(|old| old.emits);
        if live.emits != old.is_some_and(|old| old.emits) {
            match live.emits {
                true => _ = self.emitters.insert(live.entity),
                false => _ = self.emitters.remove(&live.entity),
            }
        }
        match old {
            Some(old) => self.totals.subtract(&old),
            None => self.newcomers.push((live.entity, slot)),
        }
        self.totals.add(&live);
    }

    /// Gives up an instance that is not shown.
    fn leave(&mut self, entity: MainEntity) {
        if let Some(slot) = self.slots.remove(&entity) {
            self.give_up(slot);
        }
    }

    /// Gives up a slot.  It keeps its record until the next frame.
    fn give_up(&mut self, slot: u32) {
        self.gone.push(slot);
        let Some(old) = self.live[slot as usize].take() else { return };
        self.top.changed |= old.ray_mask != 0;
        self.emitters_changed |= old.emits;
        self.emitters.remove(&old.entity);
        self.totals.subtract(&old);
    }

    /// Marks the slots of instances that have disappeared, and those that edited instances had.
    fn retire(&mut self) {
        for &slot in &self.gone {
            let record = &mut self.records[slot as usize];
            // A body that has disappeared is not posed, so that its triangles are still those of the last frame.
            *record = GpuInstance {
                previous_world_from_object: record.world_from_object,
                first_light: NONE,
                flags: record.flags & !(INSTANCE_APPEARED | INSTANCE_DEFORMED) | INSTANCE_GONE,
                ..*record
            };
            self.dirty.push(slot);
        }
    }

    /// Forgets the warnings about entities that are gone.
    pub(crate) fn forget_warnings(&mut self, exists: impl Fn(MainEntity) -> bool) {
        self.warned.retain(|(entity, _)| exists(*entity));
    }

    /// The slot of an entity: that of the last frame if the instance has at most moved, else another one.  `None` if it has none and all
    /// `limit` slots are taken.  Completes its record from that of the last frame.
    fn slot_of(&mut self, entity: MainEntity, instance: &mut GpuInstance, limit: u32) -> Option<u32> {
        let last = self.slots.get(&entity).copied();
        let mut is_edited = false;
        if let Some(slot) = last {
            let old = &self.records[slot as usize];
            is_edited = without_placement(old) != without_placement(instance);
            instance.previous_world_from_object = old.world_from_object;
            instance.first_light = old.first_light;
        }
        if last.is_some() && !is_edited {
            return last;
        }
        let slot = match self.free.pop() {
            Some(slot) => slot,
            None if self.records.len() as u32 >= limit => {
                self.edit_revision += u64::from(last.is_some());
                return last;
            }
            None => {
                self.records.push(EMPTY_SLOT);
                self.live.push(None);
                self.records.len() as u32 - 1
            }
        };
        self.slots.insert(entity, slot);
        if let Some(last) = last {
            self.give_up(last);
        }
        instance.previous_world_from_object = instance.world_from_object;
        instance.first_light = NONE;
        instance.flags |= INSTANCE_APPEARED;
        self.appeared = true;
        Some(slot)
    }

    /// The record of an instance and its world bounds; `None` if its mesh or material is missing, or if it cannot be shown.
    fn record_of(
        &mut self,
        extracted: &ExtractedInstance,
        sources: &mut InstanceSources,
    ) -> Option<(GpuInstance, Bounds)> {
        match new_record(extracted, sources) {
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
                        "restir: entity {} has a transform that is singular, not finite, or reaches beyond {} m; it is left out",
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
            && (materials.slot(extracted.material).is_some() || self.asset_wait.is_pending(extracted.material, assets));
        self.waiting |= is_pending;
        // Nothing tells when an asset begins to load.
        self.unsettled.push(extracted.entity);
        if !is_pending && self.warned.is_due((extracted.entity, InstanceProblem::MissingAsset)) {
            warn!(
                "restir: entity {} has a mesh or a material that does not exist; the entity is left out",
                *extracted.entity
            );
        }
    }

    /// Sets the light id of the first triangle in a slot; those of the other triangles follow it.
    pub(crate) fn set_first_light(&mut self, slot: u32, light: u32) {
        self.records[slot as usize].first_light = light;
        self.dirty.push(slot);
    }

    /// The record of a slot.
    pub(crate) fn get(&self, slot: u32) -> &GpuInstance {
        &self.records[slot as usize]
    }

    /// The live instance in a slot.
    pub(crate) fn live_in(&self, slot: u32) -> Option<&LiveInstance> {
        self.live.get(slot as usize)?.as_ref()
    }

    /// All live instances with their slots, in the order of the slots.
    pub(crate) fn live(&self) -> impl Iterator<Item = (u32, &LiveInstance)> {
        self.live.iter().enumerate().filter_map(|(slot, live)| Some((slot as u32, live.as_ref()?)))
    }

    /// Brings the list of [`Self::in_order`] up to date.
    fn sort(&mut self) {
        if self.newcomers.is_empty() && self.order.len() as u64 == self.totals.instances {
            return;
        }
        let live = &self.live;
        let is_live = |(entity, slot): &(MainEntity, u32)| {
            live[*slot as usize].as_ref().is_some_and(|live| live.entity == *entity)
        };
        self.order.retain(is_live);
        self.order.extend(self.newcomers.drain(..).filter(is_live));
        // This sort is fast where most of the list is in order.
        self.order.sort();
        // An instance may have given up its slot and taken it again.
        self.order.dedup();
    }

    /// The live instances with their slots, in the order of their entities, once the top level has begun its frame.
    pub(super) fn in_order(&self) -> impl Iterator<Item = (u32, &LiveInstance)> {
        self.order.iter().filter_map(|(_, slot)| Some((*slot, self.live_in(*slot)?)))
    }

    /// The instances whose triangles are lights, with their slots, in the order of their entities.
    pub(crate) fn emitters(&self) -> Vec<(u32, &LiveInstance)> {
        let slots = self.emitters.iter().filter_map(|entity| self.slots.get(entity).copied());
        let mut emitters: Vec<_> = slots.filter_map(|slot| Some((slot, self.live_in(slot)?))).collect();
        emitters.sort_unstable_by_key(|(_, live)| live.entity);
        emitters
    }

    /// Whether the shown instance of an entity has a [`Subsurface`](crate::Subsurface).
    pub(crate) fn is_translucent(&self, entity: MainEntity) -> bool {
        let live = self.slots.get(&entity).and_then(|slot| self.live_in(*slot));
        live.is_some_and(|live| live.features.contains(SceneFeatures::SUBSURFACE))
    }

    /// Whether an instance whose triangles are lights was visited, or has disappeared, since the last call.
    pub(crate) fn take_emitters_changed(&mut self) -> bool {
        core::mem::take(&mut self.emitters_changed)
    }

    /// Rebuilds the top level if any bounds changed.
    pub(crate) fn build_top_level(
        &mut self,
        meshes: &mut MeshPool,
        bodies: &BodyPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        let mut top = core::mem::take(&mut self.top);
        top.begin_frame();
        self.sort();
        let was_rebuilt = match top.structures.is_some() {
            true => top.update_structures(self, meshes, bodies, device, queue),
            false => top.rebuild(self, meshes, device, queue),
        };
        self.motion_revision += u64::from(was_rebuilt);
        self.top = top;
    }

    /// Uploads the records that changed.  Returns the number of bytes sent.
    pub(crate) fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        if self.dirty.is_empty() {
            return 0;
        }
        self.dirty.sort();
        self.dirty.dedup();
        let differs = |slot: &usize| self.uploaded.get(*slot) != Some(&self.records[*slot]);
        let runs = joined_runs(self.dirty.iter().map(|slot| *slot as usize).filter(differs));
        if !runs.is_empty() && !self.gpu.reserve(self.records.len() as u32, device, queue) {
            warn_once!(
                "restir: {} instances are more than this device can bind; the last upload stays in use",
                self.records.len()
            );
            return 0;
        }
        self.dirty.clear();
        self.uploaded.resize(self.records.len(), EMPTY_SLOT);
        let mut bytes = 0;
        for run in runs {
            self.uploaded[run.clone()].copy_from_slice(&self.records[run.clone()]);
            bytes += self.gpu.write(run.start as u32, &self.records[run], queue);
        }
        bytes
    }

    /// Number of slots, including free ones.
    pub(crate) fn len(&self) -> u32 {
        self.records.len() as u32
    }
}

/// Why an instance has no record.
enum Absence {
    /// Its mesh has no triangles, or the device cannot bind its material.
    LeftOut,
    /// Its mesh or its material is missing.
    Asset,
    /// The shaders that pose bodies are not compiled yet.
    Shaders,
    /// Its transform cannot be used.
    Transform,
}

/// The record of an instance in its first frame, and its world bounds.
fn new_record(extracted: &ExtractedInstance, sources: &mut InstanceSources) -> Result<(GpuInstance, Bounds), Absence> {
    let InstanceSources { meshes, bodies, materials, .. } = sources;
    let (Some(mesh), Some(material)) = (meshes.get(extracted.mesh), materials.find(extracted.material)) else {
        let is_left_out = meshes.is_empty(extracted.mesh) || materials.is_left_out(extracted.material);
        return Err(if is_left_out { Absence::LeftOut } else { Absence::Asset });
    };
    let body = bodies.get(extracted.entity);
    if body.is_some() && !bodies.is_ready() {
        return Err(Absence::Shaders);
    }
    let (root, triangles, bounds) = match body {
        Some(body) => (body.root(), body.triangles(), body.bounds),
        None => (mesh.root(), mesh.triangles.clone(), mesh.bounds),
    };
    let placed = body.and_then(Body::place).unwrap_or(&extracted.world_from_object);
    let world_from_object = tlas::rows(placed);
    let object_from_world = tlas::inverse(&world_from_object).ok_or(Absence::Transform)?;
    let bounds = tlas::world_bounds(&world_from_object, &bounds).ok_or(Absence::Transform)?;
    let mut flags = flags_of(placed, mesh, materials.get(material).ok_or(Absence::LeftOut)?);
    if body.is_some() {
        flags |= INSTANCE_DEFORMED;
    }
    let instance = GpuInstance {
        world_from_object,
        object_from_world,
        previous_world_from_object: world_from_object,
        blas_root: root,
        first_triangle: triangles.start,
        triangle_count: triangles.end - triangles.start,
        material,
        first_light: NONE,
        flags,
        layers: if extracted.casts_shadows { extracted.camera_mask } else { 0 } | seen_by(extracted) << MAX_LAYER_SETS,
        entity: extracted.entity.index_u32(),
    };
    Ok((instance, bounds))
}

#[cfg(feature = "testing")]
impl InstancePool {
    /// Panics if a visit of all instances would change anything.
    pub(crate) fn check(&mut self, list: &InstanceList, sources: &mut InstanceSources) {
        let mut shown = 0;
        for extracted in list.visible() {
            let slot = self.slots.get(&extracted.entity).copied();
            let Ok((record, bounds)) = new_record(extracted, sources) else {
                assert_eq!(slot, None, "entity {} cannot be shown", *extracted.entity);
                continue;
            };
            let Some(slot) = slot else {
                assert!(self.left_out > 0, "entity {} is missing", *extracted.entity);
                continue;
            };
            shown += 1;
            let known = GpuInstance { flags: self.get(slot).flags & SUBSURFACE_FLAGS | record.flags, ..record };
            assert_eq!(without_placement(self.get(slot)), without_placement(&known), "entity {}", *extracted.entity);
            assert_eq!(self.get(slot).world_from_object, record.world_from_object);
            let live = self.live_in(slot).expect("the slot is in use");
            assert_eq!((live.entity, live.bounds), (extracted.entity, bounds));
            let emits = live.ray_mask != 0 && sources.materials.emits(live.material);
            assert_eq!((live.emits, self.emitters.contains(&live.entity)), (emits, emits));
        }
        assert_eq!(self.slots.len(), shown, "instances that the scene does not have");
        let mut totals = Totals::default();
        self.live().for_each(|(_, live)| totals.add(live));
        assert_eq!(self.totals, totals);
        self.sort();
        let order: Vec<_> = self.in_order().map(|(_, live)| live.entity).collect();
        assert!(order.len() == shown && order.is_sorted());
    }
}

/// The bits of a record that depend on other instances.
#[cfg(feature = "testing")]
const SUBSURFACE_FLAGS: u32 = INSTANCE_SUBSURFACE | u32::MAX << INSTANCE_SUBSURFACE_SHIFT;
