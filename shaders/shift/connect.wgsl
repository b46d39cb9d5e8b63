// Where paths may be reconnected (paper 000, 2-4): vertices far enough apart, by the footprints of both their densities, and a lobe
// rough enough before the connection.
#define_import_path bevy_restir::shift::connect

#import bevy_restir::bsdf::types::{Bsdf, LOBE_DIFFUSE}
#import bevy_restir::common::constants::FOUR_PI
#import bevy_restir::path::walk::{Step, Vertex}
#import bevy_restir::scene::surface::Surface

// Thresholds of a view.
struct Connection {
    footprint: f32,           // c/100 of the footprint of the pixel on its surface, m²
    roughness: f32,           // least perceptual roughness of the lobe before the connection
}

// One end of a pair: where a path leaves a vertex for the next one.
struct Departure {
    position: vec3<f32>,
    n_geo: vec3<f32>,
    pdf: f32,                 // marginal density of its direction
    pdf_lobe: f32,            // joint density of its direction and lobe
    lobe: u32,
    rough: bool,              // rough enough, and no delta
}

// 4π d²/|cos| at the primary hit (Eq. 6), times the threshold.
fn connection_of(eye: vec3<f32>, s: Surface, threshold: f32, roughness: f32) -> Connection {
    let d = s.position - eye;
    let d2 = dot(d, d);
    let cosine = abs(dot(s.bsdf.n_geo, d)) * inverseSqrt(max(d2, 1.0e-37));
    return Connection(0.01 * threshold * FOUR_PI * d2 / max(cosine, 1.0e-6), roughness);
}

// Perceptual roughness of a lobe.
fn lobe_roughness(b: Bsdf, lobe: u32) -> f32 {
    return select(sqrt(b.roughness), 1.0, lobe == LOBE_DIFFUSE);
}

fn departure(v: Vertex, step: Step, c: Connection) -> Departure {
    let rough = !step.delta && lobe_roughness(v.surface.bsdf, step.lobe) >= c.roughness;
    return Departure(v.surface.position, v.surface.bsdf.n_geo, step.pdf, step.pdf_lobe, step.lobe, rough);
}

// |cos at the far end| / d²: from solid angle at one vertex to area at the next.
fn geometry_factor(from_point: vec3<f32>, to_point: vec3<f32>, n_geo: vec3<f32>) -> f32 {
    let d = to_point - from_point;
    let d2 = dot(d, d);
    return abs(dot(n_geo, d)) * inverseSqrt(max(d2, 1.0e-37)) / max(d2, 1.0e-37);
}

// The footprint of the ray from a at b is large enough (Eq. 5, forward).  `pdf`: marginal density at a.
fn footprint_is_large(a: vec3<f32>, b: vec3<f32>, n_geo_b: vec3<f32>, pdf: f32, c: Connection) -> bool {
    return pdf * geometry_factor(a, b, n_geo_b) * c.footprint <= 1.0;
}

// Whether the pair of a departure and the vertex at `s`, from which the path goes on with marginal density `pdf_after`, is connectable.
fn is_connectable(a: Departure, s: Surface, pdf_after: f32, c: Connection) -> bool {
    return a.rough
        && footprint_is_large(a.position, s.position, s.bsdf.n_geo, a.pdf, c)
        && footprint_is_large(s.position, a.position, a.n_geo, pdf_after, c);
}

// The same of a vertex that ends the path: light leaves it anyhow.
fn is_connectable_end(a: Departure, s: Surface, c: Connection) -> bool {
    return a.rough && footprint_is_large(a.position, s.position, s.bsdf.n_geo, a.pdf, c);
}
