// One round of reuse, and what it shades: a pixel's sample and those of its neighbours, of the last frame (Wyman and Panteleev 2021, 6)
// or of this one, meet in one resampling step; what each contributes is shaded by its share (decoupled shading, the same, 7; vector
// weights, Lin et al. 2026, supplement, 7), and one is kept.
//
// What samples are is their domain's: points of lights, whole paths, or their ends from the first bounce on.  The step is done in the
// pixel's own domain: a neighbour's sample is shifted there first, and from there to where else it is weighed.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::common::rng::{Rng, rng_1, rng_2, rng_bits, rng_new, STREAM_REUSE}
#ifdef RESAMPLES_PATHS
#import bevy_restir::path::sample::Arrival
#import bevy_restir::restir::kept_path::{no_reservoir, Reservoir}
#import bevy_restir::restir::path_reservoir::{PackedReservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::restir::paths::{arrival_of, arrived, evaluate, Evaluated, is_handed_on, is_visible, jacobian_of, knows_own_target, of_this_frame, own_target, Receiver, receiver_of, target_value}
#else ifdef RESAMPLES_INDIRECT
#import bevy_restir::path::sample::Arrival
#import bevy_restir::restir::indirect::{evaluate, jacobian_of, knows_own_target, own_target}
#import bevy_restir::restir::indirect_reservoir::{PackedReservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::restir::kept_path::{no_reservoir, Reservoir}
#import bevy_restir::restir::paths::{arrival_of, arrived, Evaluated, is_handed_on, is_visible, of_this_frame, Receiver, receiver_of, target_value}
#else
#import bevy_restir::restir::direct::{Arrival, arrival_of, arrived, evaluate, Evaluated, is_handed_on, is_visible, jacobian_of, knows_own_target, of_this_frame, own_target, Receiver, receiver_of, target_value}
#import bevy_restir::restir::reservoir::{no_reservoir, PackedReservoir, Reservoir, reservoir_pack, reservoir_unpack}
#endif
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::mis::{MAX_INPUTS, mis_needs_target, mis_weight, MisInputs}
#import bevy_restir::restir::shape::{are_alike, previous_shape_of, shape_of}
#import bevy_restir::restir::stream::{Stream, stream_add, stream_ucw}
#import bevy_restir::restir::tiling::reservoir_index
#import bevy_restir::restir::types::{RESAMPLE_BILINEAR, RESAMPLE_DECOUPLED, RESAMPLE_DISCARD, RESAMPLE_FROM_PREVIOUS, RESAMPLE_HEURISTICS, RESAMPLE_MIS_RAYS, RESAMPLE_REUSE_VISIBILITY, RESAMPLE_SAME_MATERIAL, RESAMPLE_SEEN, RESAMPLE_SHADE, RESAMPLE_SHADING_RAYS, RESAMPLE_TARGET_RAYS}
#import bevy_restir::scene::surface::Shape
#import bevy_restir::trace::ray::{rays_traced, trace_flags}
#import bevy_restir::view::bindings::{ray_counts, view, visibility}
#import bevy_restir::view::camera::{camera_position, project}

// Of the last frame, or of this frame's last round.
@group(2) @binding(1) var<storage, read> neighbours: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(3) var previous_visibility: texture_2d<u32>;
// What the pixel's own sample carries, where a domain hands it on.
@group(2) @binding(4) var own_light: texture_2d<f32>;
@group(2) @binding(5) var resampled: texture_storage_2d<rgba32float, write>;

// What the pixel's own sample and those of its neighbours bring to the step; the pixel's own is the first.  The samples themselves stay
// where they are and are read again: arrays of them would be most of what an invocation holds.
struct Inputs {
    pixels: array<vec2<u32>, MAX_INPUTS>,
    ucw: array<f32, MAX_INPUTS>,          // in the pixel's own domain, once they arrived there
    arrivals: array<Arrival, MAX_INPUTS>, // what arriving changed
    contributions: array<vec3<f32>, MAX_INPUTS>,
    shares: array<f32, MAX_INPUTS>,       // what each is shaded by
    asks: array<bool, MAX_INPUTS>,        // a ray before it is shaded
    seen: array<bool, MAX_INPUTS>,        // as far as that is known
}

fn has(flag: u32) -> bool {
    return (settings.flags & flag) != 0u;
}

fn ids_at(pixel: vec2<u32>) -> vec2<u32> {
    if has(RESAMPLE_FROM_PREVIOUS) {
        return textureLoad(previous_visibility, pixel, 0).xy;
    }
    return textureLoad(visibility, pixel, 0).xy;
}

fn neighbour_at(pixel: vec2<u32>) -> Receiver {
    return receiver_of(ids_at(pixel), pixel, has(RESAMPLE_FROM_PREVIOUS));
}

// The pixel's own surface among its neighbours: in the last frame, or in this one.
fn own_shape(ids: vec2<u32>, pixel: vec2<u32>) -> Shape {
    if has(RESAMPLE_FROM_PREVIOUS) {
        return previous_shape_of(ids, pixel);
    }
    return shape_of(ids, pixel, false);
}

// And its place in their image, pixels.
fn own_place(own: Shape, pixel: vec2<u32>) -> vec2<f32> {
    if has(RESAMPLE_FROM_PREVIOUS) {
        return project(view.previous, own.position) - view.previous_jitter;
    }
    return vec2<f32>(pixel) + 0.5;
}

// How far from its place a tap looks, pixels: in a disk, or for the surface itself at the nearest pixel or bilinearly at four.
fn tap_offset(is_own: bool, u: vec2<f32>) -> vec2<f32> {
    if is_own {
        return select(vec2<f32>(0.0), u - 0.5, has(RESAMPLE_BILINEAR));
    }
    return settings.radius * sqrt(u.x) * vec2<f32>(cos(6.2831853 * u.y), sin(6.2831853 * u.y));
}

fn passes_heuristics(own: Shape, ids: vec2<u32>, pixel: vec2<u32>) -> bool {
    let from_previous = has(RESAMPLE_FROM_PREVIOUS);
    let other = shape_of(ids, pixel, from_previous);
    let reach = max(distance(own.position, camera_position(from_previous)), 1.0e-20);
    return are_alike(own, other, reach, settings.normal_threshold, settings.depth_threshold)
        && (own.material == other.material || !has(RESAMPLE_SAME_MATERIAL));
}

// A neighbour for one tap; NONE where none is found.  Only geometry and random numbers decide: by what neighbours keep it would be biased.
fn find_neighbour(own: Shape, place: vec2<f32>, is_own: bool, rng: ptr<function, Rng>) -> vec2<u32> {
    let tries = select(settings.tries, 1u, is_own);
    for (var t = 0u; t < tries; t++) {
        let at = place + tap_offset(is_own, rng_2(rng));
        if any(at < vec2<f32>(0.0)) || any(at >= vec2<f32>(view.size)) {
            continue;
        }
        let pixel = min(vec2<u32>(at), view.size - 1u);
        let ids = ids_at(pixel);
        if ids.x == NONE {
            continue;
        }
        if !has(RESAMPLE_HEURISTICS) || passes_heuristics(own, ids, pixel) {
            return pixel;
        }
    }
    return vec2<u32>(NONE);
}

fn own_sample(pixel: vec2<u32>) -> Reservoir {
    let index = reservoir_index(pixel, view.size, settings.tiling);
    if has(RESAMPLE_FROM_PREVIOUS) {
        return reservoir_unpack(reservoirs[index]);
    }
    return reservoir_unpack(neighbours[index]);
}

fn sample_of_neighbour(pixel: vec2<u32>) -> Reservoir {
    var s = reservoir_unpack(neighbours[reservoir_index(pixel, view.size, settings.tiling)]);
    if has(RESAMPLE_FROM_PREVIOUS) {
        s = of_this_frame(s);
    }
    // History counts at most so much; before any weight, and whatever the sample is, or it would be biased.
    s.confidence = min(s.confidence, settings.confidence_cap);
    return s;
}

// An input's sample, as its pixel keeps it or as it arrived in the pixel's own domain.
fn sample_of(inputs: ptr<function, Inputs>, j: u32, has_arrived: bool) -> Reservoir {
    if j == 0u {
        return own_sample((*inputs).pixels[0]);
    }
    var s = sample_of_neighbour((*inputs).pixels[j]);
    if has_arrived {
        s = arrived(s, (*inputs).arrivals[j]);
    }
    s.ucw = (*inputs).ucw[j];
    return s;
}

// Collects the inputs.  Where the surface itself was not in sight more neighbours are asked (Wyman and Panteleev 2021, 6.4).
fn gather(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, own: Shape, pixel: vec2<u32>, rng: ptr<function, Rng>) {
    let place = own_place(own, pixel);
    let own_kept = own_sample(pixel);
    (*inputs).pixels[0] = pixel;
    (*inputs).ucw[0] = own_kept.ucw;
    (*inputs).asks[0] = has(RESAMPLE_SHADING_RAYS) && !has(RESAMPLE_SEEN);
    (*inputs).seen[0] = true;
    (*mis).confidence[0] = own_kept.confidence;
    var count = 1u;
    var taps = settings.temporal_taps + settings.spatial_taps;
    for (var i = 0u; i < taps && count < MAX_INPUTS; i++) {
        let is_own = i < settings.temporal_taps;
        let at = find_neighbour(own, place, is_own, rng);
        if at.x == NONE {
            taps = max(taps, select(0u, settings.temporal_taps + settings.disocclusion_taps, is_own));
            continue;
        }
        let s = sample_of_neighbour(at);
        // What was seen when it was shaded, the surface itself and near neighbours are taken to see still (Wyman and Panteleev 2021,
        // 7.3).
        let near = is_own || distance(vec2<f32>(at) + 0.5, place) <= settings.visibility_radius;
        let is_reused = has(RESAMPLE_REUSE_VISIBILITY) && near;
        (*inputs).pixels[count] = at;
        (*inputs).ucw[count] = s.ucw;
        (*inputs).asks[count] = has(RESAMPLE_SHADING_RAYS) && !is_reused;
        (*inputs).seen[count] = s.seen || !is_reused;
        (*mis).confidence[count] = s.confidence;
        count += 1u;
    }
    (*mis).count = count;
}

// One of the inputs, and the share of each.
fn resample(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, rng: ptr<function, Rng>) -> Stream {
    var stream = Stream(0.0, NONE);
    for (var j = 0u; j < (*mis).count; j++) {
        let u = rng_1(rng);
        let ucw = (*inputs).ucw[j];
        if ucw > 0.0 {
            (*inputs).shares[j] = mis_weight(mis, settings.mis, j) * ucw;
            _ = stream_add(&stream, j, (*inputs).shares[j] * (*mis).targets[j], u);
        }
    }
    return stream;
}

// A sample in the pixel's own domain: there it stays.
fn bring(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, j: u32, s: Reservoir, e: Evaluated, value: f32) {
    (*inputs).contributions[j] = select(vec3<f32>(0.0), e.f, value > 0.0);
    if j == 0u {
        return;
    }
    let jacobian = jacobian_of(e);
    if !(jacobian > 0.0) {
        // It has no counterpart here.
        (*inputs).ucw[j] = 0.0;
        return;
    }
    (*mis).targets[j * MAX_INPUTS + j] = own_target(s) / jacobian;
    (*inputs).arrivals[j] = arrival_of(e);
    (*inputs).ucw[j] *= jacobian;
}

// The next input from `j` on whose sample is to be evaluated in a domain.
fn next_asked(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, domain: u32, from_input: u32) -> u32 {
    // The pixel's own is handed on; what a path is worth where it came from is known as long as nothing moved.
    for (var j = from_input; j < (*mis).count; j++) {
        let is_known = domain == j && select(knows_own_target(), is_handed_on(), j == 0u);
        if !is_known && (*inputs).ucw[j] > 0.0 && mis_needs_target(settings.mis, domain, j) {
            return j;
        }
    }
    return (*mis).count;
}

// Targets of every domain at every sample that the weights ask for, and what is seen of what is shaded; then the step itself.
fn combine(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, r: Receiver, alpha_seed: u32, rng: ptr<function, Rng>) -> Stream {
    var stream = Stream(0.0, NONE);
    let asks_for_kept = has(RESAMPLE_SHADE) && has(RESAMPLE_SHADING_RAYS) && !has(RESAMPLE_DECOUPLED);
    if is_handed_on() {
        (*mis).targets[0] = luminance((*inputs).contributions[0]);
    }
    // Where a ray is asked for what is kept there is one turn more: rays are traced at one place in the program.
    for (var turn = 0u; turn < (*mis).count + u32(asks_for_kept); turn++) {
        let is_last = turn == (*mis).count;
        let domain = select(turn, 0u, is_last);
        var j = 0u;
        if is_last {
            count_confidence(mis);
            stream = resample(inputs, mis, rng);
            j = min(stream.selected, (*mis).count);
        } else {
            j = next_asked(inputs, mis, domain, 0u);
        }
        var receiver = r;
        if domain > 0u {
            receiver = neighbour_at((*inputs).pixels[domain]);
        }
        while j < (*mis).count {
            let s = sample_of(inputs, j, domain > 0u || is_last);
            let e = evaluate(receiver, s);
            var value = target_value(e);
            // A sample is seen from where it was kept; elsewhere a ray decides.
            let asked_by_target = !is_last && domain != j && has(select(RESAMPLE_MIS_RAYS, RESAMPLE_TARGET_RAYS, domain == 0u));
            let asked_by_shading = domain == 0u && (*inputs).asks[j] && has(RESAMPLE_SHADE) && is_last == asks_for_kept;
            if value > 0.0 && (asked_by_target || asked_by_shading) {
                // Blended surfaces let every domain see by chances of its own: weights of joint chances would not add up to 1.
                let visible = is_visible(receiver, e, alpha_seed + domain);
                if asked_by_shading {
                    (*inputs).seen[j] = visible;
                } else {
                    value = select(0.0, value, visible);
                    if domain == 0u && !visible && has(RESAMPLE_DISCARD) {
                        (*mis).confidence[j] = 0.0;
                        (*inputs).ucw[j] = 0.0;
                    }
                }
            }
            if is_last {
                break;
            }
            if domain == 0u {
                bring(inputs, mis, j, s, e, value);
            } else {
                value *= jacobian_of(e);
            }
            (*mis).targets[domain * MAX_INPUTS + j] = value;
            j = next_asked(inputs, mis, domain, j + 1u);
        }
    }
    if !asks_for_kept {
        count_confidence(mis);
        stream = resample(inputs, mis, rng);
    }
    return stream;
}

@compute @workgroup_size(8, 8)
fn reuse(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel, view.size, settings.tiling);
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || view.bounces == 0u {
        reservoirs[index] = reservoir_pack(no_reservoir());
        textureStore(resampled, pixel, vec4<f32>(0.0));
        return;
    }
    var rng = rng_new(pixel, view.frame, STREAM_REUSE + settings.round, view.seed);
    let alpha_seed = rng_bits(&rng).x;
    let r = receiver_of(ids, pixel, false);
    var inputs: Inputs;
    var mis: MisInputs;
    gather(&inputs, &mis, own_shape(ids, pixel), pixel, &rng);
    inputs.contributions[0] = textureLoad(own_light, pixel, 0).rgb;
    let stream = combine(&inputs, &mis, r, alpha_seed, &rng);

    var kept = no_reservoir();
    var light = vec3<f32>(0.0);
    for (var j = 0u; j < mis.count; j++) {
        kept.confidence += mis.confidence[j];
        light += select(0.0, inputs.shares[j], inputs.seen[j]) * inputs.contributions[j];
    }
    var carried = vec3<f32>(0.0);
    if stream.selected != NONE {
        let confidence = kept.confidence;
        kept = sample_of(&inputs, stream.selected, true);
        kept.confidence = confidence;
        kept.ucw = stream_ucw(stream, mis.targets[stream.selected]);
        kept.seen = inputs.seen[stream.selected];
        carried = inputs.contributions[stream.selected];
    }
    if !has(RESAMPLE_DECOUPLED) {
        light = select(0.0, kept.ucw, kept.seen) * carried;
    }
    reservoirs[index] = stored(kept, pixel);
    if has(RESAMPLE_SHADE) {
        textureStore(resampled, pixel, vec4<f32>(light, 0.0));
    } else if is_handed_on() {
        textureStore(resampled, pixel, vec4<f32>(carried, 0.0));
    }
    let counted = textureLoad(ray_counts, pixel).x;
    textureStore(ray_counts, pixel, vec4<u32>((counted + rays_traced) | trace_flags << 24u));
}

// What an input counts may depend on geometry, never on its sample, or it would be biased.
#ifdef PLANT_CONFIDENCE_OF_SUCCESS
fn count_confidence(mis: ptr<function, MisInputs>) {
    for (var j = 1u; j < (*mis).count; j++) {
        (*mis).confidence[j] *= f32((*mis).targets[j] > 0.0);
    }
}
#else
fn count_confidence(mis: ptr<function, MisInputs>) {
}
#endif

#ifdef PLANT_NAN
fn stored(r: Reservoir, pixel: vec2<u32>) -> PackedReservoir {
    let bad = array<u32, 4>(0x7fc00000u, 0x7f800000u, 0xff800000u, 0xbf800000u);
    let kind = (pixel.x + view.frame) & 3u;
    var broken = r;
    broken.ucw = bitcast<f32>(bad[kind]);
    broken.confidence = bitcast<f32>(bad[3u - kind]);
    if all(pixel % 5u == vec2<u32>(2u)) {
        return reservoir_pack(broken);
    }
    return reservoir_pack(r);
}
#else
fn stored(r: Reservoir, pixel: vec2<u32>) -> PackedReservoir {
    return reservoir_pack(r);
}
#endif
