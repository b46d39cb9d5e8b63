//! Random meshes, transforms and rays, and scenes of them in the buffers that the shaders read.

use crate::gpu::{Bound, Gpu, Kernel};
use bevy::render::{
    render_resource::Buffer,
    renderer::{RenderDevice, RenderQueue, WgpuWrapper},
};
use bevy_restir::{
    testing::gpu_layout::*,
    testing::{
        accel::blas::{Blas, Bounds, bake, bake_vertices, build_blas},
        accel::ray_query::{AccelerationStructures, Placed},
        accel::tlas::{build_tlas, inverse, world_bounds},
        geometry::triangulate::Geometry,
        geometry::world_tree::{Part, WorldTree},
    },
};
use bytemuck::{Pod, Zeroable};
use std::{collections::HashMap, sync::Arc};

/// A small random number generator (PCG-XSH-RR) whose numbers no update of a crate can change.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x853c_49e6_748f_ea9b);
        random.bits();
        random
    }

    pub fn bits(&mut self) -> u32 {
        let old = self.0;
        self.0 = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((((old >> 18) ^ old) >> 27) as u32).rotate_right((old >> 59) as u32)
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / 16_777_216.0
    }

    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    pub fn below(&mut self, n: usize) -> usize {
        self.bits() as usize % n
    }

    pub fn point(&mut self, size: f32) -> [f32; 3] {
        [self.range(-size, size), self.range(-size, size), self.range(-size, size)]
    }

    /// Uniform on the sphere.
    pub fn direction(&mut self) -> [f32; 3] {
        loop {
            let v = self.point(1.0);
            let square: f32 = v.iter().map(|x| x * x).sum();
            if square > 1e-3 && square <= 1.0 {
                return v.map(|x| x / square.sqrt());
            }
        }
    }
}

/// The layout of `Ray` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Ray {
    pub origin: [f32; 3],
    pub t_min: f32,
    pub direction: [f32; 3],
    pub t_max: f32,
}

/// The layout of `Answer` in `tests/support/kernels/trace.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TraceResult {
    pub t: f32,
    pub instance: u32,
    pub triangle: u32,
    pub any: u32,
    pub barycentrics: [f32; 2],
    pub flags: u32,
    pub rays: u32,
}

pub const FAR: f32 = 3.0e38;

pub fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    Ray { origin, t_min: 0.0, direction, t_max: FAR }
}

/// A vertex that has a position only.
pub fn bare_vertex(position: [f32; 3]) -> GpuVertex {
    GpuVertex { position, normal: NOT_GIVEN, tangent: NOT_GIVEN, ..Default::default() }
}

/// Triangles without attributes.  Corners with equal coordinates are one vertex.
pub fn soup(positions: Vec<[[f32; 3]; 3]>) -> Geometry {
    let mut geometry = Geometry::default();
    let mut places = HashMap::new();
    for corners in positions {
        let triangle = corners.map(|position| {
            *places.entry(position.map(f32::to_bits)).or_insert_with(|| {
                geometry.vertices.push(bare_vertex(position));
                geometry.vertices.len() as u32 - 1
            })
        });
        geometry.triangles.push(triangle);
    }
    geometry
}

pub fn random_soup(random: &mut Random, count: usize, size: f32, triangle: f32) -> Geometry {
    let one = |random: &mut Random| {
        let center = random.point(size);
        std::array::from_fn(|_| {
            let d = random.point(triangle);
            std::array::from_fn(|k| center[k] + d[k])
        })
    };
    soup((0..count).map(|_| one(random)).collect())
}

/// A closed sphere of `2 (rings - 1) segments` triangles with outward normals and optional bumps. Adjacent triangles share the exact
/// coordinates of their vertices.
pub fn sphere(rings: usize, segments: usize, bump: f32, place: impl Fn([f32; 3]) -> [f32; 3]) -> Geometry {
    let vertex = |i: usize, j: usize| {
        let theta = std::f64::consts::PI * i as f64 / rings as f64;
        let phi = 2.0 * std::f64::consts::PI * (j % segments) as f64 / segments as f64;
        if i == 0 || i == rings {
            return place([0.0, if i == 0 { 1.0 } else { -1.0 }, 0.0]);
        }
        let r = 1.0 + f64::from(bump) * (7.0 * theta).sin() * (5.0 * phi).sin();
        place([r * theta.sin() * phi.cos(), r * theta.cos(), r * theta.sin() * phi.sin()].map(|x| x as f32))
    };
    let mut triangles = Vec::new();
    for i in 0..rings {
        for j in 0..segments {
            let [a, b, c, d] = [vertex(i, j), vertex(i, j + 1), vertex(i + 1, j + 1), vertex(i + 1, j)];
            if i > 0 {
                triangles.push([a, b, c]);
            }
            if i + 1 < rings {
                triangles.push([a, c, d]);
            }
        }
    }
    soup(triangles)
}

/// A random affine transform: rotation, non-uniform and perhaps mirrored scale, shear, translation.
pub fn random_rows(random: &mut Random, scale: f32, translation: f32) -> Rows {
    let mut rows = [[0.0; 4]; 3];
    loop {
        for row in &mut rows {
            for x in &mut row[..3] {
                *x = random.range(-scale, scale);
            }
            row[3] = random.range(-translation, translation);
        }
        // Nearly singular transforms would test the precision of f32 instead of the traversal.
        if let Some(i) = inverse(&rows)
            && i.iter().all(|r| r[..3].iter().all(|x| x.abs() < 6.0 / scale))
        {
            return rows;
        }
    }
}

pub fn identity() -> Rows {
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
}

/// The buffers of group 0 that tracing rays needs.
#[derive(Default)]
pub struct TestScene {
    pub uniforms: GpuSceneUniforms,
    pub nodes: Vec<[u32; 4]>,
    pub triangles: Vec<GpuTriangle>,
    pub vertices: Vec<GpuVertex>,
    pub instances: Vec<GpuInstance>,
    pub materials: Vec<GpuMaterial>,
    /// Object-space boxes of the instances' meshes; `None` for empty meshes.
    pub boxes: Vec<Option<Bounds>>,
}

impl TestScene {
    /// Instances are tuples of mesh, transform, material and flags.
    pub fn new(meshes: &[Geometry], instances: &[(usize, Rows, u32, u32)]) -> Self {
        let blas: Vec<Option<Blas>> = meshes.iter().map(build_blas).collect();
        let mut scene = Self { materials: vec![GpuMaterial::default()], ..Default::default() };
        let mut places = Vec::new();
        for b in &blas {
            let (root, first) = (scene.nodes.len() as u32 / NODE_STRIDE, scene.triangles.len() as u32);
            places.push((root, first));
            if let Some(b) = b {
                let mut nodes = b.nodes.clone();
                bake(&mut nodes, root, first);
                scene.nodes.extend(nodes);
                let mut triangles = b.triangles.clone();
                bake_vertices(&mut triangles, scene.vertices.len() as u32);
                scene.triangles.extend(triangles);
                scene.vertices.extend(&b.vertices);
            }
        }
        for &(mesh, world, material, flags) in instances {
            let back = inverse(&world).expect("tests make sound transforms");
            scene.instances.push(GpuInstance {
                world_from_object: world,
                object_from_world: back,
                previous_world_from_object: world,
                blas_root: places[mesh].0,
                first_triangle: places[mesh].1,
                triangle_count: blas[mesh].as_ref().map_or(0, |b| b.triangles.len() as u32),
                material,
                flags,
                ..Default::default()
            });
            scene.boxes.push(blas[mesh].as_ref().map(|b| b.bounds));
        }
        scene.build_top_level();
        scene.uniforms.previous_tlas_root = scene.uniforms.tlas_root;
        scene.uniforms.previous_tlas_indices = scene.uniforms.tlas_indices;
        scene.uniforms.instance_count = scene.instances.len() as u32;
        scene
    }

    /// Corners of a triangle in object space.
    pub fn corners(&self, triangle: usize) -> [[f32; 3]; 3] {
        let GpuTriangle { a, b, c } = self.triangles[triangle];
        [a, b, c].map(|vertex| self.vertices[vertex as usize].position)
    }

    /// Corners of the triangles of an instance in object space.
    pub fn corners_of(&self, instance: &GpuInstance) -> Vec<[[f32; 3]; 3]> {
        let first = instance.first_triangle as usize;
        (first..first + instance.triangle_count as usize).map(|triangle| self.corners(triangle)).collect()
    }

    /// The same scene with one tree in world space over the instances for which `rests` holds.
    pub fn with_world_tree(mut self, rests: impl Fn(usize) -> bool) -> Self {
        let resting = self.instances.iter().enumerate().filter(|(i, _)| rests(*i));
        let part = |(i, instance): (usize, &GpuInstance)| Part {
            slot: i as u32,
            first_triangle: instance.first_triangle,
            world_from_object: instance.world_from_object,
            positions: self.corners_of(instance),
        };
        let parts: Vec<Part> = resting.map(part).collect();
        let Some(tree) = WorldTree::build(&parts) else { return self };
        self.nodes.resize(self.nodes.len().next_multiple_of(NODE_STRIDE as usize), [0; 4]);
        let root = self.nodes.len() as u32 / NODE_STRIDE;
        self.nodes.extend(tree.words(root));
        let placed = |i: usize| {
            let bounds = self.boxes[i]?;
            Some(world_bounds(&self.instances[i].world_from_object, &bounds).expect("tests make finite boxes"))
        };
        let single = (0..self.instances.len()).filter(|i| !rests(*i));
        let mut entries: Vec<_> = single.filter_map(|i| Some((i as u32, placed(i)?))).collect();
        let union = |a: Bounds, b: Bounds| -> Bounds {
            (std::array::from_fn(|k| a.0[k].min(b.0[k])), std::array::from_fn(|k| a.1[k].max(b.1[k])))
        };
        let bounds = (0..self.instances.len()).filter(|i| rests(*i)).filter_map(placed).reduce(union);
        entries.extend(bounds.map(|bounds| (WORLD_TREE | root, bounds)));
        self.write_top_level(&entries);
        self.uniforms.previous_tlas_root = self.uniforms.tlas_root;
        self.uniforms.previous_tlas_indices = self.uniforms.tlas_indices;
        self
    }

    fn build_top_level(&mut self) {
        let placed = self.instances.iter().zip(&self.boxes).enumerate();
        let boxes: Vec<_> = placed
            .filter_map(|(i, (instance, bounds))| {
                let world = &instance.world_from_object;
                Some((i as u32, world_bounds(world, &(*bounds)?).expect("tests make finite boxes")))
            })
            .collect();
        self.write_top_level(&boxes);
    }

    fn write_top_level(&mut self, entries: &[(u32, Bounds)]) {
        let mut tlas = build_tlas(entries);
        self.uniforms.tlas_root = NONE;
        if !tlas.nodes.is_empty() {
            self.nodes.resize(self.nodes.len().next_multiple_of(NODE_STRIDE as usize), [0; 4]);
            let root = self.nodes.len() as u32 / NODE_STRIDE;
            bake(&mut tlas.nodes, root, 0);
            self.nodes.extend(tlas.nodes);
            self.uniforms.tlas_root = root;
            self.uniforms.tlas_indices = self.nodes.len() as u32;
            self.nodes.extend(tlas.indices);
        }
    }

    /// Goes on to the next frame with new transforms of all instances.
    pub fn move_to(&mut self, mut place: impl FnMut() -> Rows) {
        for instance in &mut self.instances {
            instance.previous_world_from_object = instance.world_from_object;
            instance.world_from_object = place();
            instance.object_from_world = inverse(&instance.world_from_object).expect("tests make sound transforms");
        }
        self.uniforms.previous_tlas_root = self.uniforms.tlas_root;
        self.uniforms.previous_tlas_indices = self.uniforms.tlas_indices;
        self.build_top_level();
    }

    /// Triangles and vertices in buffers from which the device builds its acceleration structures.
    pub fn inputs_of_structures(&self, device: &RenderDevice) -> [Buffer; 2] {
        let buffer = |contents| {
            let usage = wgpu::BufferUsages::BLAS_INPUT;
            device.create_buffer_with_data(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
        };
        let (triangles, vertices) = (or_one(&self.triangles), or_one(&self.vertices));
        [buffer(bytemuck::cast_slice(&triangles)), buffer(bytemuck::cast_slice(&vertices))]
    }

    /// The device's acceleration structures over the same triangles and instances, of the last frame and of this one.
    pub fn structures(&self, gpu: &Gpu) -> AccelerationStructures {
        let device = RenderDevice::new(WgpuWrapper::new(gpu.device.clone()));
        let queue = RenderQueue(Arc::new(WgpuWrapper::new(gpu.queue.clone())));
        let [triangles, vertices] = self.inputs_of_structures(&device);
        let mut structures = AccelerationStructures::default();
        let previous = |instance: &GpuInstance| instance.previous_world_from_object;
        for place in [previous, |instance: &GpuInstance| instance.world_from_object] {
            let placed = self.instances.iter().enumerate().filter(|(_, instance)| instance.triangle_count > 0);
            let placed: Vec<Placed> = placed
                .map(|(slot, instance)| Placed {
                    slot: slot as u32,
                    version: u64::from(instance.first_triangle),
                    rebuild: false,
                    triangles: instance.first_triangle..instance.first_triangle + instance.triangle_count,
                    vertices_end: self.vertices.len() as u32,
                    world_from_object: place(instance),
                    opaque: instance.flags & INSTANCE_ALPHA == 0,
                    mask: 0xff,
                })
                .collect();
            structures.update(&placed, [&triangles, &vertices], &device, &queue);
        }
        structures
    }

    /// A scene of one mesh without a transform.
    pub fn of(mesh: Geometry) -> Self {
        Self::new(&[mesh], &[(0, identity(), 0, 0)])
    }

    /// Runs a kernel with one invocation per input.
    pub fn run<I: bytemuck::NoUninit, O: Pod>(&self, gpu: &Gpu, kernel: &Kernel, inputs: &[I]) -> Vec<O> {
        let structures = kernel.uses(3).then(|| self.structures(gpu));
        let uploaded = self.upload(gpu, structures, inputs, inputs.len() * size_of::<O>());
        uploaded.run(kernel);
        gpu.read(&uploaded.output)
    }

    /// Uploads the scene and the inputs of a kernel, and makes a buffer for `answers` bytes of results.
    pub fn upload<I: bytemuck::NoUninit>(
        &self,
        gpu: &Gpu,
        structures: Option<AccelerationStructures>,
        inputs: &[I],
        answers: usize,
    ) -> Uploaded {
        Uploaded {
            uniforms: gpu.uniform(&self.uniforms),
            nodes: gpu.storage(&or_one(&self.nodes)),
            triangles: gpu.storage(&or_one(&self.triangles)),
            vertices: gpu.storage(&or_one(&self.vertices)),
            instances: gpu.storage(&or_one(&self.instances)),
            materials: gpu.storage(&or_one(&self.materials)),
            input: gpu.storage(inputs),
            output: gpu.zeroed::<u8>(answers),
            structures,
            count: inputs.len() as u32,
        }
    }
}

/// A scene on the GPU with the input and the output of a kernel.
pub struct Uploaded {
    uniforms: wgpu::Buffer,
    nodes: wgpu::Buffer,
    triangles: wgpu::Buffer,
    vertices: wgpu::Buffer,
    instances: wgpu::Buffer,
    materials: wgpu::Buffer,
    input: wgpu::Buffer,
    pub output: wgpu::Buffer,
    pub structures: Option<AccelerationStructures>,
    count: u32,
}

impl Uploaded {
    /// Dispatches one invocation per input.
    pub fn run(&self, kernel: &Kernel) {
        let mut bound = vec![
            (0, 0, Bound::Buffer(&self.uniforms)),
            (0, 1, Bound::Buffer(&self.nodes)),
            (0, 2, Bound::Buffer(&self.triangles)),
            (0, 3, Bound::Buffer(&self.vertices)),
            (0, 4, Bound::Buffer(&self.instances)),
            (0, 5, Bound::Buffer(&self.materials)),
            (1, 0, Bound::Buffer(&self.input)),
            (1, 1, Bound::Buffer(&self.output)),
        ];
        if let Some([current, previous]) = self.structures.as_ref().and_then(AccelerationStructures::top_levels) {
            bound.extend([(3, 0, Bound::TopLevel(current)), (3, 1, Bound::TopLevel(previous))]);
        }
        kernel.run([self.count.div_ceil(64), 1, 1], &bound);
    }
}

// A buffer may not be empty.
fn or_one<T: Clone + Zeroable>(v: &[T]) -> Vec<T> {
    if v.is_empty() { vec![T::zeroed()] } else { v.to_vec() }
}
