// Settings of resampling as the shaders take them: one for each round of a frame.  Equal by test to `GpuX` in `src/gpu_types.rs`.
#define_import_path bevy_restir::restir::types

struct DirectSettings {
    candidates: u32,           // points of lights drawn a pixel
    subset_count: u32,         // presampled subsets; 0: every pixel draws from the whole table
    subset_size: u32,
    tile: u32,                 // pixels a side that share a subset
    temporal_taps: u32,        // 0 or 1: the surface's own place in the last frame
    spatial_taps: u32,         // places round it
    disocclusion_taps: u32,    // the same where the surface has no place in the last frame
    tries: u32,                // places that are looked at for one of them
    radius: f32,               // of them, pixels
    confidence_cap: f32,       // most that a tap's history counts, in candidates' worth of this frame
    mis: u32,                  // MIS_*
    flags: u32,                // DIRECT_*
    normal_threshold: f32,     // least cosine between the normals of two pixels that reuse each other's samples
    depth_threshold: f32,      // most relative distance of one from the other's tangent plane
    visibility_radius: f32,    // within which visibility is reused, pixels
    tiling: u32,               // of reservoirs: TILING_*, or pixels a side of a tile
    round: u32,                // of reuse, from 0
    pad_a: u32,
    pad_b: u32,
    pad_c: u32,
}

// A candidate of the BSDF joins those of the lights.
const DIRECT_BSDF_CANDIDATE: u32 = 1u;
// A candidate that is not seen is not kept.
const DIRECT_CANDIDATE_RAYS: u32 = 2u;
// A neighbour's sample that is not seen is not kept.
const DIRECT_TARGET_RAYS: u32 = 4u;
// It takes its neighbour's confidence with it.
const DIRECT_DISCARD: u32 = 8u;
// Rays say in MIS weights what a neighbour could have seen: without them it is taken to see all.
const DIRECT_MIS_RAYS: u32 = 16u;
// Samples that the target knows no visibility of are looked at before they are shaded.
const DIRECT_SHADING_RAYS: u32 = 32u;
// But not those whose visibility was known near by.
const DIRECT_REUSE_VISIBILITY: u32 = 64u;
// Neighbours whose geometry differs are left out before their samples are looked at.
const DIRECT_HEURISTICS: u32 = 128u;
// All inputs are shaded, not only the one that is kept.
const DIRECT_DECOUPLED: u32 = 256u;
// Neighbours are of the last frame; without it of this one, and reservoirs are read where neighbours are.
const DIRECT_FROM_PREVIOUS: u32 = 512u;
// This round is the last: it writes light.
const DIRECT_SHADE: u32 = 1024u;
// The pixel's own sample is known to be seen.
const DIRECT_SEEN: u32 = 2048u;
// Candidates are chosen by the light that arrives.
const DIRECT_SIMPLE_TARGET: u32 = 4096u;
// The surface's own sample is of one of the four pixels round its place.
const DIRECT_BILINEAR: u32 = 8192u;
// Heuristics leave out neighbours of other materials.
const DIRECT_SAME_MATERIAL: u32 = 16384u;

const TILING_ROWS: u32 = 0u;
const TILING_COLUMNS: u32 = 0xffffffffu;
