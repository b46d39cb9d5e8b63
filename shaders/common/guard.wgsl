// Guards stop numbers that a correct shader never computes, such as NaN or negative light, so that they do not spread, and report that
// they did: `view/ray_counter.wgsl` stores the raised guards of a pixel, and `view/guard_counter.wgsl` counts them over the whole run.
//
// A guard must not be raised by a legal case: a light that is seen edge-on, a path that carries no light, textures of the user with NaN
// (which are cleaned where they are read).  Light beyond the range of f32 is legal, too, but it is missing in the picture: it is counted
// as GUARD_FLOAT_OVERFLOW instead of the guard that stops it.
#define_import_path bevy_restir::common::guard

#import bevy_restir::common::math::{is_finite, is_finite_3}

// Bits of `raised_guards`.  The bits 1, 2, 4 and 0x80000 belong to OVERFLOW_* and NON_FINITE (`common/constants.wgsl`), which are counted
// with them.  A test holds these constants and their names equal to `GUARDS` in `src/view/guards.rs`, which explains each of them.
const GUARD_FLOAT_OVERFLOW: u32 = 0x8u;
const GUARD_NEGATIVE_PIXEL: u32 = 0x10u;
const GUARD_RAY: u32 = 0x20u;
const GUARD_SURFACE: u32 = 0x40u;
const GUARD_LIGHT_SAMPLE: u32 = 0x80u;
const GUARD_LIGHT_CONTRIBUTION: u32 = 0x100u;
const GUARD_BSDF_SAMPLE: u32 = 0x200u;
const GUARD_THROUGHPUT: u32 = 0x400u;
const GUARD_RESAMPLING_WEIGHT: u32 = 0x800u;
const GUARD_CONTRIBUTION_WEIGHT: u32 = 0x1000u;
const GUARD_TARGET: u32 = 0x2000u;
const GUARD_MIS_WEIGHT: u32 = 0x4000u;
const GUARD_SHIFT_CONTRIBUTION: u32 = 0x8000u;
const GUARD_JACOBIAN: u32 = 0x10000u;
const GUARD_GI_MEASURE: u32 = 0x20000u;
const GUARD_RESERVOIR: u32 = 0x40000u;

// Guards that this invocation has raised.
var<private> raised_guards: u32;

fn raise(guard: u32) {
    raised_guards |= guard;
}

// Whether a number is finite and not negative.
fn is_sound(x: f32) -> bool {
    return is_finite(x) && x >= 0.0;
}

fn is_sound_3(v: vec3<f32>) -> bool {
    return is_finite_3(v) && all(v >= vec3<f32>(0.0));
}

// Tests the bits, as `is_finite` does.
fn is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
}

fn is_infinite(x: f32) -> bool {
    return bitcast<u32>(x) == 0x7f800000u;
}

// A condition that always holds; the guard is raised if it does not.
fn guard_holds(condition: bool, guard: u32) -> bool {
    let holds = condition && !fails_as_planted(guard);
    if !holds {
        raise(guard);
    }
    return holds;
}

// Returns `x`, or 0 if it is NaN, negative or too large for f32.  The first two are errors and raise the guard; the last one is legal, and
// raises GUARD_FLOAT_OVERFLOW instead.
fn guarded(x: f32, guard: u32) -> f32 {
    let y = as_planted(x, guard);
    if is_sound(y) {
        return y;
    }
    raise(select(guard, GUARD_FLOAT_OVERFLOW, is_infinite(y)));
    return 0.0;
}

// Like `guarded`, but infinity is legal, and stays.
fn guarded_or_infinite(x: f32, guard: u32) -> f32 {
    if is_infinite(x) {
        return x;
    }
    return guarded(x, guard);
}

// Like `guarded`, for three channels: all of them become 0 if one is not sound.
fn guarded_3(v: vec3<f32>, guard: u32) -> vec3<f32> {
    let w = vec3<f32>(as_planted(v.x, guard), v.yz);
    if is_sound_3(w) {
        return w;
    }
    let overflows = (is_sound(w.x) || is_infinite(w.x)) && (is_sound(w.y) || is_infinite(w.y)) && (is_sound(w.z) || is_infinite(w.z));
    raise(select(guard, GUARD_FLOAT_OVERFLOW, overflows));
    return vec3<f32>(0.0);
}

// PLANTED_*: tests make the conditions of some guards fail, and replace about one in eight of the numbers that those guards check.
#ifdef PLANTED_GUARDS
fn fails_as_planted(guard: u32) -> bool {
    return (guard & #{PLANTED_GUARDS}u) != 0u;
}

fn as_planted(x: f32, guard: u32) -> f32 {
    // A variable, because WGSL rejects a constant that is not finite.
    var bits = #{PLANTED_BITS}u;
    let is_chosen = (bitcast<u32>(x) * 0x9e3779b1u) >> 29u == 0u;
    return select(x, bitcast<f32>(bits), is_chosen && fails_as_planted(guard));
}
#else
fn fails_as_planted(guard: u32) -> bool {
    return false;
}

fn as_planted(x: f32, guard: u32) -> f32 {
    return x;
}
#endif
