// Share of the technique t = 1 in the picture: the camera sees a light vertex.  TEST_*: for tests of one technique, with its MIS weight or,
// with TEST_ALONE, with the weight 1.
#define_import_path bevy_restir::restir::bdpt::techniques

#ifdef TEST_HITS
const SPLAT_SHARE: f32 = 0.0;
#else ifdef TEST_NEE
const SPLAT_SHARE: f32 = 0.0;
#else ifdef TEST_CONNECTIONS
const SPLAT_SHARE: f32 = 0.0;
#else
const SPLAT_SHARE: f32 = 1.0;
#endif

#ifdef TEST_ALONE
fn splat_share(mis_weight: f32) -> f32 {
    return SPLAT_SHARE;
}
#else
fn splat_share(mis_weight: f32) -> f32 {
    return SPLAT_SHARE * mis_weight;
}
#endif
