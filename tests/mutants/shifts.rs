//! Mutants of the shifts of paths: criteria of reconnection, the hybrid shift, and packed reservoirs.  `reconnection_choice` has the
//! conditions of the shift.

use super::{Mutant, mutant};

const CRITERIA: &str = "connection_criteria_equal";
const MEASURE: &[&str] = &["the_jacobian_is_the_change_of_measure", "paths_return_unchanged_from_other_pixels"];

pub const MUTANTS: &[Mutant] = &[
    // Reconnection criteria.
    mutant(
        "4π is missing in the footprint of the pixel",
        "restir/shift/reconnection.wgsl",
        "return 0.01 * separation * FOUR_PI * d2",
        "return 0.01 * separation * d2",
        &[CRITERIA],
    ),
    mutant(
        "the separation is not in percent",
        "restir/shift/reconnection.wgsl",
        "return 0.01 * separation * FOUR_PI * d2",
        "return separation * FOUR_PI * d2",
        &[CRITERIA],
    ),
    mutant(
        "the forward footprint is not tested",
        "restir/shift/reconnection.wgsl",
        "return a.rough && is_apart(a.position, position, n_geo, a.pdf, c.kind, c.separation);",
        "return a.rough;",
        &[CRITERIA],
    ),
    mutant(
        "the roughness before the reconnection is not tested",
        "restir/shift/reconnection.wgsl",
        "return a.rough && is_apart(a.position, position, n_geo, a.pdf, c.kind, c.separation);",
        "return is_apart(a.position, position, n_geo, a.pdf, c.kind, c.separation);",
        &[CRITERIA],
    ),
    mutant(
        "the inverse footprint is not tested",
        "restir/shift/reconnection.wgsl",
        "&& (bsdf_is_diffuse(s.bsdf) || is_apart(s.position, a.position, a.n_geo, pdf_after, c.kind, c.separation));",
        ";",
        &[CRITERIA],
    ),
    mutant(
        "the bound of the Jacobian lacks its factor",
        "restir/shift/reconnection.wgsl",
        "select(1.0, TWO_PI, kind == RECONNECT_JACOBIAN_BOUND)",
        "1.0",
        &[CRITERIA],
    ),
    mutant(
        "the footprint of a path is that of its last ray",
        "restir/shift/reconnection.wgsl",
        "return a.spread + inverseSqrt(",
        "return inverseSqrt(",
        &[CRITERIA],
    ),
    mutant(
        "black boxes are compared by 1/p",
        "restir/shift/reconnection.wgsl",
        "step.pdf * step.pdf * c.roughness <= 1.0",
        "step.pdf * c.roughness <= 1.0",
        &[CRITERIA],
    ),
    mutant(
        "the footprint of the pixel lacks the cosine",
        "restir/shift/reconnection.wgsl",
        " / max(cosine, 1.0e-6) * factor;",
        " * factor;",
        &[CRITERIA],
    ),
    mutant(
        "the lobe after a reconnection by distance may be narrow",
        "restir/shift/reconnection.wgsl",
        "if c.kind == RECONNECT_DISTANCE && !rough_after {",
        "if false {",
        &[CRITERIA],
    ),
    mutant(
        "black boxes are compared by the roughness and not its square",
        "restir/shift/reconnection.wgsl",
        "step.pdf * c.roughness * c.roughness <= 1.0",
        "step.pdf * c.roughness <= 1.0",
        &[CRITERIA],
    ),
    mutant(
        "indirect light reconnects at any vertex",
        "restir/shift/reconnection.wgsl",
        "(index == 1u || c.kind != RECONNECT_FIRST)",
        "true",
        &[CRITERIA],
    ),
    mutant(
        "diffuse surfaces are tested like others",
        "restir/shift/reconnection.wgsl",
        "(bsdf_is_diffuse(s.bsdf) || is_apart(",
        "(is_apart(",
        &[CRITERIA],
    ),
    // The hybrid shift.
    mutant(
        "the Jacobian lacks the densities of the BSDF",
        "restir/shift/hybrid.wgsl",
        "(*w).density *= step.pdf_lobe;",
        "",
        MEASURE,
    ),
    mutant(
        "the Jacobian lacks the geometry",
        "restir/shift/hybrid.wgsl",
        "(*w).density *= triangle_factor(at.position, n.position, s.instance, s.triangle, previous);",
        "",
        MEASURE,
    ),
    mutant(
        "the geometry factor lacks the cosine",
        "restir/shift/reconnection.wgsl",
        "return abs(dot(n_geo, d)) * inverseSqrt(max(d2, LEAST_DIVISOR)) / max(d2, LEAST_DIVISOR);",
        "return 1.0 / max(d2, LEAST_DIVISOR);",
        &["packing_and_jacobian", "the_jacobian_is_the_change_of_measure"],
    ),
    mutant(
        "the limit of the Jacobian holds in one direction",
        "restir/shift/hybrid.wgsl",
        "max(jacobian, 1.0 / jacobian) > c.jacobian_limit",
        "jacobian > c.jacobian_limit",
        MEASURE,
    ),
    // Packing.
    mutant(
        "the lobe after the reconnection is read from another field",
        "restir/stored_path.wgsl",
        "s.lobe_after = (p.structure >> 20u) & 7u;",
        "s.lobe_after = (p.structure >> 17u) & 7u;",
        &["packing_and_jacobian", "paths_return_unchanged_from_other_pixels"],
    ),
    mutant(
        "confidence loses its high bits",
        "restir/stored_path.wgsl",
        "let confidence = (p.vertex.z >> 24u) | ((p.vertex.y >> 28u) << 8u);",
        "let confidence = p.vertex.z >> 24u;",
        &["packing_and_jacobian"],
    ),
    mutant(
        "the low bits of a channel of radiance are lost",
        "restir/stored_path.wgsl",
        "(m.y >> 14u) | (m.z << 4u)",
        "(m.y >> 13u) | (m.z << 4u)",
        &["packed_radiance_has_18_bits"],
    ),
    mutant(
        "reservoirs of direct light take the visibility for a sign",
        "restir/di/reservoir.wgsl",
        "bitcast<f32>(words.w & ~UNSEEN)",
        "bitcast<f32>(words.w)",
        &["packed_reservoirs_keep"],
    ),
    mutant(
        "reservoirs of indirect light read the light for the density",
        "restir/gi/reservoir.wgsl",
        "r.path.density = bitcast<f32>(w[8]);",
        "r.path.density = bitcast<f32>(w[9]);",
        &["gi_reservoirs_keep"],
    ),
    mutant(
        "reservoirs of paths read the target value for the density",
        "restir/pt/reservoir.wgsl",
        "r.path.density = bitcast<f32>(p.light.z);",
        "r.path.density = bitcast<f32>(p.light.w);",
        &["path_reservoirs_keep"],
    ),
    mutant(
        "reservoirs of bidirectional paths read the target value for the density",
        "restir/bdpt/reservoir.wgsl",
        "r.path.density = bitcast<f32>(p.light.z);",
        "r.path.density = bitcast<f32>(p.light.w);",
        &["light_paths_in_a_room_equal"],
    ),
    mutant(
        "reservoirs of translucent bodies read the channel from another field",
        "restir/sss/reservoir.wgsl",
        "min((p.structure >> 2u) & 3u, 2u)",
        "min((p.structure >> 4u) & 3u, 2u)",
        &["light_in_bodies_returns_unchanged"],
    ),
];
