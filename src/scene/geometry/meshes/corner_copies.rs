//! Copies of the corners of meshes on the CPU.
//!
//! The triangles of an emissive mesh are lights with powers by their areas, and the tree over instances that rest is built from corners.  So
//! emissive meshes have a copy, and so do the smallest others, within a limit.  A mesh without a copy that becomes emissive is read back from
//! the device.  Until the device has answered, only rays that hit the mesh find its light: the picture is noisier, not darker.

#[cfg(feature = "testing")]
use bevy::app::App;
use bevy::{
    asset::AssetId,
    log::warn_once,
    mesh::Mesh,
    platform::collections::{HashMap, HashSet},
    render::{
        render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor, MapMode, PollType},
        renderer::{RenderDevice, RenderQueue},
    },
};
use std::sync::{Arc, OnceLock};

use super::{MeshEntry, MeshPool};
use crate::gpu_layout::{GpuTriangle, GpuVertex};
use crate::scene::storage::allocation;

/// Greatest number of triangles of all copies of meshes that do not emit: 19 MB in ordinary meshes, four times what the tree over instances
/// that rest can hold.
const MAX_TRIANGLES: usize = 1 << 20;

/// Corners of the triangles of a mesh in object space, in the order of the leaves.
#[derive(Clone, Debug)]
pub(crate) struct CornerCopy {
    vertices: Vec<[f32; 3]>,
    triangles: Vec<GpuTriangle>,
}

impl CornerCopy {
    /// A copy of triangles whose vertices begin at this index.
    pub(super) fn new(triangles: &[GpuTriangle], vertices: &[GpuVertex], first_vertex: u32) -> Self {
        let relative =
            |t: &GpuTriangle| GpuTriangle { a: t.a - first_vertex, b: t.b - first_vertex, c: t.c - first_vertex };
        Self {
            vertices: vertices.iter().map(|vertex| vertex.position).collect(),
            triangles: triangles.iter().map(relative).collect(),
        }
    }

    pub(crate) fn corners(&self) -> impl Iterator<Item = [[f32; 3]; 3]> {
        self.triangles.iter().map(|t| [t.a, t.b, t.c].map(|vertex| self.vertices[vertex as usize]))
    }
}

/// A copy that the device has been asked for.
struct Readback {
    /// Version of the mesh.
    version: u64,
    /// Its triangles, followed by its vertices.
    staging: Buffer,
    triangle_bytes: u64,
    first_vertex: u32,
    /// Whether the buffer could be mapped, once it is known.
    is_mapped: Arc<OnceLock<bool>>,
}

/// What is known about the copies of all meshes.  The copies themselves are parts of [`MeshEntry`].
pub(super) struct CornerCopies {
    reading: HashMap<AssetId<Mesh>, Readback>,
    /// Versions of meshes that the device had no memory to read back.
    failed: HashSet<u64>,
    /// Meshes have come since the last update, so that there may be too many copies.
    pub(super) has_more: bool,
    /// Copies have come since the last update, so that there are lights to add.
    arrived: bool,
    /// Frames wait for the device, so that pictures do not depend on the time that it takes.
    pub(super) waits: bool,
    /// Copies that the device has read back are not taken.
    is_held: bool,
    limit: usize,
}

impl Default for CornerCopies {
    fn default() -> Self {
        Self {
            reading: HashMap::default(),
            failed: HashSet::default(),
            has_more: false,
            arrived: false,
            waits: false,
            is_held: false,
            limit: MAX_TRIANGLES,
        }
    }
}

impl CornerCopies {
    /// Forgets a mesh that is gone.
    pub(super) fn forget(&mut self, version: u64) {
        self.failed.remove(&version);
    }

    /// Lengths of the tables.
    #[cfg(feature = "testing")]
    pub(super) fn len(&self) -> usize {
        self.reading.len() + self.failed.len()
    }
}

impl MeshPool {
    /// Whether copies of emissive meshes have come since [`Self::update_copies`] ran.
    pub(crate) fn copies_arrived(&self) -> bool {
        self.copies.arrived
    }

    /// Whether the device is reading copies back.
    pub(super) fn awaits_copies(&self) -> bool {
        !self.copies.reading.is_empty()
    }

    /// Whether [`Self::update_copies`] is due although the set of emissive meshes has not changed.
    pub(crate) fn has_more_copies(&self) -> bool {
        self.copies.has_more || self.copies.arrived
    }

    /// Takes the copies that the device has read back since the last frame.
    pub(super) fn take_copies(&mut self, device: &RenderDevice) {
        if self.copies.reading.is_empty() || self.copies.is_held {
            return;
        }
        if self.copies.waits {
            // A lost device cannot answer, and `is_mapped` then says so.
            _ = device.poll(PollType::wait_indefinitely());
        }
        let is_done = |_: &AssetId<Mesh>, readback: &mut Readback| readback.is_mapped.get().is_some();
        for (id, readback) in self.copies.reading.extract_if(is_done) {
            let entry = self.entries.get_mut(&id).filter(|entry| entry.version == readback.version);
            match entry {
                Some(entry) if readback.is_mapped.get() == Some(&true) => {
                    entry.corners = Some(readback.read());
                    self.copies.arrived = true;
                }
                Some(_) => _ = self.copies.failed.insert(readback.version),
                None => {}
            }
        }
    }

    /// Asks the device for the copies of these meshes that are missing, and drops those of other meshes beyond the limit, the largest first.
    pub(crate) fn update_copies(
        &mut self,
        emissive: &HashSet<AssetId<Mesh>>,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        (self.copies.has_more, self.copies.arrived) = (false, false);
        let mut others: Vec<_> =
            self.entries.iter().filter(|(id, entry)| entry.corners.is_some() && !emissive.contains(*id)).collect();
        others.sort_unstable_by_key(|(id, entry)| (entry.triangles.len(), **id));
        let mut sum = 0;
        let surplus = others.into_iter().filter(|(_, entry)| {
            sum += entry.triangles.len();
            sum > self.copies.limit
        });
        let surplus: Vec<_> = surplus.map(|(id, _)| *id).collect();
        for id in surplus {
            if let Some(entry) = self.entries.get_mut(&id) {
                entry.corners = None;
            }
        }
        let mut missing: Vec<_> = emissive.iter().filter(|id| self.lacks_copy(**id)).copied().collect();
        missing.sort_unstable();
        for id in missing {
            let Some(entry) = self.entries.get(&id) else { continue };
            match self.read_back(entry, device, queue) {
                Some(readback) => _ = self.copies.reading.insert(id, readback),
                None => {
                    warn_once!(
                        "restir: no memory to read back a mesh that now emits light: its light is noisier, not darker"
                    );
                    self.copies.failed.insert(entry.version);
                }
            }
        }
    }

    /// Whether a copy of the mesh must be read back.
    fn lacks_copy(&self, id: AssetId<Mesh>) -> bool {
        let is_read = |version| self.copies.reading.get(&id).is_some_and(|readback| readback.version == version);
        let lacks = |entry: &MeshEntry| {
            entry.corners.is_none() && !self.copies.failed.contains(&entry.version) && !is_read(entry.version)
        };
        self.entries.get(&id).is_some_and(lacks)
    }

    fn read_back(&self, entry: &MeshEntry, device: &RenderDevice, queue: &RenderQueue) -> Option<Readback> {
        let (triangles, vertices) = (self.triangles.buffer()?, self.vertices.buffer()?);
        let bytes = |size: usize, count: usize| (size * count) as u64;
        let triangle_size = size_of::<GpuTriangle>();
        let vertex_size = size_of::<GpuVertex>();
        let triangle_bytes = bytes(triangle_size, entry.triangles.len());
        let vertex_bytes = bytes(vertex_size, entry.vertices.len());
        let create = || {
            device.create_buffer(&BufferDescriptor {
                label: Some("corners of an emissive mesh"),
                size: triangle_bytes + vertex_bytes,
                usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let staging = allocation::attempt(device, "corners of an emissive mesh", create).ok()?;
        let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some("corners of a mesh") });
        let first = bytes(triangle_size, entry.triangles.start as usize);
        encoder.copy_buffer_to_buffer(triangles, first, &staging, 0, triangle_bytes);
        let first = bytes(vertex_size, entry.vertices.start as usize);
        encoder.copy_buffer_to_buffer(vertices, first, &staging, triangle_bytes, vertex_bytes);
        queue.submit([encoder.finish()]);
        let is_mapped = Arc::<OnceLock<bool>>::default();
        let answer = is_mapped.clone();
        staging.slice(..).map_async(MapMode::Read, move |result| _ = answer.set(result.is_ok()));
        Some(Readback {
            version: entry.version,
            staging,
            triangle_bytes,
            first_vertex: entry.vertices.start,
            is_mapped,
        })
    }
}

impl Readback {
    fn read(&self) -> CornerCopy {
        let bytes = self.staging.slice(..).get_mapped_range();
        let (triangles, vertices) = bytes.split_at(self.triangle_bytes as usize);
        let triangles: Vec<GpuTriangle> = bytemuck::pod_collect_to_vec(triangles);
        let vertices: Vec<GpuVertex> = bytemuck::pod_collect_to_vec(vertices);
        CornerCopy::new(&triangles, &vertices, self.first_vertex)
    }
}

/// Sets the greatest number of triangles of all copies of meshes that do not emit.
#[cfg(feature = "testing")]
pub fn limit_corner_copies(app: &mut App, triangles: usize) {
    change_copies(app, |copies| (copies.limit, copies.has_more) = (triangles, true));
}

/// Lets copies wait, as those of a device that takes many frames to answer, or takes those that have waited.
#[cfg(feature = "testing")]
pub fn hold_corner_copies(app: &mut App, is_held: bool) {
    change_copies(app, |copies| copies.is_held = is_held);
}

#[cfg(feature = "testing")]
fn change_copies(app: &mut App, change: impl FnOnce(&mut CornerCopies)) {
    let world = app.get_sub_app_mut(bevy::render::RenderApp).map(|render| render.world_mut());
    if let Some(mut meshes) = world.and_then(|world| world.get_resource_mut::<MeshPool>()) {
        change(&mut meshes.copies);
    }
}
