//! Ray origins are offset by a bound on rounding: a ray that leaves a convex body hits neither its own triangle nor the rest of the body.

use crate::support::{
    compose::Def,
    gpu::{Gpu, back_ends},
    scenes::*,
};
use bevy_restir::testing::gpu_layout::Rows;

const OFFSET: &str = include_str!("../support/kernels/offset.wgsl");

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Pair {
    triangle: [u32; 4],
    barycentrics: [f32; 4],
    direction: [f32; 3],
    factor: f32,
}

#[test]
fn offset_points_leave_their_surface_at_every_scale() {
    for (gpu, backend) in back_ends() {
        offset_points_leave_their_surface(gpu, &backend);
    }
}

fn offset_points_leave_their_surface(gpu: &Gpu, backend: &[Def]) {
    let kernel = gpu.kernel("offset", OFFSET, backend);
    let mut random = Random::new(8);
    let (mut failed, mut planted) = (0, 0);
    for scale in [1e-4f32, 1e-2, 1.0, 1e2, 1e5] {
        for translation in [0.0f32, 1.0, 1e3, 1e5] {
            for in_mesh in [false, true] {
                let place = |p: [f32; 3]| if in_mesh { p.map(|x| x * scale + translation) } else { p };
                let mesh = sphere(10, 12, 0.0, place);
                // The transform rotates and stretches.
                let mut rows = random_rows(&mut random, scale, 0.0);
                (0..3).for_each(|k| rows[k][3] = [translation, -translation, 0.7 * translation][k]);
                if in_mesh {
                    rows = identity();
                }
                // Where f32 cannot separate the vertices of the mesh, there is no surface to leave.
                if in_mesh && scale < translation * 1e-4 {
                    continue;
                }
                let count = mesh.triangles.len();
                let scene = TestScene::new(&[mesh], &[(0, rows, 0, 0)]);
                let mirrored = determinant(&rows) < 0.0;
                let corner = |random: &mut Random| {
                    let (u, v) = (random.unit(), random.unit());
                    if u + v < 1.0 { [u, v] } else { [1.0 - u, 1.0 - v] }
                };
                let mut pairs: Vec<Pair> = (0..1500)
                    .map(|_| {
                        let (a, b) = (random.below(count) as u32, random.below(count) as u32);
                        let ([u, v], [s, t]) = (corner(&mut random), corner(&mut random));
                        let direction = random.direction();
                        Pair { triangle: [0, a, 0, b], barycentrics: [u, v, s, t], direction, factor: 1.0 }
                    })
                    .collect();
                let answers: Vec<[u32; 4]> = scene.run(gpu, &kernel, &pairs);
                let itself = answers.iter().filter(|a| a[0] != 0).count();
                // If the translation is far larger than the body, f32 cannot represent points inside of it.
                let resolved = scale > translation * 1e-4;
                let blocked = if resolved { answers.iter().filter(|a| a[1] != 0).count() } else { 0 };
                let largest = answers.iter().map(|a| f32::from_bits(a[2])).fold(0.0, f32::max);
                if itself + blocked > 0 || scale == 1.0 {
                    eprintln!(
                        "scale {scale:e}, at {translation:e}, in mesh {in_mesh}, mirrored {mirrored}: {itself} hit themselves, {blocked} blocked, offset <= {largest:e}"
                    );
                }
                failed += itself + blocked;
                // Without the offset, rays hit their own surface.
                pairs.iter_mut().for_each(|p| p.factor = 0.0);
                let answers: Vec<[u32; 4]> = scene.run(gpu, &kernel, &pairs);
                planted += answers.iter().filter(|a| a[0] != 0).count();
            }
        }
    }
    assert_eq!(failed, 0);
    assert!(planted > 500, "the test cannot fail: only {planted} rays need the offset");
}

fn determinant(m: &Rows) -> f32 {
    m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
}
