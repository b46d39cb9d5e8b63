//! The mutants: one line for each formula family, criterion, MIS kind, read of the last frame, and packing.

use super::Mutant;

const DI_ROOM: &str = "direct_light_in_a_room_with_shadows";
const PT_ROOM: &str = "paths_in_a_room_equal";
const MOVING_PATHS: &str = "paths_in_a_moving_frame";
const CRITERIA: &str = "connection_criteria_equal";
const LIGHT_PARTS: &[&str] = &["sum_to_the_light_of_a_frame"];

const fn mutant(
    name: &'static str,
    file: &'static str,
    old: &'static str,
    new: &'static str,
    tests: &'static [&'static str],
) -> Mutant {
    Mutant { name, file, old, new, tests }
}

pub const MUTANTS: &[Mutant] = &[
    // Resampling MIS.
    mutant(
        "balance heuristic without confidence",
        "restir/mis.wgsl",
        "let share = (*inputs).confidence[i] * select",
        "let share = select",
        &["resampling::", DI_ROOM],
    ),
    mutant(
        "1/Z counts domains that cannot draw the sample",
        "restir/mis.wgsl",
        "select(f32(target_of(inputs, i, sample) > 0.0), p, by_target)",
        "select(1.0, p, by_target)",
        &["resampling::", DI_ROOM],
    ),
    mutant(
        "pairwise weights with the canonical confidence on both sides",
        "restir/mis.wgsl",
        "var neighbor_scale = neighbor_confidence;",
        "var neighbor_scale = canonical_confidence;",
        &["resampling::", DI_ROOM],
    ),
    mutant(
        "the share of a pair is too large",
        "restir/mis.wgsl",
        "weight = 1.0 / f32(k + 1u);",
        "weight = 1.0 / f32(k);",
        &["resampling::", DI_ROOM],
    ),
    mutant(
        "no defensive share",
        "restir/mis.wgsl",
        "sum += select(0.0, canonical_confidence / total, kind == MIS_DEFENSIVE_PAIRWISE);",
        "",
        &["resampling::", DI_ROOM],
    ),
    // The resampling routine.
    mutant(
        "the last input is preferred",
        "restir/reservoir_sampling.wgsl",
        "if u * (*stream).sum < w {",
        "if u * u * (*stream).sum < w {",
        &["resampling::", DI_ROOM],
    ),
    mutant(
        "the contribution weight lacks the Jacobian",
        "pass/reuse.wgsl",
        "guarded((*inputs).ucw[j] * jacobian, GUARD_CONTRIBUTION_WEIGHT)",
        "guarded((*inputs).ucw[j], GUARD_CONTRIBUTION_WEIGHT)",
        &["planted_errors_of_paths", PT_ROOM],
    ),
    mutant(
        "a neighbor's target lacks the Jacobian",
        "pass/reuse.wgsl",
        "known_target(inputs, j, s) / jacobian",
        "known_target(inputs, j, s)",
        &["planted_errors_of_paths", PT_ROOM],
    ),
    mutant(
        "the canonical sample's target in a neighbor's domain lacks the Jacobian",
        "pass/reuse.wgsl",
        "value *= jacobian_of(e);",
        "",
        &["planted_errors_of_paths", PT_ROOM],
    ),
    mutant("MIS ignores visibility", "pass/reuse.wgsl", "value = select(0.0, value, visible);", "", &[DI_ROOM]),
    mutant(
        "visible samples are shaded as hidden ones",
        "pass/reuse.wgsl",
        "light += select(0.0, inputs.shares[j], inputs.visible[j]) * shown_contribution(&inputs, j, r);",
        "light += inputs.shares[j] * inputs.contributions[j];",
        &["di::settings", DI_ROOM],
    ),
    mutant(
        "the history has no cap",
        "pass/reuse.wgsl",
        "s.confidence = min(s.confidence, settings.confidence_cap);",
        "",
        &["confidence", "di::settings"],
    ),
    mutant(
        "the confidence of the last input alone",
        "pass/reuse.wgsl",
        "output.confidence += mis.confidence[j];",
        "output.confidence = mis.confidence[j];",
        &["debug_views_show_the_stored_paths", "confidence"],
    ),
    // The last frame.
    mutant(
        "lights keep the ids of the last frame",
        "restir/di/domain.wgsl",
        "r.point.light = current_light_id(s.point.light);",
        "",
        &["lights_that_move_change_come_and_go"],
    ),
    mutant(
        "a light is evaluated where it is now, for the last frame's surface",
        "restir/di/domain.wgsl",
        "light_point_at(s.point, r.surface.position, r.previous)",
        "light_point_at(s.point, r.surface.position, false)",
        &["lights_that_move_change_come_and_go", "previous"],
    ),
    mutant(
        "shadow rays of the last frame meet the scene of this one",
        "restir/di/domain.wgsl",
        "return light_is_visible(r.surface, e.light, alpha_seed, r.previous);",
        "return light_is_visible(r.surface, e.light, alpha_seed, false);",
        &["a_moving_occluder", "previous"],
    ),
    mutant(
        "a reconnected path is traced in this frame's scene only",
        "restir/pt/domain.wgsl",
        "return is_unoccluded(e.shifted, r.previous);",
        "return is_unoccluded(e.shifted, false);",
        &[MOVING_PATHS, "previous"],
    ),
    mutant(
        "motion is not projected to the last frame",
        "restir/neighbors.wgsl",
        "world_triangle(ids.x, ids.y, false), primary_ray(pixel)",
        "world_triangle(ids.x, ids.y, true), primary_ray(pixel)",
        &["previous", "motion_vectors", MOVING_PATHS],
    ),
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
        "return a.rough && is_apart(a.position, position, n_geo, a.pdf, c);",
        "return a.rough;",
        &[CRITERIA],
    ),
    mutant(
        "the roughness before the reconnection is not tested",
        "restir/shift/reconnection.wgsl",
        "return a.rough && is_apart(a.position, position, n_geo, a.pdf, c);",
        "return is_apart(a.position, position, n_geo, a.pdf, c);",
        &[CRITERIA],
    ),
    mutant(
        "the inverse footprint is not tested",
        "restir/shift/reconnection.wgsl",
        "&& (bsdf_is_diffuse(s.bsdf) || is_apart(s.position, a.position, a.n_geo, pdf_after, c));",
        ";",
        &[CRITERIA],
    ),
    // The hybrid shift.
    mutant(
        "earlier reconnections are not looked for",
        "restir/shift/hybrid.wgsl",
        "if is_before && connectable {",
        "if false {",
        &["shift_inverse"],
    ),
    mutant(
        "impossible reconnections are accepted",
        "restir/shift/hybrid.wgsl",
        "if !is_before && !connectable {",
        "if false {",
        &["shift_inverse"],
    ),
    mutant(
        "the Jacobian lacks the densities of the BSDF",
        "restir/shift/hybrid.wgsl",
        "(*w).density *= step.pdf_lobe;",
        "",
        &["shift_measure", "shift_inverse"],
    ),
    mutant(
        "the Jacobian lacks the geometry",
        "restir/shift/hybrid.wgsl",
        "(*w).density *= triangle_factor(at.position, n.position, s.instance, s.triangle, previous);",
        "",
        &["shift_measure", "shift_inverse"],
    ),
    mutant(
        "the geometry factor lacks the cosine",
        "restir/shift/reconnection.wgsl",
        "return abs(dot(n_geo, d)) * inverseSqrt(max(d2, 1.0e-37)) / max(d2, 1.0e-37);",
        "return 1.0 / max(d2, 1.0e-37);",
        &["shift_measure", "packing_and_jacobian"],
    ),
    // Candidates, next-event estimation, Russian roulette.
    mutant(
        "roulette is not compensated",
        "restir/pt/initial_candidates.wgsl",
        "c.survival *= q;",
        "",
        &["roulette", "a_closed_furnace", PT_ROOM],
    ),
    mutant(
        "roulette of the reference is not compensated",
        "path/reference_integrator.wgsl",
        "throughput /= q;",
        "",
        &["roulette", "a_closed_furnace_gives_emission", PT_ROOM],
    ),
    mutant(
        "light candidates are not counted",
        "restir/di/initial_candidates.wgsl",
        "both_densities(count * candidate.pmf, bsdf)",
        "both_densities(candidate.pmf, bsdf)",
        &[DI_ROOM],
    ),
    mutant(
        "next-event estimation ignores BSDF sampling",
        "path/technique_weights.wgsl",
        "let hit = select(pdf / nee, 0.0, l.delta != 0u);",
        "let hit = 0.0;",
        &[PT_ROOM],
    ),
    mutant(
        "the expected number of candidates is one",
        "path/nee.wgsl",
        "return f32(nee_candidate_count(first_count, index)) * light_pmf(light);",
        "return light_pmf(light);",
        &[PT_ROOM, "paths"],
    ),
    // Lights.
    mutant(
        "points of a triangle gather at a corner",
        "light/triangle.wgsl",
        "let r = sqrt(u.x);",
        "let r = u.x;",
        &["sampling::lights", "uniform"],
    ),
    mutant(
        "the density of a sphere is that of a flat disk",
        "light/sphere.wgsl",
        "return vec2<f32>(sine2 / (1.0 + sqrt(1.0 - sine2)), sine2);",
        "return vec2<f32>(0.5 * sine2, sine2);",
        &["analytic_area_lights"],
    ),
    mutant(
        "lights of the table have their probability without the environment",
        "light/select.wgsl",
        "return lights[light].pmf * (1.0 - environment_pmf());",
        "return lights[light].pmf;",
        &["light_choice", "sampling::environment"],
    ),
    mutant("the rim of a spot is linear", "light/point.wgsl", "return ramp * ramp;", "return ramp;", &["closed_forms"]),
    mutant(
        "texels of an environment have one solid angle",
        "light/environment.wgsl",
        "return importance(cell, 0u) / total / cell_solid_angle(cell.y, size);",
        "return importance(cell, 0u) / total / cell_solid_angle(0u, size);",
        &["sampling::environment"],
    ),
    // BSDF.
    mutant(
        "GGX lacks a factor",
        "bsdf/ggx.wgsl",
        "return 2.0 / (abs(wi.z) * ggx_stretch(wo, alpha) + abs(wo.z) * ggx_stretch(wi, alpha));",
        "return 2.0 / (abs(wi.z) * ggx_stretch(wo, alpha) + abs(wo.z) * ggx_stretch(wo, alpha));",
        &["sampling::bsdf"],
    ),
    mutant(
        "visible normals are sampled as for a smooth surface",
        "bsdf/ggx.wgsl",
        "return normalize(vec3<f32>(alpha * h.xy, h.z));",
        "return normalize(vec3<f32>(h.xy, h.z));",
        &["sampling::bsdf"],
    ),
    mutant(
        "Schlick's Fresnel has the fourth power",
        "bsdf/fresnel.wgsl",
        "return f0 + (f90 - f0) * (m2 * m2 * m);",
        "return f0 + (f90 - f0) * (m2 * m2);",
        &["sampling::bsdf"],
    ),
    mutant(
        "light that leaves a leaf behind keeps its side",
        "bsdf/diffuse.wgsl",
        "return select(1.0, -1.0, u < diffuse_probability(b, -1.0));",
        "return 1.0;",
        &["sampling::bsdf"],
    ),
    // Packing, rays, rounding, random numbers.
    mutant(
        "the lobe after the reconnection is read from another field",
        "restir/stored_path.wgsl",
        "s.lobe_after = p.structure >> 20u & 7u;",
        "s.lobe_after = p.structure >> 17u & 7u;",
        &["packing_and_jacobian", "shift_inverse"],
    ),
    mutant(
        "confidence loses its high bits",
        "restir/stored_path.wgsl",
        "let confidence = (p.vertex.z >> 24u) | (p.vertex.y >> 28u) << 8u;",
        "let confidence = p.vertex.z >> 24u;",
        &["packing_and_jacobian"],
    ),
    mutant(
        "rays start on the surface",
        "scene/offset.wgsl",
        "return ROUNDING * dot(abs(n), in_world) / max(length(n), 0x1p-120);",
        "return 0.0;",
        &["tracing::offset"],
    ),
    mutant(
        "triangles are flipped in the intersection",
        "trace/triangle.wgsl",
        "let edges = select(area, -area, flip);",
        "let edges = area;",
        &["tracing::traversal"],
    ),
    mutant(
        "absorption is linear",
        "path/medium.wgsl",
        "return exp(-min(medium * distance, vec3<f32>(200.0)));",
        "return max(1.0 - medium * distance, vec3<f32>(0.0));",
        &["material_lobes"],
    ),
    mutant(
        "frames share their random numbers",
        "common/rng.wgsl",
        "return Rng(pixel.y << 16u | pixel.x, frame, stream + seed * 0x9e3779b9u, 0u);",
        "return Rng(pixel.y << 16u | pixel.x, 0u, stream + seed * 0x9e3779b9u, 0u);",
        &["sampling::rng", "closed_forms"],
    ),
    // The limit of bright pixels, and neighbors of new surfaces.
    mutant(
        "a limit from fewer pixels than three",
        "pass/resolve.wgsl",
        "if neighbors < FEWEST_NEIGHBORS {",
        "if neighbors < 1u {",
        &["light_is_limited"],
    ),
    mutant(
        "a limit from pixels of other objects",
        "pass/resolve.wgsl",
        "textureLoad(visibility, neighbor, 0).x == instance",
        "instance == instance",
        &["light_is_limited"],
    ),
    mutant(
        "no more neighbors for new surfaces",
        "pass/reuse.wgsl",
        "canonical.confidence <= 1.0",
        "canonical.confidence < 0.0",
        &["disocclusions_use_more_neighbors"],
    ),
    // Bodies that bend.
    mutant(
        "a body of this frame in the last one",
        "scene/triangle.wgsl",
        "let is_second = previous && (instances",
        "let is_second = false && (instances",
        &["the_last_frame_reads"],
    ),
    mutant(
        "boxes of a body without the last frame",
        "deformation/refit.wgsl",
        "let both = joined(box_of(triangles[triangle]), box_of(triangles[triangle + body.triangle_count]));",
        "let both = box_of(triangles[triangle]);",
        &["the_last_frame_reads"],
    ),
    mutant(
        "normals of a body turned as vectors",
        "deformation/pose.wgsl",
        "v.normal = transform_normal(m, v.normal, mirrors);",
        "v.normal = transform_vector(m, v.normal);",
        &["a_skinned_body_equals_the_oracle"],
    ),
    // Diffuse and specular light apart.
    mutant(
        "all lobes that NEE samples are diffuse",
        "restir/pt/domain.wgsl",
        "if path.termination == TERMINATION_NEE && path.length == 2u {",
        "if path.termination == TERMINATION_NEE && path.length == 2u { return vec3<f32>(1.0);",
        LIGHT_PARTS,
    ),
    mutant(
        "the lobe at the reconnection vertex in place of the first",
        "restir/pt/domain.wgsl",
        "var lobe = path.lobe_before;",
        "var lobe = path.lobe_after;",
        LIGHT_PARTS,
    ),
    mutant(
        "light of a surface counts as diffuse",
        "view/light_part.wgsl",
        "fn shown_emission(light: vec3<f32>) -> vec3<f32> {\n    return vec3<f32>(0.0);",
        "fn shown_emission(light: vec3<f32>) -> vec3<f32> {\n    return light;",
        LIGHT_PARTS,
    ),
    mutant(
        "light by samples of the BSDF counts as diffuse",
        "view/light_part.wgsl",
        "return shown_by_lobes(b, wo, s.wi);",
        "return shown_share(vec3<f32>(1.0));",
        LIGHT_PARTS,
    ),
];
