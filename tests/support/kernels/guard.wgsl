// The results of the guard functions for given bits, and the guards that they raise.
#import bevy_restir::common::guard::{GUARD_RAY, guard_holds, guarded, guarded_3, guarded_or_infinite, is_sound, raised_guards}

struct Out {
    number: u32,
    raised: u32,
    color: vec2<u32>,          // first and second component; the second was 1
    raised_by_color: u32,
    with_infinity: u32,
    raised_with_infinity: u32,
    raised_by_condition: u32,
}

@group(0) @binding(0) var<storage, read> numbers: array<u32>;
@group(0) @binding(1) var<storage, read_write> results: array<Out>;

@compute @workgroup_size(1)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = bitcast<f32>(numbers[id.x]);
    var out: Out;
    out.number = bitcast<u32>(guarded(x, GUARD_RAY));
    out.raised = taken();
    out.color = bitcast<vec2<u32>>(guarded_3(vec3<f32>(x, 1.0, 0.5), GUARD_RAY).xy);
    out.raised_by_color = taken();
    out.with_infinity = bitcast<u32>(guarded_or_infinite(x, GUARD_RAY));
    out.raised_with_infinity = taken();
    _ = guard_holds(is_sound(x), GUARD_RAY);
    out.raised_by_condition = taken();
    results[id.x] = out;
}

fn taken() -> u32 {
    let raised = raised_guards;
    raised_guards = 0u;
    return raised;
}
