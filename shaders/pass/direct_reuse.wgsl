// Spatiotemporal reuse and shading of direct light: this frame's sample and those of places in the last frame (paper 003, 6) meet in
// one resampling step; what each contributes is shaded by its share (7: decoupled shading), and one of them is kept.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::common::rng::{Rng, rng_1, rng_2, rng_bits, rng_new, STREAM_REUSE}
#import bevy_restir::light::remap::light_of_this_frame
#import bevy_restir::restir::direct::{evaluate, Evaluated, is_visible, Receiver, receiver_of, target_value}
#import bevy_restir::restir::mis::{MAX_INPUTS, mis_needs_target, mis_weight, MisInputs}
#import bevy_restir::restir::reservoir::{no_reservoir, Reservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::restir::stream::{Stream, stream_add, stream_ucw}
#import bevy_restir::restir::types::{DIRECT_HISTORY, DIRECT_MIS_RAYS, DIRECT_REJECT, DirectSettings}
#import bevy_restir::trace::offset::surface_point
#import bevy_restir::trace::ray::{rays_traced, trace_flags}
#import bevy_restir::view::bindings::{ray_counts, view, visibility}
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::view::camera::{barycentrics_on_ray, primary_ray, project}

@group(2) @binding(0) var<uniform> settings: DirectSettings;
@group(2) @binding(1) var<storage, read> previous_reservoirs: array<vec4<u32>>;
@group(2) @binding(2) var<storage, read_write> reservoirs: array<vec4<u32>>;
@group(2) @binding(3) var previous_visibility: texture_2d<u32>;
@group(2) @binding(4) var resampled: texture_storage_2d<rgba32float, write>;

// The place of tap i in the last frame; outside of the image: NONE.  Only geometry and random numbers decide (trap T8).
fn tap_pixel(i: u32, before: vec2<f32>, rng: ptr<function, Rng>) -> vec2<u32> {
    var at = before - view.previous_jitter;
    if i > settings.temporal_taps {
        let u = rng_2(rng);
        at += settings.radius * sqrt(u.x) * vec2<f32>(cos(6.2831853 * u.y), sin(6.2831853 * u.y));
    }
    if any(at < vec2<f32>(0.0)) || any(at >= vec2<f32>(view.size)) {
        return vec2<u32>(NONE);
    }
    return min(vec2<u32>(at), view.size - 1u);
}

// Whether two surfaces are alike enough to share light.
fn are_alike(a: Receiver, b: Receiver) -> bool {
    let offset = b.surface.position - a.surface.position;
    let reach = max(distance(a.surface.position, view.current.world_from_view[3].xyz), 1.0e-20);
    return dot(a.surface.bsdf.n, b.surface.bsdf.n) >= settings.normal_threshold
        && abs(dot(offset, a.surface.bsdf.n_geo)) <= settings.depth_threshold * reach;
}

@compute @workgroup_size(8, 8)
fn direct_reuse(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = pixel.y * view.size.x + pixel.x;
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || view.bounces == 0u {
        textureStore(resampled, pixel, vec4<f32>(0.0));
        return;
    }
    var rng = rng_new(pixel, view.frame, STREAM_REUSE, view.seed);
    let alpha_seed = rng_bits(&rng).x;
    let r = receiver_of(ids, pixel, false);
    let with_rays = (settings.flags & DIRECT_MIS_RAYS) != 0u;

    // Gather the inputs: the canonical reservoir, and those of the taps.
    var inputs: MisInputs;
    var samples: array<Reservoir, MAX_INPUTS>;
    var pixels: array<vec2<u32>, MAX_INPUTS>;
    inputs.count = 1u;
    samples[0] = reservoir_unpack(reservoirs[index]);
    inputs.confidence[0] = samples[0].confidence;
    var taps = 0u;
    if (settings.flags & DIRECT_HISTORY) != 0u {
        taps = min(settings.temporal_taps + settings.spatial_taps, MAX_INPUTS - 1u);
    }
    let before = project(view.previous, previous_point(ids, pixel));
    for (var i = 1u; i <= taps; i++) {
        let at = tap_pixel(i, before, &rng);
        if at.x == NONE {
            continue;
        }
        let there = textureLoad(previous_visibility, at, 0).xy;
        if there.x == NONE {
            continue;
        }
        if (settings.flags & DIRECT_REJECT) != 0u && !are_alike(r, receiver_of(there, at, true)) {
            continue;
        }
        var s = reservoir_unpack(previous_reservoirs[at.y * view.size.x + at.x]);
        // A light that is gone takes its sample with it, but not the sample's worth.
        s.point.light = light_of_this_frame(s.point.light);
        s.ucw = select(s.ucw, 0.0, s.point.light == NONE);
        // History counts at most so much; before any weight, whatever the sample is (trap T7).
        s.confidence = min(s.confidence, settings.confidence_cap * samples[0].confidence);
        samples[inputs.count] = s;
        pixels[inputs.count] = at;
        inputs.confidence[inputs.count] = s.confidence;
        inputs.count += 1u;
    }

    // Targets of every domain at every sample that the weights ask for.
    var contributions: array<vec3<f32>, MAX_INPUTS>;
    for (var domain = 0u; domain < inputs.count; domain++) {
        var receiver = r;
        if domain > 0u {
            let at = pixels[domain];
            receiver = receiver_of(textureLoad(previous_visibility, at, 0).xy, at, true);
        }
        for (var j = 0u; j < inputs.count; j++) {
            var value = 0.0;
            if samples[j].ucw > 0.0 && mis_needs_target(settings.mis, domain, j) {
                let e = evaluate(receiver, samples[j].point);
                value = target_value(e);
                // A sample is seen from where it was kept; elsewhere a ray decides.
                let ask = value > 0.0 && domain != j && (with_rays || domain == 0u);
                // Blended surfaces let every domain see by chances of its own: weights of joint chances would not add up to 1.
                if ask && !is_visible(receiver, e, alpha_seed + domain) {
                    value = 0.0;
                }
                if domain == 0u {
                    contributions[j] = select(vec3<f32>(0.0), e.f, value > 0.0);
                }
            }
            inputs.targets[domain * MAX_INPUTS + j] = value;
        }
    }

    count_confidence(&inputs);

    // Resample, and shade every input by its share.
    var stream = Stream(0.0, NONE);
    var light = vec3<f32>(0.0);
    for (var j = 0u; j < inputs.count; j++) {
        let u = rng_1(&rng);
        if !(samples[j].ucw > 0.0) {
            continue;
        }
        let share = mis_weight(&inputs, settings.mis, j) * samples[j].ucw;
        light += share * contributions[j];
        _ = stream_add(&stream, j, share * inputs.targets[j], u);
    }
    var kept = no_reservoir();
    for (var j = 0u; j < inputs.count; j++) {
        kept.confidence += inputs.confidence[j];
    }
    if stream.selected != NONE {
        kept.point = samples[stream.selected].point;
        kept.ucw = stream_ucw(stream, inputs.targets[stream.selected]);
    }
    reservoirs[index] = stored(kept, pixel);
    textureStore(resampled, pixel, vec4<f32>(light, 0.0));
    let counted = textureLoad(ray_counts, pixel).x;
    textureStore(ray_counts, pixel, vec4<u32>((counted + rays_traced) | trace_flags << 24u));
}

// Where the pixel's surface was in the last frame.
fn previous_point(ids: vec2<u32>, pixel: vec2<u32>) -> vec3<f32> {
    let b = barycentrics_on_ray(world_triangle(ids.x, ids.y, false), primary_ray(pixel));
    return surface_point(ids.x, ids.y, b, true);
}

// What an input counts may depend on geometry, never on its sample (trap T7).
#ifdef PLANT_CONFIDENCE_OF_SUCCESS
fn count_confidence(inputs: ptr<function, MisInputs>) {
    for (var j = 1u; j < (*inputs).count; j++) {
        (*inputs).confidence[j] *= f32((*inputs).targets[j] > 0.0);
    }
}
#else
fn count_confidence(inputs: ptr<function, MisInputs>) {
}
#endif

#ifdef PLANT_NAN
fn stored(r: Reservoir, pixel: vec2<u32>) -> vec4<u32> {
    let bad = array<u32, 4>(0x7fc00000u, 0x7f800000u, 0xff800000u, 0xbf800000u);
    let words = reservoir_pack(r);
    let kind = (pixel.x + view.frame) & 3u;
    return select(words, vec4<u32>(words.x, words.y, bad[kind], bad[3u - kind]), all(pixel % 5u == vec2<u32>(2u)));
}
#else
fn stored(r: Reservoir, pixel: vec2<u32>) -> vec4<u32> {
    return reservoir_pack(r);
}
#endif
