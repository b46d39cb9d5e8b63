//! Mutants of surfaces and rays: lobes, textures, traversal, media, random numbers, and bodies that bend.

use super::{Mutant, mutant};

const BSDF: &[&str] = &["eval_and_pdf_equal_the_oracle"];

pub const MUTANTS: &[Mutant] = &[
    // Lobes.
    mutant(
        "GGX lacks a factor",
        "bsdf/ggx.wgsl",
        "return 2.0 / (abs(wi.z) * ggx_stretch(wo, alpha) + abs(wo.z) * ggx_stretch(wi, alpha));",
        "return 2.0 / (abs(wi.z) * ggx_stretch(wo, alpha) + abs(wo.z) * ggx_stretch(wo, alpha));",
        BSDF,
    ),
    mutant(
        "visible normals are sampled as for a smooth surface",
        "bsdf/ggx.wgsl",
        "return normalize(vec3<f32>(alpha * h.xy, h.z));",
        "return normalize(vec3<f32>(h.xy, h.z));",
        &["samples_follow_the_density"],
    ),
    mutant(
        "Schlick's Fresnel has the fourth power",
        "bsdf/fresnel.wgsl",
        "return f0 + (f90 - f0) * (m2 * m2 * m);",
        "return f0 + (f90 - f0) * (m2 * m2);",
        BSDF,
    ),
    mutant(
        "normals that face away from the viewer stay as they are",
        "bsdf/roughness.wgsl",
        "c < COS_VIEWER_MIN && !(b.transmission > 0.0)",
        "false",
        &["normals_that_face_away", "eval_and_pdf_equal_the_oracle"],
    ),
    mutant(
        "diffuse transmission is never sampled",
        "bsdf/diffuse.wgsl",
        "return select(1.0, -1.0, u < diffuse_probability(b, -1.0));",
        "return 1.0;",
        &["samples_follow_the_density"],
    ),
    mutant(
        "the density of refraction lacks an index of refraction",
        "bsdf/transmission.wgsl",
        "(b.eta * b.eta * transmission_cosine_i(b, wi, h) / v2)",
        "(b.eta * transmission_cosine_i(b, wi, h) / v2)",
        BSDF,
    ),
    mutant(
        "rough glass does not scale radiance",
        "bsdf/transmission.wgsl",
        "(d_g2 * wo_h * wi_h / v2)",
        "(d_g2 * wo_h * wi_h * b.eta * b.eta / v2)",
        BSDF,
    ),
    mutant(
        "smooth glass does not scale radiance",
        "bsdf/bsdf.wgsl",
        "(specular * (1.0 - reflect_probability) * b.eta * b.eta)",
        "(specular * (1.0 - reflect_probability))",
        &["delta_lobes_have_the_weights", "a_lamp_in_glass"],
    ),
    mutant(
        "every coat has its full strength",
        "bsdf/coat.wgsl",
        "return b.coat * schlick(vec3<f32>(COAT_F0), abs(dot(wo, b.coat_normal))).x;",
        "return schlick(vec3<f32>(COAT_F0), abs(dot(wo, b.coat_normal))).x;",
        BSDF,
    ),
    mutant(
        "energy compensation ignores the color",
        "bsdf/reflection.wgsl",
        "return 1.0 + f0 * b.compensation;",
        "return vec3<f32>(1.0 + b.compensation);",
        &["compensated_values_equal"],
    ),
    mutant(
        "lobes are chosen by the albedo of the others",
        "bsdf/lobe_choice.wgsl",
        "let p = albedo.y / max(albedo.y + albedo.x, 1.0e-37);",
        "let p = albedo.x / max(albedo.y + albedo.x, 1.0e-37);",
        BSDF,
    ),
    // Textures, levels of detail, alpha.
    mutant(
        "mirrored textures repeat their edge one texel too far",
        "scene/texture.wgsl",
        "return select(m, 2 * size - 1 - m, m >= size);",
        "return select(m, 2 * size - m, m >= size);",
        &["textures_are_sampled_as_the_oracle"],
    ),
    mutant(
        "negative texture coordinates repeat one texel too far",
        "common/math.wgsl",
        "return select(remainder, n - 1 - remainder, backward);",
        "return select(remainder, n - remainder, backward);",
        &["textures_are_sampled_as_the_oracle"],
    ),
    mutant(
        "triangles of a node are forgotten where those of another one wait",
        "trace/software.wgsl",
        "        push(groups.primitives);\n    }\n    return Groups(hits.children, hits.primitives);",
        "    }\n    return Groups(hits.children, hits.primitives);",
        &["tracing::traversal"],
    ),
    mutant(
        "the footprint of a pixel does not grow",
        "scene/cone.wgsl",
        "return Cone(cone.width + cone.spread * distance, cone.spread);",
        "return Cone(cone.width, cone.spread);",
        &["a_mirror_shows_the_levels", "a_checkered_floor"],
    ),
    mutant(
        "blended surfaces stop rays by the square of their alpha",
        "trace/alpha.wgsl",
        ".x < alpha;",
        ".x < alpha * alpha;",
        &["alpha_lets_rays_through"],
    ),
    // Rays, media, random numbers.
    mutant(
        "rays start on the surface",
        "scene/offset.wgsl",
        "return ROUNDING * dot(abs(normal), in_world);",
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
        "instances in a tree over resting instances are hit after their removal",
        "trace/software.wgsl",
        "return (!is_in_world || is_traced(t.instance)) && accepts_hit(t.instance, t.triangle, barycentrics, alpha_seed);",
        "return accepts_hit(t.instance, t.triangle, barycentrics, alpha_seed);",
        &["tracing::traversal"],
    ),
    mutant(
        "triangles in a tree over resting instances are numbered by their place in that tree",
        "trace/software.wgsl",
        "bitcast<vec3<f32>>(c.xyz), a.w, b.w);",
        "bitcast<vec3<f32>>(c.xyz), a.w, index);",
        &["tracing::traversal"],
    ),
    mutant(
        "the top level is traversed with the ray of the last instance",
        "trace/software.wgsl",
        "            instance_depth = 0u;\n            tree = tree_ray(ray.origin, ray.direction);",
        "            instance_depth = 0u;",
        &["tracing::traversal"],
    ),
    mutant(
        "children of a node are taken for those of another octant",
        "trace/tree.wgsl",
        "let slot = (bit - 24u) ^ (octant & 7u);",
        "let slot = bit - 24u;",
        &["tracing::traversal"],
    ),
    mutant(
        "absorption is linear",
        "path/medium.wgsl",
        "return exp(-min(medium * select(distance, 0.0, distance >= FAR), vec3<f32>(200.0)));",
        "return max(1.0 - medium * distance, vec3<f32>(0.0));",
        &["material_lobes"],
    ),
    mutant(
        "frames share their random numbers",
        "common/rng.wgsl",
        "return Rng(key, frame, seeded(stream, seed), 0u);",
        "return Rng(key, 0u, seeded(stream, seed), 0u);",
        &["sampling::rng"],
    ),
    // Bodies that bend.
    mutant(
        "boxes of a body without the last frame",
        "deformation/refit.wgsl",
        "let both = joined(box_of(triangles[triangle]), box_of(triangles[triangle + body.triangle_count]));",
        "let both = box_of(triangles[triangle]);",
        &["reads_of_the_last_frame_equal"],
    ),
    mutant(
        "normals of a body turned as vectors",
        "deformation/pose.wgsl",
        "v.normal = transform_normal(m, v.normal, mirrors);",
        "v.normal = transform_vector(m, v.normal);",
        &["a_skinned_body_equals_the_oracle"],
    ),
];
