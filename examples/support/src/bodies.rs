//! Meshes of bodies that light scatters in.

use bevy::{math::ops, mesh::VertexAttributeValues, prelude::*};

/// A head with a nose and thin ears, 11 cm high: a ball whose radius depends on the direction. It faces +Z.
pub fn head() -> Mesh {
    let mut mesh = Sphere::new(1.0).mesh().ico(79).expect("few enough triangles");
    let bump = |d: Vec3, at: Vec3, width: Vec3, height: f32| {
        height * ops::exp(-((d - at.normalize()) / width).length_squared())
    };
    let shaped = |d: Vec3| {
        let mut radius = 1.0 - 0.12 * d.x * d.x + 0.1 * d.y * d.y;
        radius += bump(d, Vec3::new(0.0, -0.15, 1.0), Vec3::new(0.1, 0.22, 0.4), 0.28);
        radius += bump(d, Vec3::new(0.0, -0.75, 0.9), Vec3::new(0.3, 0.15, 0.4), 0.1);
        radius -= bump(d, Vec3::new(0.0, -0.48, 1.0), Vec3::new(0.25, 0.05, 0.4), 0.05);
        for side in [-1.0, 1.0] {
            radius -= bump(d, Vec3::new(0.38 * side, 0.1, 1.0), Vec3::new(0.15, 0.1, 0.4), 0.09);
            radius += bump(d, Vec3::new(side, 0.0, -0.15), Vec3::new(0.5, 0.28, 0.055), 0.45);
        }
        0.05 * radius * d
    };
    if let Some(VertexAttributeValues::Float32x3(positions)) = mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION) {
        for position in positions {
            *position = shaped(Vec3::from(*position).normalize()).to_array();
        }
    }
    mesh.compute_smooth_normals();
    mesh
}
