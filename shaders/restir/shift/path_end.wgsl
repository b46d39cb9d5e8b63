// How a shifted path ends: on a light that its last ray hits, with a light sample of its last vertex, or with a connection.  Each function
// leaves the contribution in the walk, or the reason why the shift is not defined.
#define_import_path bevy_restir::restir::shift::path_end

#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::math::max_component
#import bevy_restir::common::ray::Ray
#import bevy_restir::light::analytic_area_light::{light_hit_point, RaySegment}
#import bevy_restir::light::environment::environment_pdf
#import bevy_restir::light::light::environment_light
#import bevy_restir::light::point_on_light::{light_point_at, LightPoint}
#import bevy_restir::light::remap::{light_existed, light_record}
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, LightSample}
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::nee::nee_contribution
#import bevy_restir::path::random::{DIMENSION_SHADOW_RAY, path_alpha_seed}
#import bevy_restir::path::shadow_ray::ray_to_light
#import bevy_restir::path::technique_weights::{CameraState, mis_sum_of_hit, mis_sum_of_nee, stored_weight, weight_of}
#import bevy_restir::path::walk::{Step, Vertex}
#import bevy_restir::restir::path_sample::{COPIES_MIS, PathSample, TERMINATION_ENVIRONMENT, with_mis_of, with_suffix}
#import bevy_restir::restir::shift::reconnection::{is_connectable, is_connectable_end, light_factor, PreviousVertex, ShiftParameters}
#import bevy_restir::restir::shift::shifted_path::{SHIFT_EARLIER_CONNECTABLE, SHIFT_NOT_CONNECTABLE, SHIFT_OK, SHIFT_REPLAY_ENDED, ShadowRays, with_shadow_ray}
#ifdef CONNECTIONS
#import bevy_restir::path::technique_weights::mis_sum_of_connection
#import bevy_restir::restir::connection::connection::{connection_to, Retraced, retraced, stored_connection, stores_light_vertex, with_connection}
#import bevy_restir::scene::triangle::instance_exists
#endif

// State of a shift, up to the current vertex.
struct Walk {
    v: Vertex,
    before: PreviousVertex,   // the vertex before `v`, from the second vertex on
    throughput: vec3<f32>,    // up to and including the step from the reconnection vertex
    suffix: vec3<f32>,        // throughput after that step
    density: f32,             // `PathSample::density` of the shifted path
    rays: ShadowRays,
    reason: u32,
    f: vec3<f32>,
    path: PathSample,         // with the fields that the shift changes
    state: CameraState,       // of the current vertex, and then of the ray that leaves it; unused where the MIS weight is copied
    below: bool,              // the current vertex is a point where light enters a body
}

// Whether the last ray passed a spherical or rectangular light, or the disk of a sun.
#ifdef LIGHT_SHAPES
fn ends_on_analytic_light(s: PathSample) -> bool {
    return s.light.light != NONE;
}
#else
fn ends_on_analytic_light(s: PathSample) -> bool {
    return false;
}
#endif

// Whether the light of a path existed in the last frame.  A path does not know the light of a triangle that its last ray hit.
fn end_existed(s: PathSample) -> bool {
    if s.light.light != NONE {
        return light_existed(s.light.light);
    }
    return s.termination != TERMINATION_ENVIRONMENT || light_existed(ENVIRONMENT_LIGHT);
}

// Ends the path on its spherical or rectangular light: at the point that it stores, or where the ray now hits the light.
fn hit_analytic_light(
    w: ptr<function, Walk>,
    s: PathSample,
    index: u32,
    step: Step,
    ray: Ray,
    medium: vec3<f32>,
    reconnects: bool,
    alpha_seed: u32,
    c: ShiftParameters,
    previous: bool,
) {
    let at = (*w).v.surface;
    var p = s.light;
    if !reconnects {
        p = hit_point_of_light(s, RaySegment(ray.origin, FAR, ray.direction), previous);
    }
    let l = light_point_at(p, at.position, previous);
    if !(max_component(l.radiance) > 0.0) {
        (*w).reason = SHIFT_REPLAY_ENDED;
        return;
    }
    if reconnects {
        (*w).density *= light_factor(l);
    }
    require_same_end(w, s, is_connectable_end((*w).before, l.position, l.normal, c));
    (*w).rays = with_shadow_ray((*w).rays, ray_to_light(at, l, previous), alpha_seed);
    end_on_light(w, s, index, step, l.radiance * transmittance(medium, l.distance), l, c);
}

fn hit_point_of_light(s: PathSample, segment: RaySegment, previous: bool) -> LightPoint {
    let record = light_record(s.light.light, previous);
    if record == NONE {
        return LightPoint(NONE, 0u);
    }
    return light_hit_point(s.light.light, record, segment);
}

// Ends a path whose last ray escapes.
fn hit_environment(w: ptr<function, Walk>, s: PathSample, index: u32, step: Step, c: ShiftParameters, previous: bool) {
    require_same_end(w, s, (*w).before.rough);
    let l = light_at_infinity(s, step.wi, previous);
    end_on_light(w, s, index, step, l.radiance, l, c);
}

// The environment in a direction, or the sun that the path ends on.
fn light_at_infinity(s: PathSample, wi: vec3<f32>, previous: bool) -> LightSample {
    if ends_on_analytic_light(s) {
        let p = hit_point_of_light(s, RaySegment(vec3<f32>(0.0), FAR, wi), previous);
        return light_point_at(p, vec3<f32>(0.0), previous);
    }
    return environment_light(wi, environment_pdf(wi, previous), previous);
}

// The shifted path must reconnect at its light exactly if the original path does; otherwise the shift would not be invertible.
fn require_same_end(w: ptr<function, Walk>, s: PathSample, connectable: bool) {
    if s.reconnection == 0u && connectable {
        (*w).reason = SHIFT_EARLIER_CONNECTABLE;
    }
    if s.reconnection == s.length && !connectable {
        (*w).reason = SHIFT_NOT_CONNECTABLE;
    }
}

// Contribution of a path whose last ray hit a light.  `l`: the sample with which NEE at the vertex before would have found the same point.
fn end_on_light(w: ptr<function, Walk>, s: PathSample, index: u32, step: Step, radiance: vec3<f32>, l: LightSample, c: ShiftParameters) {
    // This sum checks its numbers; the compiler removes the other sums where weights are copied.
    var coefficients = vec3<f32>(1.0, 0.0, 0.0);
    if !COPIES_MIS {
        coefficients = mis_sum_of_hit((*w).state, l, step.delta, index, c.counts);
    }
    end_path(w, s, radiance, coefficients);
}

// The MIS weight of the shifted path, with these coefficients of its own or with those that the path stores.
#ifdef COPIED_MIS
fn weight_of_shifted(s: PathSample, coefficients: vec3<f32>, state: CameraState) -> f32 {
    return s.mis_coefficients.x;
}

fn stored_weight_of_shifted(s: PathSample, state: CameraState) -> f32 {
    return s.mis_coefficients.x;
}
#else
fn weight_of_shifted(s: PathSample, coefficients: vec3<f32>, state: CameraState) -> f32 {
    return weight_of(coefficients, state);
}

fn stored_weight_of_shifted(s: PathSample, state: CameraState) -> f32 {
    return stored_weight(s.mis_coefficients, state);
}
#endif

// Contribution of a path that ends with this radiance.
fn end_path(w: ptr<function, Walk>, s: PathSample, radiance: vec3<f32>, coefficients: vec3<f32>) {
    (*w).f = (*w).throughput * (*w).suffix * radiance * weight_of_shifted(s, coefficients, (*w).state);
    (*w).path = with_suffix((*w).path, (*w).suffix * radiance, coefficients);
}

// The last vertex of a camera sub-path, which goes on to a point that was sampled by all lobes, must reconnect exactly if it does in the
// original path.  `pdf`: marginal density of that direction.
fn require_same_last_vertex(w: ptr<function, Walk>, s: PathSample, index: u32, pdf: f32, c: ShiftParameters) -> bool {
    let connectable = index > 1u && !(*w).below && is_connectable((*w).before, (*w).v.surface, pdf, true, c);
    if index < s.reconnection && connectable {
        (*w).reason = SHIFT_EARLIER_CONNECTABLE;
    }
    if index == s.reconnection && !(*w).below && !connectable {
        (*w).reason = SHIFT_NOT_CONNECTABLE;
    }
    return (*w).reason == SHIFT_OK;
}

// Contribution of a path whose last vertex samples its light by NEE: the density is that of the light, whichever vertex samples it.
fn end_with_nee(w: ptr<function, Walk>, s: PathSample, index: u32, c: ShiftParameters, previous: bool, retrace: bool) {
    let nee = nee_contribution((*w).v, s.light, previous);
    if !require_same_last_vertex(w, s, index, nee.pdf_bsdf, c) {
        return;
    }
    end_path(w, s, nee.f, mis_sum_of_nee((*w).state, (*w).v, nee.light, nee.pdf_bsdf, index, c.counts));
    // From the reconnection vertex on, visibility changes only where something moved.
    if index < s.reconnection || retrace {
        let ray = ray_to_light((*w).v.surface, nee.light, previous);
        (*w).rays = with_shadow_ray((*w).rays, ray, path_alpha_seed(s.seed, index, DIMENSION_SHADOW_RAY));
    }
}

#ifdef CONNECTIONS
// Contribution of a path whose last vertex is connected with a light vertex.
fn end_with_connection(w: ptr<function, Walk>, s: PathSample, index: u32, c: ShiftParameters, previous: bool, retrace: bool) {
    let v = (*w).v;
    var k = stored_connection(v, s);
    if retrace || stores_light_vertex(s) {
        var end = Retraced(s, instance_exists(s.instance, previous));
        if retrace {
            end = retraced(s, previous);
        }
        if !end.exists {
            (*w).reason = SHIFT_REPLAY_ENDED;
            return;
        }
        k = connection_to(v, end.path, c.counts.connections, previous);
        (*w).rays = with_shadow_ray((*w).rays, k.ray, path_alpha_seed(s.seed, index, DIMENSION_SHADOW_RAY));
        if stores_light_vertex(s) {
            (*w).path = end.path;
        }
    }
    if !require_same_last_vertex(w, s, index, k.pdf, c) {
        return;
    }
    let coefficients = mis_sum_of_connection((*w).state, v, k.wi, k.pdf, k.mis_ratios);
    if stores_light_vertex(s) {
        (*w).f = (*w).throughput * k.f * k.light * weight_of_shifted(s, coefficients, (*w).state);
    } else if index == s.reconnection && !(*w).below {
        (*w).path = with_mis_of(with_connection(s, k), s);
        (*w).f = (*w).throughput * k.f * k.light * weight_of_shifted(s, coefficients, (*w).state);
    } else {
        end_path(w, s, k.f * k.light, coefficients);
    }
}
#else
fn end_with_connection(w: ptr<function, Walk>, s: PathSample, index: u32, c: ShiftParameters, previous: bool, retrace: bool) {
}
#endif
