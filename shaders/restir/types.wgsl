// Settings of resampling, one set for each iteration of reuse.  A test holds them equal to `GpuResampleSettings` in `src/gpu_layout.rs`.
#define_import_path bevy_restir::restir::types

struct ResampleSettings {
    candidates: u32,           // light candidates: of a pixel (di), of each hit of a probe (sss), of the first vertex of a path
    subset_count: u32,         // presampled light subsets; 0: every pixel draws from the whole table of lights
    subset_size: u32,
    light_tile_size: u32,      // pixels a side that share a subset
    temporal_samples: u32,     // 0 or 1: the pixel that showed the surface in the last frame
    spatial_samples: u32,      // neighbors around that pixel
    disocclusion_samples: u32, // neighbors where the surface was not visible in the last frame
    neighbor_attempts: u32,    // positions that are tried for each neighbor
    temporal_attempts: u32,    // positions that are tried for the temporal neighbor
    radius: f32,               // of the disk that neighbors are in, pixels
    confidence_cap: f32,       // greatest confidence of a sample of the last frame, in frames' worth of candidates
    decorrelation: f32,        // share of the confidence that a sample loses if all pixels around it hold it, too
    mis: u32,                  // MIS_*
    flags: u32,                // RESAMPLE_*
    normal_threshold: f32,     // least cosine between the normals of similar surfaces
    depth_threshold: f32,      // greatest distance of a similar surface from the tangent plane, over the distance to the camera
    visibility_radius: f32,    // within which visibility is reused, pixels
    reservoir_layout: u32,     // LAYOUT_*, or pixels a side of a tile
    iteration: u32,            // of reuse, from 0
    reconnection: u32,         // RECONNECT_*
    roughness: f32,            // least perceptual roughness of a lobe before a reconnection
    separation: f32,           // the constant c of footprints (Lin et al. 2026, supplement, Eq. 5), or the least distance, m
    jacobian_limit: f32,       // greatest Jacobian of a shift, and reciprocal of the least
    light_paths: u32,          // light sub-paths of a frame
    splats: u32,               // `light_paths`, or 0: the camera does not see their vertices
    nee_share: f32,            // `LightShares`
    caustic_share: f32,
    subsurface_shift: u32,     // SUBSURFACE_*
    pair_layers: u32,          // shifts that a pixel keeps in paired reuse
    pair_tile_bits: u32,       // tiles of paired reuse have 2^pair_tile_bits pixels a side
    domain: u32,               // index among the domains of the technique, from 0
}

// BSDF sampling adds a candidate to those of the lights.
const RESAMPLE_BSDF_CANDIDATE: u32 = 1u;
// An occluded candidate is dropped.
const RESAMPLE_CANDIDATE_RAYS: u32 = 2u;
// A neighbor's sample that is occluded here is dropped.
const RESAMPLE_TARGET_RAYS: u32 = 4u;
// The confidence of a neighbor whose sample is dropped is dropped, too.
const RESAMPLE_DISCARD_OCCLUDED: u32 = 8u;
// Targets of MIS weights include visibility.
const RESAMPLE_MIS_RAYS: u32 = 16u;
// Samples are shaded after a test of their visibility, if their target did not include it.
const RESAMPLE_SHADING_RAYS: u32 = 32u;
// The visibility of samples is reused: of the same surface in the last frame, and of near neighbors.
const RESAMPLE_REUSE_VISIBILITY: u32 = 64u;
// Only neighbors of similar geometry are reused.
const RESAMPLE_HEURISTICS: u32 = 128u;
// All inputs are shaded by their shares, not only the selected one.
const RESAMPLE_SHADE_ALL: u32 = 256u;
// Neighbors are taken from the last frame; otherwise from the previous iteration of this frame.
const RESAMPLE_FROM_PREVIOUS: u32 = 512u;
// This is the last iteration: it writes light.
const RESAMPLE_SHADE: u32 = 1024u;
// The pixel's own sample is known to be visible.
const RESAMPLE_CANDIDATES_VISIBLE: u32 = 2048u;
// Candidates are selected by arriving light, without the BSDF.
const RESAMPLE_TARGET_WITHOUT_BSDF: u32 = 4096u;
// The temporal neighbor is one of the four pixels around the reprojected position, chosen by bilinear weights.
const RESAMPLE_BILINEAR: u32 = 8192u;
// Only neighbors of the same material are similar.
const RESAMPLE_SAME_MATERIAL: u32 = 16384u;
// Something moved, or a light changed, since the last frame.
const RESAMPLE_MOVED: u32 = 32768u;
// Paths of the last frame are replayed in this frame after their reconnection vertex.
const RESAMPLE_RETRACE_FORWARD: u32 = 65536u;
// Paths of this frame are replayed in the last frame after their reconnection vertex, for MIS weights.
const RESAMPLE_RETRACE_BACKWARD: u32 = 131072u;
// The reconnection vertex is treated as diffuse: the same radiance leaves it in all directions.
const RESAMPLE_DIFFUSE_SECONDARY: u32 = 262144u;
// A reconnected sample gets a probe that finds its point of entry.
const RESAMPLE_INVERT_PROBES: u32 = 524288u;
// Light paths that can be reconnected between the vertex that the camera sees and the one before are samples of a domain of their own.
const RESAMPLE_RECONNECT_LIGHT_PATHS: u32 = 1048576u;
// Where the surface was hidden in the last frame, a position beside the object that hid it is tried.
const RESAMPLE_DUAL_MOTION: u32 = 2097152u;
// Russian roulette ends no path.
const RESAMPLE_NO_ROULETTE: u32 = 4194304u;
// The scene and the camera are those of the last frame.
const RESAMPLE_STILL: u32 = 8388608u;
// The scene, the camera and the jitter are those of the last frame, and so are the rays of all pixels.
const RESAMPLE_SAME_RAYS: u32 = 16777216u;
// Objects have moved, but lights are chosen with the probabilities of the last frame.
const RESAMPLE_SAME_DENSITIES: u32 = 33554432u;

// Reconnection by the footprints of the densities on both sides (Lin et al. 2026, supplement, 2); by a density in place of the roughness
// (ibid., 4), in the unit of a roughness or as printed; by a bound of the Jacobian or the footprint of the path (ibid., 11).
const RECONNECT_FOOTPRINTS: u32 = 0u;
const RECONNECT_BLACK_BOX: u32 = 1u;
const RECONNECT_BLACK_BOX_PRINTED: u32 = 2u;
const RECONNECT_JACOBIAN_BOUND: u32 = 3u;
const RECONNECT_PATH_FOOTPRINT: u32 = 4u;
// Reconnection beyond a least distance, as in all kinds from here on.
const RECONNECT_DISTANCE: u32 = 5u;
// Reconnection at the second vertex only, beyond a least distance.
const RECONNECT_FIRST: u32 = 6u;

// Shifts of light that enters a body (Werner et al. 2024): the point of entry is kept; its probe is drawn again; one or the other.
const SUBSURFACE_RECONNECTION: u32 = 0u;
const SUBSURFACE_DELAYED: u32 = 1u;
const SUBSURFACE_HYBRID: u32 = 2u;

const LAYOUT_ROWS: u32 = 0u;
const LAYOUT_COLUMNS: u32 = 0xffffffffu;
