//! Makes the draw calls of the visibility pass.  Instances in adjacent slots share a call if mesh, culling mode and cameras are the same.

use bevy::render::render_resource::Face;
use std::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{
    geometry::{instance_record::LiveInstance, instances::InstancePool},
    material::materials::MaterialPool,
};

/// A draw call.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Draw {
    pub instances: Range<u32>,
    /// Number of triangles of each instance.
    pub triangles: u32,
    /// Bits of the cameras that see the instances.
    pub camera_mask: u32,
    pub cull: Option<Face>,
}

/// How an instance is drawn: its culling mode, the cameras that see it, its first triangle, its number of triangles and its slot.
type Key = (u32, u32, u32, u32, u32);

/// The draw calls for all instances, sorted by culling mode so that the pass changes pipelines rarely.
#[derive(Default)]
pub(crate) struct DrawList {
    /// Sorted.
    keys: Vec<Key>,
    pub draws: Vec<Draw>,
}

impl DrawList {
    /// Brings the list up to date.
    pub(crate) fn update(&mut self, instances: &InstancePool, materials: &MaterialPool) {
        let key_of = |slot: u32, live: &LiveInstance| {
            let instance = instances.get(slot);
            let flags = materials.get(live.material).map_or(0, |m| m.flags);
            let cull = flags & (MATERIAL_CULL_BACK | MATERIAL_CULL_FRONT);
            (cull, live.camera_mask, instance.first_triangle, instance.triangle_count, slot)
        };
        let mut is_listed = vec![false; instances.len() as usize];
        self.keys.retain(|key| {
            let is_same = instances.live_in(key.4).is_some_and(|live| key_of(key.4, live) == *key);
            is_listed[key.4 as usize] = is_same;
            is_same
        });
        let missing = instances.live().filter(|(slot, _)| !is_listed[*slot as usize]);
        self.keys.extend(missing.map(|(slot, live)| key_of(slot, live)));
        // This sort is fast where most of the list is in order.
        self.keys.sort();
        self.draws = draws(&self.keys);
    }
}

/// The draw calls for instances that are sorted.
fn draws(keys: &[Key]) -> Vec<Draw> {
    let mut draws: Vec<Draw> = Vec::new();
    let mut last = None;
    for &(flags, camera_mask, first, triangles, slot) in keys {
        let kind = Some((flags, camera_mask, first));
        match draws.last_mut().filter(|draw| last == kind && draw.instances.end == slot) {
            Some(draw) => draw.instances.end += 1,
            None => {
                let cull = match flags {
                    MATERIAL_CULL_BACK => Some(Face::Back),
                    MATERIAL_CULL_FRONT => Some(Face::Front),
                    _ => None,
                };
                draws.push(Draw { instances: slot..slot + 1, triangles, camera_mask, cull });
            }
        }
        last = kind;
    }
    draws
}
