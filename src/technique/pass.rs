//! Compute passes as data: shader, resources, number of workgroups.

/// A resource of group 2; a pass lists its resources in the order of their bindings, except for the counters, which have the same binding in
/// all passes.  Where each domain has such a resource, a pass binds that of its own domain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PassResource {
    /// Sum of radiance and number of samples of every pixel, read and written.
    Radiance,
    /// Counters of the view, read and written.
    Counters,
    /// Uniforms of an iteration of reuse.
    Settings,
    /// Light subsets, written.
    Subsets,
    /// Light subsets, read.
    SubsetsRead,
    /// Reservoirs of this frame's candidates, written.
    CandidateReservoirs,
    /// Reservoirs that an iteration of reuse takes neighbors from, read.
    NeighborReservoirs,
    /// Reservoirs that an iteration of reuse reads and replaces.
    OutputReservoirs,
    /// Reservoirs of the last frame, read and written.
    LastReservoirs,
    /// Reservoirs of the last frame, read.
    LastReservoirsRead,
    /// Samples of the last frame in the pixels of this one, written; the neighbors of a domain that has them.
    ForwardedReservoirs,
    /// Reservoirs that the frame leaves to the next one, read.
    FinalReservoirs,
    /// Visibility buffer of the last frame.
    PreviousVisibility,
    /// Contributions of this frame's candidates, written.
    CandidateLight,
    /// Contributions of the samples before an iteration of reuse, read.
    LightBefore,
    /// Contributions of the samples after an iteration of reuse, or the light of the last one, written.
    LightAfter,
    /// Direct light that only BSDF sampling finds, written.
    UnresampledLight,
    /// Direct light that only BSDF sampling finds, read.
    UnresampledLightRead,
    /// Resampled direct light, read.
    DirectLight,
    /// Resampled direct light that enters translucent objects, read.
    SubsurfaceLight,
    /// Light of resampled paths, read.
    PathLight,
    /// The light vertex cache, written; one empty texel without connections.
    LightVertices,
    /// The light vertex cache, read; one empty texel without connections.
    LightVerticesRead,
    /// The light map, written.
    LightMap,
    /// The light map, read.
    LightMapRead,
    /// Resampled light of light sub-paths, read.
    SplatLight,
    /// Resampled light of light sub-paths that can be reconnected, read.
    ReconnectedLight,
    /// Masks of the similar partners of pixels, written.
    PairMasks,
    /// Masks of the similar partners of pixels, read.
    PairMasksRead,
    /// Shifts between the pixels of pairs, written.
    PairShifts,
    /// Shifts between the pixels of pairs, read.
    PairShiftsRead,
    /// Queue of the pixels whose shifts replay paths, written.
    ReplayQueue,
    /// Queue of the pixels whose shifts replay paths, read.
    ReplayQueueRead,
    /// Uniforms of an iteration of the denoiser.
    DenoiserSettings,
    /// Light without albedo, after an iteration of the denoiser, written.
    SignalsAfter,
    /// Light without albedo, before an iteration of the denoiser, read.
    SignalsBefore,
    /// The denoiser's guide of this frame, written.
    Guide,
    /// The denoiser's guide of this frame, read.
    GuideRead,
    /// The denoiser's guide of the last frame, read.
    LastGuide,
    /// Optical images of this frame, written.
    OpticalImages,
    /// Optical images of this frame, read; one empty texel where the scene has nothing smooth.
    OpticalImagesRead,
    /// Optical images of the last frame, read; one empty texel where the scene has nothing smooth.
    LastOpticalImages,
    /// Places of the optical images in the last frame, written.
    ImagePlaces,
    /// Places of the optical images in the last frame, read; one empty texel where the scene has nothing smooth.
    ImagePlacesRead,
    /// Means over frames, written.
    Means,
    /// Means over frames as the last frame left them, read.
    LastMeans,
}

/// Number of workgroups of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dispatch {
    /// One invocation for each pixel, in workgroups of 8 x 8.
    Pixels,
    /// One invocation for each entry of the light subsets: workgroups of 64 along x, a subset along y.
    Subsets,
    /// As many as the replay queue of the previous pass asks for.
    ReplayQueue,
}

/// The purpose of the rays that a pass traces, by which `rays_of_pixel` estimates their number.  A pass over pixels that traces rays can run
/// over bands of the picture: its shader adds `view.first_pixel` to its coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rays {
    None,
    /// A path from the camera in each pixel.
    Path,
    /// Initial candidates of a domain.
    Candidates,
    /// Shifts between each pixel and its neighbors, in both directions.
    Shifts,
    /// Shifts from the partners of each pixel to the pixel.
    PairShifts,
    /// Shifts as in `PairShifts`, but only those that replay nothing.
    ShortPairShifts,
    /// Light sub-paths.
    LightPaths,
    /// One shift in each pixel.
    Shift,
    /// Optical images.
    Images,
}

/// A compute pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ComputePass {
    /// Name of its pipelines and its time span.
    pub name: &'static str,
    /// Name of its file in `shaders/pass/` and of its entry point.
    pub file: &'static str,
    /// Rooms of `shaders/` that `#import domain::{...}` stands for, the nearest first; empty where the shader has no such line.
    pub domain_rooms: &'static [&'static str],
    /// Shader definitions besides those of the scene's features.
    pub defs: &'static [&'static str],
    pub resources: &'static [PassResource],
    pub dispatch: Dispatch,
    pub rays: Rays,
}

impl ComputePass {
    /// A pass over pixels whose name is that of its file, and which traces no rays.
    pub(crate) const fn per_pixel(name: &'static str, resources: &'static [PassResource]) -> Self {
        Self { name, file: name, domain_rooms: &[], defs: &[], resources, dispatch: Dispatch::Pixels, rays: Rays::None }
    }
}

/// A pass of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pass {
    /// Rasterizes (instance, triangle).
    Visibility,
    /// Runs a compute shader.
    Compute(&'static ComputePass),
    /// Writes radiance and depth to Bevy's view target.
    Composite,
}
