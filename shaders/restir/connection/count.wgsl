// Number of connections of a camera vertex, as MIS weights count them: relative to the share of light sub-paths that the camera sees
// (`LightShares`).  Connections are resampled with the camera paths that they end, so that they count more than those; but many pixels share
// a light vertex, so that they count less than camera paths.  The geometric mean of both shares lies near the best of 1, 4 and 16 in two
// scenes (docs/experiments.md).
#define_import_path bevy_restir::restir::connection::count

#import bevy_restir::restir::bindings::settings

#ifdef CONNECTIONS
const CONNECTS: bool = true;

fn connections_of_vertex() -> f32 {
    return select(0.0, inverseSqrt(settings.nee_share), settings.nee_share > 0.0);
}
#else
const CONNECTS: bool = false;

fn connections_of_vertex() -> f32 {
    return 0.0;
}
#endif
