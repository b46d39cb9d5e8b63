// The candidates of a pixel: all paths of one tree, its vertices each aimed at a light and each waiting to meet one, resampled into
// one (Lin et al. 2026, supplement, 1, 6 and 7: direct light is among them).  A path's weight is what it carries in primary sample space
// over the probability that roulette let it live; where others may reconnect to it is decided as it grows.
#define_import_path bevy_restir::path::tree

#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_is_delta, bsdf_terms}
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::math::{is_finite_3, luminance, max_component}
#import bevy_restir::common::rng::{Rng, rng_1}
#import bevy_restir::light::environment::{environment_pdf, environment_radiance}
#import bevy_restir::light::point_on_light::{light_point_at, LightPoint, no_light_point}
#import bevy_restir::light::select::light_pmf
#import bevy_restir::light::shape::{crossing_point, CROSSINGS_MAX, next_crossing, Way}
#import bevy_restir::light::triangle::triangle_light_pdf_solid_angle
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, LightSample}
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::random::{OF_LIGHT_RAY, OF_RAY, path_alpha_seed, path_seed}
#import bevy_restir::path::sample::{END_EMITTER, END_ENVIRONMENT, END_LIGHT, landed_barycentrics, no_path_sample, PathSample}
#import bevy_restir::path::shadow::light_is_visible
#import bevy_restir::path::walk::{sampled_step, Step, step_cone, step_medium, Vertex}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::candidate::{light_candidate, subset_of}
#import bevy_restir::restir::types::RESAMPLE_INDIRECT
#import bevy_restir::restir::stream::{Stream, stream_add, stream_ucw}
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::shift::connect::{Connection, Departure, departure, is_connectable, is_connectable_end, is_rough, light_factor, triangle_factor}
#import bevy_restir::trace::offset::offset_point
#import bevy_restir::trace::ray::Ray
#import bevy_restir::trace::trace::trace_closest
#import bevy_restir::view::bindings::view

// Roulette starts where a path has scattered this often.
const ROULETTE_FROM: u32 = 3u;

// A tree as it grows.
struct Tree {
    stream: Stream,
    sample: PathSample,       // the selected one
    f: vec3<f32>,             // and what it carries
    grown: PathSample,        // what all paths that end from here on have in common
    survival: f32,            // probability that roulette let them live
}

// A path that was chosen, its contribution weight, and what it carries.
struct Chosen {
    path: PathSample,
    ucw: f32,
    f: vec3<f32>,
}

// What aiming at a point of a light from a vertex gives, in the light's measure: f·L·|cos|·MIS; without visibility.
struct Aimed {
    f: vec3<f32>,
    light: LightSample,
    pdf_bsdf: f32,            // marginal density of the direction
}

// `count`: expected number of candidates that the vertex aims at the light (Lin et al. 2026, supplement, 5: M p₁ against p₂).
fn aim(v: Vertex, p: LightPoint, count: f32, previous: bool) -> Aimed {
    let l = light_point_at(p, v.surface.position, previous);
    var a = Aimed(vec3<f32>(0.0), l, 0.0);
    if !(l.pdf_solid_angle > 0.0) {
        return a;
    }
    let bsdf = bsdf_terms(v.surface.bsdf, v.wo, l.wi);
    a.pdf_bsdf = bsdf.pdf;
    let pdf = count * l.pdf_solid_angle * l.aim;
    let weight = select(pdf / (pdf + a.pdf_bsdf), 1.0, l.delta != 0u);
    let carried = transmittance(step_medium(v, l.wi), l.distance);
    a.f = bsdf.f * l.radiance * carried * (weight / l.pdf_solid_angle);
    if !is_finite_3(a.f) {
        a.f = vec3<f32>(0.0);
    }
    return a;
}

// How many lights a path aims at from the vertex of this index, to keep one of them (Lin et al. 2026, supplement, Fig. 4): fewer at later
// ones.
fn light_candidates(index: u32) -> u32 {
    return max(settings.candidates / (index * index), 1u);
}

// How many of them are expected to be this light.
fn expected_candidates(light: u32, index: u32) -> f32 {
    return f32(light_candidates(index)) * light_pmf(light);
}

// One of them by what it brings to the vertex, whether it is seen or not, and its contribution weight.
struct AimedAt {
    point: LightPoint,
    ucw: f32,
}

fn choose_light(v: Vertex, index: u32, pixel: vec2<u32>, rng: ptr<function, Rng>) -> AimedAt {
    let count = light_candidates(index);
    let subset = subset_of(pixel, index);
    var stream = Stream(0.0, NONE);
    var chosen = no_light_point();
    var chosen_target = 0.0;
    for (var i = 0u; i < count; i++) {
        let c = light_candidate(v.surface.position, subset, rng);
        let u = rng_1(rng);
        if !(c.pmf > 0.0) || !(c.light.pdf_solid_angle > 0.0) {
            continue;
        }
        let value = luminance(bsdf_eval(v.surface.bsdf, v.wo, c.light.wi) * c.light.radiance) / c.light.pdf_solid_angle;
        if stream_add(&stream, i, value / (f32(count) * c.pmf), u) {
            chosen = c.point;
            chosen_target = value;
        }
    }
    return AimedAt(chosen, stream_ucw(stream, chosen_target));
}

// Weight of a path whose last ray met light that its vertex aims at with density `light_pdf`; a delta is never aimed.
fn met_weight(step: Step, light_pdf: f32) -> f32 {
    return select(step.pdf / (step.pdf + light_pdf), 1.0, step.delta || !(light_pdf > 0.0));
}

// For tests, which want many paths that met their light by chance: those that were aimed at it are not chosen.
#ifdef TEST_NOT_AIMED
const AIMED: f32 = 0.0;
#else
const AIMED: f32 = 1.0;
#endif

// A candidate with its contribution weight, but for roulette.
fn offer(tree: ptr<function, Tree>, candidate: PathSample, f: vec3<f32>, ucw: f32, u: f32) {
    let value = luminance(f);
    // SPIR-V takes no pointer to a member.
    var stream = (*tree).stream;
    let selected = stream_add(&stream, candidate.length, value * ucw / (*tree).survival, u);
    (*tree).stream = stream;
    if selected {
        (*tree).sample = candidate;
        (*tree).f = f;
        (*tree).sample.target_value = value;
    }
}

// The paths of a first vertex; at most `view.bounces` scattering events.
fn path_tree(first: Vertex, pixel: vec2<u32>, c: Connection, rng: ptr<function, Rng>) -> Chosen {
    let seed = path_seed(pixel);
    var tree = Tree(Stream(0.0, NONE), no_path_sample(), vec3<f32>(0.0), no_path_sample(), 1.0);
    tree.grown.seed = seed;
    tree.grown.born = view.frame;
    // Direct light may be another technique's.
    let shortest = select(2u, 3u, (settings.flags & RESAMPLE_INDIRECT) != 0u);
    var v = first;
    var before: Departure;
    var throughput = vec3<f32>(1.0);
    var suffix = vec3<f32>(1.0);       // since the reconnection vertex
    var eta_scale = 1.0;
    for (var index = 1u; index <= view.bounces; index++) {
        tree.grown.length = index + 1u;

        // Aim at a light.
        var aimed_at = AimedAt(no_light_point(), 0.0);
        if tree.grown.length >= shortest && !bsdf_is_delta(v.surface.bsdf) {
            aimed_at = choose_light(v, index, pixel, rng);
        }
        if aimed_at.ucw > 0.0 {
            let a = aim(v, aimed_at.point, expected_candidates(aimed_at.point.light, index), false);
            if max_component(a.f) > 0.0 && light_is_visible(v.surface, a.light, path_alpha_seed(seed, index, OF_LIGHT_RAY), false) {
                var aimed = tree.grown;
                aimed.end = END_LIGHT;
                aimed.light = aimed_at.point;
                if aimed.reconnection != 0u {
                    aimed.radiance = suffix * a.f;
                } else if index > 1u && is_connectable(before, v.surface, a.pdf_bsdf, true, c) {
                    // Nothing is sampled after the connection: the light is where it is.
                    aimed = connected(aimed, before, factor_at(aimed, before, v), index);
                } else {
                    aimed.reconnection = index + 1u;
                }
                offer(&tree, aimed, throughput * a.f, aimed_at.ucw * AIMED, rng_1(rng));
            }
        }

        // Go on.
        let step = sampled_step(v, seed, index);
        if !step.valid {
            break;
        }
        if tree.grown.reconnection != 0u {
            suffix *= step.weight;
        } else if index > 1u && !step.delta && is_connectable(before, v.surface, step.pdf, is_rough(v, step, c), c) {
            tree.grown = connected(tree.grown, before, factor_at(tree.grown, before, v), index);
            tree.grown.density *= step.pdf_lobe;
            tree.grown.lobe_after = step.lobe;
            tree.grown.wi = step.wi;
        }
        throughput *= step.weight;
        eta_scale *= step.eta * step.eta;
        before = departure(v, step, index, c);

        // Roulette changes how likely a path is, never what it carries.
        if index >= ROULETTE_FROM {
            let q = min(max_component(throughput) * eta_scale / tree.survival, 0.95);
            if !(rng_1(rng) < q) {
                break;
            }
            tree.survival *= q;
        }

        let medium = step_medium(v, step.wi);
        let origin = offset_point(v.surface.position, v.surface.bsdf.n_geo, step.wi, v.surface.offset);
        let hit = trace_closest(Ray(origin, 0.0, step.wi, FAR), path_alpha_seed(seed, index, OF_RAY));
        let way = Way(origin, hit.t, step.wi);
        var from_light = 0u;
        for (var i = 0u; i < CROSSINGS_MAX && tree.grown.length >= shortest; i++) {
            let light = next_crossing(way, from_light);
            if light == NONE {
                break;
            }
            from_light = light + 1u;
            let p = crossing_point(light, light, way);
            let l = light_point_at(p, v.surface.position, false);
            let light_pdf = expected_candidates(light, index) * l.pdf_solid_angle * l.aim;
            let met = met_light(tree.grown, p, l, before, step, index, c);
            let radiance = l.radiance * transmittance(medium, l.distance);
            offer_met(&tree, met, throughput, suffix, radiance, light_pdf, step, index, rng_1(rng));
        }
        if hit.instance == NONE {
            if tree.grown.length < shortest {
                break;
            }
            let light_pdf = expected_candidates(ENVIRONMENT_LIGHT, index) * environment_pdf(step.wi);
            let met = met_at_infinity(tree.grown, before, step, index);
            offer_met(&tree, met, throughput, suffix, environment_radiance(step.wi), light_pdf, step, index, rng_1(rng));
            break;
        }
        let may_be_kept = tree.grown.reconnection == 0u && before.rough;
        let barycentrics = landed_barycentrics(hit.barycentrics, may_be_kept);
        let cone = step_cone(v, step, hit.t);
        let s = surface_at(hit.instance, hit.triangle, barycentrics, -step.wi, cone, false);
        let carried = transmittance(medium, distance(s.position, v.surface.position));
        throughput *= carried;
        suffix *= select(vec3<f32>(1.0), carried, tree.grown.reconnection != 0u);
        tree.grown = place(tree.grown, hit.instance, hit.triangle, barycentrics);
        if tree.grown.length >= shortest && max_component(s.emission) > 0.0 {
            let light_pdf = emission_pdf(s, hit.instance, hit.triangle, v.surface.position, index, false);
            let factor = triangle_factor(before.position, s.position, hit.instance, hit.triangle, false);
            let met = met_at(tree.grown, before, s.position, s.bsdf.n_geo, factor, index, c);
            // `throughput` and `suffix` have come here already.
            offer_met(&tree, met, throughput, suffix, s.emission, light_pdf, step, index, rng_1(rng));
        }
        v = Vertex(s, -step.wi, medium, cone);
    }
    return Chosen(tree.sample, stream_ucw(tree.stream, tree.sample.target_value), tree.f);
}

// A path whose last ray met light, at a point of an emitter, in a direction, or on its way past one.
fn met_at(
    grown: PathSample,
    before: Departure,
    position: vec3<f32>,
    n_geo: vec3<f32>,
    factor: f32,
    index: u32,
    c: Connection,
) -> PathSample {
    var met = grown;
    met.end = END_EMITTER;
    if met.reconnection == 0u && is_connectable_end(before, position, n_geo, c) {
        met = connected(met, before, factor, index + 1u);
    }
    return met;
}

fn met_at_infinity(grown: PathSample, before: Departure, step: Step, index: u32) -> PathSample {
    var met = grown;
    met.end = END_ENVIRONMENT;
    if met.reconnection == 0u && before.rough {
        met.reconnection = index + 1u;
        met.lobe_before = step.lobe;
        met.wi = step.wi;
        met.density = step.pdf_lobe;
    }
    return met;
}

fn met_light(grown: PathSample, p: LightPoint, l: LightSample, before: Departure, step: Step, index: u32, c: Connection) -> PathSample {
    var met: PathSample;
    if l.distance >= FAR {
        met = met_at_infinity(grown, before, step, index);
    } else {
        met = met_at(grown, before, l.position, l.normal, light_factor(l), index, c);
    }
    met.light = p;
    return met;
}

// Offers it.  `radiance` arrives at the vertex of this index, which aims there with density `light_pdf`; `throughput` and `suffix` lead
// up to it.
fn offer_met(
    tree: ptr<function, Tree>,
    path: PathSample,
    throughput: vec3<f32>,
    suffix: vec3<f32>,
    radiance: vec3<f32>,
    light_pdf: f32,
    step: Step,
    index: u32,
    u: f32,
) {
    var met = path;
    let weight = met_weight(step, light_pdf);
    if met.reconnection == index {
        met.radiance = suffix * radiance;
        met.light_pdf = light_pdf;
    } else if met.reconnection != 0u && met.reconnection < index {
        met.radiance = suffix * radiance * weight;
    }
    offer(tree, met, throughput * radiance * weight, 1.0, u);
}

// Until there is a reconnection vertex the newest one may become it.
fn place(s: PathSample, instance: u32, triangle: u32, barycentrics: vec2<f32>) -> PathSample {
    var placed = s;
    if s.reconnection == 0u {
        placed.instance = instance;
        placed.triangle = triangle;
        placed.barycentrics = barycentrics;
    }
    return placed;
}

// `triangle_factor` of the newest vertex, before there is a reconnection vertex.
fn factor_at(s: PathSample, before: Departure, v: Vertex) -> f32 {
    return triangle_factor(before.position, v.surface.position, s.instance, s.triangle, false);
}

// Makes the vertex of this index the reconnection vertex; `factor` is from solid angle to its own measure.
fn connected(s: PathSample, before: Departure, factor: f32, index: u32) -> PathSample {
    var c = s;
    c.reconnection = index;
    c.lobe_before = before.lobe;
    c.density = before.pdf_lobe * factor;
    return c;
}

// Density, solid angle at `from_point`, with which the vertex of this index there aims at a point of an emissive triangle: of all its
// candidates.
fn emission_pdf(s: Surface, instance: u32, triangle: u32, from_point: vec3<f32>, index: u32, previous: bool) -> f32 {
    if s.light == NONE {
        return 0.0;
    }
    return expected_candidates(s.light, index) * triangle_light_pdf_solid_angle(instance, triangle, from_point, s.position, previous);
}
