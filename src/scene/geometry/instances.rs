//! Drawn meshes → [`GpuInstance`] in stable slots, and the top level over them.  What moved keeps its last transform for one frame;
//! the top level of the last frame stays beside the new one, so that temporal reuse can trace the past.

use bevy::{
    asset::AssetServer,
    ecs::resource::Resource,
    log::{warn, warn_once},
    platform::collections::{HashMap, HashSet},
    render::{
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};
use std::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{
    accel::blas::Bounds,
    accel::ray_query::{AccelerationStructures, Placed},
    accel::tlas::{self, Tlas},
    asset_wait::AssetWait,
    extract::{ExtractedInstance, ExtractedScene},
    features::SceneFeatures,
    geometry::meshes::MeshPool,
    geometry::render_layers::MAX_LAYER_SETS,
    material::materials::MaterialPool,
    storage::{dirty_runs::dirty_runs, growable_buffer::GrowableBuffer, overflow_warning::OverflowWarning},
};

/// A top level on the GPU.
#[derive(Clone, Debug, Default)]
pub(crate) struct GpuTlas {
    /// Nodes and, from `indices` on, the packed instance list.
    pub range: Range<u32>,
    nodes: u32,
}

impl GpuTlas {
    /// Beside the bottom levels, and the bytes sent; `None` where the device has no room.
    pub(crate) fn write(
        tlas: &Tlas,
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<(Self, u64)> {
        let nodes = (tlas.nodes.len() / NODE_STRIDE as usize) as u32;
        let mut words: Vec<[u32; 4]> = tlas.nodes.iter().chain(&tlas.indices).copied().collect();
        let count = (words.len() as u32).div_ceil(NODE_STRIDE);
        words.resize((count * NODE_STRIDE) as usize, [0; 4]);
        let range = meshes.allocate_nodes(count, device, queue)?;
        crate::scene::accel::blas::bake(&mut words[..(nodes * NODE_STRIDE) as usize], range.start, 0);
        let bytes = meshes.nodes.write(range.start, bytemuck::cast_slice(&words), queue);
        Some((Self { range, nodes }, bytes))
    }

    pub(crate) fn root(&self) -> u32 {
        if self.nodes == 0 { NONE } else { self.range.start }
    }

    pub(crate) fn indices(&self) -> u32 {
        (self.range.start + self.nodes) * NODE_STRIDE
    }
}

/// An instance that rays can meet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LiveInstance {
    pub slot: u32,
    pub entity: MainEntity,
    pub mesh: bevy::asset::AssetId<bevy::mesh::Mesh>,
    pub material: u32,
    /// Bits of the cameras that see it, and of those whose other rays meet it.
    pub camera_mask: u32,
    pub ray_mask: u32,
}

/// The instances of the scene.
#[derive(Resource)]
pub(crate) struct InstancePool {
    slots: HashMap<MainEntity, u32>,
    free: Vec<u32>,
    wanted: Vec<GpuInstance>,
    uploaded: Vec<GpuInstance>,
    /// World boxes of the live slots, as the current top level has them.
    boxes: Vec<(u32, Bounds)>,
    /// As this frame has them.
    boxes_of_frame: Vec<(u32, Bounds)>,
    pub live: Vec<LiveInstance>,
    pub gpu: GrowableBuffer<GpuInstance>,
    current: GpuTlas,
    /// The last frame's, where it differs.
    previous: Option<GpuTlas>,
    /// In place of both where rays are traced by ray queries.
    pub structures: Option<AccelerationStructures>,
    /// What they are to hold.
    placed: Vec<Placed>,
    /// Warned about already.
    reported: HashSet<MainEntity>,
    absent: HashSet<MainEntity>,
    arrivals: AssetWait,
    overflow: OverflowWarning,
    pub features: SceneFeatures,
    /// An instance waits for its mesh or material.
    pub waiting: bool,
    pub center: [f32; 3],
    pub radius: f32,
    pub triangles: u64,
    /// Counts moves.
    pub motion_revision: u64,
    /// Counts every other change.
    pub edit_revision: u64,
    /// Bytes of nodes sent in this frame.
    pub uploaded_nodes: u64,
}

impl Default for InstancePool {
    fn default() -> Self {
        Self {
            slots: HashMap::default(),
            free: Vec::new(),
            wanted: Vec::new(),
            uploaded: Vec::new(),
            boxes: Vec::new(),
            boxes_of_frame: Vec::new(),
            live: Vec::new(),
            gpu: GrowableBuffer::new("instances"),
            current: GpuTlas::default(),
            previous: None,
            structures: None,
            placed: Vec::new(),
            reported: HashSet::default(),
            absent: HashSet::default(),
            arrivals: AssetWait::default(),
            overflow: OverflowWarning::default(),
            features: SceneFeatures::empty(),
            waiting: true,
            center: [0.0; 3],
            radius: 0.0,
            triangles: 0,
            motion_revision: 0,
            edit_revision: 0,
            uploaded_nodes: 0,
        }
    }
}

const ABSENT: GpuInstance = GpuInstance {
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

/// An instance but for where it is, and where its lights are in the table, if they are: what a history holds of them is mapped from table
/// to table.
fn without_place(instance: &GpuInstance) -> GpuInstance {
    let nowhere = Rows::default();
    GpuInstance {
        world_from_object: nowhere,
        object_from_world: nowhere,
        previous_world_from_object: nowhere,
        first_light: if instance.first_light == NONE { NONE } else { 0 },
        ..*instance
    }
}

impl InstancePool {
    /// A pool whose top levels are the device's own acceleration structures.
    pub(crate) fn for_ray_queries() -> Self {
        Self { structures: Some(AccelerationStructures::default()), ..Default::default() }
    }

    /// Brings the slots up to the extracted list, of which the device can bind `limit`.  The materials are packed already; lights are
    /// filled in afterwards.
    pub(crate) fn update(
        &mut self,
        scene: &ExtractedScene,
        meshes: &MeshPool,
        materials: &mut MaterialPool,
        assets: &AssetServer,
        limit: u32,
    ) {
        self.waiting = false;
        self.arrivals.begin_frame();
        self.live.clear();
        self.features = SceneFeatures::empty();
        self.triangles = 0;
        self.boxes_of_frame.clear();
        let mut seen = vec![false; self.wanted.len()];
        let mut left_out = 0;
        for extracted in &scene.instances {
            let Some((mut instance, world_box)) = self.instance_of(extracted, meshes, materials, assets) else {
                continue;
            };
            let Some(slot) = self.slot_of(extracted.entity, limit) else {
                left_out += 1;
                continue;
            };
            seen.resize(self.wanted.len(), false);
            seen[slot as usize] = true;
            let old = &self.wanted[slot as usize];
            if old.blas_root != NONE {
                instance.previous_world_from_object = old.world_from_object;
            }
            instance.first_light = old.first_light;
            self.features |= materials.features(instance.material);
            self.triangles += instance.triangle_count as u64;
            self.wanted[slot as usize] = instance;
            // What no ray meets is not in the tree; the camera sees it all the same.
            let ray_mask = if extracted.casts_shadows { extracted.camera_mask } else { 0 };
            if ray_mask != 0 {
                self.boxes_of_frame.push((slot, world_box));
            }
            self.live.push(LiveInstance {
                slot,
                entity: extracted.entity,
                mesh: extracted.mesh,
                material: instance.material,
                camera_mask: extracted.camera_mask,
                ray_mask,
            });
        }
        let (wanted, free) = (&mut self.wanted, &mut self.free);
        self.slots.retain(|_, slot| {
            let present = seen[*slot as usize];
            if !present {
                wanted[*slot as usize] = ABSENT;
                free.push(*slot);
            }
            present
        });
        if self.overflow.should_warn(left_out, meshes.idle() && !self.waiting) {
            warn!("restir: {left_out} meshes are left out: this device binds {limit} at most");
        }
    }

    /// The slot of an entity; `None` where there are no more than `limit` and all are taken.
    fn slot_of(&mut self, entity: MainEntity, limit: u32) -> Option<u32> {
        if let Some(&slot) = self.slots.get(&entity) {
            return Some(slot);
        }
        let slot = match self.free.pop() {
            Some(slot) => slot,
            None if self.wanted.len() as u32 >= limit => return None,
            None => {
                self.wanted.push(ABSENT);
                self.wanted.len() as u32 - 1
            }
        };
        self.slots.insert(entity, slot);
        Some(slot)
    }

    /// The record of an instance and its box; `None` while something is missing or where rays can never meet it.
    fn instance_of(
        &mut self,
        extracted: &ExtractedInstance,
        meshes: &MeshPool,
        materials: &mut MaterialPool,
        assets: &AssetServer,
    ) -> Option<(GpuInstance, Bounds)> {
        if meshes.is_empty(extracted.mesh) || materials.is_left_out(extracted.material) {
            return None;
        }
        let (Some(mesh), Some(material)) = (meshes.get(extracted.mesh), materials.slot(extracted.material)) else {
            // What nobody loads or builds never comes: the rest is shown without it.
            let mesh_comes = meshes.get(extracted.mesh).is_some()
                || meshes.is_building(extracted.mesh)
                || self.arrivals.is_pending(extracted.mesh, assets);
            let coming = mesh_comes
                && (materials.slot(extracted.material).is_some()
                    || self.arrivals.is_pending(extracted.material, assets));
            self.waiting |= coming;
            if !coming && self.absent.insert(extracted.entity) {
                warn!(
                    "restir: entity {} has a mesh or a material that does not exist; it is left out",
                    *extracted.entity
                );
            }
            return None;
        };
        let world_from_object = tlas::rows(&extracted.world_from_object);
        let inverse = tlas::inverse(&world_from_object);
        let bounds = tlas::world_bounds(&world_from_object, &mesh.bounds);
        let (Some(object_from_world), Some(bounds)) = (inverse, bounds) else {
            if self.reported.insert(extracted.entity) {
                warn!("restir: entity {} has a singular or non-finite transform; it is left out", *extracted.entity);
            }
            return None;
        };
        if extracted.skinned {
            warn_once!("restir: skinned meshes are shown in their bind pose (entity {})", *extracted.entity);
        }
        if extracted.morphed {
            warn_once!("restir: morphed meshes are shown as they are at rest (entity {})", *extracted.entity);
        }
        let packed = materials.get(material)?;
        let mut flags = 0;
        if extracted.world_from_object.matrix3.determinant() < 0.0 {
            flags |= INSTANCE_MIRRORED;
        }
        if packed.flags & (MATERIAL_ALPHA_MASK | MATERIAL_ALPHA_BLEND) != 0 {
            flags |= INSTANCE_ALPHA;
        }
        if !mesh.second_uvs.is_empty() {
            flags |= INSTANCE_SECOND_UV;
        }
        let instance = GpuInstance {
            world_from_object,
            object_from_world,
            previous_world_from_object: world_from_object,
            blas_root: mesh.root(),
            first_triangle: mesh.triangles.start,
            triangle_count: mesh.triangles.end - mesh.triangles.start,
            material,
            first_light: NONE,
            flags,
            layers: if extracted.casts_shadows { extracted.camera_mask } else { 0 }
                | extracted.camera_mask << MAX_LAYER_SETS,
            entity: extracted.entity.index_u32(),
        };
        Some((instance, bounds))
    }

    /// A light id for the first triangle of a slot; the others follow.
    pub(crate) fn set_first_light(&mut self, slot: u32, light: u32) {
        self.wanted[slot as usize].first_light = light;
    }

    /// The record of a slot.
    pub(crate) fn get(&self, slot: u32) -> &GpuInstance {
        &self.wanted[slot as usize]
    }

    /// Rebuilds the top level where a box changed, and lets go of the last frame's where none did for a frame.
    pub(crate) fn build_top_level(&mut self, meshes: &mut MeshPool, device: &RenderDevice, queue: &RenderQueue) {
        self.uploaded_nodes = 0;
        if self.structures.is_some() {
            self.place(meshes, device, queue);
            return;
        }
        if let Some(old) = self.previous.take() {
            meshes.release_nodes(old.range);
        }
        if self.boxes_of_frame == self.boxes {
            return;
        }
        core::mem::swap(&mut self.boxes, &mut self.boxes_of_frame);
        self.measure();
        let tlas = tlas::build_tlas(&self.boxes);
        let Some((fresh, bytes)) = GpuTlas::write(&tlas, meshes, device, queue) else {
            warn_once!("restir: the top level over {} instances does not fit this device", self.boxes.len());
            return;
        };
        self.uploaded_nodes = bytes;
        self.previous = Some(core::mem::replace(&mut self.current, fresh));
        self.motion_revision += 1;
    }

    /// The same for the device's own acceleration structures.
    fn place(&mut self, meshes: &mut MeshPool, device: &RenderDevice, queue: &RenderQueue) {
        if self.boxes_of_frame != self.boxes {
            core::mem::swap(&mut self.boxes, &mut self.boxes_of_frame);
            self.measure();
        }
        self.placed.clear();
        self.placed.extend(self.live.iter().filter(|live| live.ray_mask != 0).filter_map(|live| {
            let (mesh, instance) = (meshes.get(live.mesh)?, &self.wanted[live.slot as usize]);
            Some(Placed {
                slot: live.slot,
                mesh: mesh.version,
                triangles: mesh.triangles.clone(),
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
            let versions = meshes.versions();
            structures.retain(|mesh| versions.contains(&mesh));
        }
    }

    /// Sphere round every box.
    fn measure(&mut self) {
        let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
        for (_, (a, b)) in &self.boxes {
            for i in 0..3 {
                low[i] = low[i].min(a[i]);
                high[i] = high[i].max(b[i]);
            }
        }
        if self.boxes.is_empty() {
            (self.center, self.radius) = ([0.0; 3], 0.0);
            return;
        }
        self.center = core::array::from_fn(|i| 0.5 * low[i] + 0.5 * high[i]);
        let half: [f64; 3] = core::array::from_fn(|i| 0.5 * (high[i] as f64 - low[i] as f64));
        self.radius = half.iter().map(|h| h * h).sum::<f64>().sqrt().min(1e18) as f32;
    }

    /// Sends what changed.  Returns the bytes sent.
    pub(crate) fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        let runs = dirty_runs(&self.uploaded, &self.wanted);
        if runs.is_empty() {
            return 0;
        }
        if !self.gpu.reserve(self.wanted.len() as u32, device, queue) {
            warn_once!("restir: {} instances are more than this device can bind", self.wanted.len());
            return 0;
        }
        for i in runs.iter().flat_map(|r| r.clone()) {
            let (old, new) = (self.uploaded.get(i), &self.wanted[i]);
            // A change of the last frame's transform alone shows nothing new.
            self.motion_revision += old.is_none_or(|old| old.world_from_object != new.world_from_object) as u64;
            self.edit_revision += old.is_none_or(|old| without_place(old) != without_place(new)) as u64;
        }
        let bytes = runs.into_iter().map(|r| self.gpu.write(r.start as u32, &self.wanted[r], queue)).sum();
        self.uploaded.clone_from(&self.wanted);
        bytes
    }

    /// Roots and instance lists of this frame's top level and of the last frame's.
    pub(crate) fn top_levels(&self) -> [u32; 4] {
        if let Some([current, previous]) = self.structures.as_ref().map(AccelerationStructures::roots) {
            return [current, NONE, previous, NONE];
        }
        let previous = self.previous.as_ref().unwrap_or(&self.current);
        [self.current.root(), self.current.indices(), previous.root(), previous.indices()]
    }

    /// Slots in use, holes included.
    pub(crate) fn len(&self) -> u32 {
        self.wanted.len() as u32
    }
}
