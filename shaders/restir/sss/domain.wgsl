// ReSTIR SSS: the domain of light that enters a body at a point x2 and leaves it at x1, the surface of a pixel (Werner et al. 2024).  It
// defines the functions that the resampling routine (`pass/reuse.wgsl`) calls.
//
// Three shifts take a sample to another pixel.  Reconnection keeps x2.  Delayed reconnection draws the probe of the sample again at the new
// pixel, which gives another x2, and keeps the point of the light: it is for an x2 near x1, where the profile is steep.  The hybrid shift
// reconnects if x2 is far from x1, and otherwise draws the probe again.
#define_import_path bevy_restir::restir::sss::domain

#import bevy_restir::bsdf::bsdf::bsdf_eval
#import bevy_restir::common::constants::{LEAST_MAGNITUDE, NONE}
#import bevy_restir::common::guard::{GUARD_LIGHT_CONTRIBUTION, guarded_3}
#import bevy_restir::common::math::{is_finite, luminance, max_component}
#import bevy_restir::common::ray::Hit
#import bevy_restir::common::rng::unit_float
#import bevy_restir::light::point_on_light::light_point_at
#import bevy_restir::light::remap::current_light_id
#import bevy_restir::light::types::{LightSample, no_light_sample}
#import bevy_restir::path::medium::{medium_towards, transmittance}
#import bevy_restir::path::shadow_ray::light_is_visible
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::sss::reservoir::{EntrySample, Reservoir}
#import bevy_restir::restir::types::{RESAMPLE_INVERT_PROBES, RESAMPLE_MOVED, SUBSURFACE_DELAYED, SUBSURFACE_HYBRID}
#import bevy_restir::scene::surface::Surface
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::subsurface::entry::{entry_surface, exit_factor, profile_per_area, scatters_below}
#import bevy_restir::subsurface::probe::{channel_probability, inverse_probe, probe_frame, Probe, probe_pdf, probe_ray}
#import bevy_restir::trace::probe_hits::{probe_distance, probe_triangle}
#import bevy_restir::trace::trace::{probe_hit, trace_probe}
#import bevy_restir::view::primary::primary_surface

// x2 is far from x1 if their distance is at least this many times d, the length of the diffusion profile (`subsurface/profile.wgsl`), or
// the cosine between their normals is at most FAR_COSINE.
const FAR_LENGTHS: f32 = 2.0;
const FAR_COSINE: f32 = 0.5;
// Neighbors are at most this many times d away (Werner et al. 2024): light that enters farther from a pixel matters little to it.
const NEIGHBOR_LENGTHS: f32 = 2.0;
// Least radius of the disk of neighbors, as a share of the greatest radius, and in pixels.
const LEAST_RADIUS_SHARE: f32 = 1.0 / 6.0;
const LEAST_RADIUS: f32 = 2.0;

// A pixel's surface, in this frame or the last.
struct Receiver {
    surface: Surface,
    exit_factors: vec3<f32>,   // factors of the BSSRDF at x1; 0: no light scatters below this surface
    frame: mat3x3<f32>,        // of its probes
    footprint: f32,            // diameter of the pixel, m
    previous: bool,
}

// Where light enters, as a receiver sees it.
struct EntryPoint {
    surface: Surface,
    carried: vec3<f32>,        // light that leaves x1 per light that enters x2, in the measure of the triangle of x2
    density: f32,              // of finding x2 from x1, in the same measure, divided by the probability of a channel, which replay keeps
    is_far: bool,
}

// Sample fields that a shift changes.
struct ShiftResult {
    triangle: u32,
    barycentrics: vec2<f32>,
    probe: Probe,
    hit: u32,
    density: f32,
    target_value: f32,
}

// A sample, shifted to a receiver.
struct Evaluated {
    f: vec3<f32>,              // contribution without visibility
    jacobian: f32,             // 0: the shift is not defined
    is_lit: bool,              // the segment from x2 to the light is that of the stored sample, and so known to be free
    entry: Surface,
    light: LightSample,
    result: ShiftResult,
}

fn receiver_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Receiver {
    let s = primary_surface(ids, pixel, previous);
    return receiver_at(s.surface, s.wo, s.cone.width, previous);
}

fn receiver_at(s: Surface, wo: vec3<f32>, footprint: f32, previous: bool) -> Receiver {
    var factor = vec3<f32>(0.0);
    if scatters_below(s, wo) {
        factor = exit_factor(s, wo);
    }
    return Receiver(s, factor, probe_frame(s.smooth_n), footprint, previous);
}

fn scatters(r: Receiver) -> bool {
    return max_component(r.exit_factors) > 0.0;
}

fn entry_point(r: Receiver, hit: Hit) -> EntryPoint {
    let entry = entry_surface(r.surface, hit, r.previous);
    let area = world_triangle(hit.instance, hit.triangle, r.previous).area;
    let offset = entry.position - r.surface.position;
    let distance = length(offset);
    let near = FAR_LENGTHS * max_component(r.surface.radius);
    return EntryPoint(
        entry,
        r.exit_factors * profile_per_area(r.surface.radius, distance) * area,
        probe_pdf(offset, entry.bsdf.n_geo, r.frame, r.surface.radius) * area / channel_probability(r.surface.radius),
        distance >= near || dot(entry.bsdf.n_geo, r.surface.bsdf.n_geo) <= FAR_COSINE,
    );
}

// Contribution of a point of a light that shines on a point of entry, without visibility.
fn contribution_of(p: EntryPoint, l: LightSample) -> vec3<f32> {
    if !(l.pdf_solid_angle > 0.0) {
        return vec3<f32>(0.0);
    }
    let medium = transmittance(medium_towards(p.surface, l.wi, vec3<f32>(0.0)), l.distance);
    let f = p.carried * bsdf_eval(p.surface.bsdf, p.surface.bsdf.n, l.wi) * l.radiance * medium / l.pdf_solid_angle;
    return guarded_3(f, GUARD_LIGHT_CONTRIBUTION);
}

// The hit of a sample's probe about a receiver; NONE if there are fewer hits.
fn replayed_hit(r: Receiver, s: EntrySample) -> Hit {
    var hit = Hit(0.0, NONE, NONE, vec2<f32>(0.0));
    if !(r.surface.radius[s.probe.channel] > 0.0) {
        return hit;
    }
    let line = probe_ray(s.probe, r.surface.position, r.frame, r.surface.radius);
    if !line.valid {
        return hit;
    }
    let hits = trace_probe(line.ray, r.surface.instance, s.alpha_seed, r.previous);
    if s.hit < hits.count {
        hit = probe_hit(line.ray, r.surface.instance, probe_triangle(hits, s.hit), probe_distance(hits, s.hit), r.previous);
    }
    return hit;
}

fn no_shift() -> Evaluated {
    var e: Evaluated;
    e.light = no_light_sample();
    return e;
}

fn evaluate(r: Receiver, reservoir: Reservoir) -> Evaluated {
    let s = reservoir.sample;
    if !scatters(r) || s.instance != r.surface.instance || !(s.density > 0.0) {
        return no_shift();
    }
    let is_hybrid = settings.subsurface_shift == SUBSURFACE_HYBRID;
    let replays = settings.subsurface_shift == SUBSURFACE_DELAYED || (is_hybrid && !s.is_far);
    var hit = Hit(0.0, s.instance, s.triangle, s.barycentrics);
    if replays {
        hit = replayed_hit(r, s);
        if hit.instance == NONE {
            return no_shift();
        }
    }
    let p = entry_point(r, hit);
    // The inverse shift must make the same choice.
    if !(p.density > 0.0) || !is_finite(p.density) || (is_hybrid && p.is_far != s.is_far) {
        return no_shift();
    }
    let light = light_point_at(s.light, p.surface.position, r.previous);
    let f = contribution_of(p, light);
    let result = ShiftResult(hit.triangle, hit.barycentrics, s.probe, s.hit, p.density, luminance(f));
    let is_lit = !replays && !has(RESAMPLE_MOVED);
    return Evaluated(f, jacobian_of_shift(s.density, p.density, replays), is_lit, p.surface, light, result);
}

// Share of a sample's light that the receiver scatters diffusely: all that leaves a body.
#ifdef SPLIT_LIGHT
fn diffuse_share(r: Receiver, s: Reservoir, packed_splat_share: f32) -> vec3<f32> {
    return vec3<f32>(1.0);
}
#endif

// p̂: the resampling routine selects by it.
fn target_value(e: Evaluated) -> f32 {
    return luminance(e.f);
}

fn can_be_shifted(s: Reservoir) -> bool {
    return true;
}

fn jacobian_of(e: Evaluated) -> f32 {
    return e.jacobian;
}

// A reconnection keeps the segment to the light: it is tested again only where something moved.
fn is_visible(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return e.is_lit || light_is_visible(e.entry, e.light, alpha_seed, r.previous);
}

fn shift_result_of(e: Evaluated) -> ShiftResult {
    return e.result;
}

fn apply_shift(r: Reservoir, a: ShiftResult) -> Reservoir {
    var shifted = r;
    shifted.sample.triangle = a.triangle;
    shifted.sample.barycentrics = a.barycentrics;
    shifted.sample.probe = a.probe;
    shifted.sample.hit = a.hit;
    shifted.sample.density = a.density;
    shifted.sample.target_value = a.target_value;
    return shifted;
}

// The reservoir stores p̂ as of the frame that wrote it.  Temporal reuse needs it as of that frame, so that it holds even where things moved.
fn stores_target() -> bool {
    return true;
}

fn stored_target(r: Reservoir) -> f32 {
    return r.sample.target_value;
}

// A sample of the last frame, with the light ids of this frame.  A sample of a removed light gets the weight 0 and keeps its confidence.
fn in_current_frame(r: Reservoir) -> Reservoir {
    var current = r;
    current.sample.light.light = current_light_id(r.sample.light.light);
    current.ucw = select(r.ucw, 0.0, current.sample.light.light == NONE);
    return current;
}

// The sample that a pixel stores.  A reconnected sample gets a probe that finds its x2 from here, so that later iterations can draw it again.
fn completed(r: Receiver, reservoir: Reservoir, bits: u32) -> Reservoir {
    if !has(RESAMPLE_INVERT_PROBES) || !(reservoir.ucw > 0.0) || !scatters(r) {
        return reservoir;
    }
    var inverted = reservoir;
    let s = reservoir.sample;
    let p = entry_point(r, Hit(0.0, s.instance, s.triangle, s.barycentrics));
    let u = unit_float(vec4<u32>(bits)).x;
    inverted.sample.probe = inverse_probe(
        p.surface.position - r.surface.position, p.surface.bsdf.n_geo, r.frame, r.surface.radius, u,
    );
    inverted.sample.hit = hit_of_triangle(r, inverted.sample);
    return inverted;
}

// Whether a pixel resamples; the reservoirs of others stay empty.
fn resamples(r: Receiver) -> bool {
    return scatters(r);
}

// Radius of the disk that neighbors are in, pixels: NEIGHBOR_LENGTHS times d, projected.
fn neighbor_radius(r: Receiver) -> f32 {
    let projected = NEIGHBOR_LENGTHS * max_component(r.surface.radius) / max(r.footprint, LEAST_MAGNITUDE);
    return clamp(projected, max(LEAST_RADIUS_SHARE * settings.radius, min(LEAST_RADIUS, settings.radius)), settings.radius);
}

// Index of the sample's triangle among the hits of its probe; NO_HIT if the probe misses it because of rounding.
const NO_HIT: u32 = 15u;

fn hit_of_triangle(r: Receiver, s: EntrySample) -> u32 {
    let line = probe_ray(s.probe, r.surface.position, r.frame, r.surface.radius);
    if !line.valid {
        return NO_HIT;
    }
    let hits = trace_probe(line.ray, r.surface.instance, s.alpha_seed, r.previous);
    for (var i = 0u; i < hits.count; i++) {
        if probe_triangle(hits, i) == s.triangle {
            return i;
        }
    }
    return NO_HIT;
}

// PLANT_*: errors that only tests define, and must find.
#ifdef PLANT_NO_JACOBIAN
fn jacobian_of_shift(before: f32, after: f32, replays: bool) -> f32 {
    return 1.0;
}
#else
fn jacobian_of_shift(before: f32, after: f32, replays: bool) -> f32 {
    return select(1.0, before / after, replays);
}
#endif
