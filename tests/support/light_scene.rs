//! A scene of lights and an environment in GPU buffers, for kernels that sample them.

use super::{
    compose::Def,
    gpu::{Bound, Gpu},
    oracle::environment::Map,
    scenes::bare_vertex,
};
use bevy_restir::{
    testing::gpu_layout::{
        GpuInstance, GpuLight, GpuMaterial, GpuSceneUniforms, GpuTriangle, GpuVertex, GpuViewUniforms, LIGHT_MESH,
        NONE, Rows,
    },
    testing::light::alias_table::alias_table,
};
use glam::DMat3;

/// A direction of the environment, as the kernel reads and writes it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub struct EnvironmentSample {
    pub direction: [f32; 3],
    pub pdf: f32,
    pub radiance: [f32; 3],
    pub pdf_again: f32,
}

/// The content of bind groups 0 and 1 as far as lights need it.
pub struct LightScene<'g> {
    pub gpu: &'g Gpu,
    pub scene: GpuSceneUniforms,
    pub view: GpuViewUniforms,
    /// Nodes of the trees over lights.
    pub nodes: Vec<[u32; 4]>,
    pub triangles: Vec<GpuTriangle>,
    pub vertices: Vec<GpuVertex>,
    pub instances: Vec<GpuInstance>,
    pub materials: Vec<GpuMaterial>,
    pub lights: Vec<GpuLight>,
    /// One page of the atlas, 4x4.
    pub atlas: [[u8; 4]; 16],
    /// Records of textures, and second texture coordinates: at most one row each.
    pub table: Vec<[u32; 4]>,
    pub second_uvs: Vec<[[f32; 2]; 3]>,
    map: wgpu::TextureView,
    importance: wgpu::TextureView,
}

pub const IDENTITY: Rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

pub fn texture(gpu: &Gpu, format: wgpu::TextureFormat, levels: &[(u32, u32, &[u8])]) -> wgpu::Texture {
    let size = |w, h| wgpu::Extent3d { width: w, height: h, depth_or_array_layers: 1 };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: size(levels[0].0, levels[0].1),
        mip_level_count: levels.len() as u32,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    for (level, &(w, h, bytes)) in levels.iter().enumerate() {
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo { mip_level: level as u32, ..texture.as_image_copy() },
            bytes,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(bytes.len() as u32 / h),
                rows_per_image: None,
            },
            size(w, h),
        );
    }
    texture
}

fn array_view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

impl<'g> LightScene<'g> {
    /// A scene without lights, in a white environment without a map.
    pub fn new(gpu: &'g Gpu) -> Self {
        let dark = texture(gpu, wgpu::TextureFormat::R32Float, &[(1, 1, &[0; 4])]);
        let mut lit = Self {
            gpu,
            scene: GpuSceneUniforms { radius: 1.0, shapes_root: NONE, environment_limit: 0.8, ..Default::default() },
            view: GpuViewUniforms { environment_color: [1.0; 3], ..Default::default() },
            nodes: Vec::new(),
            triangles: Vec::new(),
            vertices: Vec::new(),
            instances: Vec::new(),
            materials: Vec::new(),
            lights: Vec::new(),
            atlas: [[255; 4]; 16],
            table: Vec::new(),
            second_uvs: Vec::new(),
            map: array_view(&dark),
            importance: dark.create_view(&Default::default()),
        };
        lit.rotate(DMat3::IDENTITY);
        lit
    }

    /// Sets the rotation from world space to the environment.
    pub fn rotate(&mut self, rotation: DMat3) {
        self.view.environment_rotation =
            [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|c| c.extend(0.0).as_vec4().to_array());
    }

    /// Sets the map and an importance table of the given size.  The crate's own kernel computes level 0, which is returned.
    pub fn set_map(&mut self, map: &Map, width: u32, height: u32) -> Vec<f32> {
        let texels: Vec<[f32; 4]> = map.texels.iter().map(|c| c.as_vec3().extend(1.0).to_array()).collect();
        let level = (map.width as u32, map.height as u32, bytemuck::cast_slice(&texels));
        self.map = array_view(&texture(self.gpu, wgpu::TextureFormat::Rgba32Float, &[level]));
        self.set_table(&["ENVIRONMENT", "ENVIRONMENT_MAP"], width, height)
    }

    /// Sets a cube map with faces of `side` texels, one after the other, and a table as [`Self::set_map`] does.
    pub fn set_cube(&mut self, side: u32, texels: &[[f32; 4]], width: u32, height: u32) -> Vec<f32> {
        // The faces of a cube are stored like one texture of six times the height.
        let size = wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 6 };
        let cube = self.gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(16 * side), rows_per_image: Some(side) };
        self.gpu.queue.write_texture(cube.as_image_copy(), bytemuck::cast_slice(texels), layout, size);
        self.map = array_view(&cube);
        self.set_table(&["ENVIRONMENT", "ENVIRONMENT_MAP", "ENVIRONMENT_CUBE"], width, height)
    }

    fn set_table(&mut self, defs: &[&'static str], width: u32, height: u32) -> Vec<f32> {
        let source = include_str!("kernels/environment_importance.wgsl");
        let defs: Vec<Def> = defs.iter().map(|def| super::compose::flag(def)).collect();
        let size = self.gpu.storage(&[width, height]);
        let cells = self.gpu.zeroed::<f32>((width * height) as usize);
        let bound = [(2, 0, Bound::Buffer(&size)), (2, 1, Bound::Buffer(&cells))];
        self.run("environment_importance", source, &defs, width * height, &bound);
        let first: Vec<f32> = self.gpu.read(&cells);

        // The coarser levels are sums of 2x2 cells.
        let mut chain = vec![(width, height, first.clone())];
        while let Some((w, h, above)) = chain.last().filter(|l| l.0 * l.1 > 1) {
            let (half_w, half_h) = ((w / 2).max(1), (h / 2).max(1));
            let mut next = vec![0.0f32; (half_w * half_h) as usize];
            for y in 0..*h {
                for x in 0..*w {
                    let cell = (x * half_w / w + y * half_h / h * half_w) as usize;
                    next[cell] += above[(x + y * w) as usize];
                }
            }
            chain.push((half_w, half_h, next));
        }
        let levels: Vec<_> = chain.iter().map(|(w, h, v)| (*w, *h, bytemuck::cast_slice(v))).collect();
        self.importance = texture(self.gpu, wgpu::TextureFormat::R32Float, &levels).create_view(&Default::default());
        first
    }

    /// Sets the alias table of the lights and the counts of the scene from these powers.  Each light is a bin.
    pub fn set_powers(&mut self, powers: &[f64]) {
        self.set_choice(0, powers);
        self.scene.lights_end = self.scene.light_bins;
    }

    /// Sets the alias table of the bins, which begin at this record.
    fn set_choice(&mut self, first_bin: usize, powers: &[f64]) {
        let total: f64 = powers.iter().filter(|p| p.is_finite() && **p > 0.0).sum();
        self.scene.light_power = total as f32;
        (self.scene.first_bin, self.scene.first_mesh_bin) = (first_bin as u32, first_bin as u32);
        self.scene.light_bins = 0;
        if let Some(table) = alias_table(powers) {
            self.scene.light_bins = powers.len() as u32;
            for (light, entry) in self.lights[first_bin..].iter_mut().zip(table) {
                light.pmf = entry.pmf;
                light.alias_probability = entry.probability;
                light.alias_index = entry.alias;
            }
        }
        (self.scene.previous_first_bin, self.scene.previous_light_bins) = (first_bin as u32, self.scene.light_bins);
    }

    /// Sets a table of bins with these powers: those of a single light, or of the triangles of a mesh.  Half of the meshes lie before the bins,
    /// the others behind them, and there are unused records between them.
    pub fn set_bins(&mut self, bins: &[Vec<f64>]) {
        const GAP: usize = 3;
        let mut end = 0;
        let mut take = |count: usize| {
            let first = end + GAP;
            end = first + count;
            first
        };
        let meshes: Vec<usize> = (0..bins.len()).filter(|bin| bins[*bin].len() > 1).collect();
        let (before, behind) = meshes.split_at(meshes.len() / 2);
        let mut headers: Vec<usize> = before.iter().map(|bin| take(1 + bins[*bin].len())).collect();
        let first_bin = take(bins.len());
        headers.extend(behind.iter().map(|bin| take(1 + bins[*bin].len())));
        self.lights = vec![GpuLight::default(); end];
        for (bin, header) in meshes.into_iter().zip(headers) {
            let powers = &bins[bin];
            let data = [header as u32 + 1, powers.len() as u32];
            self.lights[first_bin + bin] = GpuLight { kind: LIGHT_MESH, data, ..Default::default() };
            self.lights[header].data[0] = bin as u32;
            let table = alias_table(powers).unwrap_or_else(|| vec![Default::default(); powers.len()]);
            for (light, entry) in self.lights[header + 1..].iter_mut().zip(table) {
                *light = GpuLight {
                    pmf: entry.pmf,
                    alias_probability: entry.probability,
                    alias_index: entry.alias,
                    link: header as u32,
                    ..Default::default()
                };
            }
        }
        let usable = |powers: &Vec<f64>| powers.iter().filter(|p| p.is_finite() && **p > 0.0).sum();
        self.set_choice(first_bin, &bins.iter().map(usable).collect::<Vec<f64>>());
        self.scene.lights_end = self.lights.len() as u32;
    }

    /// The bins of [`Self::set_bins`].
    pub fn bins(&self) -> &[GpuLight] {
        &self.lights[self.scene.first_bin as usize..][..self.scene.light_bins as usize]
    }

    /// Id of the first light of a bin of [`Self::set_bins`].
    pub fn first_light(&self, bin: usize) -> usize {
        match self.bins()[bin] {
            GpuLight { kind: LIGHT_MESH, data, .. } => data[0] as usize,
            _ => self.scene.first_bin as usize + bin,
        }
    }

    /// Samples the environment where an element of `samples` is zero, and evaluates the direction of the others.
    pub fn sample_environment(&self, seed: u32, samples: &[EnvironmentSample], defs: &[Def]) -> Vec<EnvironmentSample> {
        let seed = self.gpu.storage(&[seed]);
        let buffer = self.gpu.storage(samples);
        let bound = [(2, 0, Bound::Buffer(&seed)), (2, 1, Bound::Buffer(&buffer))];
        self.run("environment", include_str!("kernels/environment.wgsl"), defs, samples.len() as u32, &bound);
        self.gpu.read(&buffer)
    }

    /// Makes these the corners of the only triangle, whose texture coordinates are its barycentric coordinates.
    pub fn set_triangle(&mut self, corners: [[f32; 3]; 3]) {
        let uvs = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let vertices = corners.into_iter().zip(uvs);
        self.vertices = vertices.map(|(position, uv)| GpuVertex { uv, ..bare_vertex(position) }).collect();
        self.triangles = vec![GpuTriangle { a: 0, b: 1, c: 2 }];
    }

    /// Runs a kernel with workgroups of 64.
    pub fn run(&self, name: &str, source: &str, defs: &[Def], threads: u32, own: &[(u32, u32, Bound)]) {
        fn some<T: Clone + bytemuck::Zeroable>(v: &[T]) -> Vec<T> {
            if v.is_empty() { vec![T::zeroed()] } else { v.to_vec() }
        }
        let gpu = self.gpu;
        let scene = gpu.uniform(&self.scene);
        let view = gpu.uniform(&self.view);
        let nodes = gpu.storage(&some(&self.nodes));
        let triangles = gpu.storage(&some(&self.triangles));
        let vertices = gpu.storage(&some(&self.vertices));
        let instances = gpu.storage(&some(&self.instances));
        let materials = gpu.storage(&some(&self.materials));
        let lights = gpu.storage(&some(&self.lights));
        let page = (4, 4, bytemuck::cast_slice(&self.atlas));
        let atlas = texture(gpu, wgpu::TextureFormat::Rgba8Unorm, &[page]).create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        // One row of each array.
        let mut table = self.table.clone();
        table.resize(1024, [0; 4]);
        let table = texture(gpu, wgpu::TextureFormat::Rgba32Uint, &[(1024, 1, bytemuck::cast_slice(&table))]);
        let mut uvs = self.second_uvs.clone();
        uvs.resize(1024, [[0.0; 2]; 3]);
        let uvs = texture(gpu, wgpu::TextureFormat::Rg32Float, &[(3 * 1024, 1, bytemuck::cast_slice(&uvs))]);
        let [table, uvs] = [table, uvs].map(|t| t.create_view(&Default::default()));
        let mut bound = vec![
            (0, 0, Bound::Buffer(&scene)),
            (0, 1, Bound::Buffer(&nodes)),
            (0, 2, Bound::Buffer(&triangles)),
            (0, 3, Bound::Buffer(&vertices)),
            (0, 4, Bound::Buffer(&instances)),
            (0, 5, Bound::Buffer(&materials)),
            (0, 6, Bound::Buffer(&lights)),
            (0, 7, Bound::Texture(&atlas)),
            (0, 9, Bound::Texture(&table)),
            (0, 10, Bound::Texture(&uvs)),
            (1, 0, Bound::Buffer(&view)),
            (1, 2, Bound::Texture(&self.map)),
            (1, 3, Bound::Texture(&self.importance)),
        ];
        bound.extend(own.iter().map(|(g, b, what)| {
            let what = match what {
                Bound::Buffer(b) => Bound::Buffer(b),
                Bound::Texture(t) => Bound::Texture(t),
                Bound::TopLevel(t) => Bound::TopLevel(t),
            };
            (*g, *b, what)
        }));
        gpu.kernel(name, source, defs).run([threads.div_ceil(64), 1, 1], &bound);
    }
}
