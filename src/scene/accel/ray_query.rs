//! The device's own acceleration structures, for tracing by ray queries.
//!
//! Each mesh has a bottom level, which is built once over the triangles and vertices that shaders read.  There is a top level over the
//! instances of this frame and, while it differs, one over those of the last frame, because temporal reuse traces rays through the previous
//! scene.

use bevy::{
    log::{warn, warn_once},
    platform::collections::HashMap,
    render::{
        render_resource::{binding_types::acceleration_structure, *},
        renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
    },
};
use std::ops::Range;

use crate::{
    gpu_layout::{GpuVertex, NONE, Rows},
    scene::storage::allocation,
    settings::RayBackend,
};

/// Bytes that the CPU sends for each instance of a top level.
pub const INSTANCE_SIZE: u64 = 64;

/// Maximum number of instance slots: the custom index of an instance has 24 bits.
pub const MAX_SLOTS: u32 = 1 << 24;

/// Number of frames between two attempts to create structures that the device had no memory for.  Each attempt builds all of them.
const RETRY: u32 = 60;

/// The first requirement of tracing by ray queries that the device does not meet; `None` if it meets all of them.
pub fn missing(device: &RenderDevice) -> Option<&'static str> {
    let limits = device.limits();
    if !device.features().contains(WgpuFeatures::EXPERIMENTAL_RAY_QUERY) {
        return Some("no ray queries");
    }
    if limits.max_acceleration_structures_per_shader_stage < 2 {
        return Some("fewer than two acceleration structures per shader stage");
    }
    if limits.max_bind_groups < 4 {
        return Some("fewer than four bind groups");
    }
    if limits.max_tlas_instance_count < 1 << 16 || limits.max_blas_primitive_count < 1 << 20 {
        return Some("acceleration structures with fewer than 65536 instances or 1048576 primitives");
    }
    None
}

/// Whether to trace by ray queries.  Warns if the app requests them and the device does not support them.
pub(crate) fn is_chosen(requested: RayBackend, device: &RenderDevice, adapter: &RenderAdapterInfo) -> bool {
    match (requested, missing(device)) {
        (RayBackend::Software, _) | (RayBackend::Auto, Some(_)) => false,
        // A CPU driver emulates ray queries: 2.8 to 25 times slower than our own traversal (`docs/experiments.md`, "Rays").
        (RayBackend::Auto, None) => adapter.device_type != wgpu_types::DeviceType::Cpu,
        (RayBackend::Hardware, None) => true,
        (RayBackend::Hardware, Some(missing)) => {
            warn_once!("restir: this device has {missing}; the software back end traces the rays instead");
            false
        }
    }
}

/// The layout of group 3 (`shaders/trace/hardware.wgsl`).
pub(crate) fn layout() -> BindGroupLayoutDescriptor {
    BindGroupLayoutDescriptor::new(
        "restir acceleration structures",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (acceleration_structure(), acceleration_structure()),
        ),
    )
}

/// An instance of a top level.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// Index in the instance buffer.
    pub slot: u32,
    /// Version of its geometry, which changes when the triangles do.
    pub version: u64,
    /// Its triangles have changed since a tree of this version was last built.
    pub rebuild: bool,
    /// Range of its mesh in the triangle buffer; not empty.
    pub triangles: Range<u32>,
    /// End of the range of its vertices in the vertex buffer.
    pub vertices_end: u32,
    /// Must be invertible.
    pub world_from_object: Rows,
    /// Every hit stops the ray: no triangle needs an alpha test.
    pub opaque: bool,
    /// Bits of the cameras whose rays can hit it.
    pub mask: u8,
}

/// A top level and its number of instances.
struct TopLevel {
    tlas: Tlas,
    capacity: u32,
    count: u32,
}

/// All acceleration structures of a scene.
#[derive(Default)]
pub struct AccelerationStructures {
    /// By the version and the opacity of the geometry.
    bottom: HashMap<(u64, bool), Blas>,
    current: Option<TopLevel>,
    /// The top level of the last frame; `None` if it equals the current one.
    previous: Option<TopLevel>,
    placed: Vec<Placed>,
    /// The device had no memory for the structures, so that there are none.
    pub(crate) lacks_memory: bool,
    /// Number of frames until the next attempt to create them.
    wait: u32,
    /// Changes when the bind group of the top levels must be created again.
    pub(crate) revision: u64,
}

impl AccelerationStructures {
    /// Builds the top level over `placed` and the missing bottom levels.  The old top level becomes that of the last frame.  Returns the
    /// number of bytes sent; if no instance changed, it is 0 and both frames share one top level.  If the device has no memory for them, all
    /// structures are dropped.
    pub fn update(
        &mut self,
        placed: &[Placed],
        triangles_and_vertices: [&Buffer; 2],
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> u64 {
        if self.current.is_some() && self.placed == placed {
            self.keep();
            return 0;
        }
        if self.wait > 0 {
            self.wait -= 1;
            return 0;
        }
        let build = || self.build(placed, triangles_and_vertices, device, queue);
        if let Err(error) = allocation::attempt(device, "ray-query structures", build) {
            self.drop_all(&error);
            return 0;
        }
        self.placed.clear();
        self.placed.extend_from_slice(placed);
        self.lacks_memory = false;
        self.revision += 1;
        placed.len() as u64 * INSTANCE_SIZE
    }

    /// Drops all structures, of which some are invalid or not built.
    fn drop_all(&mut self, error: &str) {
        if !core::mem::replace(&mut self.lacks_memory, true) {
            warn!(
                "restir: no memory for the acceleration structures of the scene; Bevy lights all cameras until there is some: {error}"
            );
        }
        self.bottom.clear();
        (self.current, self.previous) = (None, None);
        self.wait = RETRY;
    }

    fn build(
        &mut self,
        placed: &[Placed],
        [triangles, vertices]: [&Buffer; 2],
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        // If instances also moved in the last frame, the top level of the frame before it can be reused.
        let spare = core::mem::replace(&mut self.previous, self.current.take());
        let count = placed.len() as u32;
        let mut top = match spare {
            Some(top) if top.capacity >= count => top,
            _ => TopLevel::new(count.next_power_of_two().max(64).min(device.limits().max_tlas_instance_count), device),
        };

        let mut built = Vec::new();
        for (i, instance) in placed.iter().enumerate() {
            let key = (instance.version, instance.opaque);
            // The tree of the other opacity, which an object that fades leaves behind, keeps the old triangles.
            if instance.rebuild {
                self.bottom.remove(&(instance.version, !instance.opaque));
            }
            let is_missing = !self.bottom.contains_key(&key);
            let size = size_of_geometry(instance);
            let blas = self.bottom.entry(key).or_insert_with(|| create_bottom_level(&size, device));
            if is_missing || instance.rebuild {
                built.push((blas.clone(), size, instance.triangles.start));
            }
            let rows = &instance.world_from_object;
            let transform = core::array::from_fn(|k| rows[k / 4][k % 4]);
            top.tlas[i] = Some(TlasInstance::new(blas, transform, instance.slot, instance.mask));
        }
        for i in count..top.count {
            top.tlas[i as usize] = None;
        }
        top.count = count;

        let entries: Vec<BlasBuildEntry> = built
            .iter()
            .map(|(blas, size, first)| BlasBuildEntry {
                blas,
                geometry: BlasGeometries::TriangleGeometries(vec![BlasTriangleGeometry {
                    size,
                    vertex_buffer: vertices,
                    first_vertex: 0,
                    vertex_stride: size_of::<GpuVertex>() as u64,
                    index_buffer: Some(triangles),
                    first_index: Some(3 * first),
                    transform_buffer: None,
                    transform_buffer_offset: None,
                }]),
            })
            .collect();
        let mut encoder =
            device.create_command_encoder(&CommandEncoderDescriptor { label: Some("restir acceleration structures") });
        encoder.build_acceleration_structures(&entries, [&top.tlas]);
        queue.submit([encoder.finish()]);
        self.current = Some(top);
    }

    /// Goes on to a frame in which no instance has changed, as [`Self::update`] does after it has compared all of them.
    pub(crate) fn keep(&mut self) {
        self.revision += u64::from(self.previous.take().is_some());
    }

    /// Drops the bottom levels of geometry that has changed without being rebuilt.
    pub(crate) fn forget(&mut self, version: u64) {
        self.bottom.remove(&(version, false));
        self.bottom.remove(&(version, true));
    }

    /// Drops the bottom levels of removed geometry.
    pub fn retain(&mut self, mut is_alive: impl FnMut(u64) -> bool) {
        self.bottom.retain(|(version, _), _| is_alive(*version));
    }

    /// The top levels of this frame and of the last frame.
    pub fn top_levels(&self) -> Option<[&Tlas; 2]> {
        let current = self.current.as_ref()?;
        Some([&current.tlas, &self.previous.as_ref().unwrap_or(current).tlas])
    }

    /// The root indices of both for the shaders: `NONE` for a top level without instances, else 0.
    pub(crate) fn roots(&self) -> [u32; 2] {
        let root = |top: Option<&TopLevel>| if top.is_some_and(|top| top.count > 0) { 0 } else { NONE };
        [root(self.current.as_ref()), root(self.previous.as_ref().or(self.current.as_ref()))]
    }

    /// Name and size in bytes of the instance data.  wgpu does not report the size of the structures themselves.
    pub(crate) fn memory(&self) -> (&'static str, u64) {
        let tops = [&self.current, &self.previous].into_iter().flatten();
        ("top-level instances", tops.map(|top| u64::from(top.capacity) * INSTANCE_SIZE).sum())
    }
}

impl TopLevel {
    fn new(capacity: u32, device: &RenderDevice) -> Self {
        let tlas = device.wgpu_device().create_tlas(&CreateTlasDescriptor {
            label: Some("restir top level"),
            max_instances: capacity,
            flags: AccelerationStructureFlags::PREFER_FAST_TRACE,
            update_mode: AccelerationStructureUpdateMode::Build,
        });
        Self { tlas, capacity, count: 0 }
    }
}

fn size_of_geometry(instance: &Placed) -> BlasTriangleGeometrySizeDescriptor {
    BlasTriangleGeometrySizeDescriptor {
        vertex_format: VertexFormat::Float32x3,
        // Triangles count their vertices from the beginning of the buffer.
        vertex_count: instance.vertices_end,
        index_format: Some(IndexFormat::Uint32),
        index_count: Some(3 * (instance.triangles.end - instance.triangles.start)),
        flags: if instance.opaque {
            AccelerationStructureGeometryFlags::OPAQUE
        } else {
            AccelerationStructureGeometryFlags::empty()
        },
    }
}

fn create_bottom_level(size: &BlasTriangleGeometrySizeDescriptor, device: &RenderDevice) -> Blas {
    device.wgpu_device().create_blas(
        &CreateBlasDescriptor {
            label: Some("restir bottom level"),
            flags: AccelerationStructureFlags::PREFER_FAST_TRACE,
            update_mode: AccelerationStructureUpdateMode::Build,
        },
        BlasGeometrySizeDescriptors::Triangles { descriptors: vec![size.clone()] },
    )
}
