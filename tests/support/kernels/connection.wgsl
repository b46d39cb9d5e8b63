// The criteria of reconnections for random pairs of vertices.
#import bevy_restir::bsdf::types::{LOBE_COAT}
#import bevy_restir::path::technique_weights::{LightShares, TechniqueCounts}
#import bevy_restir::path::walk::{Step, Vertex}
#import bevy_restir::restir::shift::reconnection::{is_connectable_by, is_connectable_end, PreviousVertex, previous_vertex, separation_threshold, ShiftParameters}
#import bevy_restir::scene::surface::Surface

struct Side {
    position: vec3<f32>,
    pdf: f32,
    n_geo: vec3<f32>,
    roughness: f32,        // GGX α
    coat_roughness: f32,   // GGX α
    lobe: u32,
    delta: u32,
    diffuse: u32,          // 1: the material has no other lobe
}

struct Pair {
    eye: vec3<f32>,
    kind: u32,
    first: vec3<f32>,
    separation: f32,
    first_normal: vec3<f32>,
    roughness: f32,
    index: u32,
    pad_a: u32,
    pad_b: u32,
    pad_c: u32,
    earlier_side: Side,    // the vertex before `from_side`, where that is not the first
    from_side: Side,
    to_side: Side,
}

struct Answer {
    threshold: f32,
    rough: u32,
    connectable: u32,
    connectable_end: u32,
}

@group(0) @binding(0) var<storage, read> pairs: array<Pair>;
@group(0) @binding(1) var<storage, read_write> answers: array<Answer>;

fn surface_of(s: Side) -> Surface {
    var surface: Surface;
    surface.position = s.position;
    surface.bsdf.n = s.n_geo;
    surface.bsdf.n_geo = s.n_geo;
    surface.bsdf.roughness = s.roughness;
    surface.bsdf.roughness_along = s.roughness;
    surface.bsdf.coat_normal = s.n_geo;
    surface.bsdf.coat_roughness = s.coat_roughness;
    surface.bsdf.coat = select(0.0, 1.0, s.lobe == LOBE_COAT);
    surface.bsdf.dielectric_reflectance = vec3<f32>(select(0.04, 0.0, s.diffuse != 0u));
    surface.bsdf.base_color = vec3<f32>(0.5);
    return surface;
}

fn vertex_of(s: Side) -> Vertex {
    var v: Vertex;
    v.surface = surface_of(s);
    return v;
}

fn step_of(s: Side) -> Step {
    var step: Step;
    step.valid = true;
    step.pdf = select(s.pdf, 0.0, s.delta != 0u);
    step.pdf_lobe = 0.5 * step.pdf;
    step.lobe = s.lobe;
    step.delta = s.delta != 0u;
    return step;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&pairs) {
        return;
    }
    let p = pairs[id.x];
    var first: Surface;
    first.position = p.first;
    first.bsdf.n_geo = p.first_normal;
    let threshold = separation_threshold(p.kind, p.separation, p.eye, first);
    let c = ShiftParameters(p.kind, threshold, p.roughness, 10.0, TechniqueCounts(1u, 0.0, 0.0, LightShares(0.0, 0.0)), 0.0, false);
    var earlier: PreviousVertex;
    if p.index > 1u {
        earlier = previous_vertex(earlier, vertex_of(p.earlier_side), step_of(p.earlier_side), 1u, c);
    }
    let before = previous_vertex(earlier, vertex_of(p.from_side), step_of(p.from_side), p.index, c);
    let v = vertex_of(p.to_side);
    answers[id.x] = Answer(
        threshold,
        u32(before.rough),
        u32(is_connectable_by(before, v, step_of(p.to_side), c)),
        u32(is_connectable_end(before, v.surface.position, v.surface.bsdf.n_geo, c)),
    );
}
