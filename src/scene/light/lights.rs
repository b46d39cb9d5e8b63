//! Every emitter in one table: analytic lights, then the triangles of every emissive instance, with a power-proportional alias
//! table over all of them.  Ids are stable while nothing changes and remapped both ways when something does.  Of triangles that the
//! device cannot bind rays find the light all the same: the picture is noisier, not darker.

use bevy::{
    ecs::resource::Resource,
    log::{warn, warn_once},
    math::Vec3,
    platform::collections::{HashMap, HashSet},
    render::{
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};
use std::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{
    accel::blas::Bounds,
    accel::tlas::build_tlas,
    extract::ExtractedScene,
    features::SceneFeatures,
    geometry::instances::{GpuTlas, InstancePool},
    geometry::meshes::MeshPool,
    light::alias_table::alias_table,
    light::emissive::{Source, analytic_light, flaw, is_placed, is_sound, luminance, shape_bounds, world_area},
    material::materials::MaterialPool,
    storage::{dirty_runs::dirty_runs, growable_buffer::GrowableBuffer, overflow_warning::OverflowWarning},
};

/// Who a light belongs to: a Bevy light, or the mesh of the same entity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Owner {
    entity: MainEntity,
    /// `LIGHT_*`: points on lights of another kind are other points.
    kind: u32,
}

/// Lights of one owner: `first..first + count` in the table.
#[derive(Clone, Debug, PartialEq)]
struct Group {
    owner: Owner,
    first: u32,
    count: u32,
}

/// Where the lights of one frame are in another; `NONE` for those that are not there.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct LightRemap {
    /// By this frame's ids.
    previous_from_current: Vec<u32>,
    /// By the last frame's ids.
    current_from_previous: Vec<u32>,
}

/// The lights of the scene.
#[derive(Resource)]
pub(crate) struct LightPool {
    sources: Vec<(MainEntity, Source)>,
    /// As in [`ExtractedScene`].
    pub(crate) hidden: HashMap<MainEntity, u32>,
    groups: Vec<Group>,
    table: Vec<GpuLight>,
    uploaded: Vec<GpuLight>,
    pub gpu: GrowableBuffer<GpuLight>,
    /// Sum of the powers of the table.
    pub power: f64,
    /// Scene radius that the powers of directional lights were made with, a power of two.
    radius: f32,
    /// Warned about already.
    warned: HashSet<MainEntity>,
    /// Emissive triangles and other lights that the table has no room for.
    left_out: [u64; 2],
    overflow: OverflowWarning,
    pub features: SceneFeatures,
    /// The last frame's table lies behind this frame's, from here on; 0 where it is the same.
    pub(crate) previous_at: u32,
    previous: Vec<GpuLight>,
    change: Change,
    /// The table behind this frame's holds the same lights in the same order.
    mirrored: bool,
    pub revision: u64,
    shapes: ShapeTree,
}

/// What there is to send.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Change {
    #[default]
    Nothing,
    /// The first lights, as many as `previous` has, moved.
    Places,
    Everything,
}

impl Default for LightPool {
    fn default() -> Self {
        Self {
            sources: Vec::new(),
            hidden: HashMap::default(),
            groups: Vec::new(),
            table: Vec::new(),
            uploaded: Vec::new(),
            gpu: GrowableBuffer::new("lights"),
            power: 0.0,
            radius: 0.0,
            warned: HashSet::default(),
            left_out: [0; 2],
            overflow: OverflowWarning::default(),
            features: SceneFeatures::empty(),
            previous_at: 0,
            previous: Vec::new(),
            change: Change::default(),
            mirrored: false,
            revision: 0,
            shapes: ShapeTree::default(),
        }
    }
}

impl LightPool {
    /// Brings the table, of which the device can bind `limit` lights, up to the scene and gives every instance its first light.
    pub(crate) fn update(
        &mut self,
        scene: &ExtractedScene,
        instances: &mut InstancePool,
        meshes: &MeshPool,
        materials: &MaterialPool,
        limit: u32,
    ) {
        self.update_table(scene, instances, meshes, materials, limit);
        let [triangles, others] = self.left_out;
        if self.overflow.should_warn(triangles + others, meshes.idle() && !instances.waiting) {
            warn!(
                "restir: this device binds {limit} lights at most: {triangles} emissive triangles are found by chance only (noisier, \
                 not darker), {others} other lights are left out (darker)"
            );
        }
    }

    fn update_table(
        &mut self,
        scene: &ExtractedScene,
        instances: &mut InstancePool,
        meshes: &MeshPool,
        materials: &MaterialPool,
        limit: u32,
    ) {
        self.previous_at = 0;
        let sources = self.gather(scene, instances, meshes, materials);
        let radius = (instances.radius.max(1e-3).log2().ceil()).exp2();
        let directional = self.features.intersects(SceneFeatures::LIGHT_DIRECTIONAL | SceneFeatures::SUN_DISK);
        let comparable = sources.len() == self.sources.len()
            && (radius == self.radius || !directional)
            && self.hidden == scene.hidden_lights;
        let all = |same: fn(&Source, &Source) -> bool| {
            comparable && sources.iter().zip(&self.sources).all(|(a, b)| a.0 == b.0 && same(&a.1, &b.1))
        };
        if all(Source::same_as) {
            return;
        }
        if all(Source::same_elsewhere) && self.move_lights(&sources) {
            self.sources = sources;
            return;
        }
        let old = core::mem::take(&mut self.groups);
        self.previous = core::mem::take(&mut self.table);
        self.sources = sources;
        self.hidden.clone_from(&scene.hidden_lights);
        self.radius = radius;
        self.rebuild(instances, meshes, limit);
        // The shaders of temporal reuse look lights up in both frames.
        let map = remap(&old, self.previous.len() as u32, &self.groups, self.table.len() as u32);
        for (light, counterpart) in self.table.iter_mut().zip(map.previous_from_current) {
            light.counterpart = counterpart;
        }
        for (light, counterpart) in self.previous.iter_mut().zip(map.current_from_previous) {
            light.counterpart = counterpart;
        }
        self.previous_at = self.table.len().max(1) as u32;
        self.mirrored = old == self.groups;
        self.change = Change::Everything;
    }

    /// Where nothing but places of analytic lights changed: their records, without a look at all the triangles.  False, and nothing
    /// done, where another set of them than before can be drawn, or where there is no table of the last frame to write to.
    fn move_lights(&mut self, sources: &[(MainEntity, Source)]) -> bool {
        let analytic = self.groups.iter().take_while(|group| group.owner.kind != LIGHT_TRIANGLE).count();
        let mut moved = Vec::with_capacity(analytic);
        for (entity, source) in sources {
            let Source::Analytic(light) = source else { break };
            let (gpu, power, _) = analytic_light(light, self.radius);
            if !is_sound(&gpu, power) {
                continue;
            }
            let id = moved.len();
            if id == analytic || self.groups[id].owner != (Owner { entity: *entity, kind: gpu.kind & LIGHT_KIND_BITS })
            {
                return false;
            }
            let GpuLight { kind, pmf, alias_probability, alias_index, .. } = self.table[id];
            moved.push(GpuLight { kind, pmf, alias_probability, alias_index, counterpart: id as u32, ..gpu });
        }
        if moved.len() != analytic {
            return false;
        }
        // Lights that are left out, black ones among them, show nothing of their ways.
        let stays = |(new, old): (&GpuLight, &GpuLight)| GpuLight { counterpart: old.counterpart, ..*new } == *old;
        if moved.iter().zip(&self.table).all(stays) {
            return true;
        }
        if !self.mirrored {
            return false;
        }
        self.previous.clear();
        self.previous.extend_from_slice(&self.table[..analytic]);
        self.table[..analytic].copy_from_slice(&moved);
        self.previous_at = self.table.len().max(1) as u32;
        self.change = Change::Places;
        true
    }

    fn gather(
        &self,
        scene: &ExtractedScene,
        instances: &InstancePool,
        meshes: &MeshPool,
        materials: &MaterialPool,
    ) -> Vec<(MainEntity, Source)> {
        let analytic = scene.lights.iter().map(|(entity, light)| (*entity, Source::Analytic(*light)));
        let emissive = instances.live.iter().filter_map(|live| {
            let emission = materials.mean_emission(live.material);
            let mesh = meshes.get(live.mesh)?;
            // What no ray meets lights nothing.
            if luminance(emission) <= 0.0 || live.ray_mask == 0 {
                return None;
            }
            let m = instances.get(live.slot).world_from_object;
            let column = |i: usize| Vec3::new(m[0][i], m[1][i], m[2][i]);
            let (x, y, z) = (column(0), column(1), column(2));
            Some((
                live.entity,
                Source::Mesh {
                    slot: live.slot,
                    version: mesh.version,
                    first_triangle: mesh.triangles.start,
                    count: mesh.triangles.end - mesh.triangles.start,
                    emission,
                    double_sided: materials.get(live.material)?.flags & MATERIAL_DOUBLE_SIDED != 0,
                    metric: [x.dot(x), y.dot(y), z.dot(z), x.dot(y), y.dot(z), z.dot(x)],
                },
            ))
        });
        analytic.chain(emissive).collect()
    }

    fn rebuild(&mut self, instances: &mut InstancePool, meshes: &MeshPool, limit: u32) {
        self.table.clear();
        self.features = SceneFeatures::empty();
        let slots: Vec<u32> = instances.live.iter().map(|live| live.slot).collect();
        for slot in slots {
            instances.set_first_light(slot, NONE);
        }
        let by_slot: HashMap<u32, _> = instances.live.iter().map(|live| (live.slot, live.mesh)).collect();
        let mut powers = Vec::new();
        self.left_out = [0; 2];
        for (entity, source) in &self.sources {
            let first = self.table.len() as u32;
            match source {
                Source::Analytic(light) => {
                    let (mut gpu, power, feature) = analytic_light(light, self.radius);
                    if let Some(flaw) = flaw(light)
                        && self.warned.insert(*entity)
                    {
                        warn!("restir: light {} has {flaw}", **entity);
                    }
                    if !is_sound(&gpu, power) {
                        // Black lights are ordinary; infinite or negative ones are not.
                        let placed = is_placed(&gpu);
                        if (power != 0.0 || !placed) && self.warned.insert(*entity) {
                            let at = if placed { "" } else { " and a transform that is not finite" };
                            warn!("restir: light {} has the power {power}{at}; it is left out", **entity);
                        }
                        continue;
                    }
                    if first >= limit {
                        self.left_out[1] += 1;
                        continue;
                    }
                    gpu.kind |= self.hidden.get(entity).map_or(0, |hidden| hidden << LIGHT_HIDDEN_SHIFT);
                    self.table.push(gpu);
                    powers.push(power);
                    self.features |= feature;
                }
                Source::Mesh { slot, first_triangle, count, emission, double_sided, .. } => {
                    if first as u64 + *count as u64 > limit as u64 {
                        self.left_out[0] += *count as u64;
                        continue;
                    }
                    let Some(mesh) = by_slot.get(slot).and_then(|id| meshes.get(*id)) else {
                        continue;
                    };
                    let m = instances.get(*slot).world_from_object;
                    let sides = if *double_sided { 2.0 } else { 1.0 };
                    let exitance = core::f64::consts::PI * luminance(*emission) * sides;
                    for (i, corners) in mesh.positions.iter().enumerate() {
                        self.table.push(GpuLight {
                            kind: LIGHT_TRIANGLE,
                            emission: *emission,
                            data: [*slot, first_triangle + i as u32],
                            ..Default::default()
                        });
                        powers.push(exitance * world_area(&m, corners));
                    }
                    self.features |= SceneFeatures::LIGHT_TRIANGLES;
                    instances.set_first_light(*slot, first);
                }
            }
            let kind = self.table.get(first as usize).map_or(LIGHT_TRIANGLE, |light| light.kind & LIGHT_KIND_BITS);
            let owner = Owner { entity: *entity, kind };
            self.groups.push(Group { owner, first, count: self.table.len() as u32 - first });
        }
        self.power = powers.iter().filter(|p| p.is_finite() && **p > 0.0).sum();
        match alias_table(&powers) {
            Some(entries) => {
                for (light, entry) in self.table.iter_mut().zip(entries) {
                    light.pmf = entry.pmf;
                    light.alias_probability = entry.probability;
                    light.alias_index = entry.alias;
                }
            }
            // Nothing emits: an empty table, so that nothing is drawn from it.
            None => self.power = 0.0,
        }
    }

    /// Sends what changed.  Returns the bytes sent.
    pub(crate) fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        let change = core::mem::take(&mut self.change);
        if change == Change::Nothing {
            return 0;
        }
        self.revision += 1;
        if change == Change::Places {
            let count = self.previous.len();
            let parts = [(0, &self.table[..count]), (self.previous_at as usize, &self.previous[..])];
            return parts
                .into_iter()
                .map(|(first, lights)| {
                    let sent = &mut self.uploaded[first..first + count];
                    let runs = dirty_runs(sent, lights);
                    sent.copy_from_slice(lights);
                    let write = |run: Range<usize>| self.gpu.write((first + run.start) as u32, &lights[run], queue);
                    runs.into_iter().map(write).sum::<u64>()
                })
                .sum();
        }
        let mut both = self.table.clone();
        both.resize(self.previous_at as usize, GpuLight::default());
        both.append(&mut self.previous);
        if !self.gpu.reserve(both.len() as u32, device, queue) {
            warn_once!("restir: {} lights are more than this device can bind", self.table.len());
            self.mirrored = false;
            return 0;
        }
        let runs = dirty_runs(&self.uploaded, &both);
        let bytes = runs.into_iter().map(|r| self.gpu.write(r.start as u32, &both[r], queue)).sum();
        self.uploaded = both;
        bytes
    }

    /// Brings the tree over balls and rectangles up to the table.  Returns the bytes sent.
    pub(crate) fn build_shapes(&mut self, meshes: &mut MeshPool, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        if self.change == Change::Nothing {
            return 0;
        }
        let analytic = self.groups.iter().take_while(|group| group.owner.kind != LIGHT_TRIANGLE).count();
        let boxes = self.table[..analytic].iter().enumerate();
        let boxes = boxes.filter_map(|(id, light)| Some((id as u32, shape_bounds(light)?))).collect();
        self.shapes.update(boxes, meshes, device, queue)
    }

    /// Root and list of lights of that tree, as [`InstancePool::top_levels`].
    pub(crate) fn shapes(&self) -> [u32; 2] {
        if self.count() > 0 { [self.shapes.nodes.root(), self.shapes.nodes.indices()] } else { [NONE, 0] }
    }

    /// Suns with a disc, the first of the table.
    pub(crate) fn sun_count(&self) -> u32 {
        let suns = self.table.iter().take_while(|light| light.kind & LIGHT_KIND_BITS == LIGHT_SUN).count();
        (suns as u32).min(self.count())
    }

    /// Lights that can be drawn from the table.
    pub(crate) fn count(&self) -> u32 {
        if self.power > 0.0 { self.table.len() as u32 } else { 0 }
    }
}

/// The tree over lights that rays meet on their way.
#[derive(Debug, Default)]
struct ShapeTree {
    boxes: Vec<(u32, Bounds)>,
    nodes: GpuTlas,
}

impl ShapeTree {
    fn update(
        &mut self,
        boxes: Vec<(u32, Bounds)>,
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> u64 {
        if boxes == self.boxes {
            return 0;
        }
        // No shader looks for lights of the last frame.
        meshes.release_nodes(core::mem::take(&mut self.nodes.range));
        let tlas = build_tlas(&boxes);
        self.boxes = boxes;
        let (nodes, bytes) = match GpuTlas::write(&tlas, meshes, device, queue) {
            Some(written) => written,
            None => {
                warn_once!(
                    "restir: the tree over {} lights does not fit this device; rays do not meet them",
                    self.boxes.len()
                );
                (GpuTlas::default(), 0)
            }
        };
        self.nodes = nodes;
        bytes
    }
}

/// Ids both ways between two tables: a light is the same if its owner is, of the same kind, and has as many lights.
fn remap(old: &[Group], old_count: u32, new: &[Group], new_count: u32) -> LightRemap {
    let by_owner: HashMap<Owner, &Group> = old.iter().map(|g| (g.owner, g)).collect();
    let mut map = LightRemap {
        previous_from_current: vec![NONE; new_count as usize],
        current_from_previous: vec![NONE; old_count as usize],
    };
    for group in new {
        let Some(before) = by_owner.get(&group.owner).filter(|b| b.count == group.count) else {
            continue;
        };
        for i in 0..group.count {
            map.previous_from_current[(group.first + i) as usize] = before.first + i;
            map.current_from_previous[(before.first + i) as usize] = group.first + i;
        }
    }
    map
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::ecs::entity::Entity;

    fn group(entity: u32, first: u32, count: u32) -> Group {
        let entity = Entity::from_raw_u32(entity).expect("a valid index").into();
        Group { owner: Owner { entity, kind: LIGHT_TRIANGLE }, first, count }
    }

    #[test]
    fn remapping_a_light_there_and_back_is_the_identity() {
        let old = [group(1, 0, 1), group(2, 1, 5), group(3, 6, 2)];
        let new = [group(3, 0, 2), group(4, 2, 7), group(2, 9, 5), group(1, 14, 3)];
        let map = remap(&old, 8, &new, 17);
        for (current, &previous) in map.previous_from_current.iter().enumerate() {
            if previous != NONE {
                assert_eq!(map.current_from_previous[previous as usize], current as u32);
            }
        }
        assert_eq!(map.current_from_previous[6], 0, "light 6 is the first of entity 3");
        assert_eq!(map.current_from_previous[0], NONE, "entity 1 has another number of lights now");
        assert_eq!(map.previous_from_current[2], NONE, "entity 4 is new");
        let mut ball = group(2, 1, 5);
        ball.owner.kind = LIGHT_SPHERE;
        assert_eq!(remap(&old, 8, &[ball], 6).previous_from_current, [NONE; 6], "entity 2 is of another kind now");
    }
}
