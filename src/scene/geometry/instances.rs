//! Keeps a [`GpuInstance`] in a stable slot for each mesh instance of the scene, and builds the top-level tree over them.
//!
//! Temporal reuse traces rays through the scene of the last frame.  So each record has the transform of the last frame, the top level of the
//! last frame is kept beside the new one, and everything else about a slot never changes: an instance that is edited gets another slot.  The
//! slot of an instance that has disappeared, or that was edited, keeps its record for one frame with the flag [`INSTANCE_GONE`], and a slot
//! that the last frame did not have carries [`INSTANCE_APPEARED`].

use bevy::{
    asset::AssetServer,
    ecs::resource::Resource,
    log::{warn, warn_once},
    math::Affine3A,
    platform::collections::{HashMap, HashSet},
    render::{
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};

use crate::gpu_layout::*;
use crate::scene::{
    accel::blas::Bounds,
    accel::ray_query::{AccelerationStructures, Placed},
    accel::tlas,
    asset_wait::AssetWait,
    extract::{ExtractedInstance, ExtractedScene},
    features::SceneFeatures,
    geometry::bodies::{Body, BodyPool},
    geometry::gpu_tlas::GpuTlas,
    geometry::meshes::{MeshEntry, MeshPool},
    geometry::render_layers::MAX_LAYER_SETS,
    material::{materials::MaterialPool, subsurface::SubsurfacePool},
    storage::{dirty_runs::dirty_runs, growable_buffer::GrowableBuffer, overflow_warning::OverflowWarning},
};
use crate::warned::Warned;

/// An instance that at least one camera sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LiveInstance {
    pub slot: u32,
    pub entity: MainEntity,
    pub mesh: bevy::asset::AssetId<bevy::mesh::Mesh>,
    pub material: u32,
    /// Bits of the cameras that see it directly: 0 for a `RestirMaterial`.
    pub camera_mask: u32,
    /// Bits of the cameras whose other rays can hit it: 0 for a `NotShadowCaster`.
    pub ray_mask: u32,
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
    slots: HashMap<MainEntity, u32>,
    free: Vec<u32>,
    /// Slots of instances that the last frame had and this one does not.
    gone: Vec<u32>,
    /// By slot.
    records: Vec<GpuInstance>,
    /// The records that the GPU has.
    uploaded: Vec<GpuInstance>,
    /// World bounds of the instances in the current top level, by slot.
    bounds: Vec<(u32, Bounds)>,
    /// World bounds of the instances of this frame that rays can hit.
    new_bounds: Vec<(u32, Bounds)>,
    pub live: Vec<LiveInstance>,
    pub gpu: GrowableBuffer<GpuInstance>,
    current: GpuTlas,
    /// The top level of the last frame; `None` if it equals the current one.
    previous: Option<GpuTlas>,
    /// Replaces both when rays are traced by ray queries.
    pub structures: Option<AccelerationStructures>,
    /// The instances for `structures`.
    placed: Vec<Placed>,
    /// Entities that were warned about.
    warned: Warned<(MainEntity, InstanceProblem)>,
    asset_wait: AssetWait,
    overflow: OverflowWarning,
    pub features: SceneFeatures,
    /// Some instance waits for its mesh or material.
    pub waiting: bool,
    /// Bounding sphere of all instances that rays can hit.
    pub center: [f32; 3],
    pub radius: f32,
    /// `center` and `radius` in the last frame.
    pub previous_sphere: ([f32; 3], f32),
    /// Triangles of all instances.
    pub triangles: u64,
    /// Counts the frames in which instances moved, appeared or disappeared.
    pub motion_revision: u64,
    /// Counts the frames in which instances appeared or disappeared, or were edited.
    pub membership_revision: u64,
    /// Counts edits of instances that had to keep their slot, because the device binds no more slots.
    pub edit_revision: u64,
    /// Bytes of the top level sent in this frame.
    pub uploaded_nodes: u64,
}

impl Default for InstancePool {
    fn default() -> Self {
        Self {
            slots: HashMap::default(),
            free: Vec::new(),
            gone: Vec::new(),
            records: Vec::new(),
            uploaded: Vec::new(),
            bounds: Vec::new(),
            new_bounds: Vec::new(),
            live: Vec::new(),
            gpu: GrowableBuffer::new("instances"),
            current: GpuTlas::default(),
            previous: None,
            structures: None,
            placed: Vec::new(),
            warned: Warned::default(),
            asset_wait: AssetWait::default(),
            overflow: OverflowWarning::default(),
            features: SceneFeatures::empty(),
            waiting: true,
            center: [0.0; 3],
            radius: 0.0,
            previous_sphere: ([0.0; 3], 0.0),
            triangles: 0,
            motion_revision: 0,
            membership_revision: 0,
            edit_revision: 0,
            uploaded_nodes: 0,
        }
    }
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

/// Center and radius of a sphere around boxes.
fn bounding_sphere<'a>(boxes: impl Iterator<Item = &'a Bounds>) -> ([f32; 3], f32) {
    let all = boxes
        .copied()
        .reduce(|a, b| (core::array::from_fn(|i| a.0[i].min(b.0[i])), core::array::from_fn(|i| a.1[i].max(b.1[i]))));
    let Some((low, high)) = all else { return ([0.0; 3], 0.0) };
    let half: [f64; 3] = core::array::from_fn(|i| 0.5 * (high[i] as f64 - low[i] as f64));
    let radius = half.iter().map(|h| h * h).sum::<f64>().sqrt().min(1e18) as f32;
    (core::array::from_fn(|i| 0.5 * low[i] + 0.5 * high[i]), radius)
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
        Self { structures: Some(AccelerationStructures::default()), ..Default::default() }
    }

    /// Updates the slots from the extracted instances, at most `limit` of them.  Materials are packed before this call, and light ids are
    /// set after it.
    pub(crate) fn update(
        &mut self,
        scene: &ExtractedScene,
        meshes: &MeshPool,
        bodies: &BodyPool,
        materials: &mut MaterialPool,
        subsurface: &mut SubsurfacePool,
        assets: &AssetServer,
        limit: u32,
    ) {
        self.waiting = false;
        self.asset_wait.begin_frame();
        self.warned.begin_frame();
        self.live.clear();
        self.features = SceneFeatures::empty();
        self.triangles = 0;
        self.new_bounds.clear();
        for slot in self.gone.drain(..) {
            self.records[slot as usize] = EMPTY_SLOT;
            self.free.push(slot);
        }
        let mut is_used = vec![false; self.records.len()];
        let mut left_out = 0;
        let mut moved = false;
        for extracted in &scene.instances {
            let Some((mut instance, world_bounds)) = self.record_of(extracted, meshes, bodies, materials, assets)
            else {
                continue;
            };
            // Probes do not find an instance that casts no shadows.
            if let Some(component) = extracted.subsurface.filter(|_| extracted.casts_shadows) {
                instance.flags |= subsurface.flags_of(extracted.entity, component);
                if instance.flags & INSTANCE_SUBSURFACE != 0 {
                    self.features |= SceneFeatures::SUBSURFACE;
                }
            }
            let Some(slot) = self.slot_of(extracted.entity, &mut instance, limit) else {
                left_out += 1;
                continue;
            };
            is_used.resize(self.records.len(), false);
            is_used[slot as usize] = true;
            moved |= instance.world_from_object != instance.previous_world_from_object;
            if instance.flags & INSTANCE_DEFORMED != 0 {
                self.features |= SceneFeatures::DEFORMATION;
                moved |= bodies.get(extracted.entity).is_some_and(|body| body.moved);
            }
            self.features |= materials.features(instance.material);
            self.triangles += instance.triangle_count as u64;
            self.records[slot as usize] = instance;
            // A `NotShadowCaster` is not in the tree.  The camera still sees it, because the visibility pass rasterizes it.
            let ray_mask = if extracted.casts_shadows { extracted.camera_mask } else { 0 };
            if ray_mask != 0 {
                self.new_bounds.push((slot, world_bounds));
            }
            self.live.push(LiveInstance {
                slot,
                entity: extracted.entity,
                mesh: extracted.mesh,
                material: instance.material,
                camera_mask: seen_by(extracted),
                ray_mask,
            });
        }
        self.retire_slots_but(&is_used);
        let appeared = self.live.iter().any(|live| self.records[live.slot as usize].flags & INSTANCE_APPEARED != 0);
        let membership_changed = appeared || !self.gone.is_empty();
        self.membership_revision += u64::from(membership_changed);
        self.motion_revision += u64::from(moved || membership_changed);
        if self.overflow.should_warn(left_out, meshes.idle() && !self.waiting) {
            warn!("restir: {left_out} meshes are left out, because this device binds at most {limit} instances");
        }
    }

    /// Marks the slots of instances that have disappeared, and those that edited instances had.
    fn retire_slots_but(&mut self, is_used: &[bool]) {
        let gone = &mut self.gone;
        self.slots.retain(|_, slot| {
            let is_used = is_used[*slot as usize];
            if !is_used {
                gone.push(*slot);
            }
            is_used
        });
        for &slot in &self.gone {
            let record = &mut self.records[slot as usize];
            // A body that has disappeared is not posed, so that its triangles are still those of the last frame.
            *record = GpuInstance {
                previous_world_from_object: record.world_from_object,
                first_light: NONE,
                flags: record.flags & !(INSTANCE_APPEARED | INSTANCE_DEFORMED) | INSTANCE_GONE,
                ..*record
            };
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
                self.records.len() as u32 - 1
            }
        };
        self.slots.insert(entity, slot);
        self.gone.extend(last);
        instance.previous_world_from_object = instance.world_from_object;
        instance.first_light = NONE;
        instance.flags |= INSTANCE_APPEARED;
        Some(slot)
    }

    /// The record of an instance and its world bounds; `None` if its mesh or material is missing, or if it cannot be shown.
    fn record_of(
        &mut self,
        extracted: &ExtractedInstance,
        meshes: &MeshPool,
        bodies: &BodyPool,
        materials: &mut MaterialPool,
        assets: &AssetServer,
    ) -> Option<(GpuInstance, Bounds)> {
        if meshes.is_empty(extracted.mesh) || materials.is_left_out(extracted.material) {
            return None;
        }
        let (Some(mesh), Some(material)) = (meshes.get(extracted.mesh), materials.slot(extracted.material)) else {
            self.wait_for_assets(extracted, meshes, materials, assets);
            return None;
        };
        let body = bodies.get(extracted.entity);
        if body.is_some() && !bodies.is_ready() {
            self.waiting = true;
            return None;
        }
        let (root, triangles, bounds) = match body {
            Some(body) => (body.root(), body.triangles(), body.bounds),
            None => (mesh.root(), mesh.triangles.clone(), mesh.bounds),
        };
        let placed = body.and_then(Body::place).unwrap_or(&extracted.world_from_object);
        let world_from_object = tlas::rows(placed);
        let inverse = tlas::inverse(&world_from_object);
        let bounds = tlas::world_bounds(&world_from_object, &bounds);
        let (Some(object_from_world), Some(bounds)) = (inverse, bounds) else {
            if self.warned.is_due((extracted.entity, InstanceProblem::UnusableTransform)) {
                warn!(
                    "restir: entity {} has a transform that is singular, not finite, or reaches beyond {} m; it is left out",
                    *extracted.entity,
                    tlas::MAX_COORDINATE
                );
            }
            return None;
        };
        let mut flags = flags_of(placed, mesh, materials.get(material)?);
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
            layers: if extracted.casts_shadows { extracted.camera_mask } else { 0 }
                | seen_by(extracted) << MAX_LAYER_SETS,
            entity: extracted.entity.index_u32(),
        };
        Some((instance, bounds))
    }

    /// Waits for the assets of an instance if they are being loaded or built; else warns once that one is missing.
    fn wait_for_assets(
        &mut self,
        extracted: &ExtractedInstance,
        meshes: &MeshPool,
        materials: &mut MaterialPool,
        assets: &AssetServer,
    ) {
        let mesh_will_exist = meshes.get(extracted.mesh).is_some()
            || meshes.is_building(extracted.mesh)
            || self.asset_wait.is_pending(extracted.mesh, assets);
        let is_pending = mesh_will_exist
            && (materials.slot(extracted.material).is_some() || self.asset_wait.is_pending(extracted.material, assets));
        self.waiting |= is_pending;
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
    }

    /// The record of a slot.
    pub(crate) fn get(&self, slot: u32) -> &GpuInstance {
        &self.records[slot as usize]
    }

    /// Rebuilds the top level if any bounds changed.  The top level of the last frame is released one frame later.
    pub(crate) fn build_top_level(
        &mut self,
        meshes: &mut MeshPool,
        bodies: &BodyPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        self.uploaded_nodes = 0;
        self.previous_sphere = (self.center, self.radius);
        if self.structures.is_some() {
            self.update_structures(meshes, bodies, device, queue);
            return;
        }
        if let Some(old) = self.previous.take() {
            meshes.release_nodes(old.range);
        }
        if !self.update_bounds() {
            return;
        }
        let tlas = tlas::build_tlas(&self.bounds);
        let Some((fresh, bytes)) = GpuTlas::write(&tlas, meshes, device, queue) else {
            warn_once!(
                "restir: the top-level tree over {} instances does not fit this device; rays use the last tree that fit",
                self.bounds.len()
            );
            return;
        };
        self.uploaded_nodes = bytes;
        self.previous = Some(core::mem::replace(&mut self.current, fresh));
        self.motion_revision += 1;
    }

    /// Rebuilds the device's own acceleration structures if an instance changed.
    fn update_structures(
        &mut self,
        meshes: &mut MeshPool,
        bodies: &BodyPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        self.update_bounds();
        self.placed.clear();
        self.placed.extend(self.live.iter().filter(|live| live.ray_mask != 0).filter_map(|live| {
            let (mesh, instance) = (meshes.get(live.mesh)?, &self.records[live.slot as usize]);
            let body = bodies.get(live.entity);
            Some(Placed {
                slot: live.slot,
                version: body.map_or(mesh.version, |body| body.version()),
                rebuild: body.is_some_and(|body| body.moved),
                triangles: instance.first_triangle..instance.first_triangle + instance.triangle_count,
                world_from_object: instance.world_from_object,
                opaque: instance.flags & INSTANCE_ALPHA == 0,
                mask: live.ray_mask as u8,
            })
        }));
        let Some(structures) = &mut self.structures else { return };
        if !meshes.triangles.reserve(1, device, queue) {
            return;
        }
        let Some(triangles) = meshes.triangles.buffer() else { return };
        let before = structures.revision;
        self.uploaded_nodes = structures.update(&self.placed, triangles, device, queue);
        if structures.revision != before {
            self.motion_revision += u64::from(self.uploaded_nodes > 0);
            let versions = meshes.versions().into_iter().chain(bodies.versions()).collect::<HashSet<_>>();
            structures.retain(|mesh| versions.contains(&mesh));
        }
    }

    /// Stores the bounds of this frame and returns whether any changed.
    fn update_bounds(&mut self) -> bool {
        let changed = self.new_bounds != self.bounds;
        if changed {
            core::mem::swap(&mut self.bounds, &mut self.new_bounds);
            (self.center, self.radius) = bounding_sphere(self.bounds.iter().map(|(_, bounds)| bounds));
        }
        changed
    }

    /// Uploads the records that changed.  Returns the number of bytes sent.
    pub(crate) fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        let runs = dirty_runs(&self.uploaded, &self.records);
        if runs.is_empty() {
            return 0;
        }
        if !self.gpu.reserve(self.records.len() as u32, device, queue) {
            warn_once!(
                "restir: {} instances are more than this device can bind; the last upload stays in use",
                self.records.len()
            );
            return 0;
        }
        let bytes = runs.into_iter().map(|r| self.gpu.write(r.start as u32, &self.records[r], queue)).sum();
        self.uploaded.clone_from(&self.records);
        bytes
    }

    /// Root and position of the instance indices for the top level of this frame, then for that of the last frame.
    pub(crate) fn top_levels(&self) -> [u32; 4] {
        if let Some([current, previous]) = self.structures.as_ref().map(AccelerationStructures::roots) {
            return [current, NONE, previous, NONE];
        }
        let previous = self.previous.as_ref().unwrap_or(&self.current);
        [self.current.root(), self.current.indices(), previous.root(), previous.indices()]
    }

    /// Number of slots, including free ones.
    pub(crate) fn len(&self) -> u32 {
        self.records.len() as u32
    }
}
