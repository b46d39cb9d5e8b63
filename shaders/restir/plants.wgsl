// Errors that only tests define, and must find.
#define_import_path bevy_restir::restir::plants

#import bevy_restir::restir::flags::has
#import bevy_restir::restir::types::RESAMPLE_SHADE

// Whether PLANT_NAN breaks the reservoirs of this pass.  It breaks those of the last pass of a frame, which the next frame reads as one
// input of several.  With PLANT_BETWEEN_PASSES it breaks those that a later pass of the same frame reads as the pixel's own sample: the
// light that only this sample finds is lost, and the weights of neighbors have no bound.
#ifdef PLANT_BETWEEN_PASSES
fn is_planted_pass() -> bool {
    return !has(RESAMPLE_SHADE);
}
#else
fn is_planted_pass() -> bool {
    return has(RESAMPLE_SHADE);
}
#endif
