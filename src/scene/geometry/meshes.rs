//! Meshes as rays see them: geometry taken where Bevy hands it to the render world, bottom levels built in tasks, ranges of the
//! shared buffers.  A mesh that changes keeps its old triangles until the new ones are ready.

use bevy::{
    asset::{AssetId, AssetServer},
    ecs::{
        resource::Resource,
        system::{Res, ResMut},
    },
    log::{warn, warn_once},
    mesh::Mesh,
    platform::collections::{HashMap, HashSet},
    render::{
        mesh::RenderMesh,
        render_asset::ExtractedAssets,
        render_resource::{BufferUsages, TextureFormat},
        renderer::{RenderDevice, RenderQueue},
    },
    tasks::{AsyncComputeTaskPool, Task, futures::check_ready},
};
use std::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{
    accel::blas::{self, Blas, Bounds},
    extract::ExtractedInstance,
    geometry::triangulate::{self, Dropped, GeometryError},
    storage::{data_texture::DataTexture, growable_buffer::GrowableBuffer, range_allocator::RangeAllocator},
};

/// A mesh on the GPU.
pub(crate) struct MeshEntry {
    nodes: Range<u32>,
    pub triangles: Range<u32>,
    pub bounds: Bounds,
    /// Object-space corners in leaf order, for the power of emissive triangles.
    pub positions: Vec<[[f32; 3]; 3]>,
    /// Second texture coordinates in the same order, kept until a material asks for them; empty where the mesh has none.
    pub second_uvs: Vec<[[f32; 2]; 3]>,
    /// Changes when the triangles do.
    pub version: u64,
}

impl MeshEntry {
    /// Node index of the root; of its first triangle where the device keeps the tree.
    pub(crate) fn root(&self) -> u32 {
        if self.nodes.is_empty() { self.triangles.start } else { self.nodes.start }
    }
}

type Built = (Result<Option<Blas>, GeometryError>, Dropped);

/// A mesh that is being built.
struct Build {
    task: Task<Built>,
    /// What it has become since: built next.
    newest: Option<Mesh>,
}

/// What can be wrong with a mesh.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Flaw {
    /// Some triangles are left out.
    Partial,
    TooLarge,
    NoTriangle,
    NotTriangles,
    Unreadable,
}

/// The meshes of the scene.
#[derive(Resource)]
pub(crate) struct MeshPool {
    entries: HashMap<AssetId<Mesh>, MeshEntry>,
    building: HashMap<AssetId<Mesh>, Build>,
    /// Meshes without a single usable triangle: nothing waits for them.
    empty: HashSet<AssetId<Mesh>>,
    /// Warned of already.
    told: HashSet<(AssetId<Mesh>, Flaw)>,
    /// Lines and points, and what to say of them once a thing is made of them: whatever else draws them needs no triangles.
    unlit: HashMap<AssetId<Mesh>, String>,
    node_ranges: RangeAllocator,
    triangle_ranges: RangeAllocator,
    pub nodes: GrowableBuffer<[[u32; 4]; NODE_STRIDE as usize]>,
    pub triangles: GrowableBuffer<GpuTriangle>,
    pub attributes: GrowableBuffer<GpuTriangleAttributes>,
    /// Beside the triangles, in scenes where a texture goes by them.
    pub second_uvs: DataTexture<[[f32; 2]; 3]>,
    /// Versions of the meshes that are in there.
    second_uvs_of: HashMap<AssetId<Mesh>, u64>,
    versions: u64,
    /// Rays are traced by ray queries: the trees are the device's, and only the order of their leaves is ours, so that both back ends
    /// number triangles alike.
    ray_queries: bool,
    /// Bytes sent in this frame.
    pub uploaded: u64,
}

impl Default for MeshPool {
    fn default() -> Self {
        Self {
            entries: HashMap::default(),
            building: HashMap::default(),
            empty: HashSet::default(),
            told: HashSet::default(),
            unlit: HashMap::default(),
            node_ranges: RangeAllocator::default(),
            triangle_ranges: RangeAllocator::default(),
            nodes: GrowableBuffer::new("acceleration structures"),
            triangles: GrowableBuffer::new("triangles"),
            attributes: GrowableBuffer::new("triangle attributes"),
            second_uvs: DataTexture::new("second texture coordinates", TextureFormat::Rg32Float, 3),
            second_uvs_of: HashMap::default(),
            versions: 0,
            ray_queries: false,
            uploaded: 0,
        }
    }
}

/// Starts a build for every mesh that was added or changed.  One that is being built is built to its end and shown: of a mesh that
/// changes faster than it is built every shape is late, but it moves.
pub(crate) fn queue_meshes(mut pool: ResMut<MeshPool>, extracted: Res<ExtractedAssets<RenderMesh>>) {
    let pool = &mut *pool;
    for id in &extracted.removed {
        pool.building.remove(id);
        pool.empty.remove(id);
        pool.unlit.remove(id);
        pool.told.retain(|(told, _)| told != id);
        pool.release(*id);
    }
    for (id, mesh) in &extracted.extracted {
        let mesh = mesh.clone();
        match pool.building.get_mut(id) {
            Some(build) => build.newest = Some(mesh),
            None => _ = pool.building.insert(*id, Build { task: build(mesh), newest: None }),
        }
    }
}

fn build(mesh: Mesh) -> Task<Built> {
    AsyncComputeTaskPool::get().spawn(async move {
        match triangulate::triangles_of(&mesh) {
            Ok(geometry) => (Ok(blas::build_blas(&geometry)), geometry.dropped),
            Err(error) => (Err(error), Dropped::default()),
        }
    })
}

/// Uploads what was built since the last frame.
pub(crate) fn finish_meshes(
    mut pool: ResMut<MeshPool>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    assets: Option<Res<AssetServer>>,
) {
    let pool = &mut *pool;
    pool.uploaded = 0;
    let mut done = Vec::new();
    pool.building.retain(|id, running| {
        let Some(built) = check_ready(&mut running.task) else { return true };
        done.push((*id, built));
        let newest = running.newest.take().map(build);
        newest.map(|task| running.task = task).is_some()
    });
    // The order in which tasks end must not decide where a mesh lies.
    done.sort_unstable_by_key(|(id, _)| *id);
    for (id, (built, dropped)) in done {
        if dropped.total() > 0 {
            let Dropped { out_of_range, non_finite, degenerate } = dropped;
            let left_out = format!(
                ": left out {out_of_range} triangles with indices out of range, {non_finite} that are not finite, {degenerate} without \
                 area"
            );
            pool.tell(id, Flaw::Partial, &left_out, assets.as_deref());
        }
        let (flaw, trouble) = match built {
            Ok(Some(blas)) => {
                if pool.insert(id, blas, &device, &queue) {
                    pool.empty.remove(&id);
                    if pool.unlit.remove(&id).is_some() {
                        pool.told.remove(&(id, Flaw::NotTriangles));
                    }
                    continue;
                }
                (Flaw::TooLarge, " does not fit the buffers of this device".into())
            }
            Ok(None) => (Flaw::NoTriangle, " has no usable triangle".into()),
            Err(error @ GeometryError::Topology(_)) => (Flaw::NotTriangles, format!(": {error}")),
            Err(error) => (Flaw::Unreadable, format!(": {error}")),
        };
        pool.tell(id, flaw, &format!("{trouble}; it is left out"), assets.as_deref());
        pool.release(id);
        pool.empty.insert(id);
    }
}

impl MeshPool {
    /// A pool whose triangles the device builds its acceleration structures from.
    pub(crate) fn for_ray_queries() -> Self {
        let mut pool = Self { ray_queries: true, ..Default::default() };
        pool.triangles.add_usage(BufferUsages::BLAS_INPUT);
        pool
    }

    fn insert(&mut self, id: AssetId<Mesh>, mut blas: Blas, device: &RenderDevice, queue: &RenderQueue) -> bool {
        if self.ray_queries {
            let vertices = 3 * blas.triangles.len() as u64;
            if vertices > u64::from(device.limits().max_blas_primitive_count) {
                return false;
            }
            blas.nodes = Vec::new();
        }
        let node_count = (blas.nodes.len() / NODE_STRIDE as usize) as u32;
        let nodes = self.node_ranges.allocate(node_count);
        let triangles = self.triangle_ranges.allocate(blas.triangles.len() as u32);
        let fits = self.nodes.reserve(self.node_ranges.end(), device, queue)
            && self.triangles.reserve(self.triangle_ranges.end(), device, queue)
            && self.attributes.reserve(self.triangle_ranges.end(), device, queue);
        if !fits {
            self.node_ranges.release(nodes);
            self.triangle_ranges.release(triangles);
            return false;
        }
        blas::bake(&mut blas.nodes, nodes.start, triangles.start);
        self.uploaded += self.nodes.write(nodes.start, bytemuck::cast_slice(&blas.nodes), queue)
            + self.triangles.write(triangles.start, &blas.triangles, queue)
            + self.attributes.write(triangles.start, &blas.attributes, queue);
        self.versions += 1;
        let entry = MeshEntry {
            nodes,
            triangles,
            bounds: blas.bounds,
            positions: blas.triangles.iter().map(|t| [t.a, t.b, t.c]).collect(),
            second_uvs: blas.second_uvs,
            version: self.versions,
        };
        if let Some(old) = self.entries.insert(id, entry) {
            self.node_ranges.release(old.nodes);
            self.triangle_ranges.release(old.triangles);
        }
        true
    }

    /// Warns of a mesh, once for as long as it exists: it may be built in every frame.
    fn tell(&mut self, id: AssetId<Mesh>, flaw: Flaw, text: &str, assets: Option<&AssetServer>) {
        if !self.told.insert((id, flaw)) {
            return;
        }
        let name = assets.and_then(|a| a.get_path(id)).map_or_else(|| id.to_string(), |path| path.to_string());
        match flaw {
            Flaw::NotTriangles => _ = self.unlit.insert(id, format!("{name}{text}")),
            _ => warn!("restir: mesh {name}{text}"),
        }
    }

    /// Warns of things that are made of lines or points.
    pub(crate) fn tell_of_unlit(&mut self, instances: &[ExtractedInstance]) {
        if self.unlit.is_empty() {
            return;
        }
        for text in instances.iter().filter_map(|instance| self.unlit.remove(&instance.mesh)) {
            warn!("restir: mesh {text}");
        }
    }

    /// Gives back what a mesh takes of the buffers.
    fn release(&mut self, id: AssetId<Mesh>) {
        self.second_uvs_of.remove(&id);
        if let Some(entry) = self.entries.remove(&id) {
            self.node_ranges.release(entry.nodes);
            self.triangle_ranges.release(entry.triangles);
        }
    }

    /// The mesh, once it is on the GPU.
    pub(crate) fn get(&self, id: AssetId<Mesh>) -> Option<&MeshEntry> {
        self.entries.get(&id)
    }

    /// Sends the second texture coordinates that are not there yet, or gives their memory back.  Returns the bytes sent.
    pub(crate) fn update_second_uvs(&mut self, wanted: bool, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        let count = self.triangle_ranges.end();
        if !wanted || count > DataTexture::<[[f32; 2]; 3]>::limit(device) {
            if wanted {
                warn_once!(
                    "restir: second texture coordinates of {count} triangles do not fit this device; they are 0"
                );
            }
            self.second_uvs.clear();
            self.second_uvs_of.clear();
            if wanted {
                self.second_uvs.reserve(1, device);
            }
            return 0;
        }
        if self.second_uvs.reserve(count, device) {
            self.second_uvs_of.clear();
        }
        let mut bytes = 0;
        for (id, entry) in self.entries.iter().filter(|(_, entry)| !entry.second_uvs.is_empty()) {
            if self.second_uvs_of.insert(*id, entry.version) != Some(entry.version) {
                bytes += self.second_uvs.write(entry.triangles.start, &entry.second_uvs, queue);
            }
        }
        bytes
    }

    /// Whether a mesh has these triangles still.
    pub(crate) fn versions(&self) -> HashSet<u64> {
        self.entries.values().map(|entry| entry.version).collect()
    }

    /// No build is under way.
    pub(crate) fn idle(&self) -> bool {
        self.building.is_empty()
    }

    /// Its triangles are on their way.
    pub(crate) fn is_building(&self, id: AssetId<Mesh>) -> bool {
        self.building.contains_key(&id)
    }

    /// Nothing will come of this mesh.
    pub(crate) fn is_empty(&self, id: AssetId<Mesh>) -> bool {
        self.empty.contains(&id)
    }

    /// A range of nodes for a top level, beside the bottom levels.
    pub(crate) fn allocate_nodes(
        &mut self,
        count: u32,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<Range<u32>> {
        let range = self.node_ranges.allocate(count);
        if self.nodes.reserve(self.node_ranges.end(), device, queue) {
            return Some(range);
        }
        self.node_ranges.release(range);
        None
    }

    /// Gives such a range back.
    pub(crate) fn release_nodes(&mut self, range: Range<u32>) {
        self.node_ranges.release(range);
    }
}
