// The hybrid shift (Lin et al. 2022; 2026, supplement, 1-2): a path is replayed from another pixel's surface with its own random numbers
// up to the vertex before the reconnection, and goes on through the vertices that it had.  It is defined only where the shifted path
// would choose the same reconnection by itself, which makes it its own inverse.
//
// Between frames in which something moved the reconnection vertex moves with its surface, the direction after it stays, and what follows
// is replayed with the path's own random numbers, too.
#define_import_path bevy_restir::shift::hybrid

#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::math::{is_finite, is_finite_3, luminance, max_component}
#import bevy_restir::light::environment::{environment_pdf, environment_radiance}
#import bevy_restir::light::point_on_light::{light_point_at, LightPoint}
#import bevy_restir::light::remap::light_record
#import bevy_restir::light::shape::{crossing_point, Way}
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, LightSample, no_light_sample}
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::random::{OF_LIGHT_RAY, OF_RAY, path_alpha_seed}
#import bevy_restir::path::sample::{Arrival, END_EMITTER, END_ENVIRONMENT, END_LIGHT, landed_barycentrics, PathSample}
#import bevy_restir::path::shadow::{ray_between, ray_to_light}
#import bevy_restir::path::tree::{aim, emission_pdf, expected_candidates, met_weight}
#import bevy_restir::path::walk::{aimed_step, drawn_step, finished_step, Step, step_cone, step_medium, Vertex}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::types::RESAMPLE_KEEPS_RADIANCE
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::shift::connect::{Connection, Departure, departure, is_connectable, is_connectable_end, is_rough, light_factor, triangle_factor}
#import bevy_restir::trace::offset::{offset_point, surface_point}
#import bevy_restir::trace::ray::Ray
#import bevy_restir::trace::trace::{trace_any, trace_closest_of}

// Why a path cannot be shifted.
const SHIFT_OK: u32 = 0u;
const SHIFT_NO_PATH: u32 = 1u;
const SHIFT_ENDED: u32 = 2u;          // the replay ended, or met a light, where the path does not
const SHIFT_EARLIER: u32 = 3u;        // an earlier pair is connectable, or any of a path that is replayed whole
const SHIFT_UNCONNECTABLE: u32 = 4u;  // the pair is not
const SHIFT_BLACK: u32 = 5u;          // nothing is carried
const SHIFT_APART: u32 = 6u;          // its densities differ by more than the limit
const SHIFT_HIDDEN: u32 = 7u;         // something stands between: what `is_free` says

// A ray that must meet nothing.
struct Free {
    ray: Ray,
    alpha_seed: u32,
}

struct Shifted {
    arrival: Arrival,         // of the path as it is there
    f: vec3<f32>,             // what it carries there, if its rays are free
    density: f32,             // `PathSample::density` there
    jacobian: f32,            // of the shift; 0 where it is not defined
    reason: u32,              // SHIFT_*
    rays: Rays,
}

// No more than two: no array, whose place would be memory.
struct Rays {
    count: u32,
    first: Free,
    second: Free,
}

// A path as far as it was shifted.
struct Walk {
    v: Vertex,
    before: Departure,        // from the last vertex, where there is one but the camera
    throughput: vec3<f32>,    // up to the reconnection vertex, and on to the next one
    suffix: vec3<f32>,        // from there on
    after: Step,              // from the reconnection vertex
    density: f32,
    rays: Rays,
    reason: u32,
    f: vec3<f32>,
    radiance: vec3<f32>,      // `PathSample::radiance` and `light_pdf` where they were found anew
    light_pdf: f32,
}

// `previous`: into the last frame.  `traces`: what follows the reconnection vertex is not what it was.
fn hybrid_shift(s: PathSample, first: Vertex, c: Connection, previous: bool, traces: bool) -> Shifted {
    if s.length < 2u {
        return failed(SHIFT_NO_PATH);
    }
    var w: Walk;
    w.v = first;
    w.throughput = vec3<f32>(1.0);
    w.suffix = vec3<f32>(1.0);
    w.density = 1.0;
    w.radiance = s.radiance;
    w.light_pdf = s.light_pdf;
    walk(&w, s, c, previous, traces);
    if w.reason == SHIFT_OK && (!(max_component(w.f) > 0.0) || !is_finite_3(w.f)) {
        w.reason = SHIFT_BLACK;
    }
    // Where nothing is divided by a density the Jacobian is 1.
    let jacobian = select(1.0, over(w.density, s.density), s.density > 0.0);
    if w.reason == SHIFT_OK && (!(jacobian > 0.0) || !is_finite(jacobian)) {
        w.reason = SHIFT_BLACK;
    }
    // Both ways alike, so that the shift stays its own inverse.
    if w.reason == SHIFT_OK && max(jacobian, 1.0 / jacobian) > settings.jacobian_limit {
        w.reason = SHIFT_APART;
    }
    if w.reason != SHIFT_OK {
        return failed(w.reason);
    }
    let arrival = Arrival(w.radiance, w.light_pdf, select(0.0, w.density, s.density > 0.0), luminance(w.f));
    return Shifted(arrival, w.f, w.density, jacobian, SHIFT_OK, w.rays);
}

fn failed(reason: u32) -> Shifted {
    var none: Shifted;
    none.reason = reason;
    return none;
}

// Whether nothing stands in the way of a shifted path, in this frame or the last.
fn is_free(s: Shifted, previous: bool) -> bool {
    for (var i = 0u; i < s.rays.count; i++) {
        var free = s.rays.first;
        if i > 0u {
            free = s.rays.second;
        }
        if trace_any(free.ray, free.alpha_seed, previous) {
            return false;
        }
    }
    return true;
}

fn walk(w: ptr<function, Walk>, s: PathSample, c: Connection, previous: bool, traces: bool) {
    // Of the vertices that scatter the last one may aim at a light.
    let aims = s.end == END_LIGHT;
    let rays = s.length - 1u - u32(aims);
    for (var index = 1u; index <= rays; index++) {
        let ends = index + 1u == s.length;
        let connects = index + 1u == s.reconnection;
        let is_kept = connects && !(ends && s.end == END_ENVIRONMENT);
        let step = left_by(w, s, index, is_kept, previous);
        if !step.valid {
            (*w).reason = SHIFT_ENDED;
            return;
        }
        if !leaves_as_it_should(w, s, index, step, c) {
            return;
        }
        let at = (*w).v.surface;
        let medium = step_medium((*w).v, step.wi);
        take(w, s, index, step, c);

        // Arrive.
        if index == s.reconnection && !traces {
            (*w).f = (*w).throughput * s.radiance * select(1.0, met_weight(step, s.light_pdf), ends);
            return;
        }
        let ray = Ray(offset_point(at.position, at.bsdf.n_geo, step.wi, at.offset), 0.0, step.wi, FAR);
        let alpha_seed = path_alpha_seed(s.seed, index, OF_RAY);
        if ends && s.end == END_EMITTER && passes_light(s) {
            pass_light(w, s, index, step, ray, medium, connects, alpha_seed, c, previous);
            return;
        }
        var instance = s.instance;
        var triangle = s.triangle;
        var barycentrics = s.barycentrics;
        // To a vertex that is kept a rough lobe leads: there is no cone to follow.
        var met_at = 0.0;
        if !connects {
            let hit = trace_closest_of(ray, alpha_seed, previous);
            instance = hit.instance;
            triangle = hit.triangle;
            let may_be_kept = (s.reconnection == 0u || index < s.reconnection) && (*w).before.rough;
            barycentrics = landed_barycentrics(hit.barycentrics, may_be_kept);
            met_at = hit.t;
        } else if !is_kept {
            // Nothing is met by a free ray.
            must_be_free(w, ray, alpha_seed);
            instance = NONE;
        }
        if instance == NONE {
            if ends && s.end == END_ENVIRONMENT {
                meet_at_infinity(w, s, index, step, c, previous);
            } else {
                (*w).reason = SHIFT_ENDED;
            }
            return;
        }
        let cone = step_cone((*w).v, step, met_at);
        let n = surface_at(instance, triangle, barycentrics, -step.wi, cone, previous);
        if is_kept {
            (*w).density *= triangle_factor(at.position, n.position, instance, triangle, previous);
            must_be_free(w, ray_between(at, n), alpha_seed);
            if (settings.flags & RESAMPLE_KEEPS_RADIANCE) != 0u {
                // As the next step would be asked; the distance is all that it depends on.
                if !is_connectable_end((*w).before, n.position, n.bsdf.n_geo, c) {
                    (*w).reason = SHIFT_UNCONNECTABLE;
                }
                (*w).f = (*w).throughput * transmittance(medium, distance(n.position, at.position)) * s.radiance;
                return;
            }
        }
        arrive(w, s, index, step, n, instance, triangle, medium, cone, c, previous);
        if ends || (*w).reason != SHIFT_OK {
            return;
        }
    }
    if aims {
        aim_at_light(w, s, s.length - 1u, c, previous, traces);
    }
}

// How the path leaves a vertex: for the next one that is kept, as it left the reconnection vertex, or as its random numbers say.
fn left_by(w: ptr<function, Walk>, s: PathSample, index: u32, is_kept: bool, previous: bool) -> Step {
    let connects = index + 1u == s.reconnection;
    var step = aimed_step(s.wi, s.lobe_before);
    if is_kept {
        step.wi = normalize(kept_point(s, (*w).v.surface.position, previous) - (*w).v.surface.position);
    } else if index == s.reconnection {
        step.lobe = s.lobe_after;
    } else if !connects {
        step = drawn_step((*w).v, s.seed, index);
    }
    return finished_step((*w).v, step);
}

// The vertex that paths are reconnected to.
fn kept_point(s: PathSample, from_point: vec3<f32>, previous: bool) -> vec3<f32> {
    if s.end == END_EMITTER && s.reconnection == s.length && passes_light(s) {
        return light_point_at(s.light, from_point, previous).position;
    }
    return surface_point(s.instance, s.triangle, s.barycentrics, previous);
}

// Whether its last ray passed a light that is no triangle.
#ifdef LIGHT_SHAPES
fn passes_light(s: PathSample) -> bool {
    return s.light.light != NONE;
}
#else
fn passes_light(s: PathSample) -> bool {
    return false;
}
#endif

// The same light is passed again: at the point that it was, or where the path comes to it now.
fn pass_light(
    w: ptr<function, Walk>,
    s: PathSample,
    index: u32,
    step: Step,
    ray: Ray,
    medium: vec3<f32>,
    connects: bool,
    alpha_seed: u32,
    c: Connection,
    previous: bool,
) {
    let at = (*w).v.surface;
    var p = s.light;
    if !connects {
        p = passed_point(s, Way(ray.origin, FAR, ray.direction), previous);
    }
    let l = light_point_at(p, at.position, previous);
    if !(max_component(l.radiance) > 0.0) {
        (*w).reason = SHIFT_ENDED;
        return;
    }
    if connects {
        (*w).density *= light_factor(l);
    }
    judge_end(w, s, is_connectable_end((*w).before, l.position, l.normal, c));
    must_be_free(w, ray_to_light(at, l), alpha_seed);
    let light_pdf = expected_candidates(s.light.light, index) * l.pdf_solid_angle * l.aim;
    end_with(w, s, index, step, l.radiance * transmittance(medium, l.distance), light_pdf);
}

fn passed_point(s: PathSample, way: Way, previous: bool) -> LightPoint {
    let record = light_record(s.light.light, previous);
    if record == NONE {
        return LightPoint(NONE, 0u);
    }
    return crossing_point(s.light.light, record, way);
}

// What a path that meets no surface meets: the environment, or a sun.
fn light_at_infinity(s: PathSample, wi: vec3<f32>, previous: bool) -> LightSample {
    if passes_light(s) {
        let p = passed_point(s, Way(vec3<f32>(0.0), FAR, wi), previous);
        return light_point_at(p, vec3<f32>(0.0), previous);
    }
    return environment_at(wi);
}

fn environment_at(wi: vec3<f32>) -> LightSample {
    var l = no_light_sample();
    l.light = ENVIRONMENT_LIGHT;
    l.radiance = environment_radiance(wi);
    l.pdf_solid_angle = environment_pdf(wi);
    return l;
}

// PLANT_*: errors that only tests define, and must find.
#ifdef PLANT_NO_JACOBIAN
fn over(there: f32, here: f32) -> f32 {
    return 1.0;
}
#else
fn over(there: f32, here: f32) -> f32 {
    return there / here;
}
#endif

// Whether pairs of vertices are connectable where the path reconnects and nowhere before.
fn leaves_as_it_should(w: ptr<function, Walk>, s: PathSample, index: u32, step: Step, c: Connection) -> bool {
    let is_before = s.reconnection == 0u || index < s.reconnection;
    if index <= 1u || !(is_before || index == s.reconnection) {
        return true;
    }
    let connectable = !step.delta && is_connectable((*w).before, (*w).v.surface, step.pdf, is_rough((*w).v, step, c), c);
    if is_before && connectable {
        (*w).reason = SHIFT_EARLIER;
    }
    if !is_before && !connectable {
        (*w).reason = SHIFT_UNCONNECTABLE;
    }
    return (*w).reason == SHIFT_OK;
}

// Takes a step: throughput before, density at, suffix after the reconnection.
fn take(w: ptr<function, Walk>, s: PathSample, index: u32, step: Step, c: Connection) {
    if s.reconnection != 0u && index > s.reconnection {
        (*w).suffix *= step.weight;
        return;
    }
    (*w).throughput *= step.weight;
    if index + 1u == s.reconnection || index == s.reconnection {
        (*w).density *= step.pdf_lobe;
    }
    (*w).before = departure((*w).v, step, index, c);
    (*w).after = step;
}

// On a surface, where the path goes on, or ends as it emits.
fn arrive(
    w: ptr<function, Walk>,
    s: PathSample,
    index: u32,
    step: Step,
    n: Surface,
    instance: u32,
    triangle: u32,
    medium: vec3<f32>,
    cone: Cone,
    c: Connection,
    previous: bool,
) {
    let carried = transmittance(medium, distance(n.position, (*w).v.surface.position));
    if s.reconnection != 0u && index >= s.reconnection {
        (*w).suffix *= carried;
    } else {
        (*w).throughput *= carried;
    }
    if index + 1u == s.length {
        if s.end != END_EMITTER || !(max_component(n.emission) > 0.0) {
            (*w).reason = SHIFT_ENDED;
            return;
        }
        judge_end(w, s, is_connectable_end((*w).before, n.position, n.bsdf.n_geo, c));
        end_with(w, s, index, step, n.emission, emission_pdf(n, instance, triangle, (*w).v.surface.position, index, previous));
    }
    (*w).v = Vertex(n, -step.wi, medium, cone);
}

// In a direction where nothing is.
fn meet_at_infinity(w: ptr<function, Walk>, s: PathSample, index: u32, step: Step, c: Connection, previous: bool) {
    judge_end(w, s, (*w).before.rough);
    let l = light_at_infinity(s, step.wi, previous);
    end_with(w, s, index, step, l.radiance, expected_candidates(l.light, index) * l.pdf_solid_angle);
}

// The light that a path meets is reconnected to where that can be done, and only there.
fn judge_end(w: ptr<function, Walk>, s: PathSample, connectable: bool) {
    if s.reconnection == 0u && connectable {
        (*w).reason = SHIFT_EARLIER;
    }
    if s.reconnection == s.length && !connectable {
        (*w).reason = SHIFT_UNCONNECTABLE;
    }
}

// The last ray of the path met light.
fn end_with(w: ptr<function, Walk>, s: PathSample, index: u32, step: Step, radiance: vec3<f32>, light_pdf: f32) {
    let weight = met_weight(step, light_pdf);
    if s.reconnection == index {
        (*w).radiance = (*w).suffix * radiance;
        (*w).light_pdf = light_pdf;
        (*w).f = (*w).throughput * (*w).radiance * weight;
        return;
    }
    if s.reconnection != 0u && index > s.reconnection {
        (*w).radiance = (*w).suffix * radiance * weight;
        (*w).f = (*w).throughput * (*w).radiance;
        return;
    }
    (*w).f = (*w).throughput * radiance * weight;
}

// The vertex aims at the light that the path aims at: its density is the light's own, whoever aims.
fn aim_at_light(w: ptr<function, Walk>, s: PathSample, index: u32, c: Connection, previous: bool, traces: bool) {
    let a = aim((*w).v, s.light, expected_candidates(s.light.light, index), previous);
    let connectable = index > 1u && is_connectable((*w).before, (*w).v.surface, a.pdf_bsdf, true, c);
    if index < s.reconnection && connectable {
        (*w).reason = SHIFT_EARLIER;
        return;
    }
    if index == s.reconnection && !connectable {
        (*w).reason = SHIFT_UNCONNECTABLE;
        return;
    }
    if index > s.reconnection {
        (*w).radiance = (*w).suffix * a.f;
        (*w).f = (*w).throughput * (*w).radiance;
    } else {
        (*w).f = (*w).throughput * a.f;
    }
    // From the reconnection vertex on nothing has changed, where nothing has moved.
    if index < s.reconnection || traces {
        must_be_free(w, ray_to_light((*w).v.surface, a.light), path_alpha_seed(s.seed, index, OF_LIGHT_RAY));
    }
}

fn must_be_free(w: ptr<function, Walk>, ray: Ray, alpha_seed: u32) {
    if (*w).rays.count == 0u {
        (*w).rays.first = Free(ray, alpha_seed);
    } else {
        (*w).rays.second = Free(ray, alpha_seed);
    }
    (*w).rays.count += 1u;
}
