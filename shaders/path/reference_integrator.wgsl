// The reference path tracer: next-event estimation (NEE) and BSDF sampling, combined by the balance heuristic (Veach 1997, 9.2), with
// Russian roulette and without clamping.  It is unbiased for paths of up to `view.bounces` scattering events.  Light that scatters below a
// surface enters where a probe finds the object: lights and directions are sampled there as at any other vertex.
#define_import_path bevy_restir::path::reference_integrator

#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_is_delta, bsdf_pdf, bsdf_sample}
#import bevy_restir::bsdf::types::BsdfSample
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::guard::{GUARD_LIGHT_CONTRIBUTION, GUARD_THROUGHPUT, guarded_3}
#import bevy_restir::common::math::max_component
#import bevy_restir::common::ray::{Hit, Ray}
#import bevy_restir::common::rng::{Rng, rng_1, rng_3, rng_4, rng_bits, unit_float}
#import bevy_restir::light::analytic_area_light::{light_hit_point, LIGHT_HITS_MAX, next_light_hit, RaySegment}
#import bevy_restir::light::environment::{environment_pdf, environment_radiance}
#import bevy_restir::light::light::light_sample
#import bevy_restir::light::point_on_light::light_point_at
#import bevy_restir::light::select::{environment_pmf, light_pmf, light_select}
#import bevy_restir::light::types::RAYS_FIND_LIGHT
#import bevy_restir::path::medium::{medium_before, medium_towards, transmittance}
#import bevy_restir::path::nee::emitter_nee_pdf
#import bevy_restir::path::roulette::{ROULETTE_FROM, survival_probability}
#import bevy_restir::path::shadow_ray::light_is_visible
#import bevy_restir::scene::cone::{cone_after, cone_along}
#import bevy_restir::scene::material::may_emit
#import bevy_restir::scene::offset::offset_point
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::trace::trace::trace_closest
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::pixel_cone
#import bevy_restir::view::light_part::{bsdf_diffuse_share, sample_diffuse_share, shown_emission, shown_share}
#ifdef SUBSURFACE
#import bevy_restir::subsurface::entry::{exit_factor, sample_entry, scatters_below, subsurface_probability}
#endif

// Number of bounces of this invocation's path, for a debug view.
var<private> bounces_taken: u32;

// MIS weight of NEE against BSDF sampling, by their densities of one direction.  TEST_*: tests use one technique alone.
#ifdef TEST_LIGHTS_ALONE
fn nee_mis_weight(lights: f32, bsdf: f32) -> f32 {
    return 1.0;
}
#else ifdef TEST_BSDF_ALONE
fn nee_mis_weight(lights: f32, bsdf: f32) -> f32 {
    return 0.0;
}
#else
fn nee_mis_weight(lights: f32, bsdf: f32) -> f32 {
    return lights / (lights + bsdf);
}
#endif

// Light from a direction.
struct SampledLight {
    radiance: vec3<f32>,
    wi: vec3<f32>,
}

fn no_sampled_light() -> SampledLight {
    return SampledLight(vec3<f32>(0.0), vec3<f32>(0.0, 0.0, 1.0));
}

// Radiance towards wo from one sampled light, times its MIS weight; traces a shadow ray.
fn nee_radiance(s: Surface, wo: vec3<f32>, medium: vec3<f32>, rng: ptr<function, Rng>) -> SampledLight {
    let u = rng_4(rng);
    let alpha_seed = rng_bits(rng).x;
    let choice = light_select(u.xy);
    if !(choice.pmf > 0.0) {
        return no_sampled_light();
    }
    let l = light_sample(choice.light, s.position, u.zw);
    let pdf = choice.pmf * l.pdf_solid_angle * l.pdf_scale;
    if !(pdf > 0.0) || !(max_component(l.radiance) > 0.0) {
        return no_sampled_light();
    }
    let f = guarded_3(bsdf_eval(s.bsdf, wo, l.wi), GUARD_LIGHT_CONTRIBUTION);
    if !(max_component(f) > 0.0) {
        return no_sampled_light();
    }
    var weight = 1.0;
    if l.delta == 0u {
        weight = nee_mis_weight(pdf, bsdf_pdf(s.bsdf, wo, l.wi));
    }
    if !light_is_visible(s, l, alpha_seed, false) {
        return no_sampled_light();
    }
    let carried = transmittance(medium_towards(s, l.wi, medium), l.distance);
    return SampledLight(guarded_3(f * l.radiance * carried * (weight / pdf), GUARD_LIGHT_CONTRIBUTION), l.wi);
}

// Radiance of the analytic area lights that a segment hits, times their MIS weights against NEE at `from_point`.  `pdf`: density of the
// direction; 0 if NEE cannot sample it.
fn light_hit_radiance(segment: RaySegment, from_point: vec3<f32>, medium: vec3<f32>, pdf: f32) -> vec3<f32> {
    var radiance = vec3<f32>(0.0);
    var first = 0u;
    for (var i = 0u; i < LIGHT_HITS_MAX; i++) {
        let light = next_light_hit(segment, first);
        if light == NONE {
            break;
        }
        first = light + 1u;
        let l = light_point_at(light_hit_point(light, light, segment), from_point, false);
        let weight = bsdf_mis_weight(pdf, light_pmf(light) * l.pdf_solid_angle * l.pdf_scale);
        radiance += l.radiance * transmittance(medium, l.distance) * weight;
    }
    return radiance;
}

// The surface that a path scatters from: the one that it hit, or one where light enters the same body.
struct Scatterer {
    surface: Surface,
    wo: vec3<f32>,
    weight: vec3<f32>,         // factor of light that it scatters, divided by the probability of choosing it
    radiance: vec3<f32>,       // of a light that is sampled where light enters
    below: bool,               // light enters here
    valid: bool,               // whether light enters; true for the surface that was hit
}

#ifdef SUBSURFACE
// Samples a light where it enters the body, then continues there or at the surface.
fn next_scatterer(s: Surface, wo: vec3<f32>, medium: vec3<f32>, rng: ptr<function, Rng>) -> Scatterer {
    if !scatters_below(s, wo) {
        return Scatterer(s, wo, vec3<f32>(1.0), vec3<f32>(0.0), false, true);
    }
    let u = rng_4(rng);
    let bits = rng_bits(rng);
    let entry = sample_entry(s, u, bits.x, false);
    let weight = exit_factor(s, wo) * entry.weight;
    var radiance = vec3<f32>(0.0);
    if entry.valid {
        radiance = weight * nee_radiance(entry.surface, entry.surface.bsdf.n, medium, rng).radiance;
    }
    let p = subsurface_probability(s, wo);
    if unit_float(bits).y < p {
        return Scatterer(entry.surface, entry.surface.bsdf.n, weight / p, radiance, true, entry.valid);
    }
    return Scatterer(s, wo, vec3<f32>(1.0 / (1.0 - p)), radiance, false, true);
}
#else
fn next_scatterer(s: Surface, wo: vec3<f32>, medium: vec3<f32>, rng: ptr<function, Rng>) -> Scatterer {
    return Scatterer(s, wo, vec3<f32>(1.0), vec3<f32>(0.0), false, true);
}
#endif

// Weight of light that a BSDF sample has found.  `pdf`: its density; 0 for directions that NEE cannot sample.
fn bsdf_mis_weight(pdf: f32, nee_pdf: f32) -> f32 {
    return select(1.0, 1.0 - nee_mis_weight(nee_pdf, pdf), pdf > 0.0);
}

// The same for the emission of a surface that was hit.
fn emission_weight(s: Surface, hit: Hit, from_point: vec3<f32>, pdf: f32) -> f32 {
    let nee_pdf = emitter_nee_pdf(s.light, light_pmf(s.light), hit.instance, hit.triangle, from_point, s.position, false);
    return bsdf_mis_weight(pdf, nee_pdf);
}

// The same for the environment.
fn environment_weight(direction: vec3<f32>, pdf: f32) -> f32 {
    return bsdf_mis_weight(pdf, environment_pmf() * environment_pdf(direction, false));
}

// Russian roulette.
fn survives_roulette(throughput: ptr<function, vec3<f32>>, eta_scale: f32, rng: ptr<function, Rng>) -> bool {
    let q = survival_probability(*throughput, eta_scale);
    if !(rng_1(rng) < q) {
        return false;
    }
    *throughput /= q;
    return true;
}

// Shown share of the light that a path finds behind a scatterer in the direction of a sample, if the scatterer is the first one.
fn shown_behind(s: Scatterer, b: BsdfSample) -> vec3<f32> {
    if s.below {
        return shown_share(vec3<f32>(1.0));
    }
    return shown_share(sample_diffuse_share(s.surface.bsdf, s.wo, b));
}

// Emission of a surface, with its MIS weight against NEE at the last vertex.  An unlit material shines for the camera alone.
fn emitted_radiance(s: Surface, hit: Hit, from_point: vec3<f32>, pdf: f32, is_first: bool) -> vec3<f32> {
    var radiance = select(vec3<f32>(0.0), s.unlit, is_first);
    if max_component(s.emission) > 0.0 {
        radiance += s.emission * emission_weight(s, hit, from_point, pdf);
    }
    return radiance;
}

// Radiance of analytic lights that a ray meets before its hit, and of the environment if it hits nothing.
fn radiance_along(ray: Ray, hit: Hit, from_point: vec3<f32>, medium: vec3<f32>, pdf: f32) -> vec3<f32> {
    var radiance = light_hit_radiance(RaySegment(ray.origin, hit.t, ray.direction), from_point, medium, pdf);
    if hit.instance == NONE {
        radiance += environment_radiance(ray.direction, false) * environment_weight(ray.direction, pdf);
    }
    return radiance;
}

// The shown part of the light that NEE finds at a surface.  `shown`: its share behind the first surface; at the first surface itself, the
// share depends on the direction of the light.
fn shown_nee(s: Surface, wo: vec3<f32>, medium: vec3<f32>, shown: vec3<f32>, is_first: bool, rng: ptr<function, Rng>) -> vec3<f32> {
    if bsdf_is_delta(s.bsdf) {
        return vec3<f32>(0.0);
    }
    let nee = nee_radiance(s, wo, medium, rng);
    if is_first {
        return shown_share(bsdf_diffuse_share(s.bsdf, wo, nee.wi)) * nee.radiance;
    }
    return shown * nee.radiance;
}

// Radiance along a camera ray with a known first hit.
fn estimate_radiance(first: Hit, camera_ray: Ray, rng: ptr<function, Rng>) -> vec3<f32> {
    var radiance = vec3<f32>(0.0);
    var throughput = vec3<f32>(1.0);
    // Shown share of the light that the path finds: at first of the light that the first surface emits, then of the light that it scatters.
    var shown = shown_emission(vec3<f32>(1.0));
    var medium = vec3<f32>(0.0);
    var hit = first;
    var ray = camera_ray;
    var cone = pixel_cone(view.current, camera_ray, first.t);
    var from_point = camera_ray.origin;
    // Density of the last direction; 0 for directions that NEE cannot sample.
    var pdf = 0.0;
    // Squared relative indices of refraction (`survival_probability`).
    var eta_scale = 1.0;

    for (var scattered = 0u; scattered <= view.bounces; scattered++) {
        // The last surface could only emit light.
        if scattered == view.bounces && !may_emit(hit.instance) {
            break;
        }
        let wo = -ray.direction;
        var s = surface_at(hit.instance, hit.triangle, hit.barycentrics, wo, cone, false);
        // As in resampled paths, the ray from the camera is not absorbed.
        if scattered > 0u {
            medium = medium_before(s, medium);
        }
        throughput *= transmittance(medium, hit.t);

        radiance += shown * throughput * emitted_radiance(s, hit, from_point, pdf, scattered == 0u);
        if scattered == view.bounces {
            break;
        }

        radiance += throughput * shown_nee(s, wo, medium, shown, scattered == 0u, rng);

        // Sample the BSDF, where the path hit the surface or where light enters the body below it.
        let scatterer = next_scatterer(s, wo, medium, rng);
        if scattered == 0u {
            shown = shown_share(vec3<f32>(1.0));
        }
        radiance += shown * throughput * scatterer.radiance;
        if !scatterer.valid {
            break;
        }
        s = scatterer.surface;
        let b = bsdf_sample(s.bsdf, scatterer.wo, rng_3(rng));
        if b.valid == 0u {
            break;
        }
        if scattered == 0u {
            shown = shown_behind(scatterer, b);
        }
        throughput = guarded_3(throughput * scatterer.weight * b.weight, GUARD_THROUGHPUT);
        pdf = b.pdf;
        eta_scale *= b.eta * b.eta;
        medium = medium_towards(s, b.wi, medium);

        if scattered + 1u >= ROULETTE_FROM && !survives_roulette(&throughput, eta_scale, rng) {
            break;
        }

        bounces_taken = scattered + 1u;
        // The last ray could only find light.
        if bounces_taken == view.bounces && !RAYS_FIND_LIGHT {
            break;
        }
        from_point = s.position;
        ray = Ray(offset_point(s.position, s.bsdf.n_geo, b.wi, s.offset), 0.0, b.wi, FAR);
        hit = trace_closest(ray, rng_bits(rng).x);
        cone = cone_along(cone_after(cone, b.delta != 0u), hit.t);
        radiance += shown * throughput * radiance_along(ray, hit, from_point, medium, pdf);
        if hit.instance == NONE {
            break;
        }
    }
    return radiance;
}
