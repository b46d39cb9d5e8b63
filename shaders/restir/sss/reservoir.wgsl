// The reservoir of ReSTIR SSS: where light enters the body of a pixel, and the point of the light that it comes from.  52 bytes.
#define_import_path bevy_restir::restir::sss::reservoir

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, is_sound}
#import bevy_restir::light::point_on_light::{LightPoint, no_light_point}
#import bevy_restir::subsurface::probe::Probe

// Light that enters a body: the path from a pixel's surface x1 through the body to x2, and to a light.  The measure is that of the triangle
// of x2 (uniform, total 1) times that of the light, so that a body that moves or grows changes no density.
struct EntrySample {
    light: LightPoint,
    instance: u32,             // of x2; NONE: there is no sample
    triangle: u32,
    barycentrics: vec2<f32>,
    probe: Probe,              // finds x2 from x1
    hit: u32,                  // index of x2 among the hits of the probe
    is_far: bool,              // x2 is far from x1, or faces another way: the hybrid shift reconnects
    alpha_seed: u32,           // 16 bits, by which its probes see blended surfaces, in every pixel
    density: f32,              // of finding x2 from x1, in the measure of the triangle, over the probability of a channel
    target_value: f32,         // p̂ in the pixel that stores it
}

struct Reservoir {
    sample: EntrySample,
    ucw: f32,                  // W: E[f(X) W] = ∫ f; 0: no sample
    confidence: f32,           // in frames' worth of candidates
    seen: bool,                // always true: a sample that is occluded is not stored
}

struct PackedReservoir {
    light: u32,
    coordinates: u32,
    instance: u32,
    triangle: u32,
    barycentric_x: f32,
    barycentric_y: f32,
    u_radius: f32,
    u_angle: f32,
    structure: u32,            // 2 bits of the axis, 2 of the channel, 4 of the hit, 1 of `is_far`, 16 of `alpha_seed`
    density: f32,
    target_value: f32,
    ucw: f32,
    confidence: f32,
}

fn no_reservoir() -> Reservoir {
    let sample = EntrySample(no_light_point(), NONE, NONE, vec2<f32>(0.0), Probe(0u, 0u, 0.0, 0.0), 0u, false, 0u, 0.0, 0.0);
    return Reservoir(sample, 0.0, 0.0, true);
}

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    let s = r.sample;
    let structure = s.probe.axis | (s.probe.channel << 2u) | (s.hit << 4u) | (u32(s.is_far) << 8u) | (s.alpha_seed << 9u);
    return PackedReservoir(
        s.light.light, s.light.coordinates, s.instance, s.triangle, s.barycentrics.x, s.barycentrics.y,
        s.probe.u_radius, s.probe.u_angle, structure,
        s.density, s.target_value, r.ucw, r.confidence,
    );
}

// Reservoirs that hold the same candidate have the same identity, wherever it was shifted.
fn identity_of(p: PackedReservoir) -> vec2<u32> {
    return vec2<u32>(p.light, p.coordinates);
}

// A reservoir with a value that is negative or not finite is dropped with its confidence: kept confidence would make the picture dark.
fn reservoir_unpack(p: PackedReservoir) -> Reservoir {
    let is_reservoir_sound = is_sound(p.ucw) && is_sound(p.confidence) && is_sound(p.density) && is_sound(p.target_value);
    if !guard_holds(is_reservoir_sound, GUARD_RESERVOIR) {
        return no_reservoir();
    }
    let probe = Probe(p.structure & 3u, min((p.structure >> 2u) & 3u, 2u), p.u_radius, p.u_angle);
    let sample = EntrySample(
        LightPoint(p.light, p.coordinates), p.instance, p.triangle, vec2<f32>(p.barycentric_x, p.barycentric_y), probe,
        (p.structure >> 4u) & 15u, (p.structure & 256u) != 0u, (p.structure >> 9u) & 0xffffu, p.density, p.target_value,
    );
    return Reservoir(sample, p.ucw, p.confidence, true);
}
