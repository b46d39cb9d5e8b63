// ReSTIR GI (Ouyang et al. 2021; Lanz 2025, 4.3): the domain of indirect light, paths of at least two scattering events that are
// reconnected at the first vertex after the pixel's surface.  Functions that are not defined here are those of whole paths
// (`restir/pt/domain.wgsl`).
//
// The measure is that of the triangle at that vertex, and solid angle after it.  In this measure the shift has no Jacobian: the Jacobian
// of Lanz 2025 (4.3.3), of solid angles, is contained in the geometry factor of the target.  Densities are stored for the Jacobian limit
// only (4.5.5).
#define_import_path bevy_restir::restir::gi::domain

#import bevy_restir::common::guard::{GUARD_GI_MEASURE, guarded, guarded_3}
#import bevy_restir::path::medium::{medium_before_point, transmittance}
#import bevy_restir::path::scattering::scattering_vertex
#import bevy_restir::path::walk::{step_medium, step_towards}
#import bevy_restir::restir::pt::domain::{Evaluated, Receiver, shifted_to}
#import bevy_restir::restir::pt::initial_candidates::SelectedPath
#import bevy_restir::restir::shift::hybrid::replays
#import bevy_restir::restir::shift::shifted_path::SHIFT_NO_PATH
#import bevy_restir::restir::shift::reconnection::triangle_factor
#import bevy_restir::restir::stored_path::Reservoir
#import bevy_restir::scene::offset::surface_point

// Direct light, of paths one vertex shorter, is left to ReSTIR DI.
const SHORTEST_LENGTH: u32 = 3u;

// Index of the reconnection vertex.
const SECONDARY_VERTEX: u32 = 2u;

// A candidate in the measure of the domain.  Where the secondary vertex is taken for diffuse, its radiance is the one that leaves it
// towards the pixel that found it.
fn in_domain_measure(c: SelectedPath, r: Receiver) -> SelectedPath {
    var m = c;
    if c.path.reconnection != SECONDARY_VERTEX {
        return m;
    }
    if r.shift.diffuse_secondary {
        let from_vertex = scattering_vertex(r.first, c.path.seed, 1u);
        let first = from_vertex.vertex.surface.position;
        let point = surface_point(c.path.instance, c.path.triangle, c.path.barycentrics, false);
        let step = step_towards(from_vertex.vertex, normalize(point - first), c.path.lobe_before);
        let medium = step_medium(from_vertex.vertex, step.wi);
        let crossed = medium_before_point(c.path.instance, c.path.triangle, c.path.barycentrics, -step.wi, medium);
        let carried = from_vertex.weight * step.weight * transmittance(crossed, distance(point, first));
        m.path.density = step.pdf_lobe * triangle_factor(first, point, c.path.instance, c.path.triangle, false);
        m.path.radiance = select(vec3<f32>(0.0), c.f / carried, carried > vec3<f32>(0.0));
    }
    m.path.density = guarded(m.path.density, GUARD_GI_MEASURE);
    if !(m.path.density > 0.0) {
        // The secondary vertex is seen exactly edge-on.
        m.ucw = 0.0;
        m.f = vec3<f32>(0.0);
        return m;
    }
    m.ucw = guarded(c.ucw / m.path.density, GUARD_GI_MEASURE);
    m.f = guarded_3(c.f * m.path.density, GUARD_GI_MEASURE);
    return m;
}

// Paths that are not reconnected at the secondary vertex, such as those that begin on a mirror, stay in their pixel.
fn can_be_shifted(s: Reservoir) -> bool {
    return s.path.reconnection == SECONDARY_VERTEX;
}

fn evaluate(r: Receiver, s: Reservoir) -> Evaluated {
    if !can_be_shifted(s) {
        var nothing: Evaluated;
        nothing.shifted.reason = SHIFT_NO_PATH;
        return nothing;
    }
    let shifted = shifted_to(r, s.path);
    return Evaluated(guarded_3(shifted.f * shifted.density, GUARD_GI_MEASURE), shifted);
}

fn needs_replay(r: Receiver, s: Reservoir) -> bool {
    return can_be_shifted(s) && replays(s.path, r.first);
}

fn jacobian_of(e: Evaluated) -> f32 {
    return select(0.0, 1.0, e.shifted.jacobian > 0.0);
}

// The reservoir does not store p̂.
fn stores_target() -> bool {
    return false;
}

fn stored_target(s: Reservoir) -> f32 {
    return 0.0;
}
