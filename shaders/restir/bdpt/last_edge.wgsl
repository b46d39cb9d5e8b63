// The last edge of a light path that the camera sees: from x2, a vertex of the light sub-path, to x1, the vertex that the camera sees.  Paths
// whose last edge can be reconnected are those of the domain `restir/reconnected`; all others, caustics above all, are those of
// `restir/splats`.  The test depends on the path and on the camera alone, so that each path belongs to one domain in each frame.
#define_import_path bevy_restir::restir::bdpt::last_edge

#import bevy_restir::common::constants::MATERIAL_ALPHA_BLEND
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::shift::reconnection::{is_apart, separation_threshold}
#import bevy_restir::restir::types::RESAMPLE_RECONNECT_LIGHT_PATHS
#import bevy_restir::scene::bindings::{instances, materials}
#import bevy_restir::scene::surface::Surface
#import bevy_restir::view::camera::eye_of

struct LastEdge {
    before: vec3<f32>,         // position of x2
    normal: vec3<f32>,         // geometric normal there
    pdf_forward: f32,          // density with which x2 scatters light to x1, over all lobes but deltas
    pdf_reverse: f32,          // density with which x1 scatters a path from the camera to x2, likewise
}

// The criteria of ReSTIR PT for both ends: the densities are those of rough lobes, and their footprints are large enough (`is_apart`).  A light
// path scatters by all lobes at once, so that a density takes the place of a lobe's roughness: that of a GGX lobe of width α is up to about
// 1/α² (Lin et al. 2026, supplement, Eq. 26).  No blended surface is x1: a camera ray passes or hits it by a random number of its own.
fn can_reconnect(x: Surface, e: LastEdge, previous: bool) -> bool {
    if !has(RESAMPLE_RECONNECT_LIGHT_PATHS) || is_blended(x.instance) {
        return false;
    }
    let kind = settings.reconnection;
    let separation = separation_threshold(kind, settings.separation, eye_of(x.position, previous), x);
    let rough = max(e.pdf_forward, e.pdf_reverse) * settings.roughness * settings.roughness <= 1.0;
    return rough
        && is_apart(e.before, x.position, x.bsdf.n_geo, e.pdf_forward, kind, separation)
        && is_apart(x.position, e.before, e.normal, e.pdf_reverse, kind, separation);
}

fn is_blended(instance: u32) -> bool {
    return (materials[instances[instance].material].flags & MATERIAL_ALPHA_BLEND) != 0u;
}
