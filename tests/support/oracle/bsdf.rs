//! Design 2's material in f64: `diel`, `trans` and `metal` mixed as written there, and the density of our sampler.

use glam::DVec3;
use std::f64::consts::PI;

pub const ALPHA_DELTA: f64 = 1e-3;
const SPREAD_DELTA: f64 = 2e-5;

/// `Bsdf` of `shaders/bsdf/types.wgsl`.
#[derive(Clone, Copy, Debug)]
pub struct Material {
    pub n: DVec3,
    pub n_geo: DVec3,
    pub base: DVec3,
    pub f0_d: DVec3,
    pub metallic: f64,
    pub alpha: f64,
    pub transmission: f64,
    /// Index on the far side over the index on wo's.
    pub eta: f64,
    /// Turquin's (1 - E)/E at wo; 0 without energy compensation.
    pub compensation: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    Diffuse,
    Reflection,
    Transmission,
}

pub const LOBES: [Lobe; 3] = [Lobe::Diffuse, Lobe::Reflection, Lobe::Transmission];

fn schlick(f0: DVec3, c: f64) -> DVec3 {
    let one = |f0: f64| {
        if f0 == 0.0 { 0.0 } else { f0 + (1.0 - f0) * (1.0 - c).powi(5) }
    };
    DVec3::new(one(f0.x), one(f0.y), one(f0.z))
}

/// Fresnel's equations between indices 1 and `eta`, unpolarised.
pub fn fresnel(c: f64, eta: f64) -> f64 {
    let sin_t = (1.0 - c * c).max(0.0).sqrt() / eta;
    if eta == 1.0 {
        return 0.0;
    }
    if sin_t >= 1.0 {
        return 1.0;
    }
    let t = (1.0 - sin_t * sin_t).sqrt();
    let s = (c - eta * t) / (c + eta * t);
    let p = (eta * c - t) / (eta * c + t);
    (s * s + p * p) / 2.0
}

fn d_ggx(n_h: f64, alpha: f64) -> f64 {
    if n_h <= 0.0 {
        return 0.0;
    }
    let tan2 = (1.0 - n_h * n_h).max(0.0) / (n_h * n_h);
    1.0 / (PI * alpha * alpha * n_h.powi(4) * (1.0 + tan2 / (alpha * alpha)).powi(2))
}

fn lambda(n_w: f64, alpha: f64) -> f64 {
    let tan2 = (1.0 - n_w * n_w).max(0.0) / (n_w * n_w);
    ((1.0 + alpha * alpha * tan2).sqrt() - 1.0) / 2.0
}

fn luminance(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

impl Material {
    fn same_side(&self, wo: DVec3, wi: DVec3) -> Option<bool> {
        let up = |w: DVec3| self.n.dot(w) > 0.0;
        let up_geo = |w: DVec3| self.n_geo.dot(w) > 0.0;
        (up(wo) && up_geo(wo) && up(wi) == up_geo(wi) && self.n.dot(wi) != 0.0).then(|| up(wi))
    }

    pub fn is_delta(&self, lobe: Lobe) -> bool {
        match lobe {
            Lobe::Diffuse => false,
            Lobe::Reflection => self.alpha < ALPHA_DELTA,
            Lobe::Transmission => self.alpha < ALPHA_DELTA || self.alpha * (self.eta - 1.0).abs() < SPREAD_DELTA,
        }
    }

    /// Fresnel's share of light that leaves a microfacet by reflection: (1-m)[(1-T)F + T Fx] + m schlick(base).
    pub fn reflected(&self, c: f64) -> DVec3 {
        let gain = |f0: DVec3| DVec3::ONE + f0 * self.compensation;
        let at_normal = DVec3::splat(((self.eta - 1.0) / (self.eta + 1.0)).powi(2));
        let diel = schlick(self.f0_d, c) * gain(self.f0_d) * (1.0 - self.transmission)
            + self.transmission * fresnel(c, self.eta) * gain(at_normal);
        diel.lerp(schlick(self.base, c) * gain(self.base), self.metallic)
    }

    /// By refraction: (1-m) T (1-Fx) base.
    pub fn refracted(&self, c: f64) -> DVec3 {
        let trans = self.base * (1.0 - fresnel(c, self.eta)) * self.transmission;
        trans.lerp(DVec3::ZERO, self.metallic)
    }

    /// h of a refraction, with Walter's `ht = -(η_i i + η_o o)` turned up.
    fn refraction_h(&self, wo: DVec3, wi: DVec3) -> DVec3 {
        let ht = -(wi * self.eta + wo).normalize_or_zero();
        if ht.dot(self.n) < 0.0 { -ht } else { ht }
    }

    /// f·|n.wi|; 0 of a delta.
    pub fn eval(&self, wo: DVec3, wi: DVec3, lobe: Lobe) -> DVec3 {
        let Some(same) = self.same_side(wo, wi) else {
            return DVec3::ZERO;
        };
        let (n_o, n_i) = (self.n.dot(wo).abs(), self.n.dot(wi).abs());
        if self.is_delta(lobe) || same == (lobe == Lobe::Transmission) {
            return DVec3::ZERO;
        }
        let g2 = 1.0 / (1.0 + lambda(n_o, self.alpha) + lambda(n_i, self.alpha));
        match lobe {
            Lobe::Diffuse => {
                let h = (wo + wi).normalize();
                let f = schlick(self.f0_d, wo.dot(h).abs());
                (1.0 - self.metallic) * (1.0 - self.transmission) * (DVec3::ONE - f) * self.base / PI * n_i
            }
            Lobe::Reflection => {
                let h = (wo + wi).normalize();
                let spec = d_ggx(self.n.dot(h), self.alpha) * g2 / (4.0 * n_i * n_o);
                self.reflected(wo.dot(h).abs()) * spec * n_i
            }
            Lobe::Transmission => {
                // Indices 1 on wo's side and eta on wi's.
                let h = self.refraction_h(wo, wi);
                let (o_h, i_h) = (wo.dot(h), wi.dot(h));
                if o_h <= 0.0 || i_h >= 0.0 {
                    return DVec3::ZERO;
                }
                let walter = (i_h * o_h).abs() / (n_i * n_o) * g2 * d_ggx(self.n.dot(h), self.alpha)
                    / (self.eta * i_h + o_h).powi(2);
                self.refracted(o_h) * walter * n_i
            }
        }
    }

    pub fn eval_all(&self, wo: DVec3, wi: DVec3) -> DVec3 {
        LOBES.iter().map(|&lobe| self.eval(wo, wi, lobe)).sum()
    }

    /// Probability of microfacets against diffuse.
    pub fn p_microfacet(&self, n_o: f64) -> f64 {
        let albedo = (1.0 - self.metallic) * (1.0 - self.transmission) * self.base;
        if albedo.max_element() <= 0.0 {
            return 1.0;
        }
        if self.f0_d.max(self.metallic * self.base).max_element().max(self.transmission) <= 0.0 {
            return 0.0;
        }
        let diffuse = luminance(albedo * (DVec3::ONE - schlick(self.f0_d, n_o)));
        let micro = luminance(self.reflected(n_o) + self.refracted(n_o));
        (micro / (micro + diffuse)).clamp(0.05, 0.95)
    }

    /// Probability that a microfacet seen at cosine c reflects.
    pub fn p_reflect(&self, c: f64) -> f64 {
        let (r, t) = (luminance(self.reflected(c)), luminance(self.refracted(c)));
        if t > 0.0 { r / (r + t) } else { 1.0 }
    }

    /// Joint density of the lobe and wi, solid angle; 0 of a delta.
    pub fn pdf(&self, wo: DVec3, wi: DVec3, lobe: Lobe) -> f64 {
        let Some(same) = self.same_side(wo, wi) else { return 0.0 };
        if self.is_delta(lobe) || same == (lobe == Lobe::Transmission) {
            return 0.0;
        }
        let (n_o, n_i) = (self.n.dot(wo), self.n.dot(wi).abs());
        let visible =
            |h: DVec3| d_ggx(self.n.dot(h), self.alpha) * wo.dot(h).max(0.0) / (1.0 + lambda(n_o, self.alpha)) / n_o;
        let p = self.p_microfacet(n_o);
        match lobe {
            Lobe::Diffuse => (1.0 - p) * n_i / PI,
            Lobe::Reflection => {
                let h = (wo + wi).normalize();
                p * self.p_reflect(wo.dot(h)) * visible(h) / (4.0 * wo.dot(h))
            }
            Lobe::Transmission => {
                let h = self.refraction_h(wo, wi);
                let (o_h, i_h) = (wo.dot(h), wi.dot(h));
                if o_h <= 0.0 || i_h >= 0.0 {
                    return 0.0;
                }
                let jacobian = self.eta.powi(2) * i_h.abs() / (o_h + self.eta * i_h).powi(2);
                p * (1.0 - self.p_reflect(o_h)) * visible(h) * jacobian
            }
        }
    }

    pub fn pdf_all(&self, wo: DVec3, wi: DVec3) -> f64 {
        LOBES.iter().map(|&lobe| self.pdf(wo, wi, lobe)).sum()
    }

    /// Where a mirror or a smooth interface sends wo; `None` at total reflection.
    pub fn delta_direction(&self, wo: DVec3, lobe: Lobe) -> Option<DVec3> {
        let c = self.n.dot(wo);
        match lobe {
            Lobe::Diffuse => None,
            Lobe::Reflection => Some(2.0 * c * self.n - wo),
            Lobe::Transmission => {
                let tangent = -(wo - c * self.n) / self.eta;
                let sin2 = tangent.length_squared();
                (sin2 < 1.0).then(|| tangent - (1.0 - sin2).sqrt() * self.n)
            }
        }
    }
}
