//! The material in f64, after glTF 2.0 (Appendix B and the KHR extensions): a mix of dielectric, transmission and metal under a coat; and
//! the density of our sampler.

use glam::DVec3;
use std::f64::consts::PI;

pub const ALPHA_DELTA: f64 = 1e-3;
const SPREAD_DELTA: f64 = 2e-5;
const COS_VIEWER_MIN: f64 = 1e-4;

/// Matches `Bsdf` of `shaders/bsdf/types.wgsl`.
#[derive(Clone, Copy, Debug)]
pub struct Material {
    pub n: DVec3,
    pub n_geo: DVec3,
    pub base: DVec3,
    pub f0_d: DVec3,
    pub metallic: f64,
    pub alpha: f64,
    pub transmission: f64,
    /// The index of refraction on the far side divided by that on wo's side.
    pub eta: f64,
    /// Turquin's (1 - E)/E at wo; 0 without energy compensation.
    pub compensation: f64,
    /// A thin wall: `eta` is 1.
    pub thin: bool,
    pub diffuse_transmission: f64,
    /// The direction in the plane of n with roughness `alpha_along`; across it is `alpha`.
    pub tangent: DVec3,
    pub alpha_along: f64,
    pub coat: f64,
    pub coat_alpha: f64,
    pub coat_n: DVec3,
    pub coat_compensation: f64,
    /// The share of reflected diffuse light that scatters below the surface.
    pub subsurface: DVec3,
    /// The reflectance at normal incidence of the interface that light crosses to enter a body.
    pub entry_f0: DVec3,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    Diffuse,
    Reflection,
    Transmission,
    Coat,
}

pub const LOBES: [Lobe; 4] = [Lobe::Diffuse, Lobe::Reflection, Lobe::Transmission, Lobe::Coat];

fn schlick(f0: DVec3, c: f64) -> DVec3 {
    let one = |f0: f64| {
        if f0 == 0.0 { 0.0 } else { f0 + (1.0 - f0) * (1.0 - c).powi(5) }
    };
    DVec3::new(one(f0.x), one(f0.y), one(f0.z))
}

/// Unpolarized Fresnel reflectance between indices 1 and `eta`.
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

/// A direction by its squared cosines: to the normal, and, relative to the sine, to the tangent and the bitangent.
struct Angles {
    cos: f64,
    cos_phi2: f64,
    sin_phi2: f64,
}

impl Angles {
    fn tan2(&self) -> f64 {
        (1.0 - self.cos * self.cos).max(0.0) / (self.cos * self.cos)
    }
}

fn d_ggx(h: &Angles, along: f64, across: f64) -> f64 {
    if h.cos <= 0.0 {
        return 0.0;
    }
    let stretched = h.tan2() * (h.cos_phi2 / along.powi(2) + h.sin_phi2 / across.powi(2));
    1.0 / (PI * along * across * h.cos.powi(4) * (1.0 + stretched).powi(2))
}

fn lambda(w: &Angles, along: f64, across: f64) -> f64 {
    let alpha2 = w.cos_phi2 * along.powi(2) + w.sin_phi2 * across.powi(2);
    ((1.0 + alpha2 * w.tan2()).sqrt() - 1.0) / 2.0
}

/// w mirrored at the plane of n.
fn mirrored(w: DVec3, n: DVec3) -> DVec3 {
    w - 2.0 * n.dot(w) * n
}

fn luminance(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

impl Material {
    /// With the normal as wo sees it: bent towards wo where it points away, unless light is refracted.
    fn towards(&self, wo: DVec3) -> Self {
        let c = self.n.dot(wo);
        if c >= COS_VIEWER_MIN || self.transmission > 0.0 {
            return *self;
        }
        let n = (self.n + (COS_VIEWER_MIN - c) * wo).normalize();
        Self { n, tangent: (self.tangent - self.tangent.dot(n) * n).normalize(), ..*self }
    }

    fn same_side(&self, wo: DVec3, wi: DVec3) -> Option<bool> {
        let up = |w: DVec3| self.n.dot(w) > 0.0;
        let up_geo = |w: DVec3| self.n_geo.dot(w) > 0.0;
        (up(wo) && up_geo(wo) && up(wi) == up_geo(wi) && self.n.dot(wi) != 0.0).then(|| up(wi))
    }

    fn angles(&self, w: DVec3) -> Angles {
        let (t, b) = (self.tangent.dot(w).powi(2), self.n.cross(self.tangent).dot(w).powi(2));
        let share = |x: f64| if t + b > 0.0 { x / (t + b) } else { 0.5 };
        Angles { cos: self.n.dot(w).abs(), cos_phi2: share(t), sin_phi2: share(b) }
    }

    fn coat_angles(&self, w: DVec3) -> Angles {
        Angles { cos: self.coat_n.dot(w).abs(), cos_phi2: 0.5, sin_phi2: 0.5 }
    }

    fn d(&self, h: DVec3) -> f64 {
        d_ggx(&self.angles(h), self.alpha_along, self.alpha)
    }

    fn lambda(&self, w: DVec3) -> f64 {
        lambda(&self.angles(w), self.alpha_along, self.alpha)
    }

    /// Whether the coat's microfacets face both directions.
    fn coat_carries(&self, wo: DVec3, wi: DVec3) -> bool {
        self.coat > 0.0 && [self.coat_n, self.n_geo].iter().all(|n| n.dot(wo) > 0.0 && n.dot(wi) > 0.0)
    }

    /// cc · Fc.
    pub fn coat_share(&self, wo: DVec3) -> f64 {
        self.coat * schlick(DVec3::splat(0.04), self.coat_n.dot(wo).abs()).x
    }

    pub fn coat_reflected(&self, wo: DVec3) -> f64 {
        self.coat_share(wo) * (1.0 + 0.04 * self.coat_compensation)
    }

    pub fn is_delta(&self, lobe: Lobe) -> bool {
        match lobe {
            Lobe::Diffuse => false,
            Lobe::Reflection => self.alpha < ALPHA_DELTA,
            Lobe::Transmission if self.thin => self.alpha < ALPHA_DELTA,
            Lobe::Transmission => self.alpha < ALPHA_DELTA || self.alpha * (self.eta - 1.0).abs() < SPREAD_DELTA,
            Lobe::Coat => self.coat_alpha < ALPHA_DELTA,
        }
    }

    /// The Fresnel reflectance of the transmitting interface.
    fn interface(&self, c: f64) -> DVec3 {
        if self.thin { schlick(self.f0_d, c) } else { DVec3::splat(fresnel(c, self.eta)) }
    }

    /// The Fresnel share of reflected light at a microfacet: (1-m)[(1-T)F + T Fx] + m schlick(base).
    pub fn reflected(&self, c: f64) -> DVec3 {
        let gain = |f0: DVec3| DVec3::ONE + f0 * self.compensation;
        let at_normal = if self.thin { self.f0_d } else { DVec3::splat(((self.eta - 1.0) / (self.eta + 1.0)).powi(2)) };
        let diel = schlick(self.f0_d, c) * gain(self.f0_d) * (1.0 - self.transmission)
            + self.transmission * self.interface(c) * gain(at_normal);
        diel.lerp(schlick(self.base, c) * gain(self.base), self.metallic)
    }

    /// The share of transmitted light: (1-m) T (1-Fx) base.
    pub fn refracted(&self, c: f64) -> DVec3 {
        let trans = self.base * (DVec3::ONE - self.interface(c)) * self.transmission;
        trans.lerp(DVec3::ZERO, self.metallic)
    }

    /// The half vector of a refraction: Walter's `ht = -(η_i i + η_o o)`, flipped to the upper side.
    fn refraction_h(&self, wo: DVec3, wi: DVec3) -> DVec3 {
        let ht = -(wi * self.eta + wo).normalize_or_zero();
        if ht.dot(self.n) < 0.0 { -ht } else { ht }
    }

    /// The length of the shortest vector that any lobe normalizes to its half vector.
    pub fn half_length(&self, wo: DVec3, wi: DVec3) -> f64 {
        let of_body = match self.n.dot(wi) > 0.0 {
            true => wo + wi,
            false if self.thin => wo + mirrored(wi, self.n),
            false => wo + self.eta * wi,
        };
        of_body.length().min((wo + wi).length().max(if self.coat > 0.0 { 0.0 } else { 2.0 }))
    }

    /// f·|n.wi|; 0 for delta lobes.
    pub fn eval(&self, wo: DVec3, wi: DVec3, lobe: Lobe) -> DVec3 {
        if lobe == Lobe::Coat {
            if self.is_delta(lobe) || !self.coat_carries(wo, wi) {
                return DVec3::ZERO;
            }
            let [o, i, h] = [wo, wi, (wo + wi).normalize()].map(|w| self.coat_angles(w));
            let alpha = self.coat_alpha;
            let g2 = 1.0 / (1.0 + lambda(&o, alpha, alpha) + lambda(&i, alpha, alpha));
            return DVec3::splat(self.coat_reflected(wo) * d_ggx(&h, alpha, alpha) * g2 / (4.0 * o.cos));
        }
        (1.0 - self.coat_share(wo)) * self.towards(wo).eval_body(wo, wi, lobe)
    }

    fn eval_body(&self, wo: DVec3, wi: DVec3, lobe: Lobe) -> DVec3 {
        let Some(same) = self.same_side(wo, wi) else {
            return DVec3::ZERO;
        };
        let (n_o, n_i) = (self.n.dot(wo).abs(), self.n.dot(wi).abs());
        if self.is_delta(lobe) {
            return DVec3::ZERO;
        }
        let g2 = 1.0 / (1.0 + self.lambda(wo) + self.lambda(wi));
        match (lobe, same) {
            (Lobe::Diffuse, _) => {
                let (wi, share) = match same {
                    true => (wi, (1.0 - self.diffuse_transmission) * (DVec3::ONE - self.subsurface)),
                    false => (mirrored(wi, self.n), DVec3::splat(self.diffuse_transmission)),
                };
                let f = schlick(self.f0_d, wo.dot((wo + wi).normalize()).abs());
                let entry = DVec3::ONE - schlick(self.entry_f0, n_i);
                (1.0 - self.metallic) * (1.0 - self.transmission) * (DVec3::ONE - f) * entry * self.base / PI
                    * share
                    * n_i
            }
            (Lobe::Reflection, true) => {
                let h = (wo + wi).normalize();
                self.reflected(wo.dot(h).abs()) * self.d(h) * g2 / (4.0 * n_i * n_o) * n_i
            }
            (Lobe::Transmission, false) if self.thin => {
                let h = (wo + mirrored(wi, self.n)).normalize();
                self.refracted(wo.dot(h).abs()) * self.d(h) * g2 / (4.0 * n_i * n_o) * n_i
            }
            (Lobe::Transmission, false) => {
                // The indices are 1 on wo's side and eta on wi's.
                let h = self.refraction_h(wo, wi);
                let (o_h, i_h) = (wo.dot(h), wi.dot(h));
                if o_h <= 0.0 || i_h >= 0.0 {
                    return DVec3::ZERO;
                }
                let walter = (i_h * o_h).abs() / (n_i * n_o) * g2 * self.d(h) / (self.eta * i_h + o_h).powi(2);
                self.refracted(o_h) * walter * n_i
            }
            _ => DVec3::ZERO,
        }
    }

    pub fn eval_all(&self, wo: DVec3, wi: DVec3) -> DVec3 {
        LOBES.iter().map(|&lobe| self.eval(wo, wi, lobe)).sum()
    }

    /// Diffuse light that stays at the surface, on both sides.
    fn diffuse_albedo(&self) -> DVec3 {
        let stays = DVec3::ONE - (1.0 - self.diffuse_transmission) * self.subsurface;
        (1.0 - self.metallic) * (1.0 - self.transmission) * self.base * stays
    }

    /// The probability that the diffuse lobe reflects.
    fn p_same_side(&self) -> f64 {
        let same = (1.0 - self.diffuse_transmission) * (1.0 - self.subsurface.min_element());
        let both = same + self.diffuse_transmission;
        if both > 0.0 { same / both } else { 0.0 }
    }

    /// The probability to sample microfacets rather than the diffuse lobe.
    pub fn p_microfacet(&self, n_o: f64) -> f64 {
        let albedo = self.diffuse_albedo();
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

    /// The probability that a microfacet seen at cosine c reflects.
    pub fn p_reflect(&self, c: f64) -> f64 {
        let (r, t) = (luminance(self.reflected(c)), luminance(self.refracted(c)));
        if t > 0.0 { r / (r + t) } else { 1.0 }
    }

    /// The probability to sample the coat.
    pub fn p_coat(&self, wo: DVec3) -> f64 {
        if self.coat <= 0.0 || self.coat_n.dot(wo) <= 0.0 || self.n_geo.dot(wo) <= 0.0 {
            return 0.0;
        }
        let n_o = self.towards(wo).n.dot(wo);
        let diffuse = self.diffuse_albedo();
        let black = self.f0_d.max(self.metallic * self.base).max_element().max(self.transmission) <= 0.0
            && diffuse.max_element() <= 0.0;
        if n_o <= 0.0 || black {
            return 1.0;
        }
        let body =
            luminance(diffuse * (DVec3::ONE - schlick(self.f0_d, n_o)) + self.reflected(n_o) + self.refracted(n_o));
        let coat = self.coat_reflected(wo);
        (coat / (coat + (1.0 - self.coat_share(wo)) * body)).clamp(0.05, 0.95)
    }

    /// The joint density of the lobe and wi in solid angle; 0 for delta lobes.
    pub fn pdf(&self, wo: DVec3, wi: DVec3, lobe: Lobe) -> f64 {
        if self.is_delta(lobe) {
            return 0.0;
        }
        if lobe == Lobe::Coat {
            if !self.coat_carries(wo, wi) {
                return 0.0;
            }
            let [o, h] = [wo, (wo + wi).normalize()].map(|w| self.coat_angles(w));
            let alpha = self.coat_alpha;
            return self.p_coat(wo) * d_ggx(&h, alpha, alpha) / (1.0 + lambda(&o, alpha, alpha)) / (4.0 * o.cos);
        }
        (1.0 - self.p_coat(wo)) * self.towards(wo).pdf_body(wo, wi, lobe)
    }

    fn pdf_body(&self, wo: DVec3, wi: DVec3, lobe: Lobe) -> f64 {
        let Some(same) = self.same_side(wo, wi) else { return 0.0 };
        let (n_o, n_i) = (self.n.dot(wo), self.n.dot(wi).abs());
        let visible = |h: DVec3| self.d(h) * wo.dot(h).max(0.0) / (1.0 + self.lambda(wo)) / n_o;
        let p = self.p_microfacet(n_o);
        match (lobe, same) {
            (Lobe::Diffuse, true) => (1.0 - p) * self.p_same_side() * n_i / PI,
            (Lobe::Diffuse, false) => (1.0 - p) * (1.0 - self.p_same_side()) * n_i / PI,
            (Lobe::Reflection, true) => {
                let h = (wo + wi).normalize();
                p * self.p_reflect(wo.dot(h)) * visible(h) / (4.0 * wo.dot(h))
            }
            (Lobe::Transmission, false) if self.thin => {
                let h = (wo + mirrored(wi, self.n)).normalize();
                p * (1.0 - self.p_reflect(wo.dot(h))) * visible(h) / (4.0 * wo.dot(h))
            }
            (Lobe::Transmission, false) => {
                let h = self.refraction_h(wo, wi);
                let (o_h, i_h) = (wo.dot(h), wi.dot(h));
                if o_h <= 0.0 || i_h >= 0.0 {
                    return 0.0;
                }
                let jacobian = self.eta.powi(2) * i_h.abs() / (o_h + self.eta * i_h).powi(2);
                p * (1.0 - self.p_reflect(o_h)) * visible(h) * jacobian
            }
            _ => 0.0,
        }
    }

    pub fn pdf_all(&self, wo: DVec3, wi: DVec3) -> f64 {
        LOBES.iter().map(|&lobe| self.pdf(wo, wi, lobe)).sum()
    }

    /// The direction in which a mirror or a smooth interface sends wo; `None` at total internal reflection.
    pub fn delta_direction(&self, wo: DVec3, lobe: Lobe) -> Option<DVec3> {
        let c = self.n.dot(wo);
        match lobe {
            Lobe::Diffuse => None,
            Lobe::Reflection => Some(2.0 * c * self.n - wo),
            Lobe::Coat => Some(2.0 * self.coat_n.dot(wo) * self.coat_n - wo),
            Lobe::Transmission if self.thin => Some(-wo),
            Lobe::Transmission => {
                let tangent = -(wo - c * self.n) / self.eta;
                let sin2 = tangent.length_squared();
                (sin2 < 1.0).then(|| tangent - (1.0 - sin2).sqrt() * self.n)
            }
        }
    }
}
