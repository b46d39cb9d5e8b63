//! Mutants of lights, materials, rays, packing, bodies that bend, and parts of the light.

use super::{Mutant, mutant};

const LIGHT_PARTS: &[&str] = &["sum_to_the_light_of_a_frame"];

pub const MUTANTS: &[Mutant] = &[
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
