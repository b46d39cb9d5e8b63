//! Makes the draw calls of the visibility pass.  Instances of one mesh in adjacent slots share a call.

use bevy::render::render_resource::Face;
use std::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{geometry::instances::InstancePool, material::materials::MaterialPool};

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

/// The draw calls for all instances, sorted by culling mode so that the pass changes pipelines rarely.
pub(crate) fn draws(instances: &InstancePool, materials: &MaterialPool) -> Vec<Draw> {
    let mut keyed: Vec<_> = instances
        .live
        .iter()
        .map(|live| {
            let instance = instances.get(live.slot);
            let flags = materials.get(live.material).map_or(0, |m| m.flags);
            let cull = flags & (MATERIAL_CULL_BACK | MATERIAL_CULL_FRONT);
            (cull, live.camera_mask, instance.first_triangle, instance.triangle_count, live.slot)
        })
        .collect();
    keyed.sort_unstable();
    let mut draws: Vec<Draw> = Vec::new();
    let mut last = None;
    for (flags, camera_mask, first, triangles, slot) in keyed {
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
