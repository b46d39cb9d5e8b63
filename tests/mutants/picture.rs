//! Mutants of what a frame shows and reports: guards, accumulation, exposure, the limit of bright pixels, and parts of the light.

use super::{Mutant, mutant};

const LIGHT_PARTS: &[&str] = &["sum_to_the_light_of_a_frame"];

pub const MUTANTS: &[Mutant] = &[
    // Guards.
    mutant(
        "raised guards are not reported",
        "view/ray_counter.wgsl",
        "let raised = trace_flags | raised_guards;",
        "let raised = trace_flags;",
        &["guards_are_counted", "every_guard_stops"],
    ),
    mutant(
        "raised guards are not counted",
        "view/guard_counter.wgsl",
        "atomicAdd(&counters.guards[bit], 1u);",
        "",
        &["guards_are_counted", "every_guard_stops"],
    ),
    mutant(
        "guards of earlier passes are not counted without rays",
        "view/guard_counter.wgsl",
        "sum_guards(pixel, textureLoad(counts, pixel, LAYER_GUARDS).x | trace_flags | raised_guards);",
        "sum_guards(pixel, trace_flags | raised_guards);",
        &["guards_are_counted_without_rays"],
    ),
    mutant(
        "negative numbers pass the guards",
        "common/guard.wgsl",
        "return is_finite(x) && x >= 0.0;",
        "return is_finite(x);",
        &["guards_pass"],
    ),
    mutant("colors pass the guards", "common/guard.wgsl", "if is_sound_3(w) {", "if true {", &["guards_pass"]),
    // The picture.
    mutant(
        "frames are not added up",
        "pass/resolve.wgsl",
        "before = radiance[index];",
        "",
        &["samples_add_up", "direct_light_accumulates"],
    ),
    mutant(
        "the picture is not exposed",
        "pass/composite.wgsl",
        "max(sum.a, 1.0) * view.exposure",
        "max(sum.a, 1.0)",
        &["tonemapping_and_exposure"],
    ),
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
        "return select(light, vec3<f32>(0.0), shows_part());",
        "return light;",
        LIGHT_PARTS,
    ),
    mutant(
        "light by samples of the BSDF counts as diffuse",
        "view/light_part.wgsl",
        "return bsdf_diffuse_share(b, wo, s.wi);",
        "return vec3<f32>(1.0);",
        LIGHT_PARTS,
    ),
    // Fewer traced pixels.
    mutant(
        "light is interpolated across edges",
        "pass/composite.wgsl",
        "max(sides.x * sides.y, 1.0e-3) * similarity(own, other)",
        "sides.x * sides.y",
        &["a_picture_of_half_the_resolution"],
    ),
    // The denoiser.
    mutant(
        "planes slope to the other side",
        "denoiser/guide.wgsl",
        "let expected = own.depth + unit * dot(own.slope, offset);",
        "let expected = own.depth - unit * dot(own.slope, offset);",
        &["an_orthographic_camera_denoises"],
    ),
    mutant(
        "surfaces of every depth are similar",
        "denoiser/guide.wgsl",
        "return exponential_decay(abs(other_depth - expected) / tolerance);",
        "return 1.0;",
        &["denoised_objects_keep_their_edges"],
    ),
    mutant(
        "textures are filtered with the light",
        "denoiser/albedo.wgsl",
        "return select(vec3<f32>(gray), light / max(albedo, vec3<f32>(LEAST_CHANNEL)), albedo > vec3<f32>(LEAST_ALBEDO_SHARE * greatest));",
        "return light / max(luminance(albedo), LEAST_LUMINANCE);",
        &["textures_stay_sharp"],
    ),
    mutant(
        "means stay in their pixels",
        "pass/denoiser_temporal.wgsl",
        "let at = clamp(project(view.previous, position) - view.jitter - 0.5,",
        "let at = clamp(project(view.current, position) - view.jitter - 0.5,",
        &["means_over_frames_follow_the_camera"],
    ),
    mutant(
        "light that changes does not shorten a mean",
        "pass/denoiser_temporal.wgsl",
        "let frames = max(min(min(last.frames + 1.0, most_frames), frames_for_change(around)), 1.0);",
        "let frames = min(last.frames + 1.0, most_frames);",
        &["light_that_dims_does_not_linger"],
    ),
    mutant(
        "noise that frames have in common is no noise",
        "pass/denoiser_temporal.wgsl",
        "let deviation = max(grain * bounded_luminance(mean.color), abs(outlying(mean, around)));",
        "let deviation = abs(outlying(mean, around));",
        &["noise_that_frames_have_in_common"],
    ),
    mutant(
        "no pixel is an outlier",
        "pass/denoiser_temporal.wgsl",
        "abs(difference) > OUTLIER_DEVIATIONS * sqrt(variance) + OUTLIER_SHARE * usual);",
        "false);",
        &["single_bright_pixels"],
    ),
    mutant(
        "reflections have the history of diffuse light",
        "pass/denoiser_temporal.wgsl",
        "return clamp(0.5 * roughness / max(change, 1.0e-6), 1.0, f32(settings.history));",
        "return f32(settings.history);",
        &["reflections_do_not_trail"],
    ),
    mutant(
        "reflections move with surfaces that turn",
        "pass/denoiser_temporal.wgsl",
        "return reflect(normalize(at.position - eye), at.n);",
        "return normalize(at.position - eye);",
        &["reflections_on_objects_that_turn"],
    ),
    mutant(
        "mirrors are filtered as widely as rough surfaces",
        "pass/denoiser_filter.wgsl",
        "let narrow = of_image * exponential_decay(distance_in_radii * distance_in_radii);",
        "let narrow = of_image;",
        &["reflections_stay_sharp"],
    ),
    mutant(
        "mirrors are not filtered",
        "pass/denoiser_images.wgsl",
        "if !seen.exists {",
        "if true {",
        &["smooth_mirrors_and_glass"],
    ),
    mutant(
        "textures in mirrors are filtered with the light",
        "denoiser/optical_image.wgsl",
        "select(vec3<f32>(1.0), root * root, is_image(p))",
        "select(vec3<f32>(1.0), vec3<f32>(0.5), is_image(p))",
        &["reflections_stay_sharp"],
    ),
    mutant(
        "means of mirrors follow the surfaces that they show",
        "pass/denoiser_images.wgsl",
        "before.linear * last.position + before.offset",
        "last.position",
        &["means_of_mirrors_follow_the_camera"],
    ),
];
