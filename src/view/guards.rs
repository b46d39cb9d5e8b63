//! The guards of the shaders (`shaders/common/guard.wgsl`): names under which reports count them, and what each one means.

use crate::gpu_layout::*;

/// A row of [`GUARDS`].
pub struct Guard {
    /// Name in reports: the WGSL constant without `GUARD_`, in lower case.
    pub name: &'static str,
    /// Its bit in the shaders.
    pub bit: u32,
    /// The error in a pixel that raises it.
    pub meaning: &'static str,
    /// Whether only an error of ours raises it; otherwise a scene beyond our limits may.
    pub is_bug: bool,
}

const fn guard(name: &'static str, bit: u32, meaning: &'static str) -> Guard {
    Guard { name, bit, meaning, is_bug: true }
}

/// A guard that a scene beyond our limits may raise.
const fn limit(name: &'static str, bit: u32, meaning: &'static str) -> Guard {
    Guard { is_bug: false, ..guard(name, bit, meaning) }
}

/// All guards.
pub const GUARDS: &[Guard] = &[
    guard(
        "overflow_stack",
        OVERFLOW_STACK,
        "the stack of a traversal was full, so that the ray may have missed geometry",
    ),
    limit(
        "overflow_steps",
        OVERFLOW_STEPS,
        "a traversal took too many steps, so that the ray may have missed geometry, or too many light paths landed in a pixel",
    ),
    guard("non_finite", NON_FINITE, "the light of the pixel was not finite, and became black"),
    limit(
        "float_overflow",
        GUARD_FLOAT_OVERFLOW,
        "a number was too large for f32: light brighter than about 1e38 is missing",
    ),
    guard("negative_pixel", GUARD_NEGATIVE_PIXEL, "the light of the pixel was negative"),
    guard("ray", GUARD_RAY, "origin, direction or hit of a ray was not finite"),
    guard(
        "surface",
        GUARD_SURFACE,
        "position, normal or emission of a surface was not finite, or its emission negative",
    ),
    guard("light_sample", GUARD_LIGHT_SAMPLE, "radiance or density of a point of a light was NaN or negative"),
    guard(
        "light_contribution",
        GUARD_LIGHT_CONTRIBUTION,
        "light that a surface scatters from a point of a light was NaN or negative",
    ),
    guard("bsdf_sample", GUARD_BSDF_SAMPLE, "weight or density of a sampled direction was NaN or negative"),
    guard("throughput", GUARD_THROUGHPUT, "the throughput of a path was NaN or negative"),
    guard("resampling_weight", GUARD_RESAMPLING_WEIGHT, "the weight of a candidate was NaN or negative"),
    guard("contribution_weight", GUARD_CONTRIBUTION_WEIGHT, "an unbiased contribution weight was NaN or negative"),
    guard("target", GUARD_TARGET, "a target value was NaN or negative"),
    guard("mis_weight", GUARD_MIS_WEIGHT, "a MIS weight was NaN, negative or above 1"),
    guard("shift_contribution", GUARD_SHIFT_CONTRIBUTION, "the contribution of a shifted path was NaN or negative"),
    guard("jacobian", GUARD_JACOBIAN, "the Jacobian of a shift was NaN or negative"),
    guard(
        "gi_measure",
        GUARD_GI_MEASURE,
        "a path of ReSTIR GI was NaN or negative in the measure of the secondary vertex",
    ),
    guard("reservoir", GUARD_RESERVOIR, "a reservoir held a number that was not finite, or negative"),
    limit(
        "overflow_probe",
        OVERFLOW_PROBE,
        "a probe ray of a translucent object met too many triangles, so that its light is missing",
    ),
];
