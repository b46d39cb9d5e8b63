//! The passes of the denoiser (`shaders/pass/denoiser_*.wgsl`, with modules in `shaders/denoiser`).  They replace the pass that sums the light.

use super::{
    domain::iteration_names,
    frame::RESOLVE,
    pass::{ComputePass, PassResource as R, Rays},
};

/// Follows the rays of smooth mirrors and clear glass; in scenes that may have them.
const IMAGES: ComputePass = ComputePass {
    rays: Rays::Images,
    ..ComputePass::per_pixel("denoiser_images", &[R::OpticalImages, R::ImagePlaces])
};
/// Writes the light of all domains, without albedo, and the guide.
const INPUT: ComputePass = ComputePass {
    name: "denoiser_input",
    defs: &["TO_DENOISER"],
    resources: &[
        R::UnresampledLightRead,
        R::DirectLight,
        R::PathLight,
        R::SplatLight,
        R::SubsurfaceLight,
        R::ReconnectedLight,
        R::SignalsAfter,
        R::Guide,
        R::OpticalImagesRead,
    ],
    ..RESOLVE
};
/// Averages over frames.
const TEMPORAL: ComputePass = ComputePass::per_pixel(
    "denoiser_temporal",
    &[
        R::DenoiserSettings,
        R::SignalsBefore,
        R::GuideRead,
        R::LastGuide,
        R::LastMeans,
        R::Means,
        R::SignalsAfter,
        R::OpticalImagesRead,
        R::LastOpticalImages,
        R::ImagePlacesRead,
    ],
);
/// An iteration of the filter over pixels.
const FILTER: ComputePass = ComputePass::per_pixel(
    "denoiser_filter",
    &[R::DenoiserSettings, R::SignalsBefore, R::GuideRead, R::SignalsAfter, R::OpticalImagesRead],
);
/// Multiplies by the albedo, and adds emission.
const OUTPUT: ComputePass =
    ComputePass::per_pixel("denoiser_output", &[R::SignalsBefore, R::Radiance, R::OpticalImagesRead, R::Counters]);

/// Names of the iterations of the filter.
const FILTER_NAMES: [&str; 5] = iteration_names!("denoiser", "_filter");

/// Iterations of the denoiser before those of its filter.
pub(crate) const FIRST_FILTER: usize = 2;

/// The passes in order: name of the step, pass, and iteration of the denoiser.
pub(super) fn steps(
    filter_iterations: u32,
    has_images: bool,
) -> impl Iterator<Item = (&'static str, &'static ComputePass, usize)> {
    let filters = FILTER_NAMES.into_iter().take(filter_iterations as usize).map(|name| (name, &FILTER));
    let before = [(INPUT.name, &INPUT), (TEMPORAL.name, &TEMPORAL)];
    let passes = before.into_iter().chain(filters).chain([(OUTPUT.name, &OUTPUT)]);
    let passes = passes.zip(0..).map(|((name, pass), iteration)| (name, pass, iteration));
    has_images.then_some((IMAGES.name, &IMAGES, 0)).into_iter().chain(passes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_denoiser_binds_light_where_the_pass_that_it_replaces_does() {
        let light = |pass: &ComputePass| pass.resources[..6].to_vec();
        assert_eq!(light(&INPUT), light(&RESOLVE));
    }
}
