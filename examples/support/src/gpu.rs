//! Runs small compute kernels that import the crate's own WGSL, on any adapter.

use crate::compose::{self, Def};
use bevy_restir::testing::shader_library::ShaderEdit;
use std::{
    collections::{HashMap, HashSet},
    sync::{Mutex, OnceLock, PoisonError},
};
use wgpu::util::DeviceExt;

/// A device and its queue.
pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub name: String,
    pub is_cpu: bool,
    /// Compiled kernels by everything that they depend on.
    kernels: Mutex<HashMap<String, Compiled>>,
}

/// A pipeline, and the (group, binding) pairs that it uses.
type Compiled = (wgpu::ComputePipeline, HashSet<(u32, u32)>);

/// The adapter of this machine. Without one it prints that the test is skipped; under `CI=true` it panics.
pub fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    let gpu = GPU.get_or_init(|| pollster::block_on(open(wgpu::Features::empty()))).as_ref();
    if gpu.is_none() {
        assert!(std::env::var("CI").is_err(), "no GPU adapter, and CI needs one");
        eprintln!("skipped: no GPU adapter");
    }
    gpu
}

/// The adapter of this machine with ray queries. Without them it prints that the test is skipped; under `RAY_QUERIES=required` it panics.
pub fn ray_gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    let gpu = GPU.get_or_init(|| pollster::block_on(open(wgpu::Features::EXPERIMENTAL_RAY_QUERY))).as_ref();
    if gpu.is_none() {
        assert!(std::env::var("RAY_QUERIES").is_err(), "the adapter has no ray queries, and they are required");
        eprintln!("skipped for the hardware back end: the adapter has no ray queries");
    }
    gpu
}

/// A device for each ray back end, with the shader definitions that select the back end.
pub fn back_ends() -> Vec<(&'static Gpu, Vec<Def>)> {
    let software = gpu().map(|gpu| (gpu, vec![]));
    let hardware = software.as_ref().and_then(|_| ray_gpu()).map(|gpu| (gpu, vec![compose::flag("RAY_QUERY")]));
    software.into_iter().chain(hardware).collect()
}

async fn open(features: wgpu::Features) -> Option<Gpu> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    // As Bevy does.
    let options =
        wgpu::RequestAdapterOptions { power_preference: wgpu::PowerPreference::HighPerformance, ..Default::default() };
    let adapter = instance.request_adapter(&options).await.ok()?;
    if !adapter.features().contains(features) {
        return None;
    }
    // The portable tier: the limits that WebGPU guarantees.
    let mut limits = wgpu::Limits::default();
    let mut experimental = wgpu::ExperimentalFeatures::disabled();
    if !features.is_empty() {
        limits = limits.using_acceleration_structure_values(adapter.limits());
        // SAFETY: shaders stay within what the feature's documentation allows.
        experimental = unsafe { wgpu::ExperimentalFeatures::enabled() };
    }
    let (device, queue) = adapter
        .request_device(&wgpu::DeviceDescriptor {
            required_features: features,
            required_limits: limits,
            experimental_features: experimental,
            ..Default::default()
        })
        .await
        .expect("the adapter offers WebGPU's limits");
    let info = adapter.get_info();
    let is_cpu = info.device_type == wgpu::DeviceType::Cpu;
    Some(Gpu::new(device, queue, info.name, is_cpu))
}

/// A resource that a kernel binds.
pub enum Bound<'a> {
    Buffer(&'a wgpu::Buffer),
    Texture(&'a wgpu::TextureView),
    TopLevel(&'a wgpu::Tlas),
}

/// A compiled kernel: entry point `main`.
pub struct Kernel<'g> {
    gpu: &'g Gpu,
    pipeline: wgpu::ComputePipeline,
    used: HashSet<(u32, u32)>,
}

impl Gpu {
    /// A device that exists already.
    pub fn new(device: wgpu::Device, queue: wgpu::Queue, name: String, is_cpu: bool) -> Self {
        Self { device, queue, name, is_cpu, kernels: Mutex::default() }
    }

    /// Composes and compiles a kernel.
    pub fn kernel(&self, name: &str, source: &str, defs: &[Def]) -> Kernel<'_> {
        self.kernel_with(name, source, defs, &[])
    }

    /// Composes and compiles a kernel with a library in which passages are replaced.  Equal kernels are compiled once.
    pub fn kernel_with(&self, name: &str, source: &str, defs: &[Def], edits: &[ShaderEdit]) -> Kernel<'_> {
        let key = format!("{name} {defs:?} {edits:?} {source}");
        let known = || self.kernels.lock().unwrap_or_else(PoisonError::into_inner);
        let compiled = known().get(&key).cloned();
        let (pipeline, used) = compiled.unwrap_or_else(|| {
            let compiled = self.compile(name, source, defs, edits);
            known().insert(key, compiled.clone());
            compiled
        });
        Kernel { gpu: self, pipeline, used }
    }

    fn compile(&self, name: &str, source: &str, defs: &[Def], edits: &[ShaderEdit]) -> Compiled {
        let module = compose::compose(&mut compose::composer_with(edits), name, source, defs);
        // The derived layout contains only the bindings that the entry point uses.
        let info = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), compose::CAPABILITIES)
            .validate(&module)
            .unwrap_or_else(|e| panic!("{name}: {e:?}"));
        let reached = info.get_entry_point(0);
        let used = module
            .global_variables
            .iter()
            .filter(|(handle, _)| !reached[*handle].is_empty())
            .filter_map(|(_, v)| v.binding.as_ref().map(|b| (b.group, b.binding)))
            .collect();
        let descriptor = wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(module)),
        };
        // Without checks of bounds, as Bevy compiles shaders.
        // SAFETY: the kernels stay within their buffers.
        let shader =
            unsafe { self.device.create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked()) };
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: None,
            module: &shader,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        (pipeline, used)
    }

    /// A storage buffer that can be read back.
    pub fn storage<T: bytemuck::NoUninit>(&self, data: &[T]) -> wgpu::Buffer {
        self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(data),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
        })
    }

    /// A storage buffer of `count` zeroed `T`.
    pub fn zeroed<T: bytemuck::NoUninit + bytemuck::Zeroable>(&self, count: usize) -> wgpu::Buffer {
        self.storage(&vec![T::zeroed(); count])
    }

    /// A uniform buffer.
    pub fn uniform<T: bytemuck::NoUninit>(&self, data: &T) -> wgpu::Buffer {
        self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: bytemuck::bytes_of(data),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        })
    }

    /// Waits for the device and copies a buffer back.
    pub fn read<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer) -> Vec<T> {
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: buffer.size(),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
        self.queue.submit([encoder.finish()]);
        staging.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("the staging buffer maps"));
        self.device.poll(wgpu::PollType::wait_indefinitely()).expect("the device answers");
        let bytes = staging.slice(..).get_mapped_range();
        bytemuck::pod_collect_to_vec(&bytes)
    }
}

/// Converts a vector of a kernel to doubles.
pub fn wide(v: [f32; 3]) -> bevy::math::DVec3 {
    bevy::math::DVec3::from(v.map(f64::from))
}

impl Kernel<'_> {
    /// Whether the kernel binds anything in a group.
    pub fn uses(&self, group: u32) -> bool {
        self.used.iter().any(|used| used.0 == group)
    }

    /// Dispatches once. Resources that the kernel does not use after composition are skipped.
    pub fn run(&self, workgroups: [u32; 3], bound: &[(u32, u32, Bound)]) {
        let groups: HashSet<u32> = self.used.iter().map(|u| u.0).collect();
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        {
            let bind_groups: Vec<_> = groups
                .iter()
                .map(|&group| {
                    let entries: Vec<_> = bound
                        .iter()
                        .filter(|(g, b, _)| *g == group && self.used.contains(&(*g, *b)))
                        .map(|(_, binding, resource)| wgpu::BindGroupEntry {
                            binding: *binding,
                            resource: match resource {
                                Bound::Buffer(buffer) => buffer.as_entire_binding(),
                                Bound::Texture(view) => wgpu::BindingResource::TextureView(view),
                                Bound::TopLevel(tlas) => tlas.as_binding(),
                            },
                        })
                        .collect();
                    let layout = self.pipeline.get_bind_group_layout(group);
                    let bind_group = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                        label: None,
                        layout: &layout,
                        entries: &entries,
                    });
                    (group, bind_group)
                })
                .collect();
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            for (group, bind_group) in &bind_groups {
                pass.set_bind_group(*group, bind_group, &[]);
            }
            pass.dispatch_workgroups(workgroups[0], workgroups[1], workgroups[2]);
        }
        self.gpu.queue.submit([encoder.finish()]);
    }
}
