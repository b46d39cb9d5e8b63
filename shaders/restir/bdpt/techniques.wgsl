// Shares of the techniques of light sub-paths in the picture, each with its MIS weight.  TEST_*: for tests of one technique, with its MIS
// weight or, with TEST_ALONE, with the weight 1.
#define_import_path bevy_restir::restir::bdpt::techniques

#ifdef TEST_HITS
const CONNECTIONS: f32 = 0.0;
const SPLATS: f32 = 0.0;
#else ifdef TEST_NEE
const CONNECTIONS: f32 = 0.0;
const SPLATS: f32 = 0.0;
#else ifdef TEST_CONNECTIONS
const CONNECTIONS: f32 = 1.0;
const SPLATS: f32 = 0.0;
#else ifdef TEST_SPLATS
const CONNECTIONS: f32 = 0.0;
const SPLATS: f32 = 1.0;
#else
const CONNECTIONS: f32 = 1.0;          // s, t >= 2
const SPLATS: f32 = 1.0;               // t = 1: the camera sees a light vertex
#endif

#ifdef TEST_ALONE
fn technique_weight(mis_weight: f32, share: f32) -> f32 {
    return share;
}
#else
fn technique_weight(mis_weight: f32, share: f32) -> f32 {
    return share * mis_weight;
}
#endif
