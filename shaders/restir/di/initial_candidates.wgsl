// Initial candidates of a pixel of ReSTIR DI (Wyman and Panteleev 2021, 3 and 5): points of lights from a presampled subset, and one that
// BSDF sampling finds, joined by MIS in the measure of the lights.  One of them is selected, and a ray tests its visibility.
#define_import_path bevy_restir::restir::di::initial_candidates

#import bevy_restir::bsdf::bsdf::{bsdf_is_delta, bsdf_sample}
#import bevy_restir::bsdf::types::BsdfSample
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::math::max_component
#import bevy_restir::common::ray::Ray
#import bevy_restir::common::rng::{Rng, rng_1, rng_3, rng_bits}
#import bevy_restir::light::analytic_area_light::{light_hit_point, LIGHT_HITS_MAX, next_light_hit, RaySegment}
#import bevy_restir::light::environment::{environment_pdf, environment_radiance}
#import bevy_restir::light::point_on_light::{environment_direction, environment_light_point, LightPoint, light_point_at, no_light_point, triangle_light_point}
#import bevy_restir::light::select::{environment_pmf, light_pmf}
#import bevy_restir::light::types::{LightSample, RAYS_FIND_LIGHT}
#import bevy_restir::path::medium::{medium_towards, transmittance}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::di::domain::{bsdf_pdf_of, evaluate, evaluate_arriving, evaluate_sample, is_visible, Receiver, target_value}
#import bevy_restir::restir::di::reservoir::Reservoir
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::light_candidates::{light_candidate, opacity_of, subset_of, useful_candidates}
#import bevy_restir::restir::reservoir_sampling::{Stream, stream_add, stream_ucw}
#import bevy_restir::restir::types::{RESAMPLE_BSDF_CANDIDATE, RESAMPLE_CANDIDATE_RAYS, RESAMPLE_TARGET_WITHOUT_BSDF}
#import bevy_restir::scene::cone::{cone_after, cone_along}
#import bevy_restir::scene::material::may_emit
#import bevy_restir::scene::offset::offset_point
#import bevy_restir::scene::surface::surface_at
#import bevy_restir::trace::trace::trace_closest
#import bevy_restir::view::light_part::{sample_diffuse_share, shown_light}

struct SelectedCandidate {
    reservoir: Reservoir,
    f: vec3<f32>,              // contribution of its sample, without visibility
    unresampled: vec4<f32>,    // light that only BSDF sampling finds, as `shown_light` returns it
}

// Candidates may be selected by any target that is positive where light is (Wyman and Panteleev 2021, 3.3).
fn candidate_target(r: Receiver, l: LightSample) -> f32 {
    if has(RESAMPLE_TARGET_WITHOUT_BSDF) {
        return target_value(evaluate_arriving(r, l));
    }
    return target_value(evaluate_sample(r, l));
}

// A ray in a direction of the BSDF: the point of a light at its end, or light that is not in the table.
struct BsdfRay {
    point: LightPoint,
    light: vec3<f32>,
    weight: vec3<f32>,         // f·|cos| over the density
    diffuse: vec3<f32>,        // share of the light that the surface scatters diffusely
    delta: bool,
    segment: RaySegment,
}

fn bsdf_ray_to(point: LightPoint, light: vec3<f32>, r: Receiver, b: BsdfSample, segment: RaySegment) -> BsdfRay {
    return BsdfRay(point, light, b.weight, sample_diffuse_share(r.surface.bsdf, r.wo, b), b.delta != 0u, segment);
}

fn no_bsdf_ray() -> BsdfRay {
    return BsdfRay(no_light_point(), vec3<f32>(0.0), vec3<f32>(0.0), vec3<f32>(0.0), true, RaySegment(vec3<f32>(0.0), 0.0, vec3<f32>(0.0, 0.0, 1.0)));
}

// Random numbers of a BSDF ray (dimensions of `Rng`).
const BSDF_RAY_DIMENSIONS: u32 = 2u;

fn trace_bsdf_ray(r: Receiver, rng: ptr<function, Rng>) -> BsdfRay {
    let u = rng_3(rng);
    let alpha_seed = rng_bits(rng).x;
    let b = bsdf_sample(r.surface.bsdf, r.wo, u);
    if b.valid == 0u {
        return no_bsdf_ray();
    }
    let origin = offset_point(r.surface.position, r.surface.bsdf.n_geo, b.wi, r.surface.offset);
    let hit = trace_closest(Ray(origin, 0.0, b.wi, FAR), alpha_seed);
    let segment = RaySegment(origin, hit.t, b.wi);
    if hit.instance == NONE {
        // The importance of an image that is written on the GPU may be that of the last frame.
        let point = environment_light_point(b.wi);
        let density = environment_pmf() * environment_pdf(environment_direction(point, false), false);
        if b.delta != 0u || !(density > 0.0) {
            return bsdf_ray_to(no_light_point(), b.weight * environment_radiance(b.wi, false), r, b, segment);
        }
        return bsdf_ray_to(point, vec3<f32>(0.0), r, b, segment);
    }
    if !may_emit(hit.instance) {
        return bsdf_ray_to(no_light_point(), vec3<f32>(0.0), r, b, segment);
    }
    let cone = cone_along(cone_after(r.cone, b.delta != 0u), hit.t);
    let s = surface_at(hit.instance, hit.triangle, hit.barycentrics, -b.wi, cone, false);
    if !(max_component(s.emission) > 0.0) {
        return bsdf_ray_to(no_light_point(), vec3<f32>(0.0), r, b, segment);
    }
    if b.delta != 0u || !(light_pmf(s.light) > 0.0) {
        // The ray may have crossed a body that absorbs.
        let carried = transmittance(medium_towards(r.surface, b.wi, vec3<f32>(0.0)), hit.t);
        return bsdf_ray_to(no_light_point(), b.weight * s.emission * carried, r, b, segment);
    }
    return bsdf_ray_to(triangle_light_point(s.light, hit.barycentrics), vec3<f32>(0.0), r, b, segment);
}

// The stream of candidates, and the one that is selected so far.
struct Candidates {
    stream: Stream,
    point: LightPoint,
    selected_target: f32,      // target of the point: its contribution weight is divided by it
}

fn add_light_candidates(c: ptr<function, Candidates>, r: Receiver, with_bsdf: bool, pixel: vec2<u32>, rng: ptr<function, Rng>) {
    let subset = subset_of(pixel, 0u);
    let wanted = useful_candidates(settings.candidates);
    let count = f32(wanted);
    let lights = select(wanted, 0u, bsdf_is_delta(r.surface.bsdf));
    for (var i = 0u; i < lights; i++) {
        let candidate = light_candidate(r.surface.position, subset, rng);
        let value = candidate_target(r, candidate.light);
        let u = rng_1(rng);
        if candidate.pmf > 0.0 && value > 0.0 {
            let bsdf = select(0.0, bsdf_pdf_of(r, candidate.light, candidate.opacity), with_bsdf);
            let densities = candidate.rounding * both_densities(count * candidate.pmf, bsdf);
            add_candidate(c, i, candidate.point, value, value / densities, u);
        }
    }
}

// Adds every light that a BSDF ray passes, and the one at its end, as candidates.  Returns the light that cannot be resampled, because it
// arrives by a delta lobe or its source is not in the table.
fn add_bsdf_candidates(c: ptr<function, Candidates>, r: Receiver, ray: BsdfRay, rng: ptr<function, Rng>) -> vec4<f32> {
    var unresampled = ray.light;
    var point = ray.point;
    var first = 0u;
    for (var i = 0u; i < LIGHT_HITS_MAX; i++) {
        if point.light != NONE {
            let l = light_point_at(point, r.surface.position, false);
            let pmf = light_pmf(point.light);
            if ray.delta || !(pmf > 0.0) {
                let carried = transmittance(medium_towards(r.surface, l.wi, vec3<f32>(0.0)), l.distance);
                unresampled += ray.weight * l.radiance * carried;
            } else {
                let value = candidate_target(r, l);
                let densities = both_densities(f32(settings.candidates) * pmf * l.pdf_scale, bsdf_pdf_of(r, l, opacity_of(l)));
                add_candidate(c, settings.candidates + i, point, value, value / densities, rng_1(rng));
            }
        }
        let light = next_light_hit(ray.segment, first);
        if !(ray.segment.length > 0.0) || light == NONE {
            break;
        }
        point = light_hit_point(light, light, ray.segment);
        first = light + 1u;
    }
    return shown_light(unresampled, ray.diffuse);
}

fn add_candidate(c: ptr<function, Candidates>, index: u32, point: LightPoint, value: f32, weight: f32, u: f32) {
    // SPIR-V takes no pointer to a member.
    var stream = (*c).stream;
    if stream_add(&stream, index, weight, u) {
        (*c).point = point;
        (*c).selected_target = value;
    }
    (*c).stream = stream;
}

fn sample_candidates(r: Receiver, pixel: vec2<u32>, rng: ptr<function, Rng>) -> SelectedCandidate {
    let with_bsdf = has(RESAMPLE_BSDF_CANDIDATE) && RAYS_FIND_LIGHT;
    var c = Candidates(Stream(0.0, NONE), no_light_point(), 0.0);
    add_light_candidates(&c, r, with_bsdf, pixel, rng);
    var ray = no_bsdf_ray();
    if with_bsdf {
        ray = trace_bsdf_ray(r, rng);
    } else if has(RESAMPLE_BSDF_CANDIDATE) {
        // The random numbers after it stay the same.
        (*rng).dimension += BSDF_RAY_DIMENSIONS;
    }
    let unresampled = add_bsdf_candidates(&c, r, ray, rng);

    // An occluded sample has the weight 0, and still counts as a frame's worth of candidates.  The BSDF ray has tested its own visibility.
    var reservoir = Reservoir(c.point, 0.0, 1.0, true);
    var f = vec3<f32>(0.0);
    if c.point.light != NONE {
        let e = evaluate(r, reservoir);
        f = e.f;
        let needs_no_ray = c.stream.selected >= settings.candidates || !has(RESAMPLE_CANDIDATE_RAYS);
        if needs_no_ray || is_visible(r, e, rng_bits(rng).x) {
            reservoir.ucw = stream_ucw(c.stream, c.selected_target);
        }
    }
    return SelectedCandidate(reservoir, f, unresampled);
}

// Sum of the densities of light sampling and BSDF sampling: with p̂ over this sum as resampling weight, candidates are weighted by the
// balance heuristic.  PLANT_*: an error that only tests define, and must find.
#ifdef PLANT_MISSING_DENSITY
fn both_densities(lights: f32, bsdf: f32) -> f32 {
    return select(bsdf, lights, lights > 0.0);
}
#else
fn both_densities(lights: f32, bsdf: f32) -> f32 {
    return lights + bsdf;
}
#endif
