// Settings of resampling as the shaders take them: one for each round of a frame.  Equal by test to `GpuX` in `src/gpu_types.rs`.
#define_import_path bevy_restir::restir::types

struct ResampleSettings {
    candidates: u32,           // points of lights drawn a pixel
    subset_count: u32,         // presampled subsets; 0: every pixel draws from the whole table
    subset_size: u32,
    tile: u32,                 // pixels a side that share a subset
    temporal_taps: u32,        // 0 or 1: the surface's own place in the last frame
    spatial_taps: u32,         // places round it
    disocclusion_taps: u32,    // the same where the surface has no place in the last frame
    tries: u32,                // places that are looked at for one of them
    radius: f32,               // within which they are, pixels
    confidence_cap: f32,       // most that a tap's history counts, in candidates' worth of this frame
    mis: u32,                  // MIS_*
    flags: u32,                // RESAMPLE_*
    normal_threshold: f32,     // least cosine between the normals of two pixels that reuse each other's samples
    depth_threshold: f32,      // most relative distance of one from the other's tangent plane
    visibility_radius: f32,    // within which visibility is reused, pixels
    tiling: u32,               // of reservoirs: TILING_*, or pixels a side of a tile
    round: u32,                // of reuse, from 0
    reconnection: u32,         // of paths: RECONNECT_*
    roughness: f32,            // least perceptual roughness of a lobe that paths reconnect after
    separation: f32,           // between the vertices: c of the footprints, or a distance, m
    jacobian_limit: f32,       // most Jacobian of a shift, either way
}

// A candidate of the BSDF joins those of the lights.
const RESAMPLE_BSDF_CANDIDATE: u32 = 1u;
// A candidate that is not seen is not kept.
const RESAMPLE_CANDIDATE_RAYS: u32 = 2u;
// A neighbour's sample that is not seen is not kept.
const RESAMPLE_TARGET_RAYS: u32 = 4u;
// It takes its neighbour's confidence with it.
const RESAMPLE_DISCARD: u32 = 8u;
// Rays say in MIS weights what a neighbour could have seen: without them it is taken to see all.
const RESAMPLE_MIS_RAYS: u32 = 16u;
// Samples that the target knows no visibility of are looked at before they are shaded.
const RESAMPLE_SHADING_RAYS: u32 = 32u;
// But not those whose visibility was known near by.
const RESAMPLE_REUSE_VISIBILITY: u32 = 64u;
// Neighbours whose geometry differs are left out before their samples are looked at.
const RESAMPLE_HEURISTICS: u32 = 128u;
// All inputs are shaded, not only the one that is kept.
const RESAMPLE_DECOUPLED: u32 = 256u;
// Neighbours are of the last frame; without it of this one, and reservoirs are read where neighbours are.
const RESAMPLE_FROM_PREVIOUS: u32 = 512u;
// This round is the last: it writes light.
const RESAMPLE_SHADE: u32 = 1024u;
// The pixel's own sample is known to be seen.
const RESAMPLE_SEEN: u32 = 2048u;
// Candidates are chosen by the light that arrives.
const RESAMPLE_SIMPLE_TARGET: u32 = 4096u;
// The surface's own sample is of one of the four pixels round its place.
const RESAMPLE_BILINEAR: u32 = 8192u;
// Heuristics leave out neighbours of other materials.
const RESAMPLE_SAME_MATERIAL: u32 = 16384u;
// Since the last frame something moved, or a light changed.
const RESAMPLE_MOVED: u32 = 32768u;
// What paths bring from the last frame is traced again in this one,
const RESAMPLE_TRACE_FORTH: u32 = 65536u;
// and what they would have been there is traced there.
const RESAMPLE_TRACE_BACK: u32 = 131072u;
// Paths of one bounce are another technique's.
const RESAMPLE_INDIRECT: u32 = 262144u;
// The radiance of a path leaves its reconnection vertex to all sides alike.
const RESAMPLE_KEEPS_RADIANCE: u32 = 524288u;

// By the footprints of both densities (Lin et al. 2026, supplement, 2), the same with a density in place of a roughness (4), or by a
// distance.
const RECONNECT_FOOTPRINTS: u32 = 0u;
const RECONNECT_BLACK_BOX: u32 = 1u;
const RECONNECT_DISTANCE: u32 = 2u;
// To the first vertex that bounces light, beyond a distance.
const RECONNECT_FIRST: u32 = 3u;

const TILING_ROWS: u32 = 0u;
const TILING_COLUMNS: u32 = 0xffffffffu;
