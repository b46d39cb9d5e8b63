// Group 2 of the passes that resample: the settings of a round, and the subsets of lights that candidates come from.
#define_import_path bevy_restir::restir::bindings

#import bevy_restir::light::presampled::PresampledLight
#import bevy_restir::restir::types::ResampleSettings

@group(2) @binding(0) var<uniform> settings: ResampleSettings;
// Of the passes that draw candidates.
@group(2) @binding(1) var<storage, read> subsets: array<PresampledLight>;
