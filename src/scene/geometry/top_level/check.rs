//! Checks the top levels against the instances, on the CPU and on the GPU, for tests.

use bevy::{
    app::App,
    render::{
        RenderApp,
        render_resource::{BufferDescriptor, BufferUsages, CommandEncoderDescriptor, MapMode, PollType},
        renderer::{RenderDevice, RenderQueue},
    },
};

use super::TopLevel;
use crate::gpu_layout::{NODE_STRIDE, NONE};
use crate::scene::{
    accel::{
        blas::Bounds,
        reached::Reached,
        wide_node::{Node, STRIDE},
    },
    geometry::{gpu_tlas::GpuTlas, instances::InstancePool, meshes::MeshPool},
};

/// What rays reach in the top levels.
#[derive(Debug)]
pub struct TopLevels {
    /// In that of this frame on the GPU.
    pub current: Reached,
    /// In that of the last frame on the GPU.
    pub previous: Reached,
    /// In that of this frame on the CPU.
    pub expected: Reached,
    /// The entries that rays must reach, with their bounds: slots of instances, and the tree over those that rest.
    pub traced: Vec<(u32, Bounds)>,
    /// Number of instances in the small tree over newcomers.
    pub newcomers: usize,
    /// Bytes of the top level that this frame has sent.
    pub sent_bytes: u64,
}

impl TopLevel {
    /// Panics unless rays reach each instance that they can hit in one way only, and nothing else.  With ray queries it does nothing.
    pub(crate) fn check(&self, instances: &InstancePool) {
        if self.structures.is_none() {
            self.trees.joined().reached(0).assert_holds(&self.traced(instances));
        }
    }

    fn traced(&self, instances: &InstancePool) -> Vec<(u32, Bounds)> {
        let single = instances.live().filter(|(slot, _)| !self.resting.contains(*slot));
        single.filter_map(|(slot, live)| Some((slot, live.traced_bounds()?))).chain(self.resting.entry()).collect()
    }
}

/// The top levels of an app; `None` where the plugin is off.
pub fn read_top_levels(app: &App) -> Option<TopLevels> {
    let world = app.get_sub_app(RenderApp)?.world();
    let instances = world.get_resource::<InstancePool>()?;
    let meshes = world.get_resource::<MeshPool>()?;
    let (device, queue) = (world.get_resource::<RenderDevice>()?, world.get_resource::<RenderQueue>()?);
    let top = &instances.top;
    let [current, previous] = top.gpu.both();
    Some(TopLevels {
        expected: top.trees.joined().reached(current.range.start),
        current: read(current, meshes, device, queue)?,
        previous: read(previous, meshes, device, queue)?,
        traced: top.traced(instances),
        newcomers: top.trees.newcomers(),
        sent_bytes: top.uploaded_nodes,
    })
}

fn read(tree: &GpuTlas, meshes: &MeshPool, device: &RenderDevice, queue: &RenderQueue) -> Option<Reached> {
    if tree.root() == NONE {
        return Some(Reached::default());
    }
    let buffer = meshes.nodes.buffer()?;
    let bytes = |nodes: u32| u64::from(nodes * NODE_STRIDE) * size_of::<[u32; 4]>() as u64;
    let (start, size) = (tree.range.start, bytes(tree.range.end - tree.range.start));
    let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
    let staging = device.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: None });
    encoder.copy_buffer_to_buffer(buffer, bytes(start), &staging, 0, size);
    queue.submit([encoder.finish()]);
    staging.slice(..).map_async(MapMode::Read, |result| result.expect("the staging buffer maps"));
    device.poll(PollType::wait_indefinitely()).expect("the device answers");
    let words: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(&staging.slice(..).get_mapped_range());
    let node_at = |index: u32| -> Node { core::array::from_fn(|i| words[(index - start) as usize * STRIDE + i]) };
    let first = tree.indices() as usize - start as usize * STRIDE;
    Some(Reached::new(Some(tree.root()), node_at, |place| words[first + place / 4][place % 4]))
}
