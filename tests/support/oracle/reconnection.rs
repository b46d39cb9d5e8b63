//! Where a path may be reconnected, in f64: the dual footprint threshold (Lin et al. 2026, supplement, Eqs. 5 and 6), the threshold on
//! the density of black-box materials (ibid., Eq. 26), the bound of the Jacobian and the footprint of the path (ibid., 11), and the
//! thresholds on distance and roughness of Lin et al. 2022.  Also the choice of the reconnection vertex of a whole path.

use glam::DVec3;
use std::f64::consts::PI;

/// A vertex of a path after the camera, and the direction in which the path leaves it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Vertex {
    pub position: DVec3,
    pub n_geo: DVec3,
    /// The marginal density of the direction, solid angle.
    pub pdf: f64,
    /// Perceptual roughness of the lobe; 1 for a diffuse one.
    pub roughness: f64,
    /// The lobe has one direction only.
    pub is_delta: bool,
    /// No lobe of the surface depends on the direction that light comes from.
    pub is_diffuse: bool,
}

/// A criterion of where a path may be reconnected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// The footprints of both vertices, with the constant c.
    Footprints(f64),
    /// The same, with a density in place of the roughness.
    BlackBox(f64),
    /// The same, with Eq. 26 as it is printed.
    BlackBoxPrinted(f64),
    /// The product of both densities (Eq. 27), with the constant c.
    JacobianBound(f64),
    /// The footprint of the path (Müller et al. 2021), with the constant c.
    PathFootprint(f64),
    /// A distance in meters, and the roughness of both vertices (Lin et al. 2022).
    Distance(f64),
    /// A distance in meters, at the second vertex only (Ouyang et al. 2021; Lanz 2025, Eq. 30).
    First(f64),
}

/// The pixel that a path belongs to.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    pub eye: DVec3,
    pub rule: Rule,
    /// The least perceptual roughness.
    pub roughness: f64,
}

/// How far a condition is from its limit: at least 1 where it holds.
pub type Ratio = f64;

/// The square of the radius of the pixel's own footprint at the first vertex (Eq. 6).
pub fn primary_footprint(eye: DVec3, first: &Vertex) -> f64 {
    let to_eye = eye - first.position;
    to_eye.length_squared() / (first.n_geo.dot(to_eye.normalize()).abs() / (4.0 * PI))
}

/// The geometry term from `x` to `y` with the cosine at `y`.
fn geometry(x: &Vertex, y: &Vertex) -> f64 {
    let d = y.position - x.position;
    y.n_geo.dot(d.normalize()).abs() / d.length_squared()
}

/// The area on the next surface that one sample of the density `pdf` stands for: the footprint of a ray from `x` at `y`.
fn footprint(pdf: f64, x: &Vertex, y: &Vertex) -> f64 {
    1.0 / (pdf * geometry(x, y))
}

/// The footprint of a path at the last of these vertices: the squared sum of the roots of the footprints of its rays after the camera's
/// (Müller et al. 2021).  The density of a delta is infinite.
pub fn path_footprint(vertices: &[Vertex]) -> f64 {
    let spread =
        |pair: &[Vertex]| if pair[0].is_delta { 0.0 } else { footprint(pair[0].pdf, &pair[0], &pair[1]).sqrt() };
    vertices.windows(2).map(spread).sum::<f64>().powi(2)
}

impl Pixel {
    /// The right side of Eq. 5.
    fn least_footprint(&self, c: f64, first: &Vertex) -> f64 {
        c / 100.0 * primary_footprint(self.eye, first)
    }

    /// Whether the lobe at a vertex is rough enough; 0 for a delta.
    pub fn roughness_ratio(&self, v: &Vertex) -> Ratio {
        if v.is_delta {
            return 0.0;
        }
        match self.rule {
            // Eq. 26 compares 1/p² with a roughness.  A GGX lobe of width α peaks near 1/α², so that 1/√p is the quantity with the unit
            // of α; this is the reading that the project documents.
            Rule::BlackBox(_) => 1.0 / v.pdf.sqrt() / self.roughness,
            Rule::BlackBoxPrinted(_) => v.pdf.powi(-2) / self.roughness,
            _ => v.roughness / self.roughness,
        }
    }

    /// The conditions for a reconnection between `x`, the last of the vertices `before`, whose index is `index`, and the next vertex `y`;
    /// all must be at least 1.  `y_is_end`: y lies on a light, after which there is no direction.
    pub fn ratios(&self, first: &Vertex, before: &[Vertex], index: usize, y: &Vertex, y_is_end: bool) -> Vec<Ratio> {
        let x = &before[before.len() - 1];
        let mut all = vec![self.roughness_ratio(x)];
        if !y_is_end && y.is_delta && !matches!(self.rule, Rule::PathFootprint(_)) {
            all.push(0.0);
        }
        match self.rule {
            Rule::Footprints(c) | Rule::BlackBox(c) | Rule::BlackBoxPrinted(c) => {
                let least = self.least_footprint(c, first);
                all.push(footprint(x.pdf, x, y) / least);
                // A diffuse vertex has the same density for every vertex before it, and a path does not leave a light.
                if !y_is_end && !y.is_diffuse {
                    all.push(footprint(y.pdf, y, x) / least);
                }
            }
            Rule::JacobianBound(c) => {
                let hemisphere = 1.0 / (2.0 * PI);
                let pdf_after = if y_is_end { hemisphere } else { y.pdf };
                all.push(footprint(x.pdf, x, y) / pdf_after / (self.least_footprint(c, first) / hemisphere));
            }
            Rule::PathFootprint(c) => {
                let vertices = [before, &[*y]].concat();
                all.push((path_footprint(&vertices) / self.least_footprint(c, first)).sqrt());
            }
            Rule::Distance(least) => {
                all.push((x.position - y.position).length() / least);
                if !y_is_end {
                    all.push(self.roughness_ratio(y));
                }
            }
            Rule::First(least) => {
                all.push((x.position - y.position).length() / least);
                all.push(if index == 1 { f64::INFINITY } else { 0.0 });
            }
        }
        all
    }
}

/// Whether all conditions hold, and how far the nearest deciding one is from its limit, as |ln|.
pub fn decide(ratios: &[Ratio]) -> (bool, f64) {
    let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    (least >= 1.0, least.ln().abs())
}

/// The end of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The last vertex samples a point of a light.
    LightSample,
    /// The last ray hits a light; the hit is the last vertex.
    Hit,
    /// The last ray escapes.
    Escape,
}

/// The reconnection vertex that a path chooses by itself, counted from the camera, or 0; and how far the nearest decision up to there is
/// from its limit.  `vertices[0]` is the first surface; the point of a light sample is not among them.  `end`: what follows the last of
/// these vertices; `None` if the path goes on.
pub fn choice(pixel: &Pixel, vertices: &[Vertex], end: Option<End>) -> (usize, f64) {
    let mut margin = f64::INFINITY;
    for index in 2..=vertices.len() {
        let is_last = index == vertices.len();
        let mut y = vertices[index - 1];
        if is_last && end == Some(End::LightSample) {
            // No lobe is chosen where a light sample leaves: all of them count, and a delta cannot.
            (y.roughness, y.is_delta) = (f64::INFINITY, false);
        }
        let is_end = is_last && end == Some(End::Hit);
        let before = &vertices[..index - 1];
        let (connectable, distance) = decide(&pixel.ratios(&vertices[0], before, index - 1, &y, is_end));
        margin = margin.min(distance);
        if connectable {
            return (index, margin);
        }
    }
    match end {
        // The point of the light is always kept.
        Some(End::LightSample) => (vertices.len() + 1, margin),
        Some(End::Hit) | None => (0, margin),
        // The direction stands for a vertex at infinity, whose footprints are infinite.
        Some(End::Escape) => {
            let last = &vertices[vertices.len() - 1];
            let is_late = matches!(pixel.rule, Rule::First(_)) && vertices.len() > 1;
            let (connectable, distance) = decide(&[if is_late { 0.0 } else { pixel.roughness_ratio(last) }]);
            (if connectable { vertices.len() + 1 } else { 0 }, margin.min(distance))
        }
    }
}
