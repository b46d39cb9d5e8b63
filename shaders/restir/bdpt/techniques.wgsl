// Shares of the techniques in the picture: all of them, each with its MIS weight.  TEST_*: tests use one technique, with its weight or alone.
#define_import_path bevy_restir::restir::bdpt::techniques

#ifdef TEST_HITS
const HITS: f32 = 1.0;
const NEE: f32 = 0.0;
const CONNECTIONS: f32 = 0.0;
const SPLATS: f32 = 0.0;
#else ifdef TEST_NEE
const HITS: f32 = 0.0;
const NEE: f32 = 1.0;
const CONNECTIONS: f32 = 0.0;
const SPLATS: f32 = 0.0;
#else ifdef TEST_CONNECTIONS
const HITS: f32 = 0.0;
const NEE: f32 = 0.0;
const CONNECTIONS: f32 = 1.0;
const SPLATS: f32 = 0.0;
#else ifdef TEST_SPLATS
const HITS: f32 = 0.0;
const NEE: f32 = 0.0;
const CONNECTIONS: f32 = 0.0;
const SPLATS: f32 = 1.0;
#else
const HITS: f32 = 1.0;                 // s = 0: the camera sub-path hits a light
const NEE: f32 = 1.0;                  // s = 1: next-event estimation
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
