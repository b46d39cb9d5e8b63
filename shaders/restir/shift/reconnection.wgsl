// Where paths may be reconnected (Lin et al. 2026, supplement, 2-4): between vertices that are far enough apart, by the footprints of the
// densities on both sides, and after lobes that are rough enough.  Also the criteria that the paper compares with (ibid., 11).
#define_import_path bevy_restir::restir::shift::reconnection

#import bevy_restir::bsdf::bsdf::bsdf_is_diffuse
#import bevy_restir::bsdf::types::{Bsdf, LOBE_COAT, LOBE_DIFFUSE}
#import bevy_restir::common::constants::{FOUR_PI, LEAST_DIVISOR, TWO_PI}
#import bevy_restir::light::types::LightSample
#import bevy_restir::path::technique_weights::TechniqueCounts
#import bevy_restir::path::walk::{Step, Vertex}
#import bevy_restir::restir::types::{RECONNECT_BLACK_BOX, RECONNECT_BLACK_BOX_PRINTED, RECONNECT_DISTANCE, RECONNECT_FIRST, RECONNECT_JACOBIAN_BOUND, RECONNECT_PATH_FOOTPRINT}
#import bevy_restir::scene::surface::Surface
#import bevy_restir::scene::triangle::world_triangle

// Parameters of shifts to and from one pixel.
struct ShiftParameters {
    kind: u32,                // RECONNECT_*
    separation: f32,          // `separation_threshold`
    roughness: f32,           // least perceptual roughness of a lobe before the reconnection
    jacobian_limit: f32,      // greatest Jacobian, and reciprocal of the least
    counts: TechniqueCounts,
    camera_density: f32,      // of the camera's rays at the first vertex, where light sub-paths are traced
    diffuse_secondary: bool,  // the reconnection vertex is treated as diffuse: the same radiance leaves it in all directions
}

// The vertex before the newest one, as a possible start of a reconnection.
struct PreviousVertex {
    position: vec3<f32>,
    n_geo: vec3<f32>,
    pdf: f32,                 // marginal density of the direction that was taken
    pdf_lobe: f32,            // joint density of direction and lobe
    lobe: u32,
    rough: bool,              // the lobe is rough enough, and no delta
    spread: f32,              // RECONNECT_PATH_FOOTPRINT: `path_spread` up to this vertex
}

fn uses_distance(kind: u32) -> bool {
    return kind >= RECONNECT_DISTANCE;
}

// `ShiftParameters::separation` for the surface that a pixel sees.  For footprints: c/100 times the footprint of the pixel there, 4π d²/|cos|
// (Eq. 6), m².  For the bound of the Jacobian: 2π times that (Eq. 27), m²/sr.  For a distance: the setting itself, m.
fn separation_threshold(kind: u32, separation: f32, eye: vec3<f32>, s: Surface) -> f32 {
    if uses_distance(kind) {
        return separation;
    }
    let d = s.position - eye;
    let d2 = dot(d, d);
    let cosine = abs(dot(s.bsdf.n_geo, d)) * inverseSqrt(max(d2, LEAST_DIVISOR));
    let factor = select(1.0, TWO_PI, kind == RECONNECT_JACOBIAN_BOUND);
    return 0.01 * separation * FOUR_PI * d2 / max(cosine, 1.0e-6) * factor;
}

// Perceptual roughness of a lobe; of an anisotropic lobe the lesser one.
fn lobe_roughness(b: Bsdf, lobe: u32) -> f32 {
    return select(sqrt(select(b.roughness, b.coat_roughness, lobe == LOBE_COAT)), 1.0, lobe == LOBE_DIFFUSE);
}

// Whether the lobe of a step is rough enough.  RECONNECT_BLACK_BOX compares 1/√p with the threshold, where p is the density of the step: a GGX
// lobe of width α has densities up to about 1/α² (Eq. 26).  RECONNECT_BLACK_BOX_PRINTED compares 1/p² with it, as the equation is printed.
fn is_rough(v: Vertex, step: Step, c: ShiftParameters) -> bool {
    if c.kind == RECONNECT_BLACK_BOX {
        return !step.delta && step.pdf * c.roughness * c.roughness <= 1.0;
    }
    if c.kind == RECONNECT_BLACK_BOX_PRINTED {
        return !step.delta && step.pdf * step.pdf * c.roughness <= 1.0;
    }
    return !step.delta && lobe_roughness(v.surface.bsdf, step.lobe) >= c.roughness;
}

// The vertex of this index once the path has left it; `before` comes before it.  ReSTIR GI (RECONNECT_FIRST) reconnects at the second
// vertex or not at all.
fn previous_vertex(before: PreviousVertex, v: Vertex, step: Step, index: u32, c: ShiftParameters) -> PreviousVertex {
    let rough = is_rough(v, step, c) && (index == 1u || c.kind != RECONNECT_FIRST);
    var spread = 0.0;
    if c.kind == RECONNECT_PATH_FOOTPRINT && index > 1u {
        spread = path_spread(before, v.surface.position, v.surface.bsdf.n_geo);
    }
    return PreviousVertex(v.surface.position, v.surface.bsdf.n_geo, step.pdf, step.pdf_lobe, step.lobe, rough, spread);
}

// How far a path has spread where it arrives after `a`, m: the sum of √(d²/(p |cos|)) over its rays after the camera's (Müller et al. 2021).
// A delta lobe, whose density is stored as 0, spreads nothing.
fn path_spread(a: PreviousVertex, position: vec3<f32>, n_geo: vec3<f32>) -> f32 {
    if !(a.pdf > 0.0) {
        return a.spread;
    }
    return a.spread + inverseSqrt(max(a.pdf * geometry_factor(a.position, position, n_geo), LEAST_DIVISOR));
}

// |cos at the far end| / d²: from solid angle at one vertex to area at the next.
fn geometry_factor(from_point: vec3<f32>, to_point: vec3<f32>, n_geo: vec3<f32>) -> f32 {
    let d = to_point - from_point;
    let d2 = dot(d, d);
    return abs(dot(n_geo, d)) * inverseSqrt(max(d2, LEAST_DIVISOR)) / max(d2, LEAST_DIVISOR);
}

// From solid angle at one vertex to the measure of the triangle of the next, which is uniform and sums to 1: a point that keeps its
// barycentrics needs no Jacobian where its triangle grows between frames.
fn triangle_factor(from_point: vec3<f32>, to_point: vec3<f32>, instance: u32, triangle: u32, previous: bool) -> f32 {
    let t = world_triangle(instance, triangle, previous);
    return geometry_factor(from_point, to_point, t.normal) * t.area;
}

// From solid angle at a vertex to the measure of a light.
fn light_factor(l: LightSample) -> f32 {
    return select(0.0, 1.0 / l.pdf_solid_angle, l.pdf_solid_angle > 0.0);
}

// Whether b is far enough from a, which the path leaves with marginal density `pdf` (Eq. 5, forward).  `kind` and `separation`: those of
// `ShiftParameters`.
fn is_apart(a: vec3<f32>, b: vec3<f32>, n_geo_b: vec3<f32>, pdf: f32, kind: u32, separation: f32) -> bool {
    if uses_distance(kind) {
        return distance(a, b) >= separation;
    }
    return pdf * geometry_factor(a, b, n_geo_b) * separation <= 1.0;
}

// Whether the Jacobian from primary sample space to area at b and solid angle there is bounded; the path leaves b with marginal density
// `pdf_after` (Eq. 27).
fn has_bounded_jacobian(a: PreviousVertex, b: vec3<f32>, n_geo_b: vec3<f32>, pdf_after: f32, c: ShiftParameters) -> bool {
    return a.pdf * geometry_factor(a.position, b, n_geo_b) * pdf_after * c.separation <= 1.0;
}

// Whether paths may reconnect between `a` and the vertex `v`, which the path leaves by this step.  They may not before a delta lobe: a
// reconnection changes the direction in which the path arrives there, and the lobe scatters that to another direction only.
// RECONNECT_PATH_FOOTPRINT ignores the lobe at `v` (ibid., 11).
fn is_connectable_by(a: PreviousVertex, v: Vertex, step: Step, c: ShiftParameters) -> bool {
    if step.delta && c.kind != RECONNECT_PATH_FOOTPRINT {
        return false;
    }
    return is_connectable(a, v.surface, step.pdf, is_rough(v, step, c), c);
}

// Whether paths may reconnect between `a` and the vertex at `s`, which the path leaves with marginal density `pdf_after` by a lobe that is
// rough enough or not (Eq. 5, inverse).
fn is_connectable(a: PreviousVertex, s: Surface, pdf_after: f32, rough_after: bool, c: ShiftParameters) -> bool {
    if c.kind == RECONNECT_JACOBIAN_BOUND {
        return a.rough && has_bounded_jacobian(a, s.position, s.bsdf.n_geo, pdf_after, c);
    }
    if c.kind == RECONNECT_PATH_FOOTPRINT {
        return is_connectable_end(a, s.position, s.bsdf.n_geo, c);
    }
    if c.kind == RECONNECT_DISTANCE && !rough_after {
        return false;
    }
    return is_connectable_end(a, s.position, s.bsdf.n_geo, c)
        && (bsdf_is_diffuse(s.bsdf) || is_apart(s.position, a.position, a.n_geo, pdf_after, c.kind, c.separation));
}

// Whether paths may reconnect between `a` and a last vertex on a light, after which there is no lobe and no density to test.  The bound of
// the Jacobian takes the density of the uniform hemisphere that its factor 2π stands for.
fn is_connectable_end(a: PreviousVertex, position: vec3<f32>, n_geo: vec3<f32>, c: ShiftParameters) -> bool {
    if c.kind == RECONNECT_JACOBIAN_BOUND {
        return a.rough && has_bounded_jacobian(a, position, n_geo, 1.0 / TWO_PI, c);
    }
    if c.kind == RECONNECT_PATH_FOOTPRINT {
        return a.rough && path_spread(a, position, n_geo) >= sqrt(c.separation);
    }
    return a.rough && is_apart(a.position, position, n_geo, a.pdf, c.kind, c.separation);
}
