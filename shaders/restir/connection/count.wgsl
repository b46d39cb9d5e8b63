// Number of connections of a camera vertex, as MIS weights count them: relative to the share of light sub-paths that the camera sees
// (`LightShares`).  Connections are resampled with the camera paths that they end.
#define_import_path bevy_restir::restir::connection::count

#import bevy_restir::restir::bindings::settings

#ifdef CONNECTIONS
const CONNECTS: bool = true;

fn connections_of_vertex() -> f32 {
    return select(0.0, 1.0 / settings.nee_share, settings.nee_share > 0.0);
}
#else
const CONNECTS: bool = false;

fn connections_of_vertex() -> f32 {
    return 0.0;
}
#endif
