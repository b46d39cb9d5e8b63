// Next-event estimation (NEE) at a vertex of a path: the number of light candidates, of which one is kept (Lin et al. 2026, supplement, 5),
// and the contribution of a point of a light.  `path/technique_weights.wgsl` has its MIS weights.
#define_import_path bevy_restir::path::nee

#import bevy_restir::bsdf::bsdf::bsdf_terms
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_LIGHT_CONTRIBUTION, guarded_3}
#import bevy_restir::light::point_on_light::{light_point_at, LightPoint}
#import bevy_restir::light::select::light_pmf
#import bevy_restir::light::triangle::triangle_light_pdf_solid_angle
#import bevy_restir::light::types::LightSample
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::walk::{step_medium, Vertex}

// A point of a light as a vertex sees it.
struct NeeContribution {
    f: vec3<f32>,             // f·L·|cos| in the measure of the light; without MIS weight and visibility
    light: LightSample,
    pdf_bsdf: f32,            // marginal density with which the BSDF samples this direction, solid angle
}

// Number of light candidates at the vertex of this index, where the first vertex draws `first_count`.  Later vertices draw
// fewer; the supplement of Lin et al. 2026 (section 5) has only one number of candidates, M.
fn nee_candidate_count(first_count: u32, index: u32) -> u32 {
    return max(first_count / (index * index), 1u);
}

// Expected number of these candidates that choose this light.
fn expected_nee_candidates(light: u32, first_count: u32, index: u32) -> f32 {
    return f32(nee_candidate_count(first_count, index)) * light_pmf(light);
}

fn nee_contribution(v: Vertex, p: LightPoint, previous: bool) -> NeeContribution {
    let l = light_point_at(p, v.surface.position, previous);
    var c = NeeContribution(vec3<f32>(0.0), l, 0.0);
    if !(l.pdf_solid_angle > 0.0) {
        return c;
    }
    let bsdf = bsdf_terms(v.surface.bsdf, v.wo, l.wi);
    c.pdf_bsdf = bsdf.pdf;
    let carried = transmittance(step_medium(v, l.wi), l.distance);
    c.f = guarded_3(bsdf.f * l.radiance * carried / l.pdf_solid_angle, GUARD_LIGHT_CONTRIBUTION);
    return c;
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
