//! A body with a skin, made by code: a tube that sways.

use bevy::{
    asset::RenderAssetUsages,
    mesh::{
        Indices, PrimitiveTopology, VertexAttributeValues,
        skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    },
    prelude::*,
};

/// Joints of a tube.
pub const JOINTS: usize = 4;
const HEIGHT: f32 = 1.8;

/// The place of a joint in the mesh at rest.
pub fn rest_joint(joint: usize) -> Vec3 {
    Vec3::new(0.1 * joint as f32, HEIGHT * joint as f32 / (JOINTS - 1) as f32, 0.0)
}

/// A standing tube that gets thinner, closed above, of `2 · rings · sides` triangles. Each vertex follows up to two joints.
pub fn tube(rings: usize, sides: usize) -> Mesh {
    let (mut positions, mut normals, mut uvs, mut joints, mut weights) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for ring in 0..=rings {
        let along = ring as f32 / rings as f32;
        let at = along * (JOINTS - 1) as f32;
        let lower = (at.floor() as usize).min(JOINTS - 2);
        let share = at - lower as f32;
        for side in 0..=sides {
            let turn = side as f32 / sides as f32;
            let (sin, cos) = (core::f32::consts::TAU * turn).sin_cos();
            let radius = if ring == rings { 0.0 } else { 0.32 - 0.15 * along };
            positions.push([radius * cos + 0.1 * at, HEIGHT * along, radius * sin]);
            normals.push(Vec3::new(cos, 0.1, sin).normalize().to_array());
            uvs.push([turn, along]);
            joints.push([lower as u16, lower as u16 + 1, 0, 0]);
            weights.push([1.0 - share, share, 0.0, 0.0]);
        }
    }
    let row = sides as u32 + 1;
    let quads = (0..rings as u32).flat_map(|ring| (0..sides as u32).map(move |side| ring * row + side));
    let indices = quads.flat_map(|a| [a, a + row, a + 1, a + 1, a + row, a + row + 1]).collect();
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::all())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
        .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uvs)
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, VertexAttributeValues::Uint16x4(joints))
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, weights)
        .with_inserted_indices(Indices::U32(indices))
}

/// The skin of a tube, with joints at rest.
pub fn skin(world: &mut World) -> SkinnedMesh {
    let inverse: Vec<Mat4> = (0..JOINTS).map(|joint| Mat4::from_translation(-rest_joint(joint))).collect();
    let inverse_bindposes =
        world.resource_mut::<Assets<SkinnedMeshInverseBindposes>>().add(SkinnedMeshInverseBindposes::from(inverse));
    let joints = (0..JOINTS).map(|joint| world.spawn(Transform::from_translation(rest_joint(joint))).id()).collect();
    SkinnedMesh { inverse_bindposes, joints }
}

/// The joints of a tube that stands at `foot` and sways; `wild` is the amplitude of its bends.
pub fn swaying(foot: Transform, time: f32, wild: f32) -> Vec<Transform> {
    let mut at = foot;
    let mut joints = Vec::with_capacity(JOINTS);
    for joint in 0..JOINTS {
        if joint > 0 {
            let step = rest_joint(joint) - rest_joint(joint - 1);
            at.translation += at.rotation * (at.scale * step);
        }
        let phase = time + 0.9 * joint as f32;
        let bend =
            Quat::from_euler(EulerRot::XYZ, 0.4 * phase.sin(), 0.5 * (0.7 * phase).cos(), 0.6 * (1.3 * phase).sin());
        let twist = Quat::from_rotation_y((wild - 1.0).max(0.0) * phase);
        at.rotation *= Quat::IDENTITY.slerp(bend, wild.min(1.0)) * twist;
        at.scale = foot.scale * (1.0 + 0.2 * wild * (2.0 * phase).sin());
        joints.push(at);
    }
    joints
}

/// Moves the joints of a body.
pub fn set_joints(world: &mut World, body: Entity, joints: &[Transform]) {
    let Some(skin) = world.get::<SkinnedMesh>(body).cloned() else { return };
    for (joint, to) in skin.joints.into_iter().zip(joints) {
        if let Some(mut transform) = world.get_mut::<Transform>(joint) {
            *transform = *to;
        }
    }
}
