// The domain of indirect light (ReSTIR GI; Ouyang et al. 2021; Lanz 2025, 4.3): paths of two bounces and more, reconnected to the first
// vertex that bounces light towards the pixel's surface.  What is not here they have in common with whole paths (`restir/paths.wgsl`).
//
// Their measure is that of its triangle at that vertex and solid angle after it, so that its shift has no Jacobian: what the Jacobian of Lanz 2025
// (4.3.3) says of solid angles is in the geometry factor that targets have in this measure.  Densities are kept for its limit (4.5.5).
#define_import_path bevy_restir::restir::indirect

#import bevy_restir::common::math::{is_finite, is_finite_3}
#import bevy_restir::path::medium::transmittance
#import bevy_restir::path::tree::Chosen
#import bevy_restir::path::walk::{step_medium, step_towards}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::kept_path::Reservoir
#import bevy_restir::restir::paths::{Evaluated, Receiver, shifted_to}
#import bevy_restir::restir::types::RESAMPLE_KEEPS_RADIANCE
#import bevy_restir::shift::connect::triangle_factor
#import bevy_restir::shift::hybrid::SHIFT_NO_PATH
#import bevy_restir::trace::offset::surface_point

// The vertex that is reconnected to.
const FIRST_BOUNCE: u32 = 2u;

// A candidate in the measure of this domain.  Where radiance is taken to leave the first bounce to all sides alike it is what leaves it
// towards the pixel that found it.
fn measured(c: Chosen, r: Receiver) -> Chosen {
    var m = c;
    if c.path.reconnection != FIRST_BOUNCE {
        return m;
    }
    if (settings.flags & RESAMPLE_KEEPS_RADIANCE) != 0u {
        let first = r.first.surface.position;
        let place = surface_point(c.path.instance, c.path.triangle, c.path.barycentrics, false);
        let step = step_towards(r.first, normalize(place - first), c.path.lobe_before);
        let carried = step.weight * transmittance(step_medium(r.first, step.wi), distance(place, first));
        m.path.density = step.pdf_lobe * triangle_factor(first, place, c.path.instance, c.path.triangle, false);
        m.path.radiance = select(vec3<f32>(0.0), c.f / carried, carried > vec3<f32>(0.0));
    }
    m.ucw = c.ucw / m.path.density;
    m.f = c.f * m.path.density;
    if !(m.path.density > 0.0) || !is_finite(m.ucw) || !is_finite_3(m.f) {
        m.ucw = 0.0;
        m.f = vec3<f32>(0.0);
    }
    return m;
}

fn evaluate(r: Receiver, s: Reservoir) -> Evaluated {
    // What a mirror shows first stays where it is.
    if s.path.reconnection != FIRST_BOUNCE {
        var none: Evaluated;
        none.shifted.reason = SHIFT_NO_PATH;
        return none;
    }
    let shifted = shifted_to(r, s.path);
    return Evaluated(shifted.f * shifted.density, shifted);
}

fn jacobian_of(e: Evaluated) -> f32 {
    return select(0.0, 1.0, e.shifted.jacobian > 0.0);
}

// None is kept.
fn knows_own_target() -> bool {
    return false;
}

fn own_target(s: Reservoir) -> f32 {
    return 0.0;
}
