//! Reads the top levels back from the GPU, for tests.

use bevy::{
    app::App,
    render::{
        RenderApp,
        render_resource::{BufferDescriptor, BufferUsages, CommandEncoderDescriptor, MapMode, PollType},
        renderer::{RenderDevice, RenderQueue},
    },
};

use crate::gpu_layout::NODE_STRIDE;
use crate::scene::geometry::{gpu_tlas::GpuTlas, instances::InstancePool, meshes::MeshPool};

const STRIDE: usize = NODE_STRIDE as usize;

/// Nodes and instances of top levels.  Indices of nodes count from the root.
#[derive(Debug, PartialEq)]
pub struct TopLevels {
    /// That of this frame on the GPU.
    pub current: Vec<[u32; 4]>,
    /// That of the last frame on the GPU.
    pub previous: Vec<[u32; 4]>,
    /// That of this frame on the CPU.
    pub expected: Vec<[u32; 4]>,
}

/// The top levels of an app; `None` where the plugin is off.
pub fn read_top_levels(app: &App) -> Option<TopLevels> {
    let world = app.get_sub_app(RenderApp)?.world();
    let top = &world.get_resource::<InstancePool>()?.top;
    let meshes = world.get_resource::<MeshPool>()?;
    let (device, queue) = (world.get_resource::<RenderDevice>()?, world.get_resource::<RenderQueue>()?);
    let mut expected: Vec<[u32; 4]> = top.tree.nodes.iter().chain(&top.tree.indices).copied().collect();
    expected.resize(expected.len().next_multiple_of(STRIDE), [0; 4]);
    let [current, previous] = top.gpu.both().map(|tree| read(tree, meshes, device, queue));
    Some(TopLevels { current: current?, previous: previous?, expected })
}

fn read(tree: &GpuTlas, meshes: &MeshPool, device: &RenderDevice, queue: &RenderQueue) -> Option<Vec<[u32; 4]>> {
    let buffer = meshes.nodes.buffer()?;
    let bytes = |nodes: u32| u64::from(nodes * NODE_STRIDE) * size_of::<[u32; 4]>() as u64;
    let size = bytes(tree.range.end - tree.range.start);
    let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
    let staging = device.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: None });
    encoder.copy_buffer_to_buffer(buffer, bytes(tree.range.start), &staging, 0, size);
    queue.submit([encoder.finish()]);
    staging.slice(..).map_async(MapMode::Read, |result| result.expect("the staging buffer maps"));
    device.poll(PollType::wait_indefinitely()).expect("the device answers");
    let mut words: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(&staging.slice(..).get_mapped_range());
    let nodes = tree.indices() as usize - tree.range.start as usize * STRIDE;
    words[..nodes].chunks_exact_mut(STRIDE).for_each(|node| node[1][0] -= tree.range.start);
    Some(words)
}
