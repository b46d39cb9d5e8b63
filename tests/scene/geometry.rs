//! Conversion of Bevy meshes to triangles, transforms and their inverses, and bounding boxes.

use crate::support::scenes::{Random, random_rows};
use bevy::{
    asset::RenderAssetUsages,
    math::{Affine3A, Vec3, primitives::Sphere},
    mesh::{Indices, Mesh, Meshable, PrimitiveTopology, VertexAttributeValues as Values},
};
use bevy_restir::testing::{
    accel::blas::build_blas,
    accel::tlas::{build_tlas, inverse, rows, world_bounds},
    geometry::triangulate::{Dropped, GeometryError, octahedral_encode, triangles_of},
    gpu_layout::{GpuTriangle, GpuVertex, NOT_GIVEN},
};

const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
const CORNERS: [[f32; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];

fn mesh(topology: PrimitiveTopology, positions: &[[f32; 3]]) -> Mesh {
    Mesh::new(topology, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions.to_vec())
}

fn list(positions: &[[f32; 3]]) -> Mesh {
    mesh(PrimitiveTopology::TriangleList, positions)
}

fn decode(word: u32) -> [f32; 3] {
    let [x, y] = [word as u16, (word >> 16) as u16].map(|h| f32::from(h as i16) / 32767.0);
    let z = 1.0 - x.abs() - y.abs();
    let t = (-z).max(0.0);
    let fold = |v: f32| if v >= 0.0 { v - t } else { v + t };
    Vec3::new(fold(x), fold(y), z).normalize().to_array()
}

fn close(a: [f32; 3], b: [f32; 3]) -> bool {
    (0..3).all(|k| (a[k] - b[k]).abs() < 2e-4)
}

#[test]
fn indexed_and_unindexed_lists_and_strips_give_the_same_triangles() {
    let expected = [[SQUARE[0], SQUARE[1], SQUARE[2]], [SQUARE[2], SQUARE[1], SQUARE[3]]];
    let unindexed: Vec<[f32; 3]> = expected.iter().flatten().copied().collect();
    let numbers = [0u16, 1, 2, 2, 1, 3];
    let strip = || mesh(PrimitiveTopology::TriangleStrip, &SQUARE);
    let restarted = vec![3u16, 2, u16::MAX, 0, 1, 2, 3, 3, 3];
    for mesh in [
        list(&unindexed),
        list(&SQUARE).with_inserted_indices(Indices::U16(numbers.to_vec())),
        list(&SQUARE).with_inserted_indices(Indices::U32(numbers.iter().map(|&i| i.into()).collect())),
        strip(),
        strip().with_inserted_indices(Indices::U32(vec![0, 1, 2, 3])),
        strip().with_inserted_indices(Indices::U16(restarted)),
    ] {
        let geometry = triangles_of(&mesh).expect("the mesh is sound");
        assert_eq!(geometry.corners(), expected);
        assert_eq!(geometry.vertices.len(), 4, "both triangles share two vertices");
        assert_eq!(geometry.dropped, Dropped::default());
    }
}

#[test]
fn unsupported_topologies_and_formats_are_named() {
    for (topology, name) in [
        (PrimitiveTopology::PointList, "PointList"),
        (PrimitiveTopology::LineList, "LineList"),
        (PrimitiveTopology::LineStrip, "LineStrip"),
    ] {
        assert_eq!(triangles_of(&mesh(topology, &SQUARE)), Err(GeometryError::Topology(name)));
    }
    let empty = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default());
    assert_eq!(triangles_of(&empty), Err(GeometryError::NoPositions));
    let geometry = triangles_of(&list(&[])).expect("an empty mesh is no error");
    assert!(geometry.triangles.is_empty() && build_blas(&geometry).is_none());
    assert_eq!(triangles_of(&list(&SQUARE[..2])).expect("an incomplete triangle is no error").triangles.len(), 0);
}

#[test]
fn bad_triangles_are_dropped_and_counted() {
    let bad = |x: f32| [[x, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let positions: Vec<[f32; 3]> =
        [bad(f32::NAN), bad(f32::INFINITY), bad(1e38), bad(1.0), bad(0.0)].into_iter().flatten().collect();
    let mut numbers: Vec<u32> = (0..15).collect();
    numbers.extend([0, 1, 99, u32::MAX, 12, 13, 12, 12, 13]);
    let geometry =
        triangles_of(&list(&positions).with_inserted_indices(Indices::U32(numbers))).expect("one triangle is left");
    assert_eq!((geometry.corners(), geometry.vertices.len()), (vec![bad(0.0)], 3));
    assert_eq!(geometry.dropped, Dropped { out_of_range: 2, non_finite: 3, degenerate: 2 });
    let text = "has triangles that are left out: 2 with indices out of range and 3 with coordinates that are not finite or beyond 1e12 m";
    assert_eq!(geometry.dropped.complaint().as_deref(), Some(text));
    // Most spheres have such triangles at their poles.
    assert_eq!(Dropped { degenerate: 96, ..Dropped::default() }.complaint(), None);
    let blas = build_blas(&geometry).expect("there is one triangle");
    assert_eq!((blas.nodes.len(), blas.depth(), blas.bounds), (5, 1, ([0.0; 3], [1.0, 1.0, 0.0])));
}

#[test]
fn missing_and_bad_attributes_are_marked() {
    let triangle = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
    let plain = triangles_of(&list(&triangle)).expect("sound");
    assert!(plain.vertices.iter().all(|v| (v.normal, v.tangent, v.uv) == (NOT_GIVEN, NOT_GIVEN, [0.0; 2])));

    // One good normal that is not of unit length, one zero, one NaN; a short uv list with a NaN in it; a tangent that is not perpendicular
    // to its normal, and one that is there without a normal.
    let bad = list(&triangle)
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0, 3.0, 0.0], [0.0; 3], [f32::NAN; 3]])
        .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, vec![[0.5, 0.25], [f32::NAN, 1.0]])
        .with_inserted_attribute(Mesh::ATTRIBUTE_TANGENT, vec![[2.0, 1.0, 0.0, -1.0]; 3]);
    let [a, b, c] = triangles_of(&bad).expect("sound").vertices[..] else { panic!("three vertices") };
    assert!(close(decode(a.normal), [0.0, 1.0, 0.0]) && close(decode(a.tangent & !1), [1.0, 0.0, 0.0]));
    assert_eq!((a.tangent & 1, [b.normal, c.normal, b.tangent, c.tangent]), (1, [NOT_GIVEN; 4]));
    assert_eq!((a.uv, b.uv, c.uv), ([0.5, 0.25], [0.0, 1.0], [0.0; 2]));
}

#[test]
fn only_equal_vertices_of_a_mesh_without_indices_are_joined() {
    let corners: Vec<[f32; 3]> = [0, 1, 2, 2, 1, 3].map(|i: usize| SQUARE[i]).to_vec();
    let uvs = |seam: f32| {
        let mut uvs = [0, 1, 2, 2, 1, 3].map(|i: usize| CORNERS[i]);
        uvs[3][0] += seam;
        uvs.to_vec()
    };
    for (seam, count) in [(0.0, 4), (0.5, 5)] {
        let mesh = list(&corners).with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uvs(seam));
        let geometry = triangles_of(&mesh).expect("sound");
        assert_eq!(geometry.vertices.len(), count, "seam {seam}");
        let read: Vec<_> =
            geometry.triangles.as_flattened().iter().map(|&i| geometry.vertices[i as usize].uv).collect();
        assert_eq!(read, uvs(seam));
    }
    // Those of a mesh with indices are as they are in the mesh, without those that no triangle has.
    let twice = [SQUARE, SQUARE].concat();
    let mesh = list(&twice).with_inserted_indices(Indices::U32(vec![0, 1, 6, 6, 1, 7]));
    let geometry = triangles_of(&mesh).expect("sound");
    assert_eq!(geometry.sources, [0, 1, 6, 7]);
    let blas = build_blas(&geometry).expect("two triangles");
    let mut seen = 0;
    for vertex in blas.triangles.iter().flat_map(|t| [t.a, t.b, t.c]) {
        assert!(vertex <= seen, "vertices have the order in which triangles have them first");
        seen = seen.max(vertex + 1);
    }
    assert_eq!(seen as usize, blas.vertices.len());
}

#[test]
fn ordinary_indexed_meshes_take_at_most_40_bytes_a_triangle() {
    for mesh in [Sphere::new(1.0).mesh().uv(64, 64), Sphere::new(1.0).mesh().ico(20).expect("few enough vertices")] {
        let blas = build_blas(&triangles_of(&mesh).expect("sound")).expect("it has triangles");
        let bytes = size_of_val(&*blas.nodes) + size_of_val(&*blas.triangles) + size_of_val(&*blas.vertices);
        let each = bytes as f64 / blas.triangles.len() as f64;
        eprintln!("{} triangles, {} vertices: {each:.1} bytes a triangle", blas.triangles.len(), blas.vertices.len());
        assert!(each < 40.0, "{each} bytes a triangle");
    }
    // 8 M triangles in the bindings of the portable tier, 128 M in those of 2 GiB.
    for (triangles, binding) in [(8u64 << 20, 128u64 << 20), (128 << 20, 2 << 30)] {
        assert!(triangles * size_of::<GpuTriangle>() as u64 <= binding);
        assert!(triangles / 2 * size_of::<GpuVertex>() as u64 <= binding);
        assert!((8.2 * triangles as f64) as u64 <= binding, "nodes");
    }
}

#[test]
fn attributes_come_in_any_format() {
    let integers: Vec<[i16; 4]> =
        SQUARE.iter().map(|p| [p[0], p[1], p[2], 0.0].map(|x| (x * 32767.0) as i16)).collect();
    let build = |values: Values| {
        let mut mesh = Mesh::new(PrimitiveTopology::TriangleStrip, RenderAssetUsages::default());
        let attribute = bevy::mesh::MeshVertexAttribute { format: (&values).into(), ..Mesh::ATTRIBUTE_POSITION };
        mesh.insert_attribute(attribute, values);
        triangles_of(&mesh)
    };
    let expected = triangles_of(&mesh(PrimitiveTopology::TriangleStrip, &SQUARE)).expect("sound").corners();
    assert_eq!(build(Values::Snorm16x4(integers)).expect("read").corners(), expected);
    let wide: Vec<[f32; 4]> = SQUARE.iter().map(|p| [p[0], p[1], p[2], 1.0]).collect();
    assert_eq!(build(Values::Float32x4(wide)).expect("read").corners(), expected);
    assert_eq!(build(Values::Float32x2(CORNERS.to_vec())), Err(GeometryError::PositionFormat("two floats")));
    assert_eq!(build(Values::Uint32x3(vec![[0; 3]; 4])), Err(GeometryError::PositionFormat("integers")));
}

#[test]
fn packed_normals_unpack_to_the_same_normal() {
    let mut random = Random::new(20);
    for _ in 0..10_000 {
        let n = random.direction();
        let error = Vec3::from(n).cross(decode(octahedral_encode(n)).into()).length();
        assert!(error < 1e-4, "{n:?}: {error} rad");
    }
}

#[test]
fn transforms_are_inverted_or_rejected() {
    let mut random = Random::new(21);
    for scale in [1e-4, 1.0, 1e5] {
        for _ in 0..100 {
            let m = random_rows(&mut random, scale, 10.0 * scale);
            let back = inverse(&m).expect("sound");
            for (r, row) in back.iter().enumerate() {
                for c in 0..3 {
                    let one: f32 = m.iter().zip(row).map(|(m, b)| b * m[c]).sum();
                    assert!((one - if r == c { 1.0 } else { 0.0 }).abs() < 1e-4);
                }
            }
        }
    }
    let with = |f: fn(&mut [[f32; 4]; 3])| {
        let mut m = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        f(&mut m);
        inverse(&m)
    };
    assert_eq!(with(|m| m[1][1] = 0.0), None);
    assert_eq!(with(|m| m[2] = m[1]), None);
    assert_eq!(with(|m| m[0][0] = f32::NAN), None);
    assert_eq!(with(|m| m[0][3] = f32::INFINITY), None);
    assert_eq!(with(|m| m.iter_mut().for_each(|r| r[..3].iter_mut().for_each(|x| *x *= 1e-39))), None);
    assert!(with(|m| m[1][1] = -1e-6).is_some());
    let affine = Affine3A::from_scale_rotation_translation(
        Vec3::new(1.0, -2.0, 3.0),
        bevy::math::Quat::from_rotation_y(0.7),
        Vec3::new(4.0, 5.0, 6.0),
    );
    let p = Vec3::new(0.3, 0.2, 0.1);
    let by_rows = rows(&affine).map(|r| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3]);
    assert!((Vec3::from(by_rows) - affine.transform_point3(p)).length() < 1e-6);
}

#[test]
fn world_bounding_boxes_contain_every_corner() {
    let mut random = Random::new(22);
    for scale in [1e-3, 1.0, 1e4] {
        for _ in 0..100 {
            let m = random_rows(&mut random, scale, 1e5);
            let (p, q) = (random.point(2.0), random.point(2.0));
            let bounds = (std::array::from_fn(|k| p[k].min(q[k])), std::array::from_fn(|k| p[k].max(q[k])));
            let world = world_bounds(&m, &bounds).expect("finite");
            for corner in 0..8 {
                for (k, row) in m.iter().enumerate() {
                    let x: f64 = (0..3)
                        .map(|c| f64::from(row[c]) * f64::from(if corner >> c & 1 == 1 { p[c] } else { q[c] }))
                        .sum::<f64>()
                        + f64::from(row[3]);
                    assert!(f64::from(world.0[k]) <= x && x <= f64::from(world.1[k]));
                }
            }
        }
    }
    let huge = [[1e38, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    assert_eq!(world_bounds(&huge, &([-9.0; 3], [9.0; 3])), None);
}

#[test]
fn the_top_level_tree_contains_every_sound_instance_once() {
    let mut random = Random::new(23);
    for count in [0, 1, 2, 77, 5000] {
        let mut boxes: Vec<_> = (0..count)
            .map(|i| {
                let p = random.point(10.0);
                (3 * i, (p, p.map(|x| x + 1.0)))
            })
            .collect();
        boxes.push((1, ([f32::NAN; 3], [1.0; 3])));
        boxes.push((2, ([f32::NEG_INFINITY; 3], [1.0; 3])));
        let tlas = build_tlas(&boxes);
        let mut found: Vec<u32> = tlas.indices.iter().flatten().copied().take(count as usize).collect();
        found.sort_unstable();
        assert_eq!(found, (0..count).map(|i| 3 * i).collect::<Vec<_>>());
        assert_eq!(tlas.nodes.is_empty(), count == 0);
    }
}

#[test]
fn trees_over_the_largest_boxes_contain_every_instance() {
    // Many large boxes make the sums of areas overflow an f32, on which the builder would read beyond an array.
    for (count, half_extent) in [(120, 9e17), (1_000, 3e17), (10_000, 1e17), (3_000, 1e15), (3_000, 1e-18)] {
        let boxes: Vec<_> = (0..count)
            .map(|i| {
                // The boxes overlap, and differ a little.
                let shift = 1e-3 * half_extent * i as f32 / count as f32;
                (i, ([shift - 0.999 * half_extent; 3], [shift + 0.999 * half_extent; 3]))
            })
            .collect();
        let tlas = build_tlas(&boxes);
        let mut found: Vec<u32> = tlas.indices.iter().flatten().copied().take(count as usize).collect();
        found.sort_unstable();
        assert_eq!(found, (0..count).collect::<Vec<_>>(), "{count} boxes of half-extent {half_extent}");
    }
}
