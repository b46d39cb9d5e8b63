// The hybrid shift (paper 000, 1-2; Lin et al. 2022): a path is replayed from another pixel's surface with its own random numbers up to
// the vertex before the reconnection, and goes on through the vertices that it had.  It is defined only where the shifted path would
// choose the same reconnection by itself, which makes it its own inverse (`formulas-and-traps` O0 to O3).
#define_import_path bevy_restir::shift::hybrid

#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::math::{is_finite, is_finite_3, max_component}
#import bevy_restir::light::environment::{environment_pdf, environment_radiance}
#import bevy_restir::light::select::{environment_pmf, light_pmf}
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::random::{OF_LIGHT_RAY, OF_RAY, path_alpha_seed}
#import bevy_restir::path::sample::{END_EMITTER, END_ENVIRONMENT, END_LIGHT, kept_barycentrics, PathSample}
#import bevy_restir::path::shadow::{light_is_visible, surface_is_visible}
#import bevy_restir::path::tree::{aim, Aimed, emission_pdf, met_weight}
#import bevy_restir::path::walk::{no_step, sampled_step, Step, step_medium, step_towards, Vertex}
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::shift::connect::{Connection, Departure, departure, geometry_factor, is_connectable, is_connectable_end}
#import bevy_restir::trace::offset::offset_point
#import bevy_restir::trace::ray::Ray
#import bevy_restir::trace::software::trace_closest_of

// Why a path cannot be shifted.
const SHIFT_OK: u32 = 0u;
const SHIFT_NO_PATH: u32 = 1u;
const SHIFT_ENDED: u32 = 2u;          // the replay ended, or met a light, where the path does not
const SHIFT_EARLIER: u32 = 3u;        // an earlier pair is connectable (O1, O3)
const SHIFT_UNCONNECTABLE: u32 = 4u;  // the pair is not (O2)
const SHIFT_BLACK: u32 = 5u;          // nothing is carried
const SHIFT_HIDDEN: u32 = 6u;         // something stands between

struct Shifted {
    f: vec3<f32>,             // what the shifted path carries, in primary sample space
    jacobian: f32,            // of the shift there; 0 where it is not defined
    reason: u32,              // SHIFT_*
    density: f32,             // `PathSample::density` of the shifted path
}

fn failed(reason: u32) -> Shifted {
    return Shifted(vec3<f32>(0.0), 0.0, reason, 0.0);
}

// The replay as far as it has come.
struct Replay {
    v: Vertex,
    index: u32,
    throughput: vec3<f32>,
    before: Departure,        // from the last vertex, where there is one but the camera
}

// Whether the pair before the replay's vertex would have been chosen, the path leaving with marginal density `pdf`.
fn earlier_is_connectable(r: Replay, pdf: f32, is_delta: bool, c: Connection) -> bool {
    return r.index > 1u && !is_delta && is_connectable(r.before, r.v.surface, pdf, c);
}

// `previous`: into the last frame.
fn hybrid_shift(s: PathSample, first: Vertex, c: Connection, previous: bool) -> Shifted {
    if s.length < 2u {
        return failed(SHIFT_NO_PATH);
    }
    var r: Replay;
    r.v = first;
    r.throughput = vec3<f32>(1.0);
    let last = select(s.reconnection - 1u, s.length, s.reconnection == 0u);
    for (r.index = 1u; r.index < last; r.index++) {
        let step = sampled_step(r.v, s.seed, r.index);
        if !step.valid {
            return failed(SHIFT_ENDED);
        }
        if earlier_is_connectable(r, step.pdf, step.delta, c) {
            return failed(SHIFT_EARLIER);
        }
        let at = r.v.surface;
        let medium = step_medium(r.v, step.wi);
        r.throughput *= step.weight;
        r.before = departure(r.v, step, c);
        let origin = offset_point(at.position, at.bsdf.n_geo, step.wi, at.offset);
        let hit = trace_closest_of(Ray(origin, 0.0, step.wi, FAR), path_alpha_seed(s.seed, r.index, OF_RAY), previous);
        let ends = r.index + 1u == s.length;
        if hit.instance == NONE {
            if !ends || s.end != END_ENVIRONMENT {
                return failed(SHIFT_ENDED);
            }
            if r.before.rough {
                return failed(SHIFT_EARLIER);
            }
            let light_pdf = environment_pmf() * environment_pdf(step.wi);
            return whole(r.throughput * environment_radiance(step.wi) * met_weight(step, light_pdf));
        }
        let n = surface_at(hit.instance, hit.triangle, kept_barycentrics(hit.barycentrics), -step.wi, previous);
        r.throughput *= transmittance(medium, distance(n.position, at.position));
        if ends {
            if s.end != END_EMITTER || !(max_component(n.emission) > 0.0) {
                return failed(SHIFT_ENDED);
            }
            if is_connectable_end(r.before, n, c) {
                return failed(SHIFT_EARLIER);
            }
            let light_pdf = emission_pdf(n, hit.instance, hit.triangle, at.position);
            return whole(r.throughput * n.emission * met_weight(step, light_pdf));
        }
        r.v = Vertex(n, -step.wi, medium);
    }
    return reconnect(s, r, c, previous);
}

// A path that was replayed to its end.
fn whole(f: vec3<f32>) -> Shifted {
    return carried(f, 1.0, 0.0);
}

fn carried(f: vec3<f32>, jacobian: f32, density: f32) -> Shifted {
    if !(max_component(f) > 0.0) || !is_finite_3(f) || !(jacobian > 0.0) || !is_finite(jacobian) {
        return failed(SHIFT_BLACK);
    }
    return Shifted(f, jacobian, SHIFT_OK, density);
}

fn reconnect(s: PathSample, r: Replay, c: Connection, previous: bool) -> Shifted {
    let is_end = s.reconnection == s.length;
    if is_end && s.end == END_LIGHT {
        return reconnect_to_light(s, r, c, previous);
    }
    if is_end && s.end == END_ENVIRONMENT {
        return reconnect_to_environment(s, r, c, previous);
    }
    return reconnect_to_surface(s, r, c, previous);
}

// To the point of a light: its density is the light's own, whoever aims.
fn reconnect_to_light(s: PathSample, r: Replay, c: Connection, previous: bool) -> Shifted {
    let a = aim(r.v, s.light, light_pmf(s.light.light), previous);
    if !(max_component(a.f) > 0.0) {
        return failed(SHIFT_BLACK);
    }
    if earlier_is_connectable(r, a.pdf_bsdf, false, c) {
        return failed(SHIFT_EARLIER);
    }
    if !light_is_visible(r.v.surface, a.light, path_alpha_seed(s.seed, r.index, OF_LIGHT_RAY), previous) {
        return failed(SHIFT_HIDDEN);
    }
    return carried(r.throughput * a.f, 1.0, 0.0);
}

// To a direction.
fn reconnect_to_environment(s: PathSample, r: Replay, c: Connection, previous: bool) -> Shifted {
    let step = step_towards(r.v, s.wi, s.lobe_before);
    if !step.valid {
        return failed(SHIFT_BLACK);
    }
    if earlier_is_connectable(r, step.pdf, false, c) {
        return failed(SHIFT_EARLIER);
    }
    if !departure(r.v, step, c).rough {
        return failed(SHIFT_UNCONNECTABLE);
    }
    let light_pdf = environment_pmf() * environment_pdf(s.wi);
    let f = r.throughput * step.weight * environment_radiance(s.wi) * met_weight(step, light_pdf);
    if max_component(f) > 0.0 && !direction_is_visible(r, s, previous) {
        return failed(SHIFT_HIDDEN);
    }
    return carried(f, step.pdf_lobe / s.density, step.pdf_lobe);
}

fn direction_is_visible(r: Replay, s: PathSample, previous: bool) -> bool {
    let at = r.v.surface;
    let ray = Ray(offset_point(at.position, at.bsdf.n_geo, s.wi, at.offset), 0.0, s.wi, FAR);
    return trace_closest_of(ray, path_alpha_seed(s.seed, r.index, OF_RAY), previous).instance == NONE;
}

// To a vertex on a surface, where the path goes on, aims at its light, or ends.
fn reconnect_to_surface(s: PathSample, r: Replay, c: Connection, previous: bool) -> Shifted {
    let at = r.v.surface;
    var n = surface_at(s.instance, s.triangle, s.barycentrics, vec3<f32>(0.0, 0.0, 1.0), previous);
    let wi = normalize(n.position - at.position);
    n = surface_at(s.instance, s.triangle, s.barycentrics, -wi, previous);
    let step = step_towards(r.v, wi, s.lobe_before);
    if !step.valid {
        return failed(SHIFT_BLACK);
    }
    if earlier_is_connectable(r, step.pdf, false, c) {
        return failed(SHIFT_EARLIER);
    }
    let medium = step_medium(r.v, wi);
    let next = Vertex(n, -wi, medium);
    let leaving = departure(r.v, step, c);
    var density = step.pdf_lobe * geometry_factor(at.position, n.position, n.bsdf.n_geo);
    var f = r.throughput * step.weight * transmittance(medium, distance(n.position, at.position));
    var connectable = false;
    if s.reconnection == s.length {
        connectable = is_connectable_end(leaving, n, c);
        f *= n.emission * met_weight(step, emission_pdf(n, s.instance, s.triangle, at.position));
    } else if s.end == END_LIGHT && s.reconnection + 1u == s.length {
        let a = aim(next, s.light, light_pmf(s.light.light), previous);
        connectable = is_connectable(leaving, n, a.pdf_bsdf, c);
        f *= a.f;
    } else {
        let after = step_towards(next, s.wi, s.lobe_after);
        if !after.valid {
            return failed(SHIFT_BLACK);
        }
        connectable = is_connectable(leaving, n, after.pdf, c);
        density *= after.pdf_lobe;
        f *= after.weight * s.radiance;
        if s.reconnection + 1u == s.length {
            f *= met_weight(after, s.light_pdf);
        }
    }
    if !connectable {
        return failed(SHIFT_UNCONNECTABLE);
    }
    if max_component(f) > 0.0 && !surface_is_visible(at, n, path_alpha_seed(s.seed, r.index, OF_RAY), previous) {
        return failed(SHIFT_HIDDEN);
    }
    return carried(f, density / s.density, density);
}
