// Where paths may be reconnected (Lin et al. 2026, supplement, 2-4): vertices far enough apart, by the footprints of both their
// densities, and lobes rough enough.
#define_import_path bevy_restir::shift::connect

#import bevy_restir::bsdf::bsdf::bsdf_is_diffuse
#import bevy_restir::bsdf::types::{Bsdf, LOBE_COAT, LOBE_DIFFUSE}
#import bevy_restir::common::constants::FOUR_PI
#import bevy_restir::light::types::LightSample
#import bevy_restir::path::walk::{Step, Vertex}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::types::{RECONNECT_BLACK_BOX, RECONNECT_DISTANCE, RECONNECT_FIRST}
#import bevy_restir::scene::surface::Surface
#import bevy_restir::scene::triangle::world_triangle

// Thresholds of a view.
struct Connection {
    separation: f32,          // c/100 of the footprint of the pixel on its surface, m²; or least distance, m
    roughness: f32,           // least perceptual roughness
}

// How a path leaves a vertex for the next one.
struct Departure {
    position: vec3<f32>,
    n_geo: vec3<f32>,
    pdf: f32,                 // marginal density of its direction
    pdf_lobe: f32,            // joint density of its direction and lobe
    lobe: u32,
    rough: bool,              // rough enough, and no delta
}

fn goes_by_distance() -> bool {
    return settings.reconnection >= RECONNECT_DISTANCE;
}

// 4π d²/|cos| at the primary hit (Eq. 6), times the threshold.
fn connection_of(eye: vec3<f32>, s: Surface) -> Connection {
    if goes_by_distance() {
        return Connection(settings.separation, settings.roughness);
    }
    let d = s.position - eye;
    let d2 = dot(d, d);
    let cosine = abs(dot(s.bsdf.n_geo, d)) * inverseSqrt(max(d2, 1.0e-37));
    return Connection(0.01 * settings.separation * FOUR_PI * d2 / max(cosine, 1.0e-6), settings.roughness);
}

// Perceptual roughness of a lobe, the least of an anisotropic one.
fn lobe_roughness(b: Bsdf, lobe: u32) -> f32 {
    return select(sqrt(select(b.roughness, b.coat_roughness, lobe == LOBE_COAT)), 1.0, lobe == LOBE_DIFFUSE);
}

// Whether a path that leaves like this may be reconnected.  A material without lobes shows its roughness by its density: a GGX lobe of
// width α peaks near 1/α² (Eq. 26 as 1/√p >= α).
fn is_rough(v: Vertex, step: Step, c: Connection) -> bool {
    if settings.reconnection == RECONNECT_BLACK_BOX {
        return !step.delta && step.pdf * c.roughness * c.roughness <= 1.0;
    }
    return !step.delta && lobe_roughness(v.surface.bsdf, step.lobe) >= c.roughness;
}

// From the vertex of an index: ReSTIR GI reconnects to the first one that bounces light, or not at all.
fn departure(v: Vertex, step: Step, index: u32, c: Connection) -> Departure {
    let rough = is_rough(v, step, c) && (index == 1u || settings.reconnection != RECONNECT_FIRST);
    return Departure(v.surface.position, v.surface.bsdf.n_geo, step.pdf, step.pdf_lobe, step.lobe, rough);
}

// |cos at the far end| / d²: from solid angle at one vertex to area at the next.
fn geometry_factor(from_point: vec3<f32>, to_point: vec3<f32>, n_geo: vec3<f32>) -> f32 {
    let d = to_point - from_point;
    let d2 = dot(d, d);
    return abs(dot(n_geo, d)) * inverseSqrt(max(d2, 1.0e-37)) / max(d2, 1.0e-37);
}

// The same to the triangle's own measure, which is uniform on it and sums to 1: where it grows between frames a point that is kept needs
// no Jacobian for that.
fn triangle_factor(from_point: vec3<f32>, to_point: vec3<f32>, instance: u32, triangle: u32, previous: bool) -> f32 {
    let t = world_triangle(instance, triangle, previous);
    return geometry_factor(from_point, to_point, t.normal) * t.area;
}

// And to a light's.
fn light_factor(l: LightSample) -> f32 {
    return select(0.0, 1.0 / l.pdf_solid_angle, l.pdf_solid_angle > 0.0);
}

// The vertices are far enough apart for a path that leaves a with marginal density `pdf` (Eq. 5, forward).
fn is_apart(a: vec3<f32>, b: vec3<f32>, n_geo_b: vec3<f32>, pdf: f32, c: Connection) -> bool {
    if goes_by_distance() {
        return distance(a, b) >= c.separation;
    }
    return pdf * geometry_factor(a, b, n_geo_b) * c.separation <= 1.0;
}

// Whether the pair of a departure and the vertex at `s` is connectable.  The path goes on from there with marginal density `pdf_after`
// and lobes that are rough enough or not (Eq. 5, inverse).
fn is_connectable(a: Departure, s: Surface, pdf_after: f32, rough_after: bool, c: Connection) -> bool {
    if settings.reconnection == RECONNECT_DISTANCE && !rough_after {
        return false;
    }
    return is_connectable_end(a, s.position, s.bsdf.n_geo, c)
        && (bsdf_is_diffuse(s.bsdf) || is_apart(s.position, a.position, a.n_geo, pdf_after, c));
}

// The same of a vertex that ends the path: light leaves it anyhow.
fn is_connectable_end(a: Departure, position: vec3<f32>, n_geo: vec3<f32>, c: Connection) -> bool {
    return a.rough && is_apart(a.position, position, n_geo, a.pdf, c);
}
