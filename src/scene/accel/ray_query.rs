//! The device's own acceleration structures, where rays are traced by ray queries: a bottom level a mesh, built once over the triangles
//! that shaders read; a top level over this frame's instances, and the last frame's beside it for as long as they differ.

use bevy::{
    log::warn_once,
    platform::collections::HashMap,
    render::{
        render_resource::{binding_types::acceleration_structure, *},
        renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
    },
};
use std::ops::Range;

use crate::{
    gpu_layout::{GpuTriangle, NONE, Rows},
    settings::RayBackend,
};

/// Bytes that the CPU sends for an instance of a top level.
pub const INSTANCE_SIZE: u64 = 64;

/// Instances that a top level can name: its custom index has 24 bits.
pub const MAX_SLOTS: u32 = 1 << 24;

/// What a device lacks for ray queries; `None` where it has all.
pub fn missing(device: &RenderDevice) -> Option<&'static str> {
    let limits = device.limits();
    if !device.features().contains(WgpuFeatures::EXPERIMENTAL_RAY_QUERY) {
        return Some("no ray queries");
    }
    if limits.max_acceleration_structures_per_shader_stage < 2 {
        return Some("room for less than two acceleration structures a shader stage");
    }
    if limits.max_bind_groups < 4 {
        return Some("less than four bind groups");
    }
    if limits.max_tlas_instance_count < 1 << 16 || limits.max_blas_primitive_count < 1 << 20 {
        return Some("room for less than 65536 instances or 1048576 vertices in its acceleration structures");
    }
    None
}

/// Whether to trace by ray queries.  Warns where they are asked for and the device has none.
pub(crate) fn is_chosen(wanted: RayBackend, device: &RenderDevice, adapter: &RenderAdapterInfo) -> bool {
    match (wanted, missing(device)) {
        (RayBackend::Software, _) | (RayBackend::Auto, Some(_)) => false,
        // A CPU emulates ray queries in its driver: measured, six times slower than our own traversal there.
        (RayBackend::Auto, None) => adapter.device_type != wgpu_types::DeviceType::Cpu,
        (RayBackend::Hardware, None) => true,
        (RayBackend::Hardware, Some(missing)) => {
            warn_once!("restir: this device has {missing}; rays are traced by the software back end");
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

/// An instance as a top level holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// Its place in the buffer of instances.
    pub slot: u32,
    /// Of its mesh; another number whenever the triangles are others.
    pub mesh: u64,
    /// Of its mesh, in the buffer of triangles; not empty.
    pub triangles: Range<u32>,
    /// Not singular.
    pub world_from_object: Rows,
    /// Every ray that meets it is stopped.
    pub opaque: bool,
    /// Bits of the cameras whose rays meet it.
    pub mask: u8,
}

/// A top level and how many instances it holds.
struct TopLevel {
    tlas: Tlas,
    capacity: u32,
    count: u32,
}

/// All acceleration structures of a scene.
#[derive(Default)]
pub struct AccelerationStructures {
    /// By mesh, and whether rays are stopped by all of it: that is a property of the geometry.
    bottom: HashMap<(u64, bool), Blas>,
    current: Option<TopLevel>,
    /// The last frame's, where it differs.
    previous: Option<TopLevel>,
    placed: Vec<Placed>,
    /// Changes when another top level is to be bound.
    pub(crate) revision: u64,
}

impl AccelerationStructures {
    /// Makes the top level that of `placed`, with the bottom levels that it needs; what it was becomes the last frame's.  Returns the
    /// bytes sent: none where nothing changed, and then the last frame's is this one's.
    pub fn update(&mut self, placed: &[Placed], triangles: &Buffer, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        if self.current.is_some() && self.placed == placed {
            self.revision += u64::from(self.previous.take().is_some());
            return 0;
        }
        self.placed.clear();
        self.placed.extend_from_slice(placed);
        // Where the last frame moved too, its own last one is taken up again.
        let spare = core::mem::replace(&mut self.previous, self.current.take());
        let count = placed.len() as u32;
        let mut top = match spare {
            Some(top) if top.capacity >= count => top,
            _ => TopLevel::new(count.next_power_of_two().max(64), device),
        };

        let mut built = Vec::new();
        for (i, instance) in placed.iter().enumerate() {
            let key = (instance.mesh, instance.opaque);
            let blas = self.bottom.entry(key).or_insert_with(|| {
                let size = size_of_geometry(instance);
                let blas = create_bottom_level(&size, device);
                built.push((blas.clone(), size, instance.triangles.start));
                blas
            });
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
                    vertex_buffer: triangles,
                    first_vertex: 3 * first,
                    vertex_stride: size_of::<GpuTriangle>() as u64 / 3,
                    index_buffer: None,
                    first_index: None,
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
        self.revision += 1;
        u64::from(count) * INSTANCE_SIZE
    }

    /// Lets go of the bottom levels of meshes that are gone.
    pub fn retain(&mut self, mut lives: impl FnMut(u64) -> bool) {
        self.bottom.retain(|(mesh, _), _| lives(*mesh));
    }

    /// This frame's top level and the last frame's.
    pub fn top_levels(&self) -> Option<[&Tlas; 2]> {
        let current = self.current.as_ref()?;
        Some([&current.tlas, &self.previous.as_ref().unwrap_or(current).tlas])
    }

    /// What stands for the roots of both in the shaders: `NONE` where there is nothing to meet.
    pub(crate) fn roots(&self) -> [u32; 2] {
        let root = |top: Option<&TopLevel>| if top.is_some_and(|top| top.count > 0) { 0 } else { NONE };
        [root(self.current.as_ref()), root(self.previous.as_ref().or(self.current.as_ref()))]
    }

    /// Bytes of the buffers of instances.  What the device makes of them wgpu does not tell.
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
        vertex_count: 3 * (instance.triangles.end - instance.triangles.start),
        index_format: None,
        index_count: None,
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
