//! Materials and directions for tests of the BSDF, and the kernels that evaluate and sample them.

use super::{
    compose::{Def, flag},
    gpu::{Bound, Gpu, Kernel, wide},
    oracle::bsdf::{LOBES, Lobe, Material},
    stats::Random,
};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Matches `Query` of the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Query {
    n: [f32; 3],
    metallic: f32,
    n_geo: [f32; 3],
    roughness: f32,
    base: [f32; 3],
    transmission: f32,
    f0: [f32; 3],
    eta: f32,
    tangent: [f32; 3],
    roughness_along: f32,
    coat_normal: [f32; 3],
    coat: f32,
    coat_roughness: f32,
    coat_compensation: f32,
    compensation: f32,
    diffuse_transmission: f32,
    thin: u32,
    pad_thin: [u32; 3],
    subsurface: [f32; 3],
    pad_subsurface: u32,
    entry_reflectance: [f32; 3],
    pad_bsdf: u32,
    wo: [f32; 3],
    seed: u32,
    wi: [f32; 3],
    pad: u32,
}

impl Query {
    /// Values are rounded to f32: the oracle must use the material and directions of the query.
    pub fn new(m: &Material, wo: DVec3, wi: DVec3, seed: u32) -> Self {
        let f = |v: DVec3| v.as_vec3().to_array();
        Self {
            n: f(m.n),
            metallic: m.metallic as f32,
            n_geo: f(m.n_geo),
            roughness: m.alpha as f32,
            base: f(m.base),
            transmission: m.transmission as f32,
            f0: f(m.f0_d),
            eta: m.eta as f32,
            tangent: f(m.tangent),
            roughness_along: m.alpha_along as f32,
            coat_normal: f(m.coat_n),
            coat: m.coat as f32,
            coat_roughness: m.coat_alpha as f32,
            coat_compensation: m.coat_compensation as f32,
            compensation: m.compensation as f32,
            diffuse_transmission: m.diffuse_transmission as f32,
            thin: m.thin.into(),
            pad_thin: [0; 3],
            subsurface: f(m.subsurface),
            pad_subsurface: 0,
            entry_reflectance: f(m.entry_f0),
            pad_bsdf: 0,
            wo: f(wo),
            seed,
            wi: f(wi),
            pad: 0,
        }
    }

    pub fn material(&self) -> Material {
        Material {
            n: wide(self.n).normalize(),
            n_geo: wide(self.n_geo).normalize(),
            base: wide(self.base),
            f0_d: wide(self.f0),
            metallic: self.metallic.into(),
            alpha: self.roughness.into(),
            transmission: self.transmission.into(),
            eta: self.eta.into(),
            compensation: self.compensation.into(),
            thin: self.thin != 0,
            diffuse_transmission: self.diffuse_transmission.into(),
            tangent: wide(self.tangent).reject_from(wide(self.n)).normalize(),
            alpha_along: self.roughness_along.into(),
            coat: self.coat.into(),
            coat_alpha: self.coat_roughness.into(),
            coat_n: wide(self.coat_normal).normalize(),
            coat_compensation: self.coat_compensation.into(),
            subsurface: wide(self.subsurface),
            entry_f0: wide(self.entry_reflectance),
        }
    }

    pub fn wo(&self) -> DVec3 {
        wide(self.wo).normalize()
    }

    pub fn wi(&self) -> DVec3 {
        wide(self.wi).normalize()
    }
}

/// Matches `Sample` of the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Sample {
    wi: [f32; 3],
    pub pdf: f32,
    weight: [f32; 3],
    flags: u32,
    ratio: [f32; 3],
    pub eta: f32,
}

impl Sample {
    pub fn wi(&self) -> DVec3 {
        wide(self.wi)
    }

    pub fn weight(&self) -> DVec3 {
        wide(self.weight)
    }

    pub fn ratio(&self) -> DVec3 {
        wide(self.ratio)
    }

    pub fn valid(&self) -> bool {
        self.flags & 32 != 0
    }

    pub fn delta(&self) -> bool {
        self.flags & 16 != 0
    }

    pub fn lobe(&self) -> Lobe {
        LOBES[(self.flags & 15) as usize]
    }
}

/// Shader definitions of every lobe.
pub fn every_lobe() -> Vec<Def> {
    ["TRANSMISSION", "CLEARCOAT", "ANISOTROPY", "DIFFUSE_TRANSMISSION", "THIN_WALL", "SUBSURFACE"].map(flag).to_vec()
}

pub struct Sampler<'g> {
    gpu: &'g Gpu,
    kernel: Kernel<'g>,
}

impl<'g> Sampler<'g> {
    pub fn new(gpu: &'g Gpu, defs: &[Def]) -> Self {
        let defs: Vec<Def> = defs.iter().copied().chain(every_lobe()).collect();
        Self { gpu, kernel: gpu.kernel("bsdf_sample", include_str!("kernels/bsdf_sample.wgsl"), &defs) }
    }

    pub fn run(&self, query: Query, count: usize) -> Vec<Sample> {
        let queries = self.gpu.storage(&[query]);
        let samples = self.gpu.zeroed::<Sample>(count.next_multiple_of(64));
        let bound = [(0, 0, Bound::Buffer(&queries)), (0, 1, Bound::Buffer(&samples))];
        self.kernel.run([count.div_ceil(64) as u32, 1, 1], &bound);
        self.gpu.read(&samples)
    }
}

/// (f, pdf) of every query: of all lobes together, then of each.
pub fn evaluate(gpu: &Gpu, queries: &[Query], defs: &[Def]) -> Vec<[[f32; 4]; 5]> {
    let kernel = gpu.kernel("bsdf_eval", include_str!("kernels/bsdf_eval.wgsl"), defs);
    let input = gpu.storage(queries);
    let output = gpu.zeroed::<[[f32; 4]; 5]>(queries.len());
    kernel.run(
        [queries.len().div_ceil(64) as u32, 1, 1],
        &[(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))],
    );
    gpu.read(&output)
}

/// White Lambert; the base of the other materials.
pub fn plain() -> Material {
    Material {
        n: DVec3::Z,
        n_geo: DVec3::Z,
        base: DVec3::ONE,
        f0_d: DVec3::ZERO,
        metallic: 0.0,
        alpha: 0.25,
        transmission: 0.0,
        eta: 1.5,
        compensation: 0.0,
        thin: false,
        diffuse_transmission: 0.0,
        tangent: DVec3::X,
        alpha_along: 0.25,
        coat: 0.0,
        coat_alpha: 0.25,
        coat_n: DVec3::Z,
        coat_compensation: 0.0,
        subsurface: DVec3::ZERO,
        entry_f0: DVec3::ZERO,
    }
}

/// The same roughness along and across.
fn isotropic(alpha: f64) -> Material {
    Material { alpha, alpha_along: alpha, ..plain() }
}

pub fn coated(alpha: f64) -> Material {
    Material { base: DVec3::new(0.7, 0.4, 0.1), f0_d: DVec3::splat(0.04), ..isotropic(alpha) }
}

pub fn metal(alpha: f64) -> Material {
    Material { base: DVec3::new(0.9, 0.6, 0.2), metallic: 1.0, ..isotropic(alpha) }
}

pub fn glass(alpha: f64, eta: f64) -> Material {
    Material { f0_d: DVec3::splat(0.04), transmission: 1.0, eta, ..isotropic(alpha) }
}

/// Every lobe at once, with normal maps.
pub fn mixture(alpha: f64, eta: f64) -> Material {
    let n = DVec3::new(0.2, -0.1, 0.9).normalize();
    Material {
        base: DVec3::new(0.9, 0.5, 0.3),
        f0_d: DVec3::new(0.08, 0.04, 0.0),
        metallic: 0.3,
        transmission: 0.4,
        n,
        n_geo: DVec3::new(0.1, 0.05, 0.95).normalize(),
        eta,
        tangent: DVec3::X.reject_from(n).normalize(),
        ..isotropic(alpha)
    }
}

/// Brushed along y, so that the highlight is stretched along x.
pub fn brushed(along: f64, across: f64) -> Material {
    Material { alpha_along: along, ..metal(across) }
}

/// A tinted thin wall.
pub fn pane(alpha: f64) -> Material {
    Material { base: DVec3::new(0.9, 0.6, 0.4), thin: true, ..glass(alpha, 1.0) }
}

/// A leaf that transmits this share of its diffuse light.
pub fn leaf(share: f64) -> Material {
    Material { diffuse_transmission: share, ..coated(0.3) }
}

/// A leaf with light below its surface.
pub fn fleshy(share: f64) -> Material {
    Material { subsurface: DVec3::new(0.9, 0.6, 0.3), ..leaf(share) }
}

/// A place where light enters a body.
pub fn entry() -> Material {
    Material { alpha: 1.0, alpha_along: 1.0, entry_f0: DVec3::splat(0.04), ..plain() }
}

/// The same material under a clear coat.
pub fn varnished(m: Material, coat: f64, alpha: f64) -> Material {
    let bent = (m.n + DVec3::new(-0.1, 0.15, 0.0)).normalize();
    Material { coat, coat_alpha: alpha, coat_n: bent, ..m }
}

/// [`mixture`] with a coat, anisotropy and diffuse transmission, as a thin wall or a body.
pub fn everything(alpha: f64, eta: f64, thin: bool) -> Material {
    let m = mixture(alpha, if thin { 1.0 } else { eta });
    varnished(Material { thin, diffuse_transmission: 0.6, alpha_along: 0.5 + 0.5 * alpha, ..m }, 0.8, 0.15)
}

/// A direction at an angle to the normal, in degrees.
pub fn at_angle(m: &Material, degrees: f64) -> DVec3 {
    let (t, b) = m.n.any_orthonormal_pair();
    let (s, c) = degrees.to_radians().sin_cos();
    c * m.n + s * (0.6 * t + 0.8 * b)
}

/// Random materials, including the extremes of every parameter.
pub fn random_material(r: &mut Random) -> Material {
    let n = r.direction();
    let bent = |r: &mut Random| (n + 0.2 * r.unit() * r.direction()).normalize();
    let ior = r.pick(&[1.0, 1.01, 1.33, 1.5, 2.4]);
    let color = |r: &mut Random| DVec3::new(r.unit(), r.unit(), r.unit()) * r.pick(&[0.0, 1.0, 1.0]);
    let random = r.unit();
    let eta = if r.unit() < 0.5 { ior } else { 1.0 / ior };
    let thin = r.unit() < 0.3;
    let strength = r.pick(&[0.0, 0.0, 0.3, 1.0, random]);
    let mut alpha = r.pick(&[1e-4, 9e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0, random.max(1e-4)]);
    let mut alpha_along = alpha + (1.0 - alpha) * strength * strength;
    if strength > 0.0 {
        (alpha, alpha_along) = (alpha.max(1e-3), alpha_along.max(1e-3));
    }
    Material {
        n,
        n_geo: if r.unit() < 0.5 { n } else { bent(r) },
        base: if r.unit() < 0.2 { DVec3::ONE } else { color(r) },
        f0_d: r.pick(&[DVec3::ZERO, DVec3::splat(0.04), DVec3::ONE, DVec3::new(0.0, 0.02, 0.16)]),
        metallic: r.pick(&[0.0, 0.0, 1.0, random]),
        alpha,
        transmission: r.pick(&[0.0, 1.0, random]),
        eta: if thin { 1.0 } else { eta },
        compensation: 0.0,
        thin,
        diffuse_transmission: r.pick(&[0.0, 0.0, 1.0, random]),
        tangent: r.direction().reject_from(n).normalize(),
        alpha_along,
        coat: r.pick(&[0.0, 0.0, 1.0, random]),
        coat_alpha: r.pick(&[1e-4, 9e-4, 1e-3, 1e-2, 0.1, 1.0, random.max(1e-4)]),
        coat_n: if r.unit() < 0.5 { n } else { bent(r) },
        coat_compensation: 0.0,
        subsurface: if r.unit() < 0.5 { DVec3::ZERO } else { color(r) },
        entry_f0: r.pick(&[DVec3::ZERO, DVec3::ZERO, DVec3::splat(0.04), DVec3::ONE]),
    }
}
