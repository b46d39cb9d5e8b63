// Shifts the sample of each pixel to a partner, and shows the result.  Tests run it instead of `shaders/pass/reuse.wgsl` in the domain of
// light paths that can be reconnected.
//
// TEST_ROUND_TRIP: the sample is shifted to the partner and back.  Shows (0: it returned, 1: it has no shift to the partner, 2: it was lost on
// the way back; 1; relative error of the contribution).  The partner is a pixel near this one or, with TEST_BEFORE, this one in the last frame.
// TEST_SPLAT: shows (0; 1; relative difference between the contribution and that of the same light path in the domain of all splats).
// Otherwise: a bounded function, integrated over the samples that the shift takes to the partner, and over those that the partner's shift
// takes here: over all pixels both sums are the same integral.

#import bevy_restir::common::math::luminance
#import bevy_restir::common::rng::pcg4d
#import bevy_restir::light::select::light_pmf
#import bevy_restir::path::light_path::arrival_cosine
#import bevy_restir::path::roulette::ROULETTE_FROM
#import bevy_restir::restir::bdpt::splat::splat_of
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::connection::light_sub_path::replayed_sub_path
#import bevy_restir::restir::reconnected::domain::{apply_shift, evaluate, is_visible, Receiver, shift_result_of, target_value}
#import bevy_restir::restir::reconnected::reservoir::{PackedReservoir, Reservoir, reservoir_unpack}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::{camera_density, camera_point}
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(4) var own_contribution: texture_2d<f32>;
@group(2) @binding(5) var resampled: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn reuse(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let s = reservoir_unpack(reservoirs[reservoir_index(pixel)]);
    var result = vec3<f32>(0.0);
    if s.ucw > 0.0 {
        result = result_of(s, pixel, textureLoad(own_contribution, pixel, 0).rgb);
    }
    textureStore(resampled, pixel, vec4<f32>(result, 0.0));
    count_rays(pixel);
}

#ifdef TEST_ROUND_TRIP
const NO_SHIFT: f32 = 1.0;
const LOST: f32 = 2.0;

fn result_of(s: Reservoir, pixel: vec2<u32>, f: vec3<f32>) -> vec3<f32> {
    let to = partner(pixel);
    let away = evaluate(to, s);
    if !(target_value(away) > 0.0) || !is_visible(to, away, 0u) {
        return vec3<f32>(NO_SHIFT, 1.0, 0.0);
    }
    let here = Receiver(pixel, false);
    let back = evaluate(here, apply_shift(s, shift_result_of(away)));
    if !(target_value(back) > 0.0) || !is_visible(here, back, 0u) {
        return vec3<f32>(LOST, 1.0, 0.0);
    }
    return vec3<f32>(0.0, 1.0, distance(back.f, f) / length(f));
}

#ifdef TEST_BEFORE
fn partner(pixel: vec2<u32>) -> Receiver {
    return Receiver(pixel, true);
}
#else
fn partner(pixel: vec2<u32>) -> Receiver {
    let bits = pcg4d(vec4<u32>(pixel, view.frame, view.seed));
    let at = vec2<i32>(pixel) + vec2<i32>(bits.xy % 17u) - 8;
    return Receiver(vec2<u32>(clamp(at, vec2<i32>(0), vec2<i32>(view.size) - 1)), false);
}
#endif
#else ifdef TEST_SPLAT
// A splat is the value of a light path over its density.  The contribution is the value over the density of everything but the last edge, so
// that it is the splat times the density of that edge in the image.  Sub-paths that roulette could have ended are left out.
fn result_of(s: Reservoir, pixel: vec2<u32>, f: vec3<f32>) -> vec3<f32> {
    let p = replayed_sub_path(s.path, s.frame, s.light, s.events, false);
    let splat = splat_of(p.walk, p.alpha_seed, false);
    if s.events > ROULETTE_FROM || !(luminance(splat.value) > 0.0) {
        return vec3<f32>(0.0);
    }
    let x = p.walk.surface;
    let point = camera_point(view.current, x.position);
    let rays = camera_density(view.current, -point.ray.direction, distance(point.ray.origin, x.position))
        * abs(dot(x.bsdf.n_geo, point.ray.direction));
    let edge = p.walk.pdf * arrival_cosine(x, p.walk.towards_light) / (p.walk.hit.t * p.walk.hit.t);
    let expected = splat.value * (light_pmf(s.light) * f32(settings.splats) * edge / rays);
    return vec3<f32>(0.0, 1.0, distance(expected, f) / length(expected));
}
#else
const PARTNER: vec2<u32> = vec2<u32>(8u, 4u);

fn result_of(s: Reservoir, pixel: vec2<u32>, f: vec3<f32>) -> vec3<f32> {
    let to = Receiver(pixel ^ PARTNER, false);
    let away = evaluate(to, s);
    if !(target_value(away) > 0.0) || !is_visible(to, away, 0u) {
        return vec3<f32>(0.0);
    }
    let there = target_value(away);
    let here = luminance(f);
    // The lesser of both bounds what the weight, the light of the pixel over `here`, multiplies.
    return s.ucw * min(here, there) * vec3<f32>(there / (1.0 + there), here / (1.0 + here), 0.0);
}
#endif
