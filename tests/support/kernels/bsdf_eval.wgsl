// The value and density of the BSDF for every query: of all lobes together, and of each lobe.
#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_eval_lobe, bsdf_lobe_terms, bsdf_pdf}
#import bevy_restir::bsdf::types::Bsdf

// Number of lobes: of LOBE_* in `bsdf/types.wgsl`, without LOBE_BELOW.
const LOBE_COUNT: u32 = 4u;

struct Query {
    b: Bsdf,
    wo: vec3<f32>,
    seed: u32,
    wi: vec3<f32>,
    pad: u32,
}

@group(0) @binding(0) var<storage, read> queries: array<Query>;
// (f, pdf): of all lobes, then of each lobe.
@group(0) @binding(1) var<storage, read_write> answers: array<array<vec4<f32>, 5>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= arrayLength(&queries) {
        return;
    }
    let q = queries[i];
    answers[i][0] = vec4<f32>(bsdf_eval(q.b, q.wo, q.wi), bsdf_pdf(q.b, q.wo, q.wi));
    for (var lobe = 0u; lobe < LOBE_COUNT; lobe++) {
        answers[i][lobe + 1u] = vec4<f32>(bsdf_eval_lobe(q.b, q.wo, q.wi, lobe), bsdf_lobe_terms(q.b, q.wo, q.wi, lobe).pdf_lobe);
    }
}
