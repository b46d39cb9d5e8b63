//! Keeps the bodies: instances of skinned and morphed meshes, each with triangles, vertices and a tree of its own.
//!
//! A compute pass poses the vertices of the bodies whose pose has changed, and refits their trees (`shaders/deformation/`).  Triangles keep
//! their indices, so that samples of the last frame refer to the right ones.  A body whose pose does not change costs no GPU time;
//! each frame extracts its pose and compares it on the CPU.

use bevy::{
    asset::AssetId,
    ecs::resource::Resource,
    log::{warn, warn_once},
    math::Affine3A,
    mesh::Mesh,
    platform::collections::HashMap,
    render::{
        render_resource::{binding_types::*, *},
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};
use std::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{
    accel::{blas::Bounds, tlas::rows},
    extract::{ExtractedScene, instances::sorted},
    geometry::{
        corner_texture::BodySource,
        meshes::{MeshEntry, MeshPool},
        rig::Pose,
    },
    storage::{growable_buffer::GrowableBuffer, range_allocator::RangeAllocator},
};
use crate::shader_library::ShaderLibrary;
use crate::warned::Warned;

/// A body on the GPU.
pub(crate) struct Body {
    mesh: AssetId<Mesh>,
    /// Version of its mesh.
    mesh_version: u64,
    /// Triangles of this frame, followed by those of the last frame.
    all_triangles: Range<u32>,
    /// Vertices of this frame, followed by those of the last frame.
    all_vertices: Range<u32>,
    /// Empty with ray queries.
    nodes: Range<u32>,
    boxes: Range<u32>,
    pose: Pose,
    /// Bounds in the space of the instance.
    pub bounds: Bounds,
    /// Versions of its geometry for the device's own trees, of this frame and of the last one.  They alternate, so that the tree of the last
    /// frame remains.
    versions: [u64; 2],
    /// Its shape differs from that of the last frame.
    pub moved: bool,
    /// Its vertices must be posed in this frame: its pose has changed in this frame, or in the last one.  After a change in the last frame
    /// the vertices are right, and their copies for the last frame are still those of the pose before.
    is_due: bool,
    /// The device had no memory to pose its vertices.  They are posed late, and once more in the frame after, for the copy of the last frame.
    is_late: bool,
    /// Its vertices have not been posed yet, so there are none of the last frame.
    appeared: bool,
}

impl Body {
    /// Its triangles of this frame.
    pub(crate) fn triangles(&self) -> Range<u32> {
        first_half(&self.all_triangles)
    }

    /// Its vertices of this frame.
    pub(crate) fn vertices(&self) -> Range<u32> {
        first_half(&self.all_vertices)
    }

    /// World from object, if it is not that of its entity.
    pub(crate) fn place(&self) -> Option<&Affine3A> {
        self.pose.place.as_ref()
    }

    /// Index of the root node; with ray queries, where we have no nodes, index of the first triangle.
    pub(crate) fn root(&self) -> u32 {
        if self.nodes.is_empty() { self.all_triangles.start } else { self.nodes.start }
    }

    /// The version of its geometry.
    pub(crate) fn version(&self) -> u64 {
        self.versions[0]
    }
}

fn first_half(range: &Range<u32>) -> Range<u32> {
    range.start..range.start + (range.end - range.start) / 2
}

/// Reasons to warn about a body.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum BodyProblem {
    NotFinite,
    TooLarge,
}

/// Greatest number of bodies: that of workgroups in a dimension of a dispatch.
const MAX_WORKGROUPS: usize = 65535;

/// Number of vertices that a workgroup poses, equal to `WORKGROUP` in `shaders/pass/deform.wgsl`.
pub const WORKGROUP: u32 = 64;

/// The bodies of the scene.
#[derive(Resource)]
pub(crate) struct BodyPool {
    bodies: HashMap<MainEntity, Body>,
    /// Bodies that were removed or replaced in this frame.  Temporal reuse still traces rays through them.
    retired: Vec<Body>,
    box_ranges: RangeAllocator,
    /// Minimum and maximum of the box of each node.
    boxes: GrowableBuffer<[[f32; 4]; 2]>,
    records: GrowableBuffer<GpuBody>,
    poses: GrowableBuffer<[f32; 4]>,
    layout: BindGroupLayoutDescriptor,
    /// The pipelines of `pose` and `refit`; `None` until there is a body.
    pipelines: Option<[CachedComputePipelineId; 2]>,
    warned: Warned<(MainEntity, BodyProblem)>,
    /// The pipelines are compiled.
    is_ready: bool,
    /// The GPU has the shapes of this frame.
    pub fits: bool,
}

impl Default for BodyPool {
    fn default() -> Self {
        let read = || storage_buffer_read_only_sized(false, None);
        let write = || storage_buffer_sized(false, None);
        let entries = BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (read(), read(), read(), write(), write(), write(), write()),
        );
        Self {
            bodies: HashMap::default(),
            retired: Vec::new(),
            box_ranges: RangeAllocator::default(),
            boxes: GrowableBuffer::new("boxes of bodies"),
            records: GrowableBuffer::new("bodies"),
            poses: GrowableBuffer::new("poses"),
            layout: BindGroupLayoutDescriptor::new("restir bodies", &entries),
            pipelines: None,
            warned: Warned::default(),
            is_ready: false,
            fits: true,
        }
    }
}

impl BodyPool {
    /// Lengths of the pool's tables.
    #[cfg(feature = "testing")]
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("bodies", self.bodies.len()),
            ("retired bodies", self.retired.len()),
            ("boxes", self.box_ranges.end() as usize),
            ("warnings of bodies", self.warned.len()),
        ]
    }

    /// Forgets the warnings about entities that are gone.
    pub(crate) fn forget_warnings(&mut self, exists: impl Fn(MainEntity) -> bool) {
        self.warned.retain(|(entity, _)| exists(*entity));
    }

    /// Makes a body for each posed instance of a mesh that bends, and takes over the poses.
    pub(crate) fn update(
        &mut self,
        scene: &ExtractedScene,
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        self.warned.begin_frame();
        for body in self.retired.drain(..) {
            body.versions.into_iter().for_each(|version| meshes.forget_corners(version));
            meshes.release_body([body.all_triangles, body.all_vertices, body.nodes]);
            self.box_ranges.release(body.boxes);
        }
        let mut last = core::mem::take(&mut self.bodies);
        let posed = sorted(scene.instances.posed().iter().copied().collect());
        for extracted in posed.into_iter().filter_map(|entity| scene.instances.get(entity)) {
            let Some(pose) = extracted.pose.as_deref() else { continue };
            let Some(mesh) = meshes.get(extracted.mesh).filter(|mesh| mesh.rig.is_some()) else { continue };
            let old = last.remove(&extracted.entity);
            let (old, replaced) = match old {
                Some(body) if body.mesh_version == mesh.version => (Some(body), None),
                other => (None, other),
            };
            self.retired.extend(replaced);
            let pose = if pose.is_finite() {
                pose
            } else {
                if self.warned.is_due((extracted.entity, BodyProblem::NotFinite)) {
                    warn!("restir: entity {} has a pose that is not finite; it keeps its last pose", *extracted.entity);
                }
                let Some(body) = &old else { continue };
                &body.pose.clone()
            };
            let body = match old {
                Some(body) => Some(body.in_pose(pose, meshes)),
                None if self.bodies.len() + last.len() >= MAX_WORKGROUPS => None,
                None => self.create(extracted.mesh, pose, meshes, device, queue),
            };
            match body {
                Some(body) => _ = self.bodies.insert(extracted.entity, body),
                None if self.warned.is_due((extracted.entity, BodyProblem::TooLarge)) => {
                    warn!(
                        "restir: entity {} keeps its rest pose, because there are too many bodies that bend, or no room for its triangles",
                        *extracted.entity
                    );
                }
                None => {}
            }
        }
        self.retired.extend(last.into_values());
    }

    /// A body in its first frame; `None` if it does not fit the device.
    fn create(
        &mut self,
        id: AssetId<Mesh>,
        pose: &Pose,
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<Body> {
        let mesh = meshes.get(id)?;
        let (mesh_version, nodes) = (mesh.version, mesh.nodes.len() as u32);
        let bounds = mesh.rig.as_ref()?.bounds.in_pose(pose);
        if mesh.triangles.len().max(mesh.vertices.len()) > MAX_WORKGROUPS * WORKGROUP as usize {
            return None;
        }
        let counts = [2 * mesh.triangles.len() as u32, 2 * mesh.vertices.len() as u32, nodes];
        let boxes = self.box_ranges.allocate(nodes);
        let ranges = self.boxes.reserve(self.box_ranges.end(), device, queue);
        let ranges = ranges.then(|| meshes.allocate(counts, device, queue)).flatten();
        let Some([all_triangles, all_vertices, nodes]) = ranges else {
            self.box_ranges.release(boxes);
            return None;
        };
        Some(Body {
            mesh: id,
            mesh_version,
            all_triangles,
            all_vertices,
            nodes,
            boxes,
            pose: pose.clone(),
            bounds,
            versions: [meshes.next_version(), meshes.next_version()],
            moved: false,
            is_due: true,
            is_late: false,
            appeared: true,
        })
    }

    /// The body of an instance; `None` if its mesh does not bend or keeps its rest pose.
    pub(crate) fn get(&self, entity: MainEntity) -> Option<&Body> {
        self.bodies.get(&entity)
    }

    /// Whether no mesh bends.
    pub(crate) fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// Starts to compile the shaders.
    pub(crate) fn prepare_pipelines(&mut self, pipelines: &PipelineCache, shaders: &ShaderLibrary) {
        let layout = &self.layout;
        let ids = *self.pipelines.get_or_insert_with(|| {
            ["pose", "refit"].map(|entry_point| {
                pipelines.queue_compute_pipeline(ComputePipelineDescriptor {
                    label: Some(format!("restir {entry_point}").into()),
                    layout: vec![layout.clone()],
                    shader: shaders.pass("pass/deform.wgsl", &[]),
                    entry_point: Some(entry_point.into()),
                    ..Default::default()
                })
            })
        });
        self.is_ready = ids.iter().all(|id| pipelines.get_compute_pipeline(*id).is_some());
    }

    /// Whether bodies can be posed: the shaders are compiled.
    pub(crate) fn is_ready(&self) -> bool {
        self.is_ready
    }

    /// Poses the vertices of all bodies that are due, and refits their trees.  Returns the number of bytes sent.
    pub(crate) fn deform(
        &mut self,
        meshes: &mut MeshPool,
        pipelines: &PipelineCache,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> u64 {
        self.fits = true;
        let Some([pose, refit]) = self.pipelines.map(|ids| ids.map(|id| pipelines.get_compute_pipeline(id))) else {
            return 0;
        };
        let (Some(pose), Some(refit)) = (pose, refit) else { return 0 };
        let mut due: Vec<_> = self.bodies.values_mut().filter(|body| body.is_due).collect();
        // A map has no fixed order.
        due.sort_unstable_by_key(|body| body.all_triangles.start);
        let (mut records, mut rows_of_poses) = (Vec::new(), Vec::new());
        for body in &due {
            let Some(mesh) = meshes.get(body.mesh) else { continue };
            records.extend(body.record(mesh, &mut rows_of_poses));
        }
        if records.is_empty() {
            return 0;
        }
        rows_of_poses.push([0.0; 4]);
        let reserved = self.records.reserve(records.len() as u32, device, queue)
            && self.poses.reserve(rows_of_poses.len() as u32, device, queue)
            && self.boxes.reserve(1, device, queue)
            && meshes.nodes.reserve(1, device, queue);
        if !reserved {
            // The next frame tries again: memory may have become free.
            self.fits = false;
            warn_once!(
                "restir: Bevy lights all cameras, because the poses of {} skinned or morphed objects do not fit this device",
                records.len()
            );
            due.into_iter().for_each(|body| body.is_late = true);
            return 0;
        }
        for body in due {
            body.is_due = core::mem::take(&mut body.is_late) || body.moved;
            body.appeared = false;
        }
        let bytes = self.records.write(0, &records, queue) + self.poses.write(0, &rows_of_poses, queue);
        self.dispatch([pose, refit], &records, meshes, pipelines, device, queue);
        bytes
    }

    /// Runs the passes for bodies whose records are on the device.
    fn dispatch(
        &self,
        [pose, refit]: [&ComputePipeline; 2],
        records: &[GpuBody],
        meshes: &MeshPool,
        pipelines: &PipelineCache,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        let buffers = [
            self.records.buffer(),
            meshes.rigs.buffer(),
            self.poses.buffer(),
            meshes.triangles.buffer(),
            meshes.vertices.buffer(),
            meshes.nodes.buffer(),
            self.boxes.buffer(),
        ];
        let [Some(a), Some(b), Some(c), Some(d), Some(e), Some(f), Some(g)] =
            buffers.map(|buffer| buffer.map(|buffer| buffer.as_entire_binding()))
        else {
            return;
        };
        let layout = pipelines.get_bind_group_layout(&self.layout);
        let entries = BindGroupEntries::sequential((a, b, c, d, e, f, g));
        let bind_group = device.create_bind_group("restir bodies", &layout, &entries);
        let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some("restir bodies") });
        {
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            pass.set_bind_group(0, &bind_group, &[]);
            // Each invocation also adds a triangle of a new body.
            let invocations = |body: &GpuBody| match body.flags & BODY_APPEARED {
                0 => body.vertex_count,
                _ => body.vertex_count.max(body.triangle_count),
            };
            let most = records.iter().map(invocations).max().unwrap_or(0);
            pass.set_pipeline(pose);
            pass.dispatch_workgroups(most.div_ceil(WORKGROUP), records.len() as u32, 1);
            pass.set_pipeline(refit);
            pass.dispatch_workgroups(records.len() as u32, 1, 1);
        }
        queue.submit([encoder.finish()]);
    }

    /// Versions of the geometry of the bodies that have moved in this frame.
    pub(crate) fn moved(&self) -> impl Iterator<Item = u64> {
        self.bodies.values().filter(|body| body.moved).map(Body::version)
    }

    /// Versions of the geometry of all bodies.
    pub(crate) fn versions(&self) -> impl Iterator<Item = u64> {
        self.bodies.values().chain(&self.retired).flat_map(|body| body.versions)
    }

    /// Version, first triangle and mesh of each body, for the textures of its corners.
    pub(crate) fn sources(&self) -> impl Iterator<Item = BodySource> + Clone {
        // The two versions swap places in every frame, so the lower one identifies the body.
        self.bodies.values().map(|b| (b.versions[0].min(b.versions[1]), b.all_triangles.start, b.mesh))
    }

    /// Names and sizes in bytes, for the report.
    pub(crate) fn memory(&self) -> [(&'static str, u64); 3] {
        [self.records.memory(), self.poses.memory(), self.boxes.memory()]
    }
}

impl Body {
    /// The body in the next frame.
    fn in_pose(mut self, pose: &Pose, meshes: &MeshPool) -> Self {
        self.moved = !self.pose.has_shape_of(pose);
        self.is_due |= self.moved;
        if self.moved {
            self.versions.swap(0, 1);
            let rig = meshes.get(self.mesh).and_then(|mesh| mesh.rig.as_ref());
            self.bounds = rig.map_or(self.bounds, |rig| rig.bounds.in_pose(pose));
        }
        self.pose.clone_from(pose);
        self
    }

    /// The record for the shaders.  Appends its pose to `poses`.
    fn record(&self, mesh: &MeshEntry, poses: &mut Vec<[f32; 4]>) -> Option<GpuBody> {
        let rig = mesh.rig.as_ref()?;
        let tables = rig.tables;
        let joints = poses.len() as u32;
        poses.extend(self.pose.joints.iter().flat_map(rows));
        let weights = poses.len() as u32;
        let targets = self.pose.weights.iter().take(tables.target_count as usize).enumerate();
        poses.extend(targets.filter(|(_, weight)| **weight != 0.0).map(|(i, weight)| [*weight, i as f32, 0.0, 0.0]));
        let is_skinned = tables.influences != NONE && !self.pose.joints.is_empty();
        Some(GpuBody {
            rest_triangle: mesh.triangles.start,
            triangle: self.all_triangles.start,
            triangle_count: mesh.triangles.len() as u32,
            rest_vertex: mesh.vertices.start,
            vertex: self.all_vertices.start,
            vertex_count: mesh.vertices.len() as u32,
            rest_node: mesh.nodes.start,
            node: self.nodes.start,
            first_box: 2 * self.boxes.start,
            influences: if is_skinned { rig.words.start + tables.influences } else { NONE },
            targets: rig.words.start + tables.targets,
            levels: rig.words.start + tables.levels,
            // With ray queries there are no nodes.
            level_count: if self.nodes.is_empty() { 0 } else { tables.level_count },
            joints,
            joint_count: self.pose.joints.len() as u32,
            weights,
            weight_count: poses.len() as u32 - weights,
            flags: if self.appeared { BODY_APPEARED } else { 0 },
        })
    }
}
