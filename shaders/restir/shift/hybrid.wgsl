// The hybrid shift (Lin et al. 2022; 2026, supplement, 1-2).  It replays a path from another pixel's surface with the path's own random
// numbers up to the vertex before the reconnection vertex, and reuses the vertices from there on.  It is defined only where the shifted
// path would choose the same reconnection vertex by itself: so it is its own inverse.
//
// Between frames in which something moved, the reconnection vertex moves with its surface, the direction after it stays, and the rest of
// the path is replayed as well (`retrace`).
#define_import_path bevy_restir::restir::shift::hybrid

#import bevy_restir::bsdf::types::LOBE_BELOW
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::guard::{GUARD_JACOBIAN, GUARD_SHIFT_CONTRIBUTION, guarded_3, guarded_or_infinite, is_infinite}
#import bevy_restir::common::math::{luminance, max_component}
#import bevy_restir::common::ray::{Hit, Ray}
#import bevy_restir::light::point_on_light::light_point_at
#import bevy_restir::path::medium::{medium_before, transmittance}
#import bevy_restir::path::random::{DIMENSION_RAY, path_alpha_seed}
#import bevy_restir::path::scattering::{drawn_choice, entry_vertex, given_choice, ScatteringVertex}
#import bevy_restir::path::shadow_ray::ray_between
#import bevy_restir::path::technique_weights::{below_surface, camera_state, emitter_sample, state_at, state_of_ray}
#import bevy_restir::path::walk::{drawn_step, given_step, no_step, Step, step_cone, step_medium, Vertex, with_weight_and_densities}
#import bevy_restir::restir::connection::connection::{ends_with_connection, stores_light_vertex}
#import bevy_restir::restir::path_sample::{COPIES_MIS, PathSample, shift_result, TERMINATION_EMITTER, TERMINATION_ENVIRONMENT, TERMINATION_NEE, vertex_barycentrics}
#import bevy_restir::restir::shift::path_end::{end_existed, end_on_light, end_with_connection, end_with_nee, ends_on_analytic_light, hit_analytic_light, hit_environment, require_same_end, stored_weight_of_shifted, Walk}
#import bevy_restir::restir::shift::reconnection::{is_connectable_by, is_connectable_end, previous_vertex, ShiftParameters, triangle_factor}
#import bevy_restir::restir::shift::shifted_path::{failed, SHIFT_EARLIER_CONNECTABLE, SHIFT_JACOBIAN_LIMIT, SHIFT_NO_CONTRIBUTION, SHIFT_NO_PATH, SHIFT_NOT_CONNECTABLE, SHIFT_OK, SHIFT_REPLAY_ENDED, ShiftedPath, with_shadow_ray}
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::offset::{offset_point, surface_point}
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::scene::triangle::instance_exists
#import bevy_restir::trace::trace::trace_closest_in_frame

// Shifts a path to the surface `first`.  `previous`: in the scene of the last frame.  `retrace`: the scene has changed between the frames,
// so that the path after the reconnection vertex is replayed, too.
fn hybrid_shift(s: PathSample, first: Vertex, c: ShiftParameters, previous: bool, retrace: bool) -> ShiftedPath {
    if s.length < 2u {
        return failed(SHIFT_NO_PATH);
    }
    // The stored radiance may be that of a light that the last frame did not have.
    if previous && !end_existed(s) {
        return failed(SHIFT_REPLAY_ENDED);
    }
    var w: Walk;
    w.v = first;
    w.throughput = vec3<f32>(1.0);
    w.suffix = vec3<f32>(1.0);
    w.density = 1.0;
    w.path = s;
    w.state = camera_state(first, c.camera_density, c.counts);
    walk(&w, s, c, previous, retrace);
    if w.reason != SHIFT_OK {
        return failed(w.reason);
    }
    w.f = guarded_3(w.f, GUARD_SHIFT_CONTRIBUTION);
    // The Jacobian is a ratio of densities (Lin et al. 2026, supplement, Eq. 4).  A path without a reconnection vertex has no density: its
    // shift has the Jacobian 1.  The Jacobian is 0 where the shifted path meets the reconnection vertex edge-on.
    let has_density = s.density > 0.0 && !stores_light_vertex(s);
    let jacobian = guarded_or_infinite(select(1.0, density_ratio(w.density, s.density), has_density), GUARD_JACOBIAN);
    if !(max_component(w.f) > 0.0) || !(jacobian > 0.0) {
        return failed(SHIFT_NO_CONTRIBUTION);
    }
    // The limit is symmetric, so that the shift stays its own inverse.
    if is_infinite(jacobian) || max(jacobian, 1.0 / jacobian) > c.jacobian_limit {
        return failed(SHIFT_JACOBIAN_LIMIT);
    }
    w.path.density = select(w.path.density, w.density, has_density);
    w.path.target_value = luminance(w.f);
    return ShiftedPath(shift_result(w.path), w.f, w.density, jacobian, SHIFT_OK, w.rays);
}

// Walks from vertex to vertex.  The loop has a single call of the step, the surface and the traversal for all kinds of vertices: each
// further copy would take compile time and make the threads of a GPU diverge.
fn walk(w: ptr<function, Walk>, s: PathSample, c: ShiftParameters, previous: bool, retrace: bool) {
    for (var index = 1u; index < s.length; index++) {
        let is_last = index + 1u == s.length;
        if !scatter(w, s, index, c, previous, retrace) {
            return;
        }
        if is_last && (s.termination == TERMINATION_NEE || ends_with_connection(s)) {
            break;
        }
        let reconnects = index + 1u == s.reconnection;
        let is_reconnection_point = reconnects && !(is_last && s.termination == TERMINATION_ENVIRONMENT);

        // Leave the vertex.
        let step = step_of_shift(w, s, index, is_reconnection_point, previous);
        if !step.valid || !require_same_reconnection(w, s, index, step, c) {
            return;
        }
        let at = (*w).v.surface;
        let medium = step_medium((*w).v, step.wi);
        take_step(w, s, index, step, c);
        if index == s.reconnection && !retrace {
            (*w).f = (*w).throughput * s.radiance * stored_weight_of_shifted(s, (*w).state);
            return;
        }

        // Find the next vertex.
        let ray = Ray(offset_point(at.position, at.bsdf.n_geo, step.wi, at.offset), 0.0, step.wi, FAR);
        let alpha_seed = path_alpha_seed(s.seed, index, DIMENSION_RAY);
        if is_last && s.termination == TERMINATION_EMITTER && ends_on_analytic_light(s) {
            hit_analytic_light(w, s, index, step, ray, medium, reconnects, alpha_seed, c, previous);
            return;
        }
        var hit = Hit(0.0, s.instance, s.triangle, s.barycentrics);
        if !reconnects {
            hit = replayed_hit(ray, alpha_seed, previous);
            let may_reconnect = (s.reconnection == 0u || index < s.reconnection) && (*w).before.rough;
            hit.barycentrics = vertex_barycentrics(hit.barycentrics, may_reconnect);
        } else if !is_reconnection_point {
            (*w).rays = with_shadow_ray((*w).rays, ray, alpha_seed);
            hit.instance = NONE;
        }
        if hit.instance == NONE {
            if is_last && s.termination == TERMINATION_ENVIRONMENT {
                hit_environment(w, s, index, step, c, previous);
            } else {
                (*w).reason = SHIFT_REPLAY_ENDED;
            }
            return;
        }

        // Arrive there.  The lobe before a reconnection is rough, so that the ray cone is not propagated across it: t is 0.
        let cone = step_cone((*w).v, step, hit.t);
        let n = surface_at(hit.instance, hit.triangle, hit.barycentrics, -step.wi, cone, previous);
        if is_reconnection_point {
            reconnect(w, s, n, medium, alpha_seed, c, previous);
            if c.diffuse_secondary {
                return;
            }
        }
        arrive(w, s, index, step, n, medium, cone, c);
        if is_last && (*w).reason == SHIFT_OK {
            let light = emitter_sample(n, step.wi, hit.instance, hit.triangle, at.position, previous);
            end_on_light(w, s, index, step, n.emission, light, c);
        }
        if !COPIES_MIS {
            (*w).state = state_at((*w).state, n, step.wi, at.position, c.counts);
        }
        if is_last || (*w).reason != SHIFT_OK {
            return;
        }
    }
    // Only paths whose last camera vertex samples its light or is connected come here.
    if ends_with_connection(s) {
        end_with_connection(w, s, s.length - 1u, c, previous, retrace);
    } else {
        end_with_nee(w, s, s.length - 1u, c, previous, retrace);
    }
}

// Multiplies the throughput or the suffix by a factor.  The choice at the reconnection vertex, between its surface and the body below it,
// and the step from its surface belong to the throughput, as their densities belong to the density of the path; what follows belongs to
// the suffix.
fn multiply(w: ptr<function, Walk>, factor: vec3<f32>, is_suffix: bool) {
    if is_suffix {
        (*w).suffix *= factor;
    } else {
        (*w).throughput *= factor;
    }
}

// Goes on from the surface of the vertex of this index, or from a point where light enters the body below it.  Returns false where the shift
// is complete or not defined.
fn scatter(w: ptr<function, Walk>, s: PathSample, index: u32, c: ShiftParameters, previous: bool, retrace: bool) -> bool {
    let v = (*w).v;
    let is_reconnection = index == s.reconnection;
    var choice = given_choice(v, s.lobe_after == LOBE_BELOW);
    if is_reconnection {
        (*w).density *= choice.probability;
    } else {
        choice = drawn_choice(v, s.seed, index);
    }
    (*w).below = choice.below;
    multiply(w, choice.carried, s.reconnection != 0u && index > s.reconnection);
    if !choice.below {
        return true;
    }
    if index > 1u && (s.reconnection == 0u || index <= s.reconnection) {
        let connectable = is_connectable_end((*w).before, v.surface.position, v.surface.bsdf.n_geo, c);
        if connectable != is_reconnection {
            (*w).reason = select(SHIFT_NOT_CONNECTABLE, SHIFT_EARLIER_CONNECTABLE, connectable);
            return false;
        }
    }
    if is_reconnection && !retrace {
        // The point of entry does not depend on the path before: the stored radiance contains all that follows.
        (*w).f = (*w).throughput * s.radiance * stored_weight_of_shifted(s, (*w).state);
        return false;
    }
    let entry = replayed_entry(v, s.seed, index, previous);
    if !entry.valid {
        (*w).reason = SHIFT_REPLAY_ENDED;
        return false;
    }
    multiply(w, entry.weight, s.reconnection != 0u && index >= s.reconnection);
    (*w).state = below_surface((*w).state);
    (*w).v = entry.vertex;
    return true;
}

// The step from the vertex of this index: to the reconnection vertex, as the path left the reconnection vertex, or by its random numbers.
// Not valid where the shift is not defined.
fn step_of_shift(w: ptr<function, Walk>, s: PathSample, index: u32, is_reconnection_point: bool, previous: bool) -> Step {
    let reconnects = index + 1u == s.reconnection;
    var step = given_step(s.wi, s.lobe_before);
    if is_reconnection_point {
        if !has_reconnection_vertex(s, previous) {
            return fail_step(w, step);
        }
        step.wi = normalize(reconnection_point(s, (*w).v.surface.position, previous) - (*w).v.surface.position);
    } else if index == s.reconnection && !(*w).below {
        step.lobe = s.lobe_after;
    } else if !reconnects {
        step = replayed_step((*w).v, s.seed, index);
    }
    step = with_weight_and_densities((*w).v, step);
    if !step.valid {
        return fail_step(w, step);
    }
    return step;
}

// Marks the shift as undefined; returns a step that is not valid.
fn fail_step(w: ptr<function, Walk>, step: Step) -> Step {
    (*w).reason = SHIFT_REPLAY_ENDED;
    var none = step;
    none.valid = false;
    return none;
}

// Whether the reconnection vertex is on a light, or on an object that is in the scene.
fn has_reconnection_vertex(s: PathSample, previous: bool) -> bool {
    return reconnects_on_analytic_light(s) || instance_exists(s.instance, previous);
}

fn reconnects_on_analytic_light(s: PathSample) -> bool {
    return s.termination == TERMINATION_EMITTER && s.reconnection == s.length && ends_on_analytic_light(s);
}

fn reconnection_point(s: PathSample, from_point: vec3<f32>, previous: bool) -> vec3<f32> {
    if reconnects_on_analytic_light(s) {
        return light_point_at(s.light, from_point, previous).position;
    }
    return surface_point(s.instance, s.triangle, s.barycentrics, previous);
}

// Whether the shifted path may reconnect where the path does, and nowhere before.
fn require_same_reconnection(w: ptr<function, Walk>, s: PathSample, index: u32, step: Step, c: ShiftParameters) -> bool {
    let is_before = s.reconnection == 0u || index < s.reconnection;
    if index <= 1u || (*w).below || !(is_before || index == s.reconnection) {
        return true;
    }
    let connectable = is_connectable_by((*w).before, (*w).v, step, c);
    if is_before && connectable {
        (*w).reason = SHIFT_EARLIER_CONNECTABLE;
    }
    if !is_before && !connectable {
        (*w).reason = SHIFT_NOT_CONNECTABLE;
    }
    return (*w).reason == SHIFT_OK;
}

// Updates the state and the throughput, or the suffix after the reconnection vertex; and the density by the steps to that vertex and from it.
fn take_step(w: ptr<function, Walk>, s: PathSample, index: u32, step: Step, c: ShiftParameters) {
    let is_after = s.reconnection != 0u && (index > s.reconnection || (index == s.reconnection && (*w).below));
    if !COPIES_MIS {
        (*w).state = state_of_ray((*w).state, (*w).v, step, index == s.reconnection && !(*w).below);
    }
    multiply(w, step.weight, is_after);
    if is_after {
        return;
    }
    if index + 1u == s.reconnection || index == s.reconnection {
        (*w).density *= step.pdf_lobe;
    }
    (*w).before = previous_vertex((*w).before, (*w).v, step, index, c);
}

// Connects the current vertex with the reconnection vertex `n`.
fn reconnect(w: ptr<function, Walk>, s: PathSample, n: Surface, medium: vec3<f32>, alpha_seed: u32, c: ShiftParameters, previous: bool) {
    let at = (*w).v.surface;
    (*w).density *= triangle_factor(at.position, n.position, s.instance, s.triangle, previous);
    (*w).rays = with_shadow_ray((*w).rays, ray_between(at, n), alpha_seed);
    if c.diffuse_secondary {
        // There is no next step, which would test both directions: only the direction into the vertex can fail.
        if !is_connectable_end((*w).before, n.position, n.bsdf.n_geo, c) {
            (*w).reason = SHIFT_NOT_CONNECTABLE;
        }
        (*w).f = (*w).throughput * transmittance(medium_before(n, medium), distance(n.position, at.position)) * s.radiance;
    }
}

// Makes the surface `n` the current vertex.  If it is the last vertex, it must emit.
fn arrive(
    w: ptr<function, Walk>,
    s: PathSample,
    index: u32,
    step: Step,
    n: Surface,
    medium: vec3<f32>,
    cone: Cone,
    c: ShiftParameters,
) {
    let crossed = medium_before(n, medium);
    let carried = transmittance(crossed, distance(n.position, (*w).v.surface.position));
    multiply(w, carried, s.reconnection != 0u && index >= s.reconnection);
    if index + 1u == s.length {
        if s.termination != TERMINATION_EMITTER || !(max_component(n.emission) > 0.0) {
            (*w).reason = SHIFT_REPLAY_ENDED;
            return;
        }
        require_same_end(w, s, is_connectable_end((*w).before, n.position, n.bsdf.n_geo, c));
    }
    (*w).v = Vertex(n, -step.wi, crossed, cone);
}

// Whether a shift within a frame finds vertices by rays: those between the first vertex and the reconnection vertex, and points where light
// enters a body.
fn replays(s: PathSample, first: Vertex) -> bool {
    let ends_at_first = s.length == 2u && s.termination == TERMINATION_NEE;
    return !(s.reconnection == 2u || ends_at_first) || drawn_choice(first, s.seed, 1u).below;
}

// A pass that defers such shifts to another one has no code for them.
#ifdef DEFERS_REPLAYS
fn replayed_step(v: Vertex, seed: u32, index: u32) -> Step {
    return no_step();
}

fn replayed_hit(ray: Ray, alpha_seed: u32, previous: bool) -> Hit {
    return Hit(0.0, NONE, NONE, vec2<f32>(0.0));
}

fn replayed_entry(v: Vertex, seed: u32, index: u32, previous: bool) -> ScatteringVertex {
    return ScatteringVertex(v, vec3<f32>(0.0), true, false);
}
#else
fn replayed_step(v: Vertex, seed: u32, index: u32) -> Step {
    return drawn_step(v, seed, index);
}

fn replayed_hit(ray: Ray, alpha_seed: u32, previous: bool) -> Hit {
    return trace_closest_in_frame(ray, alpha_seed, previous);
}

fn replayed_entry(v: Vertex, seed: u32, index: u32, previous: bool) -> ScatteringVertex {
    return entry_vertex(v, seed, index, previous);
}
#endif

// PLANT_*: errors that only tests define, and must find.
#ifdef PLANT_NO_JACOBIAN
fn density_ratio(there: f32, here: f32) -> f32 {
    return 1.0;
}
#else
fn density_ratio(there: f32, here: f32) -> f32 {
    return there / here;
}
#endif
