// The camera's sub-path of a pixel, and its techniques: hits of lights (s = 0), next-event estimation (s = 1), and a connection of each
// vertex to one vertex of the light vertex cache (s >= 2) (Hedstrom et al. 2025, 5.1).
#define_import_path bevy_restir::restir::bdpt::camera_path

#import bevy_restir::bsdf::bsdf::{bsdf_is_delta, bsdf_pdf, bsdf_sample, bsdf_terms}
#import bevy_restir::bsdf::types::{bsdf_is_thin, BsdfSample}
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::math::{is_finite_3, max_component}
#import bevy_restir::common::ray::Ray
#import bevy_restir::common::rng::{Rng, rng_1, rng_3, rng_bits}
#import bevy_restir::light::analytic_area_light::{light_hit_point, LIGHT_HITS_MAX, next_light_hit, RaySegment}
#import bevy_restir::light::emission::emission_density
#import bevy_restir::light::environment::{environment_pdf, environment_radiance}
#import bevy_restir::light::point_on_light::light_point_at
#import bevy_restir::light::select::light_pmf
#import bevy_restir::light::triangle::triangle_light_pdf_solid_angle
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, LightSample, no_light_sample}
#import bevy_restir::path::bidirectional_mis::{mis_arrive, mis_camera_start, mis_connection_weight, mis_hit_weight, mis_nee_weight, mis_scatter, mis_scatter_delta, MisEnd, MisState}
#import bevy_restir::path::light_path::{scattered_value, surface_towards}
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::shadow_ray::{light_is_visible, ray_between}
#import bevy_restir::path::walk::{step_medium, Vertex}
#import bevy_restir::restir::bdpt::bindings::light_vertices
#import bevy_restir::restir::bdpt::light_vertex::{light_vertex_unpack, LightVertex}
#import bevy_restir::restir::bdpt::techniques::{CONNECTIONS, HITS, NEE, technique_weight}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::pt::initial_candidates::select_light
#import bevy_restir::scene::cone::{Cone, cone_after, cone_along}
#import bevy_restir::scene::offset::offset_point
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::trace::trace::{trace_any, trace_closest}
#import bevy_restir::view::bindings::view

// Russian roulette starts at this vertex.
const ROULETTE_FROM: u32 = 3u;

// The newest vertex of the camera's sub-path.
struct CameraWalk {
    v: Vertex,
    state: MisState,
    throughput: vec3<f32>,
    index: u32,                // of the vertex, from 1; 0: the sub-path has ended
    eta_scale: f32,            // squared relative indices of refraction: roulette must not mistake the scaling of radiance for absorption
}

// The ray by which the sub-path leaves its newest vertex.
struct CameraRay {
    state: MisState,           // before it arrives anywhere
    segment: RaySegment,
    medium: vec3<f32>,
}

// Radiance towards the camera from the surface of a pixel, besides its emission.  `camera_density`: of the camera's rays at the surface.
fn sample_camera_path(first: Vertex, camera_density: f32, pixel: vec2<u32>, rng: ptr<function, Rng>) -> vec3<f32> {
    let start = mis_camera_start(f32(settings.splats), camera_density);
    let arrived = mis_arrive(start, 1.0, abs(dot(first.surface.bsdf.n_geo, first.wo)));
    var w = CameraWalk(first, arrived, vec3<f32>(1.0), 1u, 1.0);
    var light = vec3<f32>(0.0);
    for (var index = 1u; index <= view.bounces; index++) {
        if !bsdf_is_delta(w.v.surface.bsdf) {
            light += finite(w.throughput * nee_light(w, pixel, rng));
            light += finite(w.throughput * connection_light(w, rng));
        }
        let b = bsdf_sample(w.v.surface.bsdf, w.v.wo, rng_3(rng));
        if b.valid == 0u {
            break;
        }
        w = scattered(w, b);
        if index >= ROULETTE_FROM {
            let q = min(max_component(w.throughput) * w.eta_scale, 0.95);
            if !(rng_1(rng) < q) {
                break;
            }
            w.throughput /= q;
        }

        // Find the next vertex, and the lights on the way there.
        let medium = step_medium(w.v, b.wi);
        let s = w.v.surface;
        let origin = offset_point(s.position, s.bsdf.n_geo, b.wi, s.offset);
        let hit = trace_closest(Ray(origin, 0.0, b.wi, FAR), rng_bits(rng).x);
        let ray = CameraRay(w.state, RaySegment(origin, hit.t, b.wi), medium);
        light += finite(w.throughput * light_hits(ray, w.v.surface.position));
        if hit.instance == NONE {
            light += finite(w.throughput * environment_light(ray));
            break;
        }
        let cone = cone_along(cone_after(w.v.cone, b.delta != 0u), hit.t);
        let next = surface_at(hit.instance, hit.triangle, hit.barycentrics, -b.wi, cone, false);
        w.throughput *= transmittance(medium, hit.t);
        if max_component(next.emission) > 0.0 {
            light += finite(w.throughput * next.emission * emitter_weight(ray, next, hit.instance, hit.triangle, w.v.surface.position));
        }
        w.state = mis_arrive(w.state, hit.t * hit.t, abs(dot(next.bsdf.n_geo, b.wi)));
        w.v = Vertex(next, -b.wi, medium, cone);
        w.index = index + 1u;
    }
    return light;
}

// A value that overflows counts as black.
fn finite(v: vec3<f32>) -> vec3<f32> {
    return select(vec3<f32>(0.0), v, is_finite_3(v));
}

// Throughput and state after scattering; the state does not yet hold for the next vertex.
fn scattered(walk: CameraWalk, b: BsdfSample) -> CameraWalk {
    var w = walk;
    let s = w.v.surface;
    let cos_out = abs(dot(s.bsdf.n_geo, b.wi));
    w.throughput *= b.weight;
    w.eta_scale *= b.eta * b.eta;
    if b.delta != 0u {
        w.state = mis_scatter_delta(w.state, cos_out);
    } else {
        w.state = mis_scatter(w.state, cos_out, b.pdf, reverse_pdf(s, b.wi, w.v.wo));
    }
    return w;
}

// Density with which a sub-path that arrives from `wi` would be scattered to `wo`.
fn reverse_pdf(s: Surface, wi: vec3<f32>, wo: vec3<f32>) -> f32 {
    return bsdf_pdf(surface_towards(s, wi).bsdf, wi, wo);
}

// Density of emitted rays as MIS weights need it: 0 without light sub-paths.
fn light_path_density(l: LightSample) -> f32 {
    return select(0.0, emission_density(l), settings.light_paths > 0u);
}

// Light of one sampled point of a light.
fn nee_light(w: CameraWalk, pixel: vec2<u32>, rng: ptr<function, Rng>) -> vec3<f32> {
    let selected = select_light(w.v, w.index, settings.candidates, pixel, rng);
    let alpha_seed = rng_bits(rng).x;
    let l = light_point_at(selected.point, w.v.surface.position, false);
    if !(selected.ucw > 0.0) || !(l.pdf_solid_angle > 0.0) {
        return vec3<f32>(0.0);
    }
    let s = w.v.surface;
    let terms = bsdf_terms(s.bsdf, w.v.wo, l.wi);
    let light = terms.f * l.radiance * transmittance(step_medium(w.v, l.wi), l.distance) * (selected.ucw / l.pdf_solid_angle);
    if !(max_component(light) > 0.0) || !light_is_visible(s, l, alpha_seed, false) {
        return vec3<f32>(0.0);
    }
    let light_density = light_pmf(l.light) * l.pdf_solid_angle;
    let weight = mis_nee_weight(
        select(terms.pdf, 0.0, l.delta != 0u),
        light_density * l.pdf_scale,
        light_density,
        light_path_density(l),
        abs(dot(s.bsdf.n_geo, l.wi)),
        w.state,
        reverse_pdf(s, l.wi, w.v.wo),
    );
    return light * technique_weight(weight, NEE);
}

// Light of one light sub-path.
fn connection_light(w: CameraWalk, rng: ptr<function, Rng>) -> vec3<f32> {
    let u = rng_1(rng);
    let alpha_seed = rng_bits(rng).x;
    if settings.light_paths == 0u {
        return vec3<f32>(0.0);
    }
    let p = light_vertex_unpack(light_vertices[min(u32(u * f32(settings.light_paths)), settings.light_paths - 1u)]);
    if p.events == 0u || w.index + p.events > view.bounces {
        return vec3<f32>(0.0);
    }
    let x = w.v.surface;
    // The direction decides only which side of the surface is seen.
    let y = surface_of(p, x.position);
    let d = y.position - x.position;
    let d2 = dot(d, d);
    let wi = d * inverseSqrt(max(d2, 1.0e-37));
    let terms = bsdf_terms(x.bsdf, w.v.wo, wi);
    let cos_y = abs(dot(y.bsdf.n_geo, wi));
    let value = terms.f * scattered_value(y, -wi, p.towards_light) * p.throughput * (cos_y / d2 * f32(p.count));
    if !(max_component(value) > 0.0) || !is_finite_3(value) || trace_any(ray_between(x, y), alpha_seed, false) {
        return vec3<f32>(0.0);
    }
    let from_light = surface_towards(y, p.towards_light);
    let weight = mis_connection_weight(
        MisEnd(w.state, abs(dot(x.bsdf.n_geo, wi)), terms.pdf, reverse_pdf(x, wi, w.v.wo)),
        MisEnd(p.state, cos_y, bsdf_pdf(from_light.bsdf, p.towards_light, -wi), bsdf_pdf(y.bsdf, -wi, p.towards_light)),
        d2,
    );
    let carried = transmittance(step_medium(w.v, wi), sqrt(d2) + open_distance(p, y));
    return value * carried * technique_weight(weight, CONNECTIONS);
}

// The surface of a light vertex as a point sees it.
fn surface_of(p: LightVertex, from_point: vec3<f32>) -> Surface {
    var s = surface_at(p.instance, p.triangle, p.barycentrics, p.towards_light, Cone(0.0, 0.0), false);
    return surface_towards(s, normalize(from_point - s.position));
}

// Length of the light sub-path in the medium of the connection: 0 if the connection leaves on the other side.
fn open_distance(p: LightVertex, y: Surface) -> f32 {
    return select(0.0, p.open_distance, dot(p.towards_light, y.bsdf.n_geo) > 0.0 || bsdf_is_thin(y.bsdf));
}

// Light of the analytic area lights that a ray hits.
fn light_hits(ray: CameraRay, from_point: vec3<f32>) -> vec3<f32> {
    var radiance = vec3<f32>(0.0);
    var first = 0u;
    for (var i = 0u; i < LIGHT_HITS_MAX; i++) {
        let light = next_light_hit(ray.segment, first);
        if light == NONE {
            break;
        }
        first = light + 1u;
        let l = light_point_at(light_hit_point(light, light, ray.segment), from_point, false);
        radiance += l.radiance * transmittance(ray.medium, l.distance) * hit_weight(ray, l, light_pmf(light) * l.pdf_solid_angle);
    }
    return radiance;
}

fn environment_light(ray: CameraRay) -> vec3<f32> {
    var l = no_light_sample();
    l.light = ENVIRONMENT_LIGHT;
    let wi = ray.segment.direction;
    return environment_radiance(wi) * hit_weight(ray, l, light_pmf(ENVIRONMENT_LIGHT) * environment_pdf(wi));
}

// Weight of the emission of the surface that a ray hits.
fn emitter_weight(ray: CameraRay, s: Surface, instance: u32, triangle: u32, from_point: vec3<f32>) -> f32 {
    var l = no_light_sample();
    if s.light == NONE {
        return technique_weight(1.0, HITS);
    }
    l.light = s.light;
    l.wi = ray.segment.direction;
    l.normal = s.bsdf.n_geo;
    l.distance = distance(s.position, from_point);
    let pdf = triangle_light_pdf_solid_angle(instance, triangle, from_point, s.position, false);
    return hit_weight(ray, l, light_pmf(s.light) * pdf);
}

// Weight of a light that a ray hits, which light sub-paths sample with density `light_density`.
fn hit_weight(ray: CameraRay, l: LightSample, light_density: f32) -> f32 {
    return technique_weight(mis_hit_weight(ray.state, light_density * l.pdf_scale, light_density, light_path_density(l)), HITS);
}
