// Settings of resampling as the shaders take them.  Equal by test to `GpuX` in `src/gpu_types.rs`.
#define_import_path bevy_restir::restir::types

struct DirectSettings {
    candidates: u32,           // points of lights drawn a pixel
    subset_count: u32,         // presampled subsets; 0: every pixel draws from the whole table
    subset_size: u32,
    tile: u32,                 // pixels a side that share a subset
    temporal_taps: u32,        // 0 or 1: the surface's own place in the last frame
    spatial_taps: u32,         // places round it in the last frame
    radius: f32,               // of those, pixels
    confidence_cap: f32,       // most that a tap's history counts, in candidates' worth of this frame
    mis: u32,                  // MIS_*
    flags: u32,                // DIRECT_*
    normal_threshold: f32,     // least cosine between the normals of two pixels that reuse each other's samples
    depth_threshold: f32,      // most relative distance of one from the other's tangent plane
}

// Rays decide in MIS weights what a neighbour could have seen: without them a neighbour is taken to see all: too dark near shadows.
const DIRECT_MIS_RAYS: u32 = 1u;
// Neighbours whose geometry differs are left out before their samples are looked at.
const DIRECT_REJECT: u32 = 2u;
// The last frame's reservoirs are there.
const DIRECT_HISTORY: u32 = 4u;
