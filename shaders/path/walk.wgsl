// Steps along a path, the same where it is first traced and where it is replayed: lobes are sampled one by one, their joint densities
// of direction and lobe are what is divided by (paper 000, 1), and what is kept of a step is what decides where paths reconnect.
#define_import_path bevy_restir::path::walk

#import bevy_restir::bsdf::bsdf::{bsdf_eval_lobe, bsdf_pdf, bsdf_pdf_lobe, bsdf_sample}
#import bevy_restir::common::math::is_finite_3
#import bevy_restir::path::medium::medium_towards
#import bevy_restir::path::random::path_random
#import bevy_restir::path::sample::kept_direction
#import bevy_restir::scene::surface::Surface

// A vertex as the path arrives at it.
struct Vertex {
    surface: Surface,
    wo: vec3<f32>,
    medium: vec3<f32>,        // that it came through
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
    let b = bsdf_sample(v.surface.bsdf, v.wo, path_random(seed, index));
    if b.valid == 0u {
        return no_step();
    }
    if b.delta != 0u {
        return Step(b.wi, true, b.weight, 0.0, 0.0, b.lobe, true, b.eta);
    }
    var step = step_towards(v, kept_direction(b.wi), b.lobe);
    step.eta = b.eta;
    return step;
}

// The step of a given direction and lobe.
fn step_towards(v: Vertex, wi: vec3<f32>, lobe: u32) -> Step {
    var s = no_step();
    s.wi = wi;
    s.lobe = lobe;
    s.pdf_lobe = bsdf_pdf_lobe(v.surface.bsdf, v.wo, wi, lobe);
    s.pdf = bsdf_pdf(v.surface.bsdf, v.wo, wi);
    if s.pdf_lobe > 0.0 {
        s.weight = bsdf_eval_lobe(v.surface.bsdf, v.wo, wi, lobe) / s.pdf_lobe;
        s.valid = is_finite_3(s.weight);
    }
    return s;
}

// Absorption on the way that a step takes.
fn step_medium(v: Vertex, wi: vec3<f32>) -> vec3<f32> {
    return medium_towards(v.surface, wi, v.medium);
}
