//! Mutants of lights: sampling, densities, presampled points, and rays that lights emit.

use super::{Mutant, mutant};

const EMISSION: &[&str] = &["sampling::emission"];

pub const MUTANTS: &[Mutant] = &[
    // Lights.
    mutant(
        "points of a triangle gather at a corner",
        "light/triangle.wgsl",
        "let r = sqrt(u.x);",
        "let r = u.x;",
        &["triangle_samples"],
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
    mutant(
        "the place within a bin does not count",
        "light/select.wgsl",
        "inside * 0x1p-24",
        "0.0 * inside",
        &["a_dim_light_is_chosen"],
    ),
    mutant(
        "the rim of a spot is linear",
        "light/point.wgsl",
        "return ramp * ramp;",
        "return ramp;",
        &["points_spots_and_suns", "a_spot_has_bevys_cone"],
    ),
    mutant(
        "rounded directions of the environment keep the density of the original ones",
        "light/point_on_light.wgsl",
        "select(1.0, e.pdf_solid_angle / density, density > 0.0)",
        "1.0",
        &["packed_samples_of_a_tiny_sun"],
    ),
    mutant(
        "texels of an environment have one solid angle",
        "light/environment.wgsl",
        "return importance(cell, 0u) / total / cell_solid_angle(cell.y, size);",
        "return importance(cell, 0u) / total / cell_solid_angle(0u, size);",
        &["sampling::environment"],
    ),
    mutant(
        "the density of a rectangle has a quarter of its area",
        "light/rect.wgsl",
        "abs(dot(r.normal, d)) * 4.0 * r.half_size.x",
        "abs(dot(r.normal, d)) * r.half_size.x",
        &["analytic_area_lights"],
    ),
    mutant(
        "the density of a sun is that of the hemisphere",
        "light/sun.wgsl",
        "s.pdf_solid_angle = 1.0 / (TWO_PI * rim_one_minus_cosine(light));",
        "s.pdf_solid_angle = 1.0 / TWO_PI;",
        &["analytic_area_lights"],
    ),
    mutant(
        "a directional light shines backwards",
        "light/directional.wgsl",
        "s.wi = -lights[light].direction;",
        "s.wi = lights[light].direction;",
        &["points_spots_and_suns", "a_directional_light_gives"],
    ),
    mutant(
        "cube maps are not mirrored",
        "light/cube.wgsl",
        "cube_point(d * vec3<f32>(1.0, 1.0, -1.0))",
        "cube_point(d)",
        &["a_cube_is_bilinear", "a_mirror_shows_the_skybox_unmirrored"],
    ),
    mutant(
        "presampled points forget the probability of their light",
        "light/presampled.wgsl",
        "PRESAMPLED_TABLE, choice.pmf, 1.0)",
        "PRESAMPLED_TABLE, 1.0, 1.0)",
        &["direct_light_in_a_room_with_shadows"],
    ),
    // Rays that lights emit.
    mutant(
        "rays of lights forget the probability of their light",
        "light/emission.wgsl",
        "ray.power = guarded_3(ray.power / pmf, GUARD_LIGHT_SAMPLE);",
        "ray.power = guarded_3(ray.power, GUARD_LIGHT_SAMPLE);",
        EMISSION,
    ),
    mutant(
        "rays of area lights lack π",
        "light/emitted_ray.wgsl",
        "radiance * PI / pdf_point",
        "radiance / pdf_point",
        EMISSION,
    ),
    mutant(
        "surfaces know the density of rays of area lights without its cosine",
        "light/emitted_ray.wgsl",
        "return abs(dot(l.normal, l.wi)) * INV_PI / (l.distance * l.distance);",
        "return INV_PI / (l.distance * l.distance);",
        EMISSION,
    ),
    mutant(
        "rays of lights start outside of their housing in large scenes",
        "light/emission.wgsl",
        "return min(DISTANCE_TOLERANCE * scene_radius, EXTENT_TOLERANCE * extent);",
        "return DISTANCE_TOLERANCE * scene_radius;",
        EMISSION,
    ),
    mutant(
        "shadow rays end on the surface of the lamp",
        "scene/offset.wgsl",
        "const END_ROUNDING: f32 = 0x1p-20;",
        "const END_ROUNDING: f32 = 0.0;",
        &["light_of_a_small_lamp"],
    ),
    mutant(
        "rays from infinity know the disk by its radius",
        "light/emitted_ray.wgsl",
        "let area = PI * scene.radius * scene.radius;",
        "let area = PI * scene.radius;",
        EMISSION,
    ),
];
