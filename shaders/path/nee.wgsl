// Next-event estimation (NEE) at a vertex of a path, and the weights that join it with BSDF sampling: the balance heuristic
// (Veach 1997, 9.2), where a vertex draws several light candidates and keeps one (Lin et al. 2026, supplement, 5).
#define_import_path bevy_restir::path::nee

#import bevy_restir::bsdf::bsdf::bsdf_terms
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_LIGHT_CONTRIBUTION, GUARD_LIGHT_SAMPLE, guarded_3, guarded_or_infinite}
#import bevy_restir::light::point_on_light::{light_point_at, LightPoint}
#import bevy_restir::light::select::light_pmf
#import bevy_restir::light::triangle::triangle_light_pdf_solid_angle
#import bevy_restir::light::types::LightSample
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::walk::{Step, step_medium, Vertex}

// A point of a light as a vertex sees it.
struct NeeContribution {
    f: vec3<f32>,             // f·L·|cos| times the MIS weight, in the measure of the light; without visibility
    light: LightSample,
    pdf_bsdf: f32,            // marginal density with which the BSDF samples this direction, solid angle
}

// Number of light candidates at the vertex of this index, where the first vertex draws `first_count`: later vertices draw fewer
// (Lin et al. 2026, supplement, Fig. 4).
fn nee_candidate_count(first_count: u32, index: u32) -> u32 {
    return max(first_count / (index * index), 1u);
}

// Expected number of these candidates that choose this light.
fn expected_nee_candidates(light: u32, first_count: u32, index: u32) -> f32 {
    return f32(nee_candidate_count(first_count, index)) * light_pmf(light);
}

// `expected_count`: of `expected_nee_candidates`; it scales the density of NEE in the balance heuristic (M p₁ against p₂).
fn nee_contribution(v: Vertex, p: LightPoint, expected_count: f32, previous: bool) -> NeeContribution {
    let l = light_point_at(p, v.surface.position, previous);
    var c = NeeContribution(vec3<f32>(0.0), l, 0.0);
    if !(l.pdf_solid_angle > 0.0) {
        return c;
    }
    let bsdf = bsdf_terms(v.surface.bsdf, v.wo, l.wi);
    c.pdf_bsdf = bsdf.pdf;
    let pdf = expected_count * l.pdf_solid_angle * l.pdf_scale;
    let weight = select(pdf / (pdf + c.pdf_bsdf), 1.0, l.delta != 0u);
    let carried = transmittance(step_medium(v, l.wi), l.distance);
    c.f = guarded_3(bsdf.f * l.radiance * carried * (weight / l.pdf_solid_angle), GUARD_LIGHT_CONTRIBUTION);
    return c;
}

// MIS weight of a path that found its light by BSDF sampling, where NEE would have sampled the same direction with density `nee_pdf`.
// NEE never samples the direction of a delta lobe.
fn bsdf_hit_weight(step: Step, nee_pdf: f32) -> f32 {
    let pdf = guarded_or_infinite(nee_pdf, GUARD_LIGHT_SAMPLE);
    return select(step.pdf / (step.pdf + pdf), 1.0, step.delta || !(pdf > 0.0));
}

// Density, solid angle at `from_point`, with which NEE samples a point of an emissive triangle; 0 for a triangle that is not in the table
// of lights.
fn emitter_nee_pdf(
    light: u32,
    expected_count: f32,
    instance: u32,
    triangle: u32,
    from_point: vec3<f32>,
    position: vec3<f32>,
    previous: bool,
) -> f32 {
    if light == NONE {
        return 0.0;
    }
    return expected_count * triangle_light_pdf_solid_angle(instance, triangle, from_point, position, previous);
}
