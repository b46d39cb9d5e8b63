// Initial candidates of ReSTIR SSS (Werner et al. 2024): one probe, and light candidates at each of its hits.
#define_import_path bevy_restir::restir::sss::initial_candidates

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::common::ray::Hit
#import bevy_restir::common::rng::{Rng, rng_1, rng_3, rng_bits}
#import bevy_restir::light::point_on_light::light_point_at
#import bevy_restir::path::shadow_ray::light_is_visible
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::light_candidates::{light_candidate, subset_of, useful_candidates}
#import bevy_restir::restir::reservoir_sampling::{Stream, stream_add, stream_ucw}
#import bevy_restir::restir::sss::domain::{contribution_of, entry_point, Receiver, scatters}
#import bevy_restir::restir::sss::reservoir::{EntrySample, no_reservoir, Reservoir}
#import bevy_restir::subsurface::probe::{channel_probability, draw_probe, probe_ray}
#import bevy_restir::trace::probe_hits::{probe_distance, probe_triangle}
#import bevy_restir::trace::trace::{probe_hit, trace_probe}

struct SelectedEntry {
    reservoir: Reservoir,
    f: vec3<f32>,
}

// Every hit is a candidate with the density of its point: no division by the number of hits.
fn sample_candidates(r: Receiver, pixel: vec2<u32>, rng: ptr<function, Rng>) -> SelectedEntry {
    var selected = SelectedEntry(no_reservoir(), vec3<f32>(0.0));
    // Pixels without subsurface scattering have no confidence, so that no other pixel takes a sample from them.
    if !scatters(r) {
        return selected;
    }
    selected.reservoir.confidence = 1.0;
    let alpha_seed = rng_bits(rng).x >> 16u;
    let probe = draw_probe(r.surface.radius, rng_3(rng));
    let line = probe_ray(probe, r.surface.position, r.frame, r.surface.radius);
    if !line.valid {
        return selected;
    }
    let hits = trace_probe(line.ray, r.surface.instance, alpha_seed, false);
    let subset = subset_of(pixel, 1u);
    let choice = channel_probability(r.surface.radius);
    let count = useful_candidates(settings.candidates);
    var stream = Stream(0.0, NONE);
    for (var h = 0u; h < hits.count; h++) {
        let hit = probe_hit(line.ray, r.surface.instance, probe_triangle(hits, h), probe_distance(hits, h), false);
        let p = entry_point(r, hit);
        if !(p.density > 0.0) {
            continue;
        }
        for (var i = 0u; i < count; i++) {
            let c = light_candidate(p.surface.position, subset, rng);
            let u = rng_1(rng);
            if !(c.pmf > 0.0) {
                continue;
            }
            let f = contribution_of(p, c.light);
            let value = luminance(f);
            if stream_add(&stream, h * count + i, value / (f32(count) * c.pmf * c.rounding * choice * p.density), u) {
                selected.f = f;
                selected.reservoir.sample = EntrySample(
                    c.point, hit.instance, hit.triangle, hit.barycentrics, probe, h, p.is_far, alpha_seed, p.density, value,
                );
            }
        }
    }
    // An occluded sample has the weight 0, and still counts as a frame's worth of candidates.
    let s = selected.reservoir.sample;
    if stream.selected != NONE {
        let p = entry_point(r, Hit(0.0, s.instance, s.triangle, s.barycentrics));
        let light = light_point_at(s.light, p.surface.position, false);
        // Presampled lights have rounded colors, which only choose candidates.
        selected.f = contribution_of(p, light);
        selected.reservoir.sample.target_value = luminance(selected.f);
        if light_is_visible(p.surface, light, rng_bits(rng).x, false) {
            selected.reservoir.ucw = stream_ucw(stream, s.target_value);
        }
    }
    return selected;
}
