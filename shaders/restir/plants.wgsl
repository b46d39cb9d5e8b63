// Errors that only tests define, and must find.
#define_import_path bevy_restir::restir::plants

#import bevy_restir::restir::flags::has
#import bevy_restir::restir::types::RESAMPLE_SHADE

// A number of four kinds that no reservoir may hold: NaN, infinities, a negative one.
fn broken_number(kind: u32) -> f32 {
    var bits = array<u32, 4>(0x7fc00000u, 0x7f800000u, 0xff800000u, 0xbf800000u);
    return bitcast<f32>(bits[kind & 3u]);
}

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
