// Connections (s, t >= 2): each vertex of a camera sub-path is joined with one vertex of the light vertex cache (Hedstrom et al. 2025, 7.1).
// The camera sub-path is traced separately from that of the resampled candidates, so that the passes of candidates bind no light vertices.
#define_import_path bevy_restir::restir::bdpt::connections

#import bevy_restir::bsdf::bsdf::{bsdf_is_delta, bsdf_pdf, bsdf_sample, bsdf_terms}
#import bevy_restir::bsdf::types::{bsdf_is_thin, BsdfSample}
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::guard::{GUARD_LIGHT_CONTRIBUTION, guarded_3}
#import bevy_restir::common::math::max_component
#import bevy_restir::common::ray::Ray
#import bevy_restir::common::rng::{Rng, rng_1, rng_3, rng_bits}
#import bevy_restir::path::bidirectional_mis::{mis_arrive, mis_camera_start, mis_connection_weight, mis_scatter, mis_scatter_delta, MisEnd, MisState}
#import bevy_restir::path::light_path::{arrival_cosine, reverse_pdf, scattered_value, surface_towards}
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::roulette::{ROULETTE_FROM, survival_probability}
#import bevy_restir::path::scattering::{scattering_vertex, ScatteringVertex}
#import bevy_restir::path::shadow_ray::ray_between
#import bevy_restir::path::walk::{step_medium, Vertex}
#import bevy_restir::restir::bdpt::bindings::light_vertices
#import bevy_restir::restir::bdpt::light_vertex::{light_vertex_unpack, LightVertex}
#import bevy_restir::restir::bdpt::techniques::{CONNECTIONS, technique_weight}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::scene::cone::{Cone, cone_after, cone_along}
#import bevy_restir::scene::offset::offset_point
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::trace::trace::{trace_any, trace_closest}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::light_part::{bsdf_diffuse_share, sample_diffuse_share, shown_light}

// The newest vertex of the camera's sub-path.
struct CameraWalk {
    v: Vertex,
    state: MisState,
    throughput: vec3<f32>,
    diffuse: vec3<f32>,        // share of the light that arrives that the first surface scatters diffusely
    is_first: bool,            // the vertex is the first surface, whose lobes decide that share
    eta_scale: f32,            // squared relative indices of refraction (`survival_probability`)
}

// Radiance towards the camera from the surface of a pixel, as `shown_light` returns it.  `camera_density`: of the camera's rays at the
// surface.
fn sample_connections(first: Vertex, camera_density: f32, rng: ptr<function, Rng>) -> vec4<f32> {
    let start = mis_camera_start(f32(settings.splats), camera_density);
    let arrived = mis_arrive(start, 1.0, arrival_cosine(first.surface, first.wo));
    var w = CameraWalk(first, arrived, vec3<f32>(1.0), vec3<f32>(0.0), true, 1.0);
    var light = vec4<f32>(0.0);
    let probe_seed = rng_bits(rng).x;
    // A connection has a scattering event at both of its ends.
    for (var index = 1u; index < view.bounces; index++) {
        let from_vertex = scattering_vertex(w.v, probe_seed, index);
        if !from_vertex.valid {
            break;
        }
        w = at_scattering_vertex(w, from_vertex);
        if !bsdf_is_delta(w.v.surface.bsdf) {
            light += connection_light(w, index, rng);
        }
        // The next vertex could not be connected.
        if index + 1u == view.bounces {
            break;
        }
        let b = bsdf_sample(w.v.surface.bsdf, w.v.wo, rng_3(rng));
        if b.valid == 0u {
            break;
        }
        w = after_scattering(w, b);
        if index >= ROULETTE_FROM {
            let q = survival_probability(w.throughput, w.eta_scale);
            if !(rng_1(rng) < q) {
                break;
            }
            w.throughput /= q;
        }

        // Find the next vertex.
        let medium = step_medium(w.v, b.wi);
        let s = w.v.surface;
        let ray = Ray(offset_point(s.position, s.bsdf.n_geo, b.wi, s.offset), 0.0, b.wi, FAR);
        let hit = trace_closest(ray, rng_bits(rng).x);
        if hit.instance == NONE {
            break;
        }
        let cone = cone_along(cone_after(w.v.cone, b.delta != 0u), hit.t);
        let next = surface_at(hit.instance, hit.triangle, hit.barycentrics, -b.wi, cone, false);
        w.throughput *= transmittance(medium, hit.t);
        w.state = mis_arrive(w.state, hit.t * hit.t, arrival_cosine(next, b.wi));
        w.v = Vertex(next, -b.wi, medium, cone);
    }
    return light;
}

// The walk at the vertex from which it goes on: the surface, or the point where light enters a translucent object.  Light sub-paths end at
// such a point, so that no technique joins the sub-paths at an edge before it.
fn at_scattering_vertex(walk: CameraWalk, from_vertex: ScatteringVertex) -> CameraWalk {
    var w = walk;
    w.v = from_vertex.vertex;
    w.throughput *= from_vertex.weight;
    if from_vertex.below {
        w.state = MisState(0.0, 0.0);
        if w.is_first {
            w.diffuse = vec3<f32>(1.0);
            w.is_first = false;
        }
    }
    return w;
}

// Throughput and state after scattering; the state does not yet hold for the next vertex.
fn after_scattering(walk: CameraWalk, b: BsdfSample) -> CameraWalk {
    var w = walk;
    let s = w.v.surface;
    let cos_out = abs(dot(s.bsdf.n_geo, b.wi));
    if w.is_first {
        w.diffuse = sample_diffuse_share(s.bsdf, w.v.wo, b);
        w.is_first = false;
    }
    w.throughput *= b.weight;
    w.eta_scale *= b.eta * b.eta;
    if b.delta != 0u {
        w.state = mis_scatter_delta(w.state, cos_out);
    } else {
        w.state = mis_scatter(w.state, cos_out, b.pdf, reverse_pdf(s, b.wi, w.v.wo));
    }
    return w;
}

// Light of one light sub-path, which is connected with the vertex of this index.
fn connection_light(w: CameraWalk, index: u32, rng: ptr<function, Rng>) -> vec4<f32> {
    let u = rng_1(rng);
    let alpha_seed = rng_bits(rng).x;
    let p = light_vertex_unpack(light_vertices[min(u32(u * f32(settings.light_paths)), settings.light_paths - 1u)]);
    if p.events == 0u || index + p.events > view.bounces {
        return vec4<f32>(0.0);
    }
    let x = w.v.surface;
    // The direction only determines which side of the surface is seen.
    let y = surface_of(p, x.position);
    let d = y.position - x.position;
    let d2 = dot(d, d);
    let wi = d * inverseSqrt(max(d2, 1.0e-37));
    let terms = bsdf_terms(x.bsdf, w.v.wo, wi);
    let cos_y = abs(dot(y.bsdf.n_geo, wi));
    if !(d2 > 0.0) {
        return vec4<f32>(0.0);
    }
    let bsdfs = terms.f * scattered_value(y, -wi, p.towards_light);
    let value = guarded_3(bsdfs * p.throughput * (cos_y / d2 * f32(p.count)), GUARD_LIGHT_CONTRIBUTION);
    if !(max_component(value) > 0.0) {
        return vec4<f32>(0.0);
    }
    let from_light = surface_towards(y, p.towards_light);
    let weight = mis_connection_weight(
        MisEnd(w.state, abs(dot(x.bsdf.n_geo, wi)), terms.pdf, reverse_pdf(x, wi, w.v.wo)),
        MisEnd(p.state, cos_y, bsdf_pdf(from_light.bsdf, p.towards_light, -wi), bsdf_pdf(y.bsdf, -wi, p.towards_light)),
        d2,
    );
    let carried = transmittance(step_medium(w.v, wi), sqrt(d2) + open_distance(p, y));
    var diffuse = w.diffuse;
    if w.is_first {
        diffuse = bsdf_diffuse_share(x.bsdf, w.v.wo, wi);
    }
    let light = w.throughput * value * carried * technique_weight(weight, CONNECTIONS);
    let shown = shown_light(guarded_3(light, GUARD_LIGHT_CONTRIBUTION), diffuse);
    // The ray comes last, so that few registers hold data while it is traced.
    return select(shown, vec4<f32>(0.0), trace_any(ray_between(x, y), alpha_seed, false));
}

// The surface of a light vertex as a point sees it.
fn surface_of(p: LightVertex, from_point: vec3<f32>) -> Surface {
    let s = surface_at(p.instance, p.triangle, p.barycentrics, p.towards_light, Cone(0.0, 0.0), false);
    return surface_towards(s, normalize(from_point - s.position));
}

// Length of the light sub-path in the medium of the connection; 0 if the connection leaves to the other side of the surface.
fn open_distance(p: LightVertex, y: Surface) -> f32 {
    return select(0.0, p.open_distance, dot(p.towards_light, y.bsdf.n_geo) > 0.0 || bsdf_is_thin(y.bsdf));
}
