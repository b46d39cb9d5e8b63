// Group 2 of the passes that resample, as far as modules of this room read it.  Each pass binds only the resources that it uses, which is
// why some bindings share an index.
#define_import_path bevy_restir::restir::bindings

#import bevy_restir::light::presampled::PresampledLight
#import bevy_restir::restir::types::ResampleSettings

@group(2) @binding(0) var<uniform> settings: ResampleSettings;
// Presampled light candidates, in passes that draw candidates.
@group(2) @binding(1) var<storage, read> subsets: array<PresampledLight>;
// The visibility buffer of the last frame, in passes that reuse.
@group(2) @binding(3) var previous_visibility: texture_2d<u32>;
// Masks of similar partners, in passes of paired reuse.
@group(2) @binding(3) var pair_masks: texture_2d<u32>;
