// Weights of every input at its own sample: from all targets, and from only the targets that the kind needs.
#import bevy_restir::restir::mis::{MAX_INPUTS, mis_needs_target, mis_weight, MisInputs}

struct Case {
    kind: u32,
    count: u32,
    confidence: array<f32, 7>,
    targets: array<f32, 49>,
}

struct Weights {
    all: array<f32, 7>,
    asked: array<f32, 7>,
}

@group(0) @binding(0) var<storage, read> cases: array<Case>;
@group(0) @binding(1) var<storage, read_write> weights: array<Weights>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&cases) {
        return;
    }
    let kind = cases[id.x].kind;
    var inputs = MisInputs(cases[id.x].count, cases[id.x].confidence, cases[id.x].targets);
    for (var j = 0u; j < inputs.count; j++) {
        weights[id.x].all[j] = mis_weight(&inputs, kind, j);
    }
    for (var i = 0u; i < MAX_INPUTS; i++) {
        for (var j = 0u; j < MAX_INPUTS; j++) {
            if !mis_needs_target(kind, i, j) {
                inputs.targets[i * MAX_INPUTS + j] = 0.0;
            }
        }
    }
    for (var j = 0u; j < inputs.count; j++) {
        weights[id.x].asked[j] = mis_weight(&inputs, kind, j);
    }
}
