// Connections (s, t >= 2): a vertex of a camera sub-path is joined with one vertex of the light vertex cache (Hedstrom et al. 2025, 7.1).  Such a
// path reconnects at the latest at the light vertex, which it then stores.  A path that reconnects at the last vertex of its camera sub-path
// stores that vertex and the light that it gets from the light vertex.  One that reconnects earlier is like any other path.
#define_import_path bevy_restir::restir::connection::connection

#import bevy_restir::restir::path_sample::PathSample
#ifdef CONNECTIONS
#import bevy_restir::bsdf::bsdf::{bsdf_is_delta, bsdf_pdf, bsdf_terms}
#import bevy_restir::bsdf::types::bsdf_is_thin
#import bevy_restir::common::constants::LEAST_DIVISOR
#import bevy_restir::common::guard::{GUARD_LIGHT_CONTRIBUTION, guarded_3}
#import bevy_restir::common::math::quantized_direction
#import bevy_restir::common::ray::Ray
#import bevy_restir::light::point_on_light::LightPoint
#import bevy_restir::light::select::light_pmf
#import bevy_restir::path::bidirectional_mis::{LightEnd, mis_connection_ratios, MisState}
#import bevy_restir::path::light_path::{scattered_value, surface_towards}
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::shadow_ray::ray_between
#import bevy_restir::path::walk::{step_medium, Vertex}
#import bevy_restir::restir::connection::light_sub_path::replayed_sub_path
#import bevy_restir::restir::connection::light_vertex::{LightVertex, newest_vertex}
#import bevy_restir::restir::path_sample::{TERMINATION_CONNECTION, with_mis_of}
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::view::bindings::view
#endif

#ifdef CONNECTIONS
// A connection, from the vertex of the camera sub-path.
struct Connection {
    wi: vec3<f32>,             // towards the light vertex, rounded as a reservoir stores it
    f: vec3<f32>,              // value of the BSDF at the camera's vertex, with the cosine
    pdf: f32,                  // density of the direction there
    light: vec3<f32>,          // light that arrives from the light vertex, divided by the densities of its sub-path from its light on
    mis_ratios: vec2<f32>,     // `mis_connection_ratios`
    ray: Ray,                  // between the two vertices
}

// A path whose light sub-path was traced again, and whether that has still found a light vertex.
struct Retraced {
    path: PathSample,
    exists: bool,
}

fn ends_with_connection(path: PathSample) -> bool {
    return path.termination == TERMINATION_CONNECTION;
}

// Number of scattering events of the light sub-path.
fn events_of_light(path: PathSample) -> u32 {
    return path.light.coordinates >> SUB_PATH_BITS;
}

// Bits for the index of the light sub-path.
const SUB_PATH_BITS: u32 = 24u;

// A camera sub-path that ends at a light vertex, and reconnects there.
fn ended_at_light_vertex(prefix: PathSample, p: LightVertex) -> PathSample {
    var path = prefix;
    path.termination = TERMINATION_CONNECTION;
    path.reconnection = path.length;
    path.light = LightPoint(p.light, p.path | (p.events << SUB_PATH_BITS));
    return with_light_vertex(path, p);
}

// A path that stores this light vertex.  The probability of its light is a part of the path's contribution weight and not of its radiance,
// because it may have changed when the light sub-path is traced again.  Such a path has no density, so that the field holds a length instead.
fn with_light_vertex(s: PathSample, p: LightVertex) -> PathSample {
    var path = s;
    path.instance = p.instance;
    path.triangle = p.triangle;
    path.barycentrics = p.barycentrics;
    path.wi = p.towards_light;
    path.radiance = p.throughput * light_pmf(p.light);
    path.mis_coefficients = vec2<f32>(p.state.last, p.state.earlier);
    path.density = p.open_distance;
    return path;
}

fn stores_light_vertex(path: PathSample) -> bool {
    return ends_with_connection(path) && path.reconnection == path.length;
}

// Traces the light sub-path of a path again, up to the light vertex.  A vertex of 0 events means that the sub-path ends before.
fn replayed_light_vertex(path: PathSample, previous: bool) -> LightVertex {
    let frame = view.frame - ((view.frame - path.born) & 0xffffu);
    let sub_path = path.light.coordinates & ((1u << SUB_PATH_BITS) - 1u);
    let events = events_of_light(path);
    let p = replayed_sub_path(sub_path, frame, path.light.light, events, previous);
    var vertex = newest_vertex(p.walk, path.light.light, sub_path);
    vertex.towards_light = quantized_direction(vertex.towards_light);
    vertex.events = select(events, 0u, p.walk.events != events || bsdf_is_delta(p.walk.surface.bsdf));
    return vertex;
}

// The connection of a vertex with the light vertex that a path stores.  `connections`: `TechniqueCounts::connections`.
fn connection_to(v: Vertex, path: PathSample, connections: f32, previous: bool) -> Connection {
    var k: Connection;
    let x = v.surface;
    // The light vertex from the side of its light, and from that of the camera.
    let lit = surface_at(path.instance, path.triangle, path.barycentrics, path.wi, Cone(0.0, 0.0), previous);
    let d = lit.position - x.position;
    let d2 = dot(d, d);
    if !(d2 > 0.0) {
        return k;
    }
    k.wi = quantized_direction(d * inverseSqrt(max(d2, LEAST_DIVISOR)));
    let seen = surface_towards(lit, -k.wi);
    let cosine = abs(dot(lit.bsdf.n_geo, k.wi));
    let terms = bsdf_terms(x.bsdf, v.wo, k.wi);
    k.f = terms.f;
    k.pdf = terms.pdf;
    let carried = transmittance(step_medium(v, k.wi), sqrt(d2) + open_distance(path, seen));
    k.light = guarded_3(scattered_value(seen, -k.wi, path.wi) * path.radiance * (cosine / d2) * carried, GUARD_LIGHT_CONTRIBUTION);
    let state = MisState(path.mis_coefficients.x, path.mis_coefficients.y);
    let end = LightEnd(state, cosine, bsdf_pdf(lit.bsdf, path.wi, -k.wi), bsdf_pdf(seen.bsdf, -k.wi, path.wi));
    k.mis_ratios = mis_connection_ratios(end, abs(dot(x.bsdf.n_geo, k.wi)), d2, connections);
    k.ray = ray_between(x, seen);
    return k;
}

// Length of the light sub-path in the medium of the connection; 0 if the connection leaves to the other side of the surface.
fn open_distance(path: PathSample, seen: Surface) -> f32 {
    let is_same_side = dot(path.wi, seen.bsdf.n_geo) > 0.0 || bsdf_is_thin(seen.bsdf);
    return select(0.0, path.density, is_same_side);
}

// Direction of the light vertex that a path stores.
fn connected_direction(from_point: vec3<f32>, path: PathSample) -> vec3<f32> {
    return normalize(surface_point(path.instance, path.triangle, path.barycentrics, false) - from_point);
}

// A path that ends as another one does.
fn with_end_of(prefix: PathSample, other: PathSample) -> PathSample {
    var path = prefix;
    path.termination = other.termination;
    path.light = other.light;
    return path;
}

// A path whose camera sub-path ends at its reconnection vertex, with the light that this connection brings there.
fn with_connection(reconnected: PathSample, k: Connection) -> PathSample {
    var path = reconnected;
    path.wi = k.wi;
    path.radiance = k.light;
    path.mis_coefficients = k.mis_ratios;
    return path;
}

// The connection that such a path stores, at its reconnection vertex `v`.  Its ray does not change.
fn stored_connection(v: Vertex, path: PathSample) -> Connection {
    let terms = bsdf_terms(v.surface.bsdf, v.wo, path.wi);
    return Connection(path.wi, terms.f, terms.pdf, path.radiance, path.mis_coefficients, Ray());
}

// A path that stores a light vertex or ends with a connection, with the light vertex that its light sub-path finds in a scene that has changed.
fn retraced(path: PathSample, previous: bool) -> Retraced {
    let vertex = replayed_light_vertex(path, previous);
    return Retraced(with_mis_of(with_light_vertex(path, vertex), path), vertex.events > 0u);
}
#else
fn ends_with_connection(path: PathSample) -> bool {
    return false;
}

fn stores_light_vertex(path: PathSample) -> bool {
    return false;
}

fn events_of_light(path: PathSample) -> u32 {
    return 0u;
}

fn connected_direction(from_point: vec3<f32>, path: PathSample) -> vec3<f32> {
    return vec3<f32>(0.0);
}
#endif
