// Points where light enters a translucent object, and the share of it that reaches the point where it leaves: a separable BSSRDF with a
// diffusion profile.  A point of entry is a surface whose only lobe is diffuse, under the interface that light crosses, so that light is
// sampled there as at any other vertex.
#define_import_path bevy_restir::subsurface::entry

#import bevy_restir::bsdf::coat::coat_share
#import bevy_restir::bsdf::diffuse::diffuse_base
#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::lobe_choice::{base_albedo, LOBE_PROBABILITY_MIN}
#import bevy_restir::bsdf::roughness::normal_towards
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_THROUGHPUT, guarded_3}
#import bevy_restir::common::math::{luminance, max_component}
#import bevy_restir::common::ray::Hit
#import bevy_restir::scene::lobes::isotropic
#import bevy_restir::scene::offset::{offset_distance, surface_point}
#import bevy_restir::scene::surface::{interpolated_normal, Surface}
#import bevy_restir::scene::triangle::{instance_transform, is_mirrored, stored_triangle, world_triangle}
#import bevy_restir::subsurface::probe::{draw_probe, probe_frame, probe_pdf, probe_ray, reach_of}
#import bevy_restir::subsurface::profile::profile
#import bevy_restir::trace::probe_hits::{probe_distance, probe_triangle}
#import bevy_restir::trace::trace::{probe_hit, trace_probe}

struct Entry {
    surface: Surface,
    weight: vec3<f32>,         // the profile over the density of the point, without `exit_factor`
    valid: bool,
}

fn no_entry() -> Entry {
    var e: Entry;
    e.valid = false;
    return e;
}

// Whether light that scatters below the surface leaves towards wo.
fn scatters_below(s: Surface, wo: vec3<f32>) -> bool {
    return max_component(s.bsdf.subsurface) > 0.0 && dot(wo, normal_towards(s.bsdf, wo)) > 0.0 && dot(wo, s.bsdf.n_geo) > 0.0;
}

// Probability of continuing a path below the surface, from the estimated albedos of the surface and of the scattering below it.
fn subsurface_probability(s: Surface, wo: vec3<f32>) -> f32 {
    let below = luminance(exit_factor(s, wo));
    let coat = coat_share(s.bsdf, wo);
    let base = base_albedo(s.bsdf, dot(wo, normal_towards(s.bsdf, wo)));
    let above = coat + (1.0 - coat) * (base.x + base.y);
    if !(above > 0.0) {
        return 1.0;
    }
    return clamp(below / (below + above), LOBE_PROBABILITY_MIN, 1.0 - LOBE_PROBABILITY_MIN);
}

// The factors of the BSSRDF at the point where light leaves: albedo, subsurface weight, the share that is not transmitted diffusely,
// interface and coat.
fn exit_factor(s: Surface, wo: vec3<f32>) -> vec3<f32> {
    let f0 = s.bsdf.dielectric_reflectance;
    return (1.0 - coat_share(s.bsdf, wo)) * reflected_share(s) * s.bsdf.subsurface * diffuse_base(s.bsdf)
        * (1.0 - schlick(f0, abs(dot(wo, normal_towards(s.bsdf, wo)))));
}

// Value of the profile at a distance, per area; 0 beyond the reach of all channels.
fn profile_per_area(radius: vec3<f32>, r: f32) -> vec3<f32> {
    var value = vec3<f32>(0.0);
    if !(r <= reach_of(radius)) {
        return value;
    }
    for (var channel = 0u; channel < 3u; channel += 1u) {
        let d = radius[channel];
        if d > 0.0 {
            value[channel] = profile(r / d) / (d * d);
        }
    }
    return value;
}

// The surface where light enters: the front side of a triangle, with its smooth normal.  `exit`: the surface where the light leaves, whose
// interface it crosses.
fn entry_surface(exit: Surface, hit: Hit, previous: bool) -> Surface {
    let t = world_triangle(hit.instance, hit.triangle, previous);
    let mirrored = is_mirrored(hit.instance);
    let transform = instance_transform(hit.instance, previous);
    let f0 = exit.bsdf.dielectric_reflectance;
    // Mean of 1 - F over the cosine-weighted hemisphere.
    let f90 = schlick(f0, 0.0);
    let through = 1.0 - f0 - (f90 - f0) / 21.0;
    var s: Surface;
    s.position = surface_point(hit.instance, hit.triangle, hit.barycentrics, previous);
    s.offset = offset_distance(hit.instance, hit.triangle, hit.barycentrics, t.normal, previous);
    s.front = 1u;
    s.material = exit.material;
    s.attenuation = exit.attenuation;
    s.light = NONE;
    s.instance = hit.instance;
    let stored = stored_triangle(hit.instance, hit.triangle, previous);
    s.bsdf.n = interpolated_normal(stored, hit.barycentrics, transform, mirrored, t.normal);
    s.bsdf.n_geo = t.normal;
    s.smooth_n = s.bsdf.n;
    // The value of the lobe is (1 - F)/`through` · |cos|/π: all other factors belong to the weight.
    s.bsdf.base_color = select(vec3<f32>(0.0), 1.0 / through, through > vec3<f32>(0.0));
    s.bsdf.entry_reflectance = f0;
    s.bsdf.roughness = 1.0;
    s.bsdf.eta = 1.0;
    s.bsdf = isotropic(s.bsdf);
    return s;
}

// Samples a point of entry.  One of the probe's hits is chosen, all with the same probability.
fn sample_entry(exit: Surface, u: vec4<f32>, alpha_seed: u32, previous: bool) -> Entry {
    var e = no_entry();
    let frame = probe_frame(exit.smooth_n);
    let line = probe_ray(draw_probe(exit.radius, u.xyz), exit.position, frame, exit.radius);
    if !line.valid {
        return e;
    }
    let hits = trace_probe(line.ray, exit.instance, alpha_seed, previous);
    if hits.count == 0u {
        return e;
    }
    let chosen = min(u32(u.w * f32(hits.count)), hits.count - 1u);
    let hit = probe_hit(line.ray, exit.instance, probe_triangle(hits, chosen), probe_distance(hits, chosen), previous);
    e.surface = entry_surface(exit, hit, previous);
    let offset = e.surface.position - exit.position;
    let pdf = probe_pdf(offset, e.surface.bsdf.n_geo, frame, exit.radius);
    if pdf > 0.0 {
        e.weight = guarded_3(profile_per_area(exit.radius, length(offset)) * (f32(hits.count) / pdf), GUARD_THROUGHPUT);
    }
    e.valid = max_component(e.weight) > 0.0;
    return e;
}

// Share of diffuse light that is reflected and not transmitted.
#ifdef DIFFUSE_TRANSMISSION
fn reflected_share(s: Surface) -> f32 {
    return 1.0 - s.bsdf.diffuse_transmission;
}
#else
fn reflected_share(s: Surface) -> f32 {
    return 1.0;
}
#endif
