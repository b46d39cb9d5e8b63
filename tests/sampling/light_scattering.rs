//! A light path scatters light at a surface as a path from the camera does that goes the other way: rough glass has one value in both
//! directions, and smooth glass scales radiance, but not the power that a light path carries.

use crate::support::{
    compose::flag,
    gpu::{Bound, Gpu, gpu, wide},
    materials::{Query, coated, glass, leaf, metal, mixture, pane},
    oracle::bsdf::{LOBES, Lobe, Material},
    stats::Random,
};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Answer {
    light: [f32; 3],
    lobe: u32,
    camera: [f32; 3],
    cosine: f32,
    light_delta: [f32; 3],
    pad_a: u32,
    camera_delta: [f32; 3],
    pad_b: u32,
}

/// Both values of each material for random directions to the camera, above the surface, and to the light, on either side.
fn answers(gpu: &Gpu, materials: &[Material], count: usize) -> Vec<(Query, Answer)> {
    let mut random = Random(9);
    let queries: Vec<Query> = (0..count)
        .map(|i| {
            let m = &materials[i % materials.len()];
            let above = loop {
                let d = random.direction();
                if m.n.dot(d) > 0.02 && m.n_geo.dot(d) > 0.02 {
                    break d;
                }
            };
            Query::new(m, above, random.direction(), 3)
        })
        .collect();
    let defs = ["TRANSMISSION", "CLEARCOAT", "DIFFUSE_TRANSMISSION", "THIN_WALL"].map(flag);
    let kernel = gpu.kernel("light_scattering", include_str!("../support/kernels/light_scattering.wgsl"), &defs);
    let (input, output) = (gpu.storage(&queries), gpu.zeroed::<Answer>(count));
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    kernel.run([(count as u32).div_ceil(64), 1, 1], &bound);
    queries.into_iter().zip(gpu.read::<Answer>(&output)).collect()
}

fn assert_near(a: [f32; 3], b: [f32; 3], what: &(Query, Answer)) {
    let (a, b) = (wide(a), wide(b));
    assert!((a - b).abs().max_element() <= 2e-3 * b.max_element() + 1e-5, "{a} and {b}: {what:?}");
}

#[test]
fn light_paths_scatter_like_paths_from_the_camera() {
    let Some(gpu) = gpu() else { return };
    let inverse = 1.0 / 1.5;
    let rough = [
        coated(0.3),
        metal(0.3),
        glass(0.3, 1.5),
        glass(0.3, inverse),
        pane(0.3),
        leaf(0.4),
        mixture(0.3, 1.5),
        mixture(0.3, inverse),
    ];
    let mut through = 0;
    for found in answers(gpu, &rough, 40_000) {
        let (q, a) = &found;
        // Next to an edge-on direction the two sides of a surface are a matter of rounding.
        let m = q.material();
        if [m.n, m.n_geo].iter().any(|n| n.dot(q.wi()).abs() < 0.02) {
            continue;
        }
        assert_near(a.light, a.camera, &found);
        through += u32::from(m.n.dot(q.wi()) < 0.0 && wide(a.camera).max_element() > 0.0);
    }
    assert!(through > 4_000, "{through} values of transmission");

    let smooth = [metal(1e-4), coated(5e-4), glass(1e-4, 1.5), glass(1e-4, inverse), pane(1e-4)];
    let mut drawn = [0; LOBES.len()];
    for found in answers(gpu, &smooth, 20_000) {
        let (q, a) = &found;
        if a.lobe > 0 && q.wi().dot(DVec3::Z).abs() > 0.02 {
            assert!(a.cosine > 0.9999, "the way back goes elsewhere: {found:?}");
            assert_near(a.light_delta, a.camera_delta, &found);
            drawn[a.lobe as usize - 1] += 1;
        }
    }
    let [reflected, refracted] = [Lobe::Reflection, Lobe::Transmission].map(|lobe| drawn[lobe as usize]);
    assert!(reflected > 2_000 && refracted > 2_000, "{reflected} reflections and {refracted} refractions");
}
