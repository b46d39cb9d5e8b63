//! Rigs: the data that deform a skinned or morphed mesh.  For each vertex these are its joints and the displacements of its morph targets,
//! packed for `shaders/deformation/`; boxes of joints and targets give the bounds of any pose.

use bevy::mesh::{Mesh, VertexAttributeValues, morph::MorphAttributes};

use super::triangulate::Geometry;
use crate::gpu_layout::{NODE_STRIDE, NONE};
use crate::scene::accel::{
    blas::{Bounds, NO_BOUNDS, joined},
    tlas::rows,
};
use bevy::math::{Affine3A, Mat3A, Vec3};

/// Offsets of the tables of a rig, in words (`Body` in `shaders/deformation/types.wgsl`), and their lengths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RigTables {
    /// `NONE` without a skin.
    pub influences: u32,
    pub targets: u32,
    pub levels: u32,
    pub target_count: u32,
    pub level_count: u32,
}

/// The part of a rig that the CPU keeps, for the bounds of poses; only shaders read the tables.
#[derive(Clone, Debug, Default)]
pub struct RigBounds {
    /// The box at rest of the vertices that a joint moves; a mesh without a skin has one entry.  Its minimum is above its maximum if there
    /// is no such vertex.
    joints: Vec<Bounds>,
    /// The box of the displacements of each morph target.
    targets: Vec<Bounds>,
}

/// The vertices of a mesh that bends.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RigVertices {
    /// Joints and weights; empty without a skin.
    influences: Vec<([u16; 4], [f32; 4])>,
    /// Position, normal and tangent, by target and then by vertex; empty without morph targets.
    displacements: Vec<[[f32; 3]; 3]>,
    vertex_count: usize,
}

/// A rig whose tables have the order of the vertices that shaders read.
#[derive(Clone, Debug, Default)]
pub struct Rig {
    pub words: Vec<u32>,
    pub tables: RigTables,
    pub bounds: RigBounds,
}

/// The pose of a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pose {
    /// World from object, if there is a skin, which ignores the transform of its entity.  Its origin is the point to which the first joint
    /// moves the origin of the mesh.
    pub place: Option<Affine3A>,
    /// Transform of each joint, from the mesh at rest to object space; empty without a skin.
    pub joints: Vec<Affine3A>,
    /// Weights of the morph targets.
    pub weights: Vec<f32>,
}

impl Pose {
    /// A pose of joints by their transforms from the mesh at rest to the world.  Object space is not rotated, because normals are
    /// interpolated there, and is mirrored if the body is.
    pub fn new(joints: Vec<Affine3A>, weights: Vec<f32>) -> Self {
        let Some(first) = joints.first() else { return Self { weights, ..Default::default() } };
        let mirror = Vec3::new(if first.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 }, 1.0, 1.0);
        let origin = first.translation;
        let place = Affine3A { matrix3: Mat3A::from_diagonal(mirror), translation: origin };
        let mirror = Affine3A::from_scale(mirror);
        let in_object =
            |joint: &Affine3A| mirror * Affine3A { translation: joint.translation - origin, matrix3: joint.matrix3 };
        Self { place: Some(place), joints: joints.iter().map(in_object).collect(), weights }
    }

    /// Whether no number is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.place.is_none_or(|place| place.is_finite())
            && self.joints.iter().all(|joint| joint.is_finite())
            && self.weights.iter().all(|weight| weight.is_finite())
    }

    /// Whether a body has the same shape in both poses.
    pub fn has_shape_of(&self, other: &Self) -> bool {
        self.joints == other.joints && self.weights == other.weights
    }
}

fn include(bounds: &mut Bounds, point: [f32; 3]) {
    *bounds = joined(*bounds, (point, point));
}

impl RigVertices {
    /// The vertices of a mesh with joints or morph targets; `None` for any other mesh.
    pub fn of(mesh: &Mesh, vertex_count: usize) -> Option<Self> {
        let attribute = |kind| mesh.try_attribute_option(kind).ok().flatten();
        let influences = match (attribute(Mesh::ATTRIBUTE_JOINT_INDEX), attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT)) {
            (Some(VertexAttributeValues::Uint16x4(joints)), Some(VertexAttributeValues::Float32x4(weights))) => {
                joints.iter().zip(weights).map(|(joints, weights)| (*joints, normalized(*weights))).collect()
            }
            _ => Vec::new(),
        };
        let displacements: Vec<_> = match mesh.try_has_morph_targets() {
            Ok(true) => mesh.get_morph_targets().unwrap_or_default().iter().map(displacement).collect(),
            _ => Vec::new(),
        };
        // A table of another length does not belong to these vertices.
        let influences = if influences.len() == vertex_count { influences } else { Vec::new() };
        let is_whole = vertex_count > 0 && displacements.len().is_multiple_of(vertex_count);
        let displacements = if is_whole { displacements } else { Vec::new() };
        let bends = !influences.is_empty() || !displacements.is_empty();
        bends.then_some(Self { influences, displacements, vertex_count })
    }

    /// Packs the rig of a mesh for the tree with these nodes, and for these of its vertices, as indices in those of the geometry.
    pub fn pack(&self, geometry: &Geometry, vertices: &[u32], nodes: &[[u32; 4]]) -> Rig {
        let mut words: Vec<u32> = Vec::new();
        let mut tables = RigTables { influences: NONE, ..Default::default() };
        let sources: Vec<usize> = vertices.iter().map(|&i| geometry.sources[i as usize] as usize).collect();
        if !self.influences.is_empty() {
            tables.influences = words.len() as u32;
            for ([a, b, c, d], weights) in sources.iter().map(|&source| &self.influences[source]) {
                words.extend([u32::from(*a) | u32::from(*b) << 16, u32::from(*c) | u32::from(*d) << 16]);
                words.extend(weights.map(f32::to_bits));
            }
        }
        tables.targets = words.len() as u32;
        tables.target_count = (self.displacements.len() / self.vertex_count.max(1)) as u32;
        for target in self.displacements.chunks_exact(self.vertex_count.max(1)) {
            words.extend(sources.iter().flat_map(|&source| target[source].as_flattened()).map(|x| x.to_bits()));
        }
        tables.levels = words.len() as u32;
        let levels = levels_of(nodes);
        tables.level_count = levels.len() as u32;
        let mut end = levels.len() as u32 + 1;
        words.push(end);
        for level in &levels {
            end += level.len() as u32;
            words.push(end);
        }
        words.extend(levels.into_iter().flatten());
        Rig { words, tables, bounds: self.bounds(geometry) }
    }

    fn bounds(&self, geometry: &Geometry) -> RigBounds {
        let joint_count =
            self.influences.iter().flat_map(|(joints, _)| *joints).max().map_or(1, |last| last as usize + 1);
        let mut joints = vec![NO_BOUNDS; joint_count];
        let mut targets = vec![NO_BOUNDS; self.displacements.len() / self.vertex_count.max(1)];
        for (vertex, &source) in geometry.vertices.iter().zip(&geometry.sources) {
            match self.influences.get(source as usize) {
                Some((of, weights)) => {
                    let used = of.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
                    used.for_each(|(joint, _)| include(&mut joints[*joint as usize], vertex.position));
                }
                None => include(&mut joints[0], vertex.position),
            }
            for (target, bounds) in targets.iter_mut().enumerate() {
                include(bounds, self.displacements[target * self.vertex_count + source as usize][0]);
            }
        }
        RigBounds { joints, targets }
    }
}

impl RigBounds {
    /// A box around all vertices in a pose: a skinned vertex lies between the places to which its joints take it.
    pub fn in_pose(&self, pose: &Pose) -> Bounds {
        let mut moved = ([0.0f64; 3], [0.0f64; 3]);
        for ((low, high), weight) in self.targets.iter().zip(&pose.weights).filter(|(_, weight)| **weight != 0.0) {
            for k in 0..3 {
                let ends = [low[k], high[k]].map(|x| f64::from(x) * f64::from(*weight));
                moved.0[k] += ends[0].min(ends[1]);
                moved.1[k] += ends[0].max(ends[1]);
            }
        }
        let mut all = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let mut size = 0.0f64;
        for (joint, (low, high)) in self.joints.iter().enumerate().filter(|(_, (low, high))| low[0] <= high[0]) {
            // As in the shader, joints beyond the last one are the last one.
            let transform = pose.joints.get(joint).or(pose.joints.last()).copied().unwrap_or(Affine3A::IDENTITY);
            for (k, row) in rows(&transform).iter().enumerate() {
                let (mut least, mut most) = (f64::from(row[3]), f64::from(row[3]));
                let mut sum = least.abs();
                for c in 0..3 {
                    let ends = [f64::from(low[c]) + moved.0[c], f64::from(high[c]) + moved.1[c]];
                    let ends = ends.map(|x| x * f64::from(row[c]));
                    least += ends[0].min(ends[1]);
                    most += ends[0].max(ends[1]);
                    sum += ends[0].abs().max(ends[1].abs());
                }
                all.0[k] = all.0[k].min(least);
                all.1[k] = all.1[k].max(most);
                size = size.max(sum);
            }
        }
        // The shader computes in f32.
        let rounding = 1e-5 * size;
        (all.0.map(|x| (x - rounding) as f32), all.1.map(|x| (x + rounding) as f32))
    }
}

/// Weights with the sum 1, as glTF requires; a vertex without weights follows its first joint.
fn normalized(weights: [f32; 4]) -> [f32; 4] {
    let weights = weights.map(|w| if w > 0.0 && w.is_finite() { w } else { 0.0 });
    let sum: f32 = weights.iter().sum();
    if sum > 0.0 && sum.is_finite() { weights.map(|w| w / sum) } else { [1.0, 0.0, 0.0, 0.0] }
}

fn displacement(of: &MorphAttributes) -> [[f32; 3]; 3] {
    [of.position, of.normal, of.tangent].map(|v| if v.is_finite() { v.to_array() } else { [0.0; 3] })
}

/// Nodes by level, the deepest first.
fn levels_of(nodes: &[[u32; 4]]) -> Vec<Vec<u32>> {
    let mut levels: Vec<Vec<u32>> = Vec::new();
    let mut open: Vec<u32> = if nodes.is_empty() { Vec::new() } else { vec![0] };
    while !open.is_empty() {
        let children = open.iter().flat_map(|&node| {
            let node = &nodes[(node * NODE_STRIDE) as usize..];
            node[1][0]..node[1][0] + (node[0][3] >> 24).count_ones()
        });
        let below = children.collect();
        levels.push(core::mem::replace(&mut open, below));
    }
    levels.reverse();
    levels
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Quat;

    /// A vertex between two joints stays within the box of the pose, however the joints turn.
    #[test]
    fn bounds_hold_every_vertex() {
        let rig = RigBounds {
            joints: vec![([-1.0, 0.0, -0.5], [1.0, 2.0, 0.5]), ([-0.5, 1.0, -0.5], [0.5, 3.0, 0.5])],
            targets: vec![([-0.5, 0.0, 0.0], [0.25, 1.0, 0.0])],
        };
        for step in 0..200 {
            let s = step as f32;
            let joint = |k: f32| {
                Affine3A::from_rotation_translation(
                    Quat::from_rotation_y(k * s) * Quat::from_rotation_x(0.7 * s),
                    Vec3::new(s.sin(), k, s.cos()),
                )
            };
            let pose = Pose { joints: vec![joint(0.3), joint(1.1)], weights: vec![s.sin()], place: None };
            let (low, high) = rig.in_pose(&pose);
            for corner in 0..8 {
                let pick = |i: usize, (a, b): (f32, f32)| if corner >> i & 1 == 0 { a } else { b };
                // In both boxes at rest.
                let rest = Vec3::new(pick(0, (-0.5, 0.5)), pick(1, (1.0, 2.0)), pick(2, (-0.5, 0.5)));
                let displaced = rest + s.sin() * Vec3::new(pick(1, (-0.5, 0.25)), pick(0, (0.0, 1.0)), 0.0);
                let weight = 0.5 + 0.5 * (3.0 * s).sin();
                let p = weight * pose.joints[0].transform_point3(displaced)
                    + (1.0 - weight) * pose.joints[1].transform_point3(displaced);
                assert!((0..3).all(|k| low[k] <= p[k] && p[k] <= high[k]), "{p} outside of {low:?} {high:?}");
            }
        }
    }

    #[test]
    fn weights_are_normalized() {
        assert_eq!(normalized([1.0, 3.0, 0.0, 0.0]), [0.25, 0.75, 0.0, 0.0]);
        assert_eq!(normalized([f32::NAN, -1.0, 0.0, 0.0]), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(normalized([f32::INFINITY, 1.0, 0.0, 0.0]), [0.0, 1.0, 0.0, 0.0]);
    }
}
