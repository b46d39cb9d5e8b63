//! Normals and tangents of corners, given by the mesh or made from the triangle where a ray hits it.

use crate::support::{
    gpu::{Gpu, gpu},
    scenes::{Random, TestScene},
};
use bevy::{
    asset::RenderAssetUsages,
    math::{DVec2, DVec3},
    mesh::{Indices, Mesh, PrimitiveTopology},
};
use bevy_restir::testing::{
    geometry::triangulate::triangles_of,
    gpu_layout::{GpuVertex, NOT_GIVEN},
};
use bytemuck::{Pod, Zeroable};

/// The layout of `Answer` in `tests/support/kernels/corners.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Answer {
    normal_a: [f32; 3],
    flipped: u32,
    others: [[f32; 4]; 5],
}

impl Answer {
    fn normals(&self) -> [DVec3; 3] {
        [wide(self.normal_a), wide(first_three(self.others[0])), wide(first_three(self.others[1]))]
    }

    fn tangents(&self) -> [DVec3; 3] {
        [2, 3, 4].map(|i| wide(first_three(self.others[i])))
    }
}

fn first_three([x, y, z, _]: [f32; 4]) -> [f32; 3] {
    [x, y, z]
}

fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

fn decode(word: u32) -> DVec3 {
    let [x, y] = [word as u16, (word >> 16) as u16].map(|h| f64::from(h as i16) / 32767.0);
    let z = 1.0 - x.abs() - y.abs();
    let t = (-z).max(0.0);
    let fold = |v: f64| if v >= 0.0 { v - t } else { v + t };
    DVec3::new(fold(x), fold(y), z).normalize()
}

/// Oracle: normals, tangents and whether the bitangent is flipped.
fn in_f64(v: [GpuVertex; 3]) -> ([DVec3; 3], [DVec3; 3], bool) {
    let p = v.map(|v| wide(v.position));
    let plane = (p[1] - p[0]).cross(p[2] - p[0]).normalize();
    let normals = v.map(|v| if v.normal == NOT_GIVEN { plane } else { decode(v.normal) });
    let uv = v.map(|v| DVec2::from_array(v.uv.map(f64::from)));
    let (b, c) = (uv[1] - uv[0], uv[2] - uv[0]);
    let (e, f) = (p[1] - p[0], p[2] - p[0]);
    let side = b.perp_dot(c).signum();
    let (along_u, along_v) = (side * (e * c.y - f * b.y), side * (f * b.x - e * c.x));
    let perpendicular = |n: DVec3| (along_u - along_u.dot(n) * n).normalize();
    let tangents =
        [0, 1, 2].map(|i| if v[i].tangent == NOT_GIVEN { perpendicular(normals[i]) } else { decode(v[i].tangent) });
    let flipped = match v[0].tangent {
        NOT_GIVEN => normals[0].cross(along_u).dot(along_v) > 0.0,
        tangent => tangent & 1 == 1,
    };
    (normals, tangents, flipped)
}

fn answers(gpu: &Gpu, scene: &TestScene) -> Vec<Answer> {
    let kernel = gpu.kernel("corners", include_str!("../support/kernels/corners.wgsl"), &[]);
    let all: Vec<u32> = (0..scene.triangles.len() as u32).collect();
    scene.run(gpu, &kernel, &all)
}

/// Triangles with random corners of this size, apart from each other.
fn triangles(random: &mut Random, size: f32) -> Vec<[f32; 3]> {
    (0..300).map(|_| random.point(size)).collect()
}

fn list(positions: Vec<[f32; 3]>) -> Mesh {
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
}

#[test]
fn normals_and_tangents_equal_the_oracle() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(31);
    for size in [1e-4, 1.0, 1e6] {
        for (has_normals, has_tangents) in [(false, false), (true, false), (true, true)] {
            let positions = triangles(&mut random, size);
            let mut directions = || positions.iter().map(|_| random.direction()).collect::<Vec<_>>();
            let (normals, tangents) = (directions(), directions());
            let uvs: Vec<[f32; 2]> = positions.iter().map(|_| [random.range(-2.0, 2.0), random.unit()]).collect();
            let mut mesh = list(positions).with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uvs);
            if has_normals {
                mesh.insert_attribute(Mesh::ATTRIBUTE_NORMAL, normals);
            }
            if has_tangents {
                let signed = |(i, [x, y, z]): (usize, [f32; 3])| [x, y, z, if i % 2 == 0 { 1.0 } else { -1.0 }];
                let tangents: Vec<[f32; 4]> = tangents.into_iter().enumerate().map(signed).collect();
                mesh.insert_attribute(Mesh::ATTRIBUTE_TANGENT, tangents);
            }
            let scene = TestScene::of(triangles_of(&mesh).expect("sound"));
            let mut farthest = 0.0f64;
            for (t, answer) in scene.triangles.iter().zip(answers(gpu, &scene)) {
                let (normals, tangents, flipped) = in_f64([t.a, t.b, t.c].map(|i| scene.vertices[i as usize]));
                let pairs =
                    normals.into_iter().zip(answer.normals()).chain(tangents.into_iter().zip(answer.tangents()));
                farthest = pairs.map(|(a, b)| (a - b).length()).fold(farthest, f64::max);
                assert_eq!(answer.flipped != 0, flipped, "handedness, {t:?}");
            }
            eprintln!("size {size:e}, normals {has_normals}, tangents {has_tangents}: error {farthest:.1e}");
            assert!(farthest < 1e-3, "size {size:e}, normals {has_normals}, tangents {has_tangents}: {farthest}");
        }
    }
}

#[test]
fn generated_tangents_equal_bevys() {
    let Some(gpu) = gpu() else { return };
    const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    const CORNERS: [[f32; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    for uv in [CORNERS, CORNERS.map(|[u, v]| [1.0 - u, v]), CORNERS.map(|[u, v]| [v, u]), CORNERS.map(|[u, v]| [u, -v])]
    {
        let plain = list(SQUARE.to_vec())
            .with_inserted_indices(Indices::U32(vec![0, 1, 2]))
            .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0, 0.0, 1.0]; 4])
            .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uv.to_vec());
        let theirs = plain.clone().with_generated_tangents().expect("Bevy can generate tangents");
        let [ours, theirs] = [plain, theirs].map(|mesh| {
            let scene = TestScene::of(triangles_of(&mesh).expect("sound"));
            (scene.vertices[0].tangent == NOT_GIVEN, answers(gpu, &scene)[0])
        });
        assert!(ours.0 && !theirs.0);
        let pairs = ours.1.tangents().into_iter().zip(theirs.1.tangents());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).length() < 2e-4), "{uv:?}");
        assert_eq!(ours.1.flipped, theirs.1.flipped, "handedness, {uv:?}");
    }
}

#[test]
fn tangents_without_texture_coordinates_are_perpendicular_to_normals() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(32);
    let positions = triangles(&mut random, 1.0);
    // No coordinates, equal ones, and ones on a line.
    for uv in [None, Some([0.0, 0.0]), Some([0.3, 0.7])] {
        for has_normals in [false, true] {
            let mut mesh = list(positions.clone());
            if has_normals {
                mesh.insert_attribute(
                    Mesh::ATTRIBUTE_NORMAL,
                    positions.iter().map(|_| random.direction()).collect::<Vec<_>>(),
                );
            }
            if let Some(direction) = uv {
                let uvs: Vec<[f32; 2]> = positions.iter().map(|p| direction.map(|x: f32| x * p[0] + 0.1)).collect();
                mesh.insert_attribute(Mesh::ATTRIBUTE_UV_0, uvs);
            }
            let scene = TestScene::of(triangles_of(&mesh).expect("sound"));
            for answer in answers(gpu, &scene) {
                for (n, t) in answer.normals().into_iter().zip(answer.tangents()) {
                    assert!((t.length() - 1.0).abs() < 1e-5 && t.dot(n).abs() < 1e-4, "{uv:?}: {t} for {n}");
                }
            }
        }
    }
}
