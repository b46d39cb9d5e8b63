//! Keeps the triangles, the vertices and the bottom-level tree of each mesh in shared buffers.
//!
//! Meshes are taken from Bevy's extraction, before Bevy moves their vertices to the GPU, and background tasks build the trees.  A changed
//! mesh keeps its old triangles until the new tree is ready.

mod arrivals;
pub(crate) mod corner_copies;
mod problems;
mod ranges;

use bevy::{
    asset::{AssetId, AssetServer},
    ecs::{
        resource::Resource,
        system::{Res, ResMut},
    },
    mesh::Mesh,
    platform::collections::{HashMap, HashSet},
    render::{
        mesh::RenderMesh,
        render_asset::ExtractedAssets,
        render_resource::{BufferUsages, TextureFormat},
        renderer::{RenderDevice, RenderQueue},
    },
};
use std::{collections::VecDeque, ops::Range};

use arrivals::Build;
use corner_copies::{CornerCopies, CornerCopy};
use problems::MeshProblem;

use crate::cpu_times::{CpuTimes, Stage};
use crate::gpu_layout::*;
use crate::scene::{
    accel::blas::{self, Blas, Bounds},
    extract::{ExtractedScene, instances::InstanceList},
    features::SceneFeatures,
    geometry::corner_texture::{BodySource, CornerTexture},
    geometry::mesh_build::{BuildError, Built},
    geometry::rig::{Rig, RigBounds, RigTables},
    geometry::triangulate::{GeometryError, HalfColor},
    storage::{growable_buffer::GrowableBuffer, range_allocator::RangeAllocator},
};
use crate::warned::Warned;

/// The rig of a mesh that bends.
pub(crate) struct MeshRig {
    /// Range of its tables in the buffer of rigs.
    pub words: Range<u32>,
    pub tables: RigTables,
    pub bounds: RigBounds,
}

/// A mesh on the GPU.
pub(crate) struct MeshEntry {
    pub nodes: Range<u32>,
    pub triangles: Range<u32>,
    pub vertices: Range<u32>,
    pub bounds: Bounds,
    /// Corners of its triangles, for the powers of emissive ones and for the tree over instances that rest.
    pub corners: Option<CornerCopy>,
    /// Second texture coordinates of all corners, kept until a material uses them; empty if the mesh has none.
    pub second_uvs: Vec<[[f32; 2]; 3]>,
    /// Vertex colors in the same order; empty if the mesh has none.
    pub colors: Vec<[HalfColor; 3]>,
    /// `None` for a mesh that does not bend, or whose tables do not fit the device.
    pub rig: Option<MeshRig>,
    /// Changes when the triangles change.
    pub version: u64,
}

impl MeshEntry {
    /// Index of the root node; with ray queries, where we have no nodes, index of the first triangle.
    pub(crate) fn root(&self) -> u32 {
        if self.nodes.is_empty() { self.triangles.start } else { self.nodes.start }
    }
}

/// The meshes of the scene.
#[derive(Resource)]
pub(crate) struct MeshPool {
    entries: HashMap<AssetId<Mesh>, MeshEntry>,
    /// Entries that were removed or replaced in this frame.  Temporal reuse still traces rays through them.
    retired: Vec<MeshEntry>,
    /// Meshes whose assets are gone.  They are released in the next frame, or when no instance shows them as a substitute.
    orphans: HashSet<AssetId<Mesh>>,
    /// Meshes that instances of the last frame showed while their own were built.
    substitutes: HashSet<AssetId<Mesh>>,
    /// Meshes that are being built or wait for their upload.
    building: HashMap<AssetId<Mesh>, Build>,
    /// Results of ended builds, in the order in which they are uploaded.
    arrivals: VecDeque<(AssetId<Mesh>, Built)>,
    /// Meshes that are left out, so that no instance waits for them: without a usable triangle, too large, unreadable, or failed to build.
    left_out: HashSet<AssetId<Mesh>>,
    /// Meshes of `left_out` that did not fit the device.  They are tried again when other meshes or bodies are gone.
    too_large: HashMap<AssetId<Mesh>, Box<Blas>>,
    /// Meshes that no instance shows.  They take no room on the GPU until one does.
    unused: HashMap<AssetId<Mesh>, Box<Blas>>,
    /// Triangles have been freed, so that a mesh in `too_large` may fit.
    has_room: bool,
    /// Problems that were warned about.
    warned: Warned<(AssetId<Mesh>, MeshProblem)>,
    /// Warnings about meshes of lines or points.  A warning is logged when an instance with a `StandardMaterial` uses the mesh, because
    /// other materials can draw lines and points.
    lines_and_points: HashMap<AssetId<Mesh>, String>,
    node_ranges: RangeAllocator,
    triangle_ranges: RangeAllocator,
    vertex_ranges: RangeAllocator,
    rig_ranges: RangeAllocator,
    pub nodes: GrowableBuffer<[[u32; 4]; NODE_STRIDE as usize]>,
    pub triangles: GrowableBuffer<GpuTriangle>,
    pub vertices: GrowableBuffer<GpuVertex>,
    /// Tables of the meshes that bend.
    pub rigs: GrowableBuffer<u32>,
    /// Second texture coordinates of the triangles, in scenes with a texture that uses them.
    pub second_uvs: CornerTexture<[f32; 2]>,
    /// Vertex colors of the triangles, in scenes with such a mesh.
    pub colors: CornerTexture<HalfColor>,
    copies: CornerCopies,
    last_version: u64,
    last_features: SceneFeatures,
    /// Meshes that have come, changed or gone since [`Self::take_changed`]; some more than once.
    changed: Vec<AssetId<Mesh>>,
    /// Rays are traced by ray queries.  The device then builds its own trees, and ours only order the triangles, so that both back ends
    /// give a triangle the same index.
    ray_queries: bool,
    /// Bytes sent in this frame.
    pub uploaded: u64,
}

impl Default for MeshPool {
    fn default() -> Self {
        Self {
            entries: HashMap::default(),
            retired: Vec::new(),
            orphans: HashSet::default(),
            substitutes: HashSet::default(),
            building: HashMap::default(),
            arrivals: VecDeque::new(),
            left_out: HashSet::default(),
            too_large: HashMap::default(),
            unused: HashMap::default(),
            has_room: false,
            warned: Warned::default(),
            lines_and_points: HashMap::default(),
            node_ranges: RangeAllocator::default(),
            triangle_ranges: RangeAllocator::default(),
            vertex_ranges: RangeAllocator::default(),
            rig_ranges: RangeAllocator::default(),
            nodes: GrowableBuffer::new("acceleration structures"),
            triangles: GrowableBuffer::new("triangles"),
            vertices: GrowableBuffer::new("vertices"),
            rigs: GrowableBuffer::new("rigs"),
            second_uvs: CornerTexture::new("second texture coordinates", "0", TextureFormat::Rg32Float),
            colors: CornerTexture::new("vertex colors", "white", TextureFormat::Rgba16Float),
            copies: CornerCopies::default(),
            last_version: 0,
            last_features: SceneFeatures::empty(),
            changed: Vec::new(),
            ray_queries: false,
            uploaded: 0,
        }
    }
}

/// Starts a build for each mesh that was added or changed.  A running build is finished and shown first, so that a mesh that changes faster
/// than it is built still moves, although late.
pub(crate) fn queue_meshes(
    mut pool: ResMut<MeshPool>,
    extracted: Res<ExtractedAssets<RenderMesh>>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::Meshes);
    let pool = &mut *pool;
    pool.release_retired();
    pool.release_orphans();
    for id in &extracted.removed {
        pool.building.remove(id);
        pool.too_large.remove(id);
        pool.unused.remove(id);
        if pool.left_out.remove(id) {
            pool.changed.push(*id);
        }
        pool.lines_and_points.remove(id);
        pool.orphans.insert(*id);
    }
    if !extracted.removed.is_empty() {
        pool.arrivals.retain(|(mesh, _)| !extracted.removed.contains(mesh));
        pool.warned.retain(|(mesh, _)| !extracted.removed.contains(mesh));
    }
    for (id, mesh) in &extracted.extracted {
        let mesh = mesh.clone();
        pool.too_large.remove(id);
        pool.orphans.remove(id);
        match pool.building.get_mut(id) {
            Some(build) => build.newest = Some(mesh),
            None => _ = pool.building.insert(*id, Build::start(mesh)),
        }
    }
}

/// Uploads the meshes that instances show and whose build has finished, up to the limit of a frame.
pub(crate) fn finish_meshes(
    mut pool: ResMut<MeshPool>,
    mut scene: ResMut<ExtractedScene>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    assets: Option<Res<AssetServer>>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::Meshes);
    let pool = &mut *pool;
    pool.uploaded = 0;
    pool.warned.begin_frame();
    pool.take_copies(&device);
    if core::mem::take(&mut pool.has_room) {
        pool.insert_too_large(&device, &queue);
    }
    pool.queue_arrivals(scene.instances.take_newly_shown());
    let is_unused = |id: AssetId<Mesh>| scene.instances.users_of_mesh(id).next().is_none();
    while let Some((id, (built, dropped))) = pool.next_arrival() {
        if let Some(text) = dropped.complaint() {
            pool.warn(id, MeshProblem::UnusableTriangles, &text, assets.as_deref());
        }
        let (problem, reason) = match built {
            Ok(Some(blas)) if !pool.entries.contains_key(&id) && is_unused(id) => {
                pool.left_out.remove(&id);
                pool.unused.insert(id, blas.into());
                continue;
            }
            Ok(Some(blas)) => match pool.insert(id, blas, &device, &queue) {
                Ok(()) => {
                    pool.left_out.remove(&id);
                    if pool.lines_and_points.remove(&id).is_some() {
                        pool.warned.forget(&(id, MeshProblem::LinesOrPoints));
                    }
                    continue;
                }
                Err(blas) => {
                    pool.too_large.insert(id, blas);
                    (MeshProblem::TooLarge, "does not fit the buffers of this device".into())
                }
            },
            Ok(None) => (MeshProblem::NoUsableTriangle, "has no usable triangle".into()),
            Err(BuildError::Geometry(error @ GeometryError::Topology(_))) => {
                (MeshProblem::LinesOrPoints, error.to_string())
            }
            Err(BuildError::Geometry(error)) => (MeshProblem::Unreadable, error.to_string()),
            Err(BuildError::Panic(text)) => (MeshProblem::BuildFailed, format!("could not be built ({text})")),
        };
        pool.warn(id, problem, &format!("{reason}; it is left out"), assets.as_deref());
        // An instance that begins to show the mesh must not show what it was.
        pool.unused.remove(&id);
        pool.release(id);
        pool.left_out.insert(id);
        pool.changed.push(id);
    }
}

impl MeshPool {
    /// Lengths of the pool's tables.
    #[cfg(feature = "testing")]
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("meshes", self.entries.len()),
            ("retired meshes", self.retired.len()),
            ("meshes without an asset", self.orphans.len()),
            ("meshes that are built", self.building.len()),
            ("meshes that wait for their upload", self.arrivals.len()),
            ("meshes that are left out", self.left_out.len()),
            ("meshes that do not fit", self.too_large.len()),
            ("meshes that are not shown", self.unused.len()),
            ("meshes of lines and points", self.lines_and_points.len()),
            ("warnings of meshes", self.warned.len()),
            ("nodes", self.node_ranges.end() as usize),
            ("triangles", self.triangle_ranges.end() as usize),
            ("vertices", self.vertex_ranges.end() as usize),
            ("rigs", self.rig_ranges.end() as usize),
            ("meshes with second coordinates", self.second_uvs.len()),
            ("meshes with vertex colors", self.colors.len()),
            ("meshes with copies of corners", self.entries.values().filter(|entry| entry.corners.is_some()).count()),
            ("meshes that are read back", self.copies.len()),
        ]
    }

    /// This pool, which waits for copies of emissive meshes if pictures must be repeatable (`waits`).
    pub(crate) fn that_may_wait(mut self, waits: bool) -> Self {
        self.copies.waits = waits;
        self
    }

    /// A pool for ray queries: the device builds its acceleration structures from our triangles and vertices.
    pub(crate) fn for_ray_queries() -> Self {
        let mut pool = Self { ray_queries: true, ..Default::default() };
        pool.triangles.add_usage(BufferUsages::BLAS_INPUT);
        pool.vertices.add_usage(BufferUsages::BLAS_INPUT);
        pool
    }

    /// Uploads the meshes that did not fit the device before, if they fit now.
    fn insert_too_large(&mut self, device: &RenderDevice, queue: &RenderQueue) {
        let mut too_large: Vec<_> = self.too_large.drain().collect();
        too_large.sort_unstable_by_key(|(id, _)| *id);
        for (id, blas) in too_large {
            match self.insert(id, *blas, device, queue) {
                Ok(()) => _ = self.left_out.remove(&id),
                Err(blas) => _ = self.too_large.insert(id, blas),
            }
        }
    }

    /// Uploads a mesh in place of its old version.  Gives the mesh back if it does not fit the device.
    fn insert(
        &mut self,
        id: AssetId<Mesh>,
        mut blas: Blas,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Result<(), Box<Blas>> {
        if self.ray_queries {
            blas.nodes = Vec::new();
        }
        let node_count = (blas.nodes.len() / NODE_STRIDE as usize) as u32;
        let counts = [blas.triangles.len() as u32, blas.vertices.len() as u32, node_count];
        let Some([triangles, vertices, nodes]) = self.allocate(counts, device, queue) else {
            return Err(blas.into());
        };
        let corners = Some(CornerCopy::new(&blas.triangles, &blas.vertices, 0));
        self.copies.has_more = true;
        blas::bake(&mut blas.nodes, nodes.start, triangles.start);
        blas::bake_vertices(&mut blas.triangles, vertices.start);
        self.uploaded += self.nodes.write(nodes.start, bytemuck::cast_slice(&blas.nodes), queue)
            + self.triangles.write(triangles.start, &blas.triangles, queue)
            + self.vertices.write(vertices.start, &blas.vertices, queue);
        let rig = blas.rig.and_then(|rig| self.insert_rig(id, rig, device, queue));
        let entry = MeshEntry {
            nodes,
            triangles,
            vertices,
            bounds: blas.bounds,
            corners,
            second_uvs: blas.second_uvs,
            colors: blas.colors,
            rig,
            version: self.next_version(),
        };
        self.retired.extend(self.entries.insert(id, entry));
        self.changed.push(id);
        Ok(())
    }

    /// Uploads the tables of a mesh that bends; `None` with a warning if they do not fit the device.
    fn insert_rig(
        &mut self,
        id: AssetId<Mesh>,
        rig: Rig,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<MeshRig> {
        let words = self.rig_ranges.allocate(rig.words.len() as u32);
        if !self.rigs.reserve(self.rig_ranges.end(), device, queue) {
            self.rig_ranges.release(words);
            self.warn(
                id,
                MeshProblem::RigTooLarge,
                "has more joints or morph targets than this device can bind; it keeps its rest pose",
                None,
            );
            return None;
        }
        self.uploaded += self.rigs.write(words.start, &rig.words, queue);
        Some(MeshRig { words, tables: rig.tables, bounds: rig.bounds })
    }

    /// A number that no mesh or body has had.
    pub(crate) fn next_version(&mut self) -> u64 {
        self.last_version += 1;
        self.last_version
    }

    /// Removes a mesh; the next frame frees its ranges in the buffers.
    fn release(&mut self, id: AssetId<Mesh>) {
        if let Some(entry) = self.entries.remove(&id) {
            self.retired.push(entry);
            self.changed.push(id);
        }
    }

    /// Takes the meshes that instances of this frame show while their own are built.
    pub(crate) fn keep_substitutes(&mut self, meshes: &mut Vec<AssetId<Mesh>>) {
        self.substitutes.clear();
        self.substitutes.extend(meshes.drain(..));
    }

    fn release_orphans(&mut self) {
        let is_free = |id: &AssetId<Mesh>| !self.substitutes.contains(id);
        let mut free: Vec<_> = self.orphans.extract_if(is_free).collect();
        free.sort_unstable();
        free.into_iter().for_each(|id| self.release(id));
    }

    /// Takes the meshes that have come, changed or gone since the last call; some more than once.
    pub(crate) fn take_changed(&mut self) -> Vec<AssetId<Mesh>> {
        core::mem::take(&mut self.changed)
    }

    /// Frees the ranges of meshes that the last frame was the last to use.
    fn release_retired(&mut self) {
        self.has_room |= !self.retired.is_empty();
        for entry in core::mem::take(&mut self.retired) {
            self.copies.forget(entry.version);
            self.second_uvs.forget(entry.version);
            self.colors.forget(entry.version);
            self.release_ranges([entry.triangles, entry.vertices, entry.nodes]);
            self.rig_ranges.release(entry.rig.map_or(0..0, |rig| rig.words));
        }
    }

    /// The mesh; `None` until it is on the GPU.
    pub(crate) fn get(&self, id: AssetId<Mesh>) -> Option<&MeshEntry> {
        self.entries.get(&id)
    }

    /// Uploads the second texture coordinates and the vertex colors that are missing if the scene needs them; else frees their memory.
    /// Returns the number of bytes sent.
    pub(crate) fn update_corner_textures(
        &mut self,
        features: SceneFeatures,
        bodies: impl Iterator<Item = BodySource> + Clone,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> u64 {
        let newest = (self.last_version, self.triangle_ranges.end());
        // Passes also shade the surfaces of the last frame.
        let features = features | core::mem::replace(&mut self.last_features, features);
        let Self { entries, retired, second_uvs, colors, .. } = self;
        let meshes = entries.values().chain(&*retired).map(|entry| (entry.version, entry.triangles.start, entry));
        let bodies = bodies.filter_map(|(version, first, mesh)| Some((version, first, entries.get(&mesh)?)));
        let all = meshes.chain(bodies);
        let needed = features.contains(SceneFeatures::SECOND_UVS);
        let sources = all.clone().map(|(version, first, entry)| (version, first, &*entry.second_uvs));
        let sent = second_uvs.update(needed, newest, sources, device, queue);
        let needed = features.contains(SceneFeatures::VERTEX_COLORS);
        let sources = all.map(|(version, first, entry)| (version, first, &*entry.colors));
        sent + colors.update(needed, newest, sources, device, queue)
    }

    /// Forgets that the values of a body are in the textures of corners.
    pub(crate) fn forget_corners(&mut self, version: u64) {
        self.second_uvs.forget(version);
        self.colors.forget(version);
    }

    /// Versions of all meshes on the GPU.
    pub(crate) fn versions(&self) -> HashSet<u64> {
        self.entries.values().chain(&self.retired).map(|entry| entry.version).collect()
    }

    /// Whether no mesh that an instance shows is being built, waits for its upload or is read back.
    pub(crate) fn shown_are_built(&self, instances: &InstanceList) -> bool {
        !self.awaits_copies() && self.building.keys().all(|id| instances.users_of_mesh(*id).next().is_none())
    }

    /// Whether each mesh has been built before; some may be built again.
    pub(crate) fn were_built(&self) -> bool {
        let was_built =
            |id| self.entries.contains_key(id) || self.left_out.contains(id) || self.unused.contains_key(id);
        self.building.keys().all(was_built)
    }

    /// Whether the mesh is being built or waits for its upload.
    pub(crate) fn is_building(&self, id: AssetId<Mesh>) -> bool {
        self.building.contains_key(&id)
    }

    /// Whether the mesh is left out: it has no usable triangle, is too large or unreadable, or could not be built.
    pub(crate) fn is_left_out(&self, id: AssetId<Mesh>) -> bool {
        self.left_out.contains(&id)
    }
}
