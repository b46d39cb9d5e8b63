// Steps along a path, the same where it is first traced and where it is replayed: lobes are sampled one by one, their joint densities
// of direction and lobe are what is divided by (Lin et al. 2026, supplement, 1), and what is kept of a step is what decides where paths
// reconnect.
#define_import_path bevy_restir::path::walk

#import bevy_restir::bsdf::bsdf::{bsdf_draw, bsdf_lobe_terms}
#import bevy_restir::common::math::{is_finite_3, max_component}
#import bevy_restir::path::medium::medium_towards
#import bevy_restir::path::random::path_random
#import bevy_restir::path::sample::kept_direction
#import bevy_restir::scene::cone::{Cone, cone_after, cone_along}
#import bevy_restir::scene::surface::Surface

// A vertex as the path arrives at it.
struct Vertex {
    surface: Surface,
    wo: vec3<f32>,
    medium: vec3<f32>,        // that it came through
    cone: Cone,               // what the pixel covers there
}

// How a path leaves a vertex.
struct Step {
    wi: vec3<f32>,
    valid: bool,
    weight: vec3<f32>,        // f·|cos| / joint density of direction and lobe
    pdf_lobe: f32,            // joint density, solid angle; of a delta 0
    pdf: f32,                 // marginal density of all lobes; of a delta 0
    lobe: u32,
    delta: bool,
    eta: f32,
}

fn no_step() -> Step {
    return Step(vec3<f32>(0.0, 0.0, 1.0), false, vec3<f32>(0.0), 0.0, 0.0, 0u, false, 1.0);
}

// The step that the random numbers of a path give at its vertex of this index.
fn sampled_step(v: Vertex, seed: u32, index: u32) -> Step {
    return finished_step(v, drawn_step(v, seed, index));
}

// A step of which direction and lobe are known, or all that there is of a delta.
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
        s.wi = kept_direction(b.wi);
    }
    return s;
}

// The step of a given direction and lobe.
fn step_towards(v: Vertex, wi: vec3<f32>, lobe: u32) -> Step {
    return finished_step(v, aimed_step(wi, lobe));
}

fn aimed_step(wi: vec3<f32>, lobe: u32) -> Step {
    var s = no_step();
    s.wi = wi;
    s.lobe = lobe;
    s.valid = true;
    return s;
}

// With its weight and densities; one that carries nothing is none.
fn finished_step(v: Vertex, step: Step) -> Step {
    var s = step;
    if !s.delta {
        let terms = bsdf_lobe_terms(v.surface.bsdf, v.wo, s.wi, s.lobe);
        s.pdf_lobe = terms.pdf_lobe;
        s.pdf = terms.pdf;
        s.weight = terms.f / max(terms.pdf_lobe, 1.0e-37);
        s.valid = s.valid && s.pdf_lobe > 0.0;
    }
    s.valid = s.valid && is_finite_3(s.weight) && max_component(s.weight) > 0.0;
    return s;
}

// Absorption on the way that a step takes.
fn step_medium(v: Vertex, wi: vec3<f32>) -> vec3<f32> {
    return medium_towards(v.surface, wi, v.medium);
}

// What the pixel covers where a step arrives.
fn step_cone(v: Vertex, step: Step, distance: f32) -> Cone {
    return cone_along(cone_after(v.cone, step.delta), distance);
}
