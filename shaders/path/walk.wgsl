// Steps along a path, shared by paths that are sampled and paths that are replayed.  A step samples one lobe; its weight is the value of that
// lobe over the joint density of direction and lobe (Lin et al. 2026, supplement, 1).
#define_import_path bevy_restir::path::walk

#import bevy_restir::bsdf::bsdf::{bsdf_draw, bsdf_lobe_terms}
#import bevy_restir::common::guard::{GUARD_BSDF_SAMPLE, guarded, guarded_3}
#import bevy_restir::common::math::{max_component, quantized_direction}
#import bevy_restir::path::medium::medium_towards
#import bevy_restir::path::random::path_random
#import bevy_restir::scene::cone::{Cone, cone_after, cone_along}
#import bevy_restir::scene::surface::Surface

// A vertex, seen from the one before it.
struct Vertex {
    surface: Surface,
    wo: vec3<f32>,
    medium: vec3<f32>,        // absorption of the body that the ray came through, 1/m
    cone: Cone,               // footprint of the pixel
}

// How a path leaves a vertex.
struct Step {
    wi: vec3<f32>,
    valid: bool,
    weight: vec3<f32>,        // f·|cos| / joint density of direction and lobe
    pdf_lobe: f32,            // joint density of direction and lobe, solid angle; 0 for a delta lobe
    pdf: f32,                 // marginal density over all lobes; 0 for a delta lobe
    lobe: u32,
    delta: bool,
    eta: f32,
}

fn no_step() -> Step {
    return Step(vec3<f32>(0.0, 0.0, 1.0), false, vec3<f32>(0.0), 0.0, 0.0, 0u, false, 1.0);
}

// The step that the path's own random numbers give at the vertex of this index.
fn sampled_step(v: Vertex, seed: u32, index: u32) -> Step {
    return with_weight_and_densities(v, drawn_step(v, seed, index));
}

// Direction and lobe by the path's random numbers; a delta lobe has its weight, too.  Other directions are rounded as a reservoir stores
// them, so that the path that is weighted is the one that is stored.
fn drawn_step(v: Vertex, seed: u32, index: u32) -> Step {
    let b = bsdf_draw(v.surface.bsdf, v.wo, path_random(seed, index));
    var s = no_step();
    s.valid = b.valid != 0u;
    s.delta = b.delta != 0u;
    s.weight = b.weight;
    s.lobe = b.lobe;
    s.eta = b.eta;
    s.wi = b.wi;
    if !s.delta {
        s.wi = quantized_direction(b.wi);
    }
    return s;
}

// The step in a given direction by a given lobe.
fn step_towards(v: Vertex, wi: vec3<f32>, lobe: u32) -> Step {
    return with_weight_and_densities(v, given_step(wi, lobe));
}

// The step in a given direction by a given lobe, without weight and densities.
fn given_step(wi: vec3<f32>, lobe: u32) -> Step {
    var s = no_step();
    s.wi = wi;
    s.lobe = lobe;
    s.valid = true;
    return s;
}

// Adds weight and densities to a step whose direction and lobe are known.  Zero throughput makes a step invalid.
fn with_weight_and_densities(v: Vertex, step: Step) -> Step {
    var s = step;
    if !s.valid {
        return s;
    }
    if !s.delta {
        let terms = bsdf_lobe_terms(v.surface.bsdf, v.wo, s.wi, s.lobe);
        s.pdf_lobe = guarded(terms.pdf_lobe, GUARD_BSDF_SAMPLE);
        s.pdf = guarded(terms.pdf, GUARD_BSDF_SAMPLE);
        s.weight = select(vec3<f32>(0.0), terms.f / s.pdf_lobe, s.pdf_lobe > 0.0);
    }
    s.weight = guarded_3(s.weight, GUARD_BSDF_SAMPLE);
    s.valid = max_component(s.weight) > 0.0;
    return s;
}

// Absorption along the ray of a step.
fn step_medium(v: Vertex, wi: vec3<f32>) -> vec3<f32> {
    return medium_towards(v.surface, wi, v.medium);
}

// Footprint of the pixel where the ray of a step arrives.
fn step_cone(v: Vertex, step: Step, distance: f32) -> Cone {
    return cone_along(cone_after(v.cone, step.delta), distance);
}
