// Initial candidates of a pixel: one random walk.  At each of its vertices NEE ends one path, and each hit of a light source ends one more.
// All of at least the technique's `SHORTEST_LENGTH` are resampled into one (Lin et al. 2026, supplement, 1, 6 and 7).  The resampling
// weight of a path is its contribution in primary sample space, divided by the probability that Russian roulette continued it.  The
// reconnection vertex is chosen as the path grows.
#define_import_path bevy_restir::restir::pt::initial_candidates

#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_is_delta}
#import bevy_restir::bsdf::types::LOBE_BELOW
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::guard::{GUARD_LIGHT_CONTRIBUTION, GUARD_THROUGHPUT, guarded_3}
#import bevy_restir::common::math::{luminance, max_component}
#import bevy_restir::common::ray::{Hit, Ray}
#import bevy_restir::common::rng::{Rng, rng_1}
#import bevy_restir::light::analytic_area_light::{light_hit_point, LIGHT_HITS_MAX, next_light_hit, RaySegment}
#import bevy_restir::light::environment::environment_pdf
#import bevy_restir::light::light::environment_light
#import bevy_restir::light::point_on_light::{light_point_at, LightPoint, no_light_point}
#import bevy_restir::light::types::{LightSample, RAYS_FIND_LIGHT}
#import bevy_restir::path::medium::{medium_before, transmittance}
#import bevy_restir::path::nee::{nee_candidate_count, nee_contribution}
#import bevy_restir::path::random::{DIMENSION_SHADOW_RAY, DIMENSION_RAY, path_alpha_seed, path_seed}
#import bevy_restir::path::roulette::{ROULETTE_FROM, survival_probability}
#import bevy_restir::path::scattering::{drawn_choice, entry_vertex}
#import bevy_restir::path::shadow_ray::light_is_visible
#import bevy_restir::path::technique_weights::{below_surface, camera_state, CameraState, emitter_sample, mis_sum_of_hit, mis_sum_of_nee, state_at, state_of_ray, weight_of}
#import bevy_restir::path::walk::{sampled_step, Step, step_cone, step_medium, Vertex}
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::light_candidates::{light_candidate, subset_of, useful_candidates}
#import bevy_restir::restir::path_sample::{no_path_sample, PathSample, TERMINATION_EMITTER, TERMINATION_ENVIRONMENT, TERMINATION_NEE, vertex_barycentrics, with_mis_weight, with_suffix}
#import bevy_restir::restir::reservoir_sampling::{Stream, stream_add, stream_ucw}
#import bevy_restir::restir::shift::reconnection::{is_connectable, is_connectable_by, is_connectable_end, light_factor, previous_vertex, PreviousVertex, ShiftParameters, triangle_factor}
#import bevy_restir::restir::types::RESAMPLE_NO_ROULETTE
#import bevy_restir::scene::material::may_emit
#import bevy_restir::scene::offset::offset_point
#import bevy_restir::scene::surface::surface_at
#import bevy_restir::trace::trace::trace_closest
#import bevy_restir::view::bindings::view
#ifdef CONNECTIONS
#import bevy_restir::path::technique_weights::mis_sum_of_connection
#import bevy_restir::restir::connection::bindings::light_vertices
#import bevy_restir::light::select::light_pmf
#import bevy_restir::restir::connection::light_vertex::light_vertex_at
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::connection::connection::{connection_to, ended_at_light_vertex, with_connection, with_end_of}
#import bevy_restir::trace::trace::trace_any
#endif

// The random walk, and the path that is selected so far.
struct Candidates {
    stream: Stream,
    selected: PathSample,
    f: vec3<f32>,             // contribution of the selected path
    prefix: PathSample,       // fields that all paths share that end from here on
    throughput: vec3<f32>,    // of the prefix, up to the current vertex
    suffix: vec3<f32>,        // throughput since the reconnection vertex
    state: CameraState,       // of the current vertex, and then of the ray that leaves it
    survival: f32,            // probability that Russian roulette continued the prefix
    below: bool,              // the current vertex is a point where light enters a body
    choice_probability: f32,  // probability of the choice between the surface of the current vertex and the body below it
}

// The selected path.
struct SelectedPath {
    path: PathSample,
    ucw: f32,
    f: vec3<f32>,
}

// A point of a light that a vertex selected among its light candidates.
struct SelectedLight {
    point: LightPoint,
    ucw: f32,
}

// Selects a light candidate by its unshadowed contribution at the vertex of this index.
fn select_light(v: Vertex, index: u32, nee_candidates: u32, pixel: vec2<u32>, rng: ptr<function, Rng>) -> SelectedLight {
    let count = useful_candidates(nee_candidate_count(nee_candidates, index));
    let subset = subset_of(pixel, index);
    var stream = Stream(0.0, NONE);
    var selected = no_light_point();
    var selected_target = 0.0;
    // There is at least one candidate.
    var i = 0u;
    loop {
        let c = light_candidate(v.surface.position, subset, rng);
        let u = rng_1(rng);
        if c.pmf > 0.0 && c.light.pdf_solid_angle > 0.0 {
            let f = bsdf_eval(v.surface.bsdf, v.wo, c.light.wi) * c.light.radiance / c.light.pdf_solid_angle;
            let value = luminance(guarded_3(f, GUARD_LIGHT_CONTRIBUTION));
            if stream_add(&stream, i, value / (f32(count) * c.pmf * c.rounding), u) {
                selected = c.point;
                selected_target = value;
            }
        }
        i += 1u;
        if i >= count {
            break;
        }
    }
    return SelectedLight(selected, stream_ucw(stream, selected_target));
}

// TEST_*: tests use one technique.
#ifdef TEST_HITS
const NEE_SHARE: f32 = 0.0;
const HIT_SHARE: f32 = 1.0;
const CONNECTION_SHARE: f32 = 0.0;
#else ifdef TEST_NEE
const NEE_SHARE: f32 = 1.0;
const HIT_SHARE: f32 = 0.0;
const CONNECTION_SHARE: f32 = 0.0;
#else ifdef TEST_CONNECTIONS
const NEE_SHARE: f32 = 0.0;
const HIT_SHARE: f32 = 0.0;
const CONNECTION_SHARE: f32 = 1.0;
#else ifdef TEST_SPLATS
const NEE_SHARE: f32 = 0.0;
const HIT_SHARE: f32 = 0.0;
const CONNECTION_SHARE: f32 = 0.0;
#else
const NEE_SHARE: f32 = 1.0;
const HIT_SHARE: f32 = 1.0;
const CONNECTION_SHARE: f32 = 1.0;
#endif

// Adds a path with its contribution weight before Russian roulette.
fn add_candidate(c: ptr<function, Candidates>, path: PathSample, f: vec3<f32>, ucw: f32, u: f32) {
    let value = luminance(f);
    // SPIR-V takes no pointer to a member.
    var stream = (*c).stream;
    let selected = stream_add(&stream, path.length, value * ucw / (*c).survival, u);
    (*c).stream = stream;
    if selected {
        (*c).selected = path;
        (*c).f = f;
        (*c).selected.target_value = value;
    }
}

// Samples the candidates of the surface `first`: paths of at most `view.bounces` scattering events, and at least `shortest` + 1 vertices.
fn sample_candidates(first: Vertex, pixel: vec2<u32>, shortest: u32, p: ShiftParameters, rng: ptr<function, Rng>) -> SelectedPath {
    let seed = path_seed(pixel);
    var c: Candidates;
    c.stream = Stream(0.0, NONE);
    c.selected = no_path_sample();
    c.prefix = no_path_sample();
    c.prefix.seed = seed;
    c.prefix.born = view.frame;
    c.throughput = vec3<f32>(1.0);
    c.suffix = vec3<f32>(1.0);
    c.survival = 1.0;
    c.state = camera_state(first, p.camera_density, p.counts);
    var v = first;
    var before: PreviousVertex;
    // Squared relative indices of refraction (`survival_probability`).
    var eta_scale = 1.0;
    for (var index = 1u; index <= view.bounces; index++) {
        c.prefix.length = index + 1u;
        if !scatter(&c, &v, before, index, p) {
            break;
        }
        if c.prefix.length >= shortest && !bsdf_is_delta(v.surface.bsdf) {
            add_nee(&c, v, before, index, pixel, p, rng);
            add_connection(&c, v, before, index, p, rng);
        }
        // The last ray could only find light.
        if index == view.bounces && !RAYS_FIND_LIGHT {
            break;
        }

        // Leave the vertex, which becomes the reconnection vertex if it may.
        let step = sampled_step(v, seed, index);
        if !step.valid {
            break;
        }
        if c.prefix.reconnection != 0u {
            c.suffix = guarded_3(c.suffix * step.weight, GUARD_THROUGHPUT);
        } else if index > 1u && !c.below && is_connectable_by(before, v, step, p) {
            c.prefix = reconnected(c.prefix, before, factor_at(c.prefix, before, v) * c.choice_probability, index);
            c.prefix.density *= step.pdf_lobe;
            c.prefix.lobe_after = step.lobe;
            c.prefix.wi = step.wi;
        }
        c.throughput = guarded_3(c.throughput * step.weight, GUARD_THROUGHPUT);
        c.state = state_of_ray(c.state, v, step, c.prefix.reconnection == index && !c.below);
        eta_scale *= step.eta * step.eta;
        before = previous_vertex(before, v, step, index, p);

        // Russian roulette changes the probability of a path, never its contribution.
        if index >= ROULETTE_FROM && !has(RESAMPLE_NO_ROULETTE) {
            let q = survival_probability(c.throughput, eta_scale / c.survival);
            if !(rng_1(rng) < q) {
                break;
            }
            c.survival *= q;
        }

        // Find the next vertex, and the lights on the way there.
        let medium = step_medium(v, step.wi);
        let origin = offset_point(v.surface.position, v.surface.bsdf.n_geo, step.wi, v.surface.offset);
        let hit = trace_closest(Ray(origin, 0.0, step.wi, FAR), path_alpha_seed(seed, index, DIMENSION_RAY));
        if c.prefix.length >= shortest {
            add_light_hits(&c, RaySegment(origin, hit.t, step.wi), v, before, step, medium, index, p, rng);
        }
        if hit.instance == NONE {
            if c.prefix.length >= shortest {
                add_environment(&c, before, step, index, p, rng);
            }
            break;
        }
        // The last vertex could only emit light.
        if index == view.bounces && !may_emit(hit.instance) {
            break;
        }
        v = next_vertex(&c, v, before, step, hit, medium, index, shortest, p, rng);
    }
    return SelectedPath(c.selected, stream_ucw(c.stream, c.selected.target_value), c.f);
}

// Goes on from the surface of the vertex of this index, or from a point where light enters the body below it.  Returns false where no
// light enters.  A vertex above such a point may become the reconnection vertex, because the point does not depend on the path before.
fn scatter(c: ptr<function, Candidates>, v: ptr<function, Vertex>, before: PreviousVertex, index: u32, p: ShiftParameters) -> bool {
    let choice = drawn_choice(*v, (*c).prefix.seed, index);
    (*c).below = choice.below;
    (*c).choice_probability = choice.probability;
    (*c).throughput *= choice.carried;
    if (*c).prefix.reconnection != 0u {
        (*c).suffix *= choice.carried;
    }
    if !choice.below {
        return true;
    }
    let at = (*v).surface;
    if (*c).prefix.reconnection == 0u && index > 1u && is_connectable_end(before, at.position, at.bsdf.n_geo, p) {
        (*c).prefix = reconnected((*c).prefix, before, factor_at((*c).prefix, before, *v) * choice.probability, index);
        (*c).prefix.lobe_after = LOBE_BELOW;
    }
    let entry = entry_vertex(*v, (*c).prefix.seed, index, false);
    if !entry.valid {
        return false;
    }
    (*c).throughput = guarded_3((*c).throughput * entry.weight, GUARD_THROUGHPUT);
    if (*c).prefix.reconnection != 0u {
        (*c).suffix = guarded_3((*c).suffix * entry.weight, GUARD_THROUGHPUT);
    }
    (*c).state = below_surface((*c).state);
    *v = entry.vertex;
    return true;
}

// The path that NEE ends at the vertex of this index.
fn add_nee(
    c: ptr<function, Candidates>,
    v: Vertex,
    before: PreviousVertex,
    index: u32,
    pixel: vec2<u32>,
    p: ShiftParameters,
    rng: ptr<function, Rng>,
) {
    let selected = select_light(v, index, p.counts.nee_candidates, pixel, rng);
    if !(selected.ucw > 0.0) {
        return;
    }
    let nee = nee_contribution(v, selected.point, false);
    let alpha_seed = path_alpha_seed((*c).prefix.seed, index, DIMENSION_SHADOW_RAY);
    if !(max_component(nee.f) > 0.0) || !light_is_visible(v.surface, nee.light, alpha_seed, false) {
        return;
    }
    let coefficients = mis_sum_of_nee((*c).state, v, nee.light, nee.pdf_bsdf, index, p.counts);
    let weight = weight_of(coefficients, (*c).state);
    let f = nee.f * weight;
    var path = (*c).prefix;
    path.termination = TERMINATION_NEE;
    path.light = selected.point;
    if path.reconnection != 0u {
        path = with_suffix(path, (*c).suffix * nee.f, coefficients);
    } else if index > 1u && !(*c).below && is_connectable(before, v.surface, nee.pdf_bsdf, true, p) {
        path = reconnected(path, before, factor_at(path, before, v) * (*c).choice_probability, index);
    } else {
        // The point on the light is kept as it is; no density depends on the vertex before it.
        path.reconnection = index + 1u;
    }
    add_candidate(c, with_mis_weight(path, weight), (*c).throughput * f, selected.ucw * NEE_SHARE, rng_1(rng));
}

#ifdef CONNECTIONS
// The path that ends with a connection of the vertex of this index with a random light vertex.
fn add_connection(c: ptr<function, Candidates>, v: Vertex, before: PreviousVertex, index: u32, p: ShiftParameters, rng: ptr<function, Rng>) {
    let u = rng_1(rng);
    let chosen = light_vertex_at(light_vertices, min(u32(u * f32(settings.light_paths)), max(settings.light_paths, 1u) - 1u));
    if settings.light_paths == 0u || chosen.events == 0u || index + chosen.events > view.bounces {
        return;
    }
    var path = ended_at_light_vertex((*c).prefix, chosen);
    let k = connection_to(v, path, p.counts.connections, false);
    let value = guarded_3(k.f * k.light, GUARD_LIGHT_CONTRIBUTION);
    if !(max_component(value) > 0.0) || trace_any(k.ray, path_alpha_seed((*c).prefix.seed, index, DIMENSION_SHADOW_RAY), false) {
        return;
    }
    let coefficients = mis_sum_of_connection((*c).state, v, k.wi, k.pdf, k.mis_ratios);
    if (*c).prefix.reconnection != 0u {
        path = with_end_of((*c).prefix, path);
        path = with_suffix(path, (*c).suffix * value, coefficients);
    } else if index > 1u && !(*c).below && is_connectable(before, v.surface, k.pdf, true, p) {
        let reconnected_here = reconnected((*c).prefix, before, factor_at((*c).prefix, before, v) * (*c).choice_probability, index);
        path = with_connection(with_end_of(reconnected_here, path), k);
    }
    let weight = weight_of(coefficients, (*c).state);
    let f = (*c).throughput * value * weight;
    add_candidate(c, with_mis_weight(path, weight), f, f32(chosen.count) / light_pmf(chosen.light) * CONNECTION_SHARE, rng_1(rng));
}
#else
fn add_connection(c: ptr<function, Candidates>, v: Vertex, before: PreviousVertex, index: u32, p: ShiftParameters, rng: ptr<function, Rng>) {
}
#endif

// The paths that end on analytic area lights between this vertex and the next surface.
fn add_light_hits(
    c: ptr<function, Candidates>,
    segment: RaySegment,
    v: Vertex,
    before: PreviousVertex,
    step: Step,
    medium: vec3<f32>,
    index: u32,
    p: ShiftParameters,
    rng: ptr<function, Rng>,
) {
    var from_light = 0u;
    for (var i = 0u; i < LIGHT_HITS_MAX; i++) {
        let light = next_light_hit(segment, from_light);
        if light == NONE {
            break;
        }
        from_light = light + 1u;
        let point = light_hit_point(light, light, segment);
        let l = light_point_at(point, v.surface.position, false);
        var path: PathSample;
        if l.distance >= FAR {
            path = ended_at_infinity((*c).prefix, before, step, index);
        } else {
            path = ended_on_emitter((*c).prefix, before, l.position, l.normal, light_factor(l), index, p);
        }
        path.light = point;
        add_bsdf_hit(c, path, l.radiance * transmittance(medium, l.distance), l, step.delta, index, p, rng_1(rng));
    }
}

// The path whose last ray escapes.
fn add_environment(c: ptr<function, Candidates>, before: PreviousVertex, step: Step, index: u32, p: ShiftParameters, rng: ptr<function, Rng>) {
    let l = environment_light(step.wi, environment_pdf(step.wi, false), false);
    let path = ended_at_infinity((*c).prefix, before, step, index);
    add_bsdf_hit(c, path, l.radiance, l, step.delta, index, p, rng_1(rng));
}

// The next vertex; if it emits, a path ends there.
fn next_vertex(
    c: ptr<function, Candidates>,
    v: Vertex,
    before: PreviousVertex,
    step: Step,
    hit: Hit,
    medium: vec3<f32>,
    index: u32,
    shortest: u32,
    p: ShiftParameters,
    rng: ptr<function, Rng>,
) -> Vertex {
    let may_reconnect = (*c).prefix.reconnection == 0u && before.rough;
    let barycentrics = vertex_barycentrics(hit.barycentrics, may_reconnect);
    let cone = step_cone(v, step, hit.t);
    let s = surface_at(hit.instance, hit.triangle, barycentrics, -step.wi, cone, false);
    let crossed = medium_before(s, medium);
    let carried = transmittance(crossed, distance(s.position, v.surface.position));
    (*c).throughput *= carried;
    if (*c).prefix.reconnection != 0u {
        (*c).suffix *= carried;
    } else {
        // Until there is a reconnection vertex, the newest vertex may become it.
        (*c).prefix.instance = hit.instance;
        (*c).prefix.triangle = hit.triangle;
        (*c).prefix.barycentrics = barycentrics;
    }
    if (*c).prefix.length >= shortest && max_component(s.emission) > 0.0 {
        let l = emitter_sample(s, step.wi, hit.instance, hit.triangle, v.surface.position, false);
        let factor = triangle_factor(before.position, s.position, hit.instance, hit.triangle, false);
        let path = ended_on_emitter((*c).prefix, before, s.position, s.bsdf.n_geo, factor, index, p);
        // Throughput and suffix include the absorption up to here.
        add_bsdf_hit(c, path, s.emission, l, step.delta, index, p, rng_1(rng));
    }
    (*c).state = state_at((*c).state, s, step.wi, v.surface.position, p.counts);
    return Vertex(s, -step.wi, crossed, cone);
}

// The prefix, ended at a point of an emitter.
fn ended_on_emitter(
    prefix: PathSample,
    before: PreviousVertex,
    position: vec3<f32>,
    n_geo: vec3<f32>,
    factor: f32,
    index: u32,
    p: ShiftParameters,
) -> PathSample {
    var path = prefix;
    path.termination = TERMINATION_EMITTER;
    if path.reconnection == 0u && is_connectable_end(before, position, n_geo, p) {
        path = reconnected(path, before, factor, index + 1u);
    }
    return path;
}

// The prefix, ended in a direction: of the environment or of a sun.
fn ended_at_infinity(prefix: PathSample, before: PreviousVertex, step: Step, index: u32) -> PathSample {
    var path = prefix;
    path.termination = TERMINATION_ENVIRONMENT;
    if path.reconnection == 0u && before.rough {
        path.reconnection = index + 1u;
        path.lobe_before = step.lobe;
        path.wi = step.wi;
        path.density = step.pdf_lobe;
    }
    return path;
}

// Adds a path whose last ray hit a light, with the radiance that arrives at the vertex of this index.  `l`: the sample with which NEE there
// would have found the same point.
fn add_bsdf_hit(
    c: ptr<function, Candidates>,
    ended: PathSample,
    radiance: vec3<f32>,
    l: LightSample,
    by_delta: bool,
    index: u32,
    p: ShiftParameters,
    u: f32,
) {
    var path = ended;
    let coefficients = mis_sum_of_hit((*c).state, l, by_delta, index, p.counts);
    if path.reconnection != 0u && path.reconnection <= index {
        path = with_suffix(path, (*c).suffix * radiance, coefficients);
    }
    let weight = weight_of(coefficients, (*c).state);
    add_candidate(c, with_mis_weight(path, weight), (*c).throughput * radiance * weight, HIT_SHARE, u);
}

// `triangle_factor` of the newest vertex of a prefix that has no reconnection vertex yet.
fn factor_at(prefix: PathSample, before: PreviousVertex, v: Vertex) -> f32 {
    return triangle_factor(before.position, v.surface.position, prefix.instance, prefix.triangle, false);
}

// Makes the vertex of this index the reconnection vertex; `factor` takes solid angle to the measure of that vertex.
fn reconnected(s: PathSample, before: PreviousVertex, factor: f32, index: u32) -> PathSample {
    var path = s;
    path.reconnection = index;
    path.lobe_before = before.lobe;
    path.density = before.pdf_lobe * factor;
    return path;
}
