//! Bodies that bend: a tube with a skin, and a sheet with morph targets.  An oracle in f64 computes their vertices in a pose, as a mesh that
//! does not bend.

use super::{app::*, small_scenes::room};
use bevy::{
    asset::RenderAssetUsages,
    math::{DAffine3, DMat3, DVec3},
    mesh::{
        PrimitiveTopology, VertexAttributeValues,
        morph::{MeshMorphWeights, MorphAttributes},
    },
    prelude::*,
};
use bevy_restir_support::skinned;
pub use bevy_restir_support::skinned::{JOINTS, rest_joint, swaying};

/// A tube of 240 triangles.
pub fn tube() -> Mesh {
    skinned::tube(12, 10)
}

/// A flat sheet of 9 x 9 vertices with two morph targets: a bulge and a wave.
pub fn sheet() -> Mesh {
    let mesh = Plane3d::new(Vec3::Z, Vec2::splat(0.6)).mesh().subdivisions(7).build();
    let Some(VertexAttributeValues::Float32x3(positions)) = mesh.attribute(Mesh::ATTRIBUTE_POSITION) else {
        unreachable!("a plane has positions")
    };
    let bulge = |p: &[f32; 3]| {
        let height = 0.5 * (1.0 - (p[0] * p[0] + p[1] * p[1]) / 0.72);
        MorphAttributes::new(Vec3::new(0.0, 0.0, height), Vec3::new(1.4 * p[0], 1.4 * p[1], 0.0), Vec3::ZERO)
    };
    let wave = |p: &[f32; 3]| {
        MorphAttributes::new(
            Vec3::new(0.2 * p[1], 0.1, 0.3 * (6.0 * p[0]).sin()),
            Vec3::new(-(6.0 * p[0]).cos(), 0.0, 0.0),
            Vec3::ZERO,
        )
    };
    let targets = positions.iter().map(bulge).chain(positions.iter().map(wave)).collect();
    let mut mesh = mesh;
    mesh.set_morph_targets(targets);
    mesh
}

/// Spawns a body with a skin.
pub fn spawn_skinned(rig: &mut Rig, name: &'static str, mesh: Mesh, material: StandardMaterial) -> Entity {
    let skin = skinned::skin(rig.app.world_mut());
    let body = rig.spawn(mesh, material, Transform::default());
    rig.insert(body, (Name::new(name), skin));
    body
}

/// Moves the joints of a body.
pub fn set_joints(rig: &mut Rig, body: Entity, joints: &[Transform]) {
    skinned::set_joints(rig.app.world_mut(), body, joints);
}

/// Sets the weights of the morph targets of a body.
pub fn set_weights(rig: &mut Rig, body: Entity, weights: &[f32]) {
    rig.insert(body, MeshMorphWeights::Value { weights: weights.to_vec() });
}

fn floats3(mesh: &Mesh, attribute: bevy::mesh::MeshVertexAttribute) -> Vec<DVec3> {
    let Some(VertexAttributeValues::Float32x3(values)) = mesh.attribute(attribute) else {
        panic!("a missing attribute")
    };
    values.iter().map(|v| Vec3::from_array(*v).as_dvec3()).collect()
}

fn with_vertices(mesh: &Mesh, positions: &[DVec3], normals: &[DVec3]) -> Mesh {
    let list = |values: &[DVec3]| values.iter().map(|v| v.as_vec3().to_array()).collect::<Vec<_>>();
    let mut still = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::all())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, list(positions))
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, list(normals))
        .with_inserted_indices(mesh.indices().expect("the mesh has indices").clone());
    if let Some(uvs) = mesh.attribute(Mesh::ATTRIBUTE_UV_0) {
        still.insert_attribute(Mesh::ATTRIBUTE_UV_0, uvs.clone());
    }
    still
}

/// Oracle: the mesh of [`tube`] in world space with its joints at these places.
pub fn skinned_in_f64(mesh: &Mesh, joints: &[Transform]) -> Mesh {
    let (Some(VertexAttributeValues::Uint16x4(of)), Some(VertexAttributeValues::Float32x4(weights))) =
        (mesh.attribute(Mesh::ATTRIBUTE_JOINT_INDEX), mesh.attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT))
    else {
        panic!("a mesh without a skin")
    };
    let matrices: Vec<DAffine3> = joints
        .iter()
        .enumerate()
        .map(|(i, joint)| {
            let place = DAffine3::from_scale_rotation_translation(
                joint.scale.as_dvec3(),
                joint.rotation.as_dquat(),
                joint.translation.as_dvec3(),
            );
            place * DAffine3::from_translation(-rest_joint(i).as_dvec3())
        })
        .collect();
    let blended = |vertex: usize| -> (DMat3, DVec3) {
        of[vertex].iter().zip(weights[vertex]).fold((DMat3::ZERO, DVec3::ZERO), |(m, t), (joint, weight)| {
            let joint = &matrices[*joint as usize];
            (m + joint.matrix3 * f64::from(weight), t + joint.translation * f64::from(weight))
        })
    };
    let (rest, rest_normals) = (floats3(mesh, Mesh::ATTRIBUTE_POSITION), floats3(mesh, Mesh::ATTRIBUTE_NORMAL));
    let moved: Vec<(DMat3, DVec3)> = (0..rest.len()).map(blended).collect();
    let positions: Vec<DVec3> = rest.iter().zip(&moved).map(|(p, (m, t))| *m * *p + *t).collect();
    let normals: Vec<DVec3> =
        rest_normals.iter().zip(&moved).map(|(n, (m, _))| (m.inverse().transpose() * *n).normalize()).collect();
    with_vertices(mesh, &positions, &normals)
}

/// Oracle: a mesh with these weights of its morph targets.
pub fn morphed_in_f64(mesh: &Mesh, weights: &[f32]) -> Mesh {
    let (mut positions, mut normals) = (floats3(mesh, Mesh::ATTRIBUTE_POSITION), floats3(mesh, Mesh::ATTRIBUTE_NORMAL));
    let targets = mesh.get_morph_targets().expect("the mesh has morph targets");
    for (target, weight) in targets.chunks(positions.len()).zip(weights) {
        for (vertex, by) in target.iter().enumerate() {
            positions[vertex] += by.position.as_dvec3() * f64::from(*weight);
            normals[vertex] += by.normal.as_dvec3() * f64::from(*weight);
        }
    }
    let normals: Vec<DVec3> = normals.into_iter().map(DVec3::normalize).collect();
    with_vertices(mesh, &positions, &normals)
}

/// A room with a body that casts shadows, a body that glows, and a sheet with morph targets: [`pose_bending`].
pub fn bending(rig: &mut Rig) {
    room(rig);
    spawn_skinned(
        rig,
        "body",
        tube(),
        StandardMaterial { base_color: Color::linear_rgb(0.9, 0.6, 0.4), ..lambert(0.0) },
    );
    spawn_skinned(rig, "glowing", tube(), lamp(3.0, 6.0, 8.0));
    let both_sides = StandardMaterial { double_sided: true, cull_mode: None, ..lambert(0.8) };
    let sheet =
        rig.spawn(sheet(), both_sides, Transform::from_xyz(-0.9, 0.5, 0.2).with_rotation(Quat::from_rotation_x(-0.8)));
    rig.insert(sheet, Name::new("sheet"));
}

/// Poses the bodies at a step, 0 to [`STEPS`](super::small_scenes::STEPS).
pub fn pose_bending(rig: &mut Rig, step: u32) {
    let s = step as f32;
    let [body, glowing, sheet] = ["body", "glowing", "sheet"].map(|name| rig.named(name));
    set_joints(rig, body, &swaying(Transform::from_xyz(0.1 + 0.1 * s, -1.2, 0.7), 0.6 * s, 1.0));
    let foot = Transform::from_xyz(1.2, -1.1 + 0.1 * s, 0.2).with_scale(Vec3::splat(0.5));
    set_joints(rig, glowing, &swaying(foot, 2.0 + 0.8 * s, 1.0));
    set_weights(rig, sheet, &[0.4 * s, 0.6 - 0.4 * s]);
}
