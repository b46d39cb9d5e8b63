// The resampling routine: one iteration of reuse.  A pixel's sample and those of its neighbors, of the last frame (Wyman and Panteleev 2021,
// 6) or of this one, are resampled into one.  With RESAMPLE_SHADE_ALL all of them are shaded by their shares (decoupled shading, ibid., 7;
// vector weights, Lin et al. 2026, supplement, 7).
//
// The kind of samples, their targets and their shifts are those of a domain, such as di, gi or pt: `domain` stands for its modules, and
// `src/shader_library.rs` puts them in.  A neighbor's sample is shifted to the pixel itself first, and from there to the pixel of every
// other input at which its MIS weight needs the target.

#import domain::{apply_shift, can_be_shifted, completed, diffuse_share, evaluate, Evaluated, find_neighbor, identity_of, in_current_frame, is_visible, jacobian_of, neighbor_radius, no_reservoir, PackedReservoir, Receiver, receiver_of, receives_light, Reservoir, reservoir_pack, reservoir_unpack, resamples, reuse_center, shift_result_of, ShiftResult, stored_target, stores_target, target_value}
#ifdef PAIRED
#import domain::{shift_from}
#import bevy_restir::restir::pairs::{pair_in_slot, pair_mask, slots_of}
#endif
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_CONTRIBUTION_WEIGHT, GUARD_TARGET, guarded}
#import bevy_restir::common::math::luminance
#import bevy_restir::common::rng::{Rng, rng_1, rng_bits}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::iteration_rng::iteration_rng
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::mis::{count_confidence, MAX_INPUTS, mis_needs_target, mis_weight, MisInputs, set_target, target_of}
#import bevy_restir::restir::neighbors::{neighbor_ids, position_around, ReuseCenter, SAME_SURFACE_RADIUS}
#ifdef PLANT_NAN
#import bevy_restir::restir::plants::{broken_number, is_planted_pass}
#endif
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::reservoir_sampling::{Stream, stream_add, stream_ucw}
#import bevy_restir::restir::types::{RESAMPLE_CANDIDATES_VISIBLE, RESAMPLE_DISCARD_OCCLUDED, RESAMPLE_FROM_PREVIOUS, RESAMPLE_MIS_RAYS, RESAMPLE_REUSE_VISIBILITY, RESAMPLE_SAME_RAYS, RESAMPLE_SHADE, RESAMPLE_SHADE_ALL, RESAMPLE_SHADING_RAYS, RESAMPLE_TARGET_RAYS}
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::light_part::{shown_light, SPLITS_LIGHT}
#import bevy_restir::view::pixel::is_in_picture
#import bevy_restir::view::ray_counter::count_rays

// Reservoirs of the last frame, or of the previous iteration of this frame.
@group(2) @binding(1) var<storage, read> neighbors: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
// The contribution of each pixel's own sample.
@group(2) @binding(4) var own_contribution: texture_2d<f32>;
@group(2) @binding(5) var resampled: texture_storage_2d<rgba32float, write>;

// The samples that are resampled; the pixel's own is the first.  Reservoirs are read again where they are needed: arrays of them would be
// most of the memory of an invocation.
struct Inputs {
    pixels: array<vec2<u32>, MAX_INPUTS>,
    ucw: array<f32, MAX_INPUTS>,                   // at the pixel itself, after the shift
    shift_results: array<ShiftResult, MAX_INPUTS>,
    contributions: array<vec3<f32>, MAX_INPUTS>,
    shares: array<f32, MAX_INPUTS>,                // MIS weight times contribution weight
    needs_ray: array<bool, MAX_INPUTS>,            // before it is shaded
    visible: array<bool, MAX_INPUTS>,              // as far as that is known
}

fn own_sample(pixel: vec2<u32>) -> Reservoir {
    let index = reservoir_index(pixel);
    if has(RESAMPLE_FROM_PREVIOUS) {
        return reservoir_unpack(reservoirs[index]);
    }
    return reservoir_unpack(neighbors[index]);
}

fn neighbor_sample(pixel: vec2<u32>) -> Reservoir {
    var s = reservoir_unpack(neighbors[reservoir_index(pixel)]);
    if has(RESAMPLE_FROM_PREVIOUS) {
        s = in_current_frame(s);
        // Confidence is capped before any weight is computed, and whatever the sample is: otherwise the cap would add bias.
        s.confidence = min(s.confidence, settings.confidence_cap);
    }
    return s;
}

// The sample of an input, as its own pixel stores it or shifted to this one.
fn sample_of(inputs: ptr<function, Inputs>, j: u32, shifted: bool) -> Reservoir {
    if j == 0u {
        return own_sample((*inputs).pixels[0]);
    }
    var s = neighbor_sample((*inputs).pixels[j]);
    if shifted {
        s = apply_shift(s, (*inputs).shift_results[j]);
    }
    s.ucw = (*inputs).ucw[j];
    return s;
}

// Where neighbors and shifts come from: a search and evaluation, or the pairs whose shifts `pass/pair_shifts.wgsl` has stored.  In pairs, the
// visibility of a shifted sample is part of the stored contribution.
#ifdef PAIRED
@group(2) @binding(6) var shifts: texture_2d_array<f32>;

// Layers of the shifts between the pixel and each input: of the input's sample to the pixel, and of the pixel's sample to the input.
var<private> layers: array<vec2<u32>, MAX_INPUTS>;
// Mask of the pixel's similar partners, and its slots that are left.
var<private> own_mask: u32;
var<private> slots: u32;

fn wanted_neighbors(pixel: vec2<u32>, canonical: Reservoir) -> u32 {
    own_mask = pair_mask(pixel);
    slots = slots_of(own_mask);
    return countOneBits(slots);
}

fn wanted_after_failure(wanted: u32, is_temporal: bool) -> u32 {
    return wanted;
}

fn next_neighbor(center: ReuseCenter, pixel: vec2<u32>, i: u32, count: u32, rng: ptr<function, Rng>) -> vec2<u32> {
    let pair = pair_in_slot(pixel, own_mask, firstTrailingBit(slots));
    slots &= slots - 1u;
    layers[count] = vec2<u32>(pair.own_layer, pair.partner_layer);
    return pair.partner;
}

// Stored shifts need no surface, and pairs no place to search from.
fn own_receiver(ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    var r: Receiver;
    return r;
}

// The split of the light into parts evaluates the surface.
fn shown_receiver(ids: vec2<u32>, pixel: vec2<u32>, r: Receiver) -> Receiver {
    if SPLITS_LIGHT {
        return receiver_of(ids, pixel, false);
    }
    return r;
}

fn own_center(ids: vec2<u32>, pixel: vec2<u32>, r: Receiver) -> ReuseCenter {
    var center: ReuseCenter;
    center.position = vec2<f32>(pixel) + 0.5;
    return center;
}

fn receiver_in(inputs: ptr<function, Inputs>, at_pixel: u32, r: Receiver) -> Receiver {
    return r;
}

fn evaluated_in(inputs: ptr<function, Inputs>, at_pixel: u32, r: Receiver, j: u32, s: Reservoir) -> Evaluated {
    let layer = select(layers[at_pixel].y, layers[j].x, at_pixel == 0u);
    return shift_from(s, textureLoad(shifts, (*inputs).pixels[at_pixel], layer, 0));
}

fn sees(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return true;
}

// Both pixels of a pair are of this frame, so that no surface of the last frame is compared.
fn showed_same_surface(ids: vec2<u32>, pixel: vec2<u32>) -> bool {
    return false;
}
#else
// A surface that was not visible in the last frame gets more neighbors (Wyman and Panteleev 2021, 6.4).  The iteration over the last frame
// detects it by a failed search (`wanted_after_failure`), later ones by a confidence of one frame.
fn wanted_neighbors(pixel: vec2<u32>, canonical: Reservoir) -> u32 {
    let wanted = settings.temporal_samples + settings.spatial_samples;
    if !has(RESAMPLE_FROM_PREVIOUS) && canonical.confidence <= 1.0 {
        return max(wanted, settings.disocclusion_samples);
    }
    return wanted;
}

fn wanted_after_failure(wanted: u32, is_temporal: bool) -> u32 {
    return max(wanted, select(0u, settings.temporal_samples + settings.disocclusion_samples, is_temporal));
}

fn next_neighbor(center: ReuseCenter, pixel: vec2<u32>, i: u32, count: u32, rng: ptr<function, Rng>) -> vec2<u32> {
    return find_neighbor(center, i < settings.temporal_samples, rng);
}

fn own_receiver(ids: vec2<u32>, pixel: vec2<u32>) -> Receiver {
    return receiver_of(ids, pixel, false);
}

fn shown_receiver(ids: vec2<u32>, pixel: vec2<u32>, r: Receiver) -> Receiver {
    return r;
}

fn own_center(ids: vec2<u32>, pixel: vec2<u32>, r: Receiver) -> ReuseCenter {
    return reuse_center(ids, pixel, neighbor_radius(r));
}

fn receiver_in(inputs: ptr<function, Inputs>, at_pixel: u32, r: Receiver) -> Receiver {
    if at_pixel == 0u {
        return r;
    }
    let pixel = (*inputs).pixels[at_pixel];
    return receiver_of(neighbor_ids(pixel), pixel, has(RESAMPLE_FROM_PREVIOUS));
}

fn evaluated_in(inputs: ptr<function, Inputs>, at_pixel: u32, r: Receiver, j: u32, s: Reservoir) -> Evaluated {
    return evaluate(r, s);
}

fn sees(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return is_visible(r, e, alpha_seed);
}

// Where surfaces are blended, frames with the same rays may show different ones.
fn showed_same_surface(ids: vec2<u32>, pixel: vec2<u32>) -> bool {
    return all(neighbor_ids(pixel) == ids);
}
#endif

fn gather_inputs(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, center: ReuseCenter, pixel: vec2<u32>, rng: ptr<function, Rng>) {
    let canonical = own_sample(pixel);
    (*inputs).pixels[0] = pixel;
    (*inputs).ucw[0] = canonical.ucw;
    (*inputs).needs_ray[0] = has(RESAMPLE_SHADING_RAYS) && !has(RESAMPLE_CANDIDATES_VISIBLE);
    (*inputs).visible[0] = true;
    (*mis).confidence[0] = canonical.confidence;
    var count = 1u;
    var wanted = wanted_neighbors(pixel, canonical);
    for (var i = 0u; i < wanted && count < MAX_INPUTS; i++) {
        let is_temporal = i < settings.temporal_samples;
        let at = next_neighbor(center, pixel, i, count, rng);
        if at.x == NONE {
            wanted = wanted_after_failure(wanted, is_temporal);
            continue;
        }
        let s = neighbor_sample(at);
        // The visibility of the surface itself and of near neighbors is reused (Wyman and Panteleev 2021, 7.3).
        let reach = max(settings.visibility_radius, select(0.0, SAME_SURFACE_RADIUS, is_temporal));
        let reuses_visibility = has(RESAMPLE_REUSE_VISIBILITY) && distance(vec2<f32>(at) + 0.5, center.position) <= reach;
        (*inputs).pixels[count] = at;
        (*inputs).ucw[count] = s.ucw;
        (*inputs).needs_ray[count] = has(RESAMPLE_SHADING_RAYS) && !reuses_visibility;
        (*inputs).visible[count] = s.seen || !reuses_visibility;
        (*mis).confidence[count] = s.confidence * (1.0 - settings.decorrelation * share_of_copies(s, at, rng));
        count += 1u;
    }
    (*mis).count = count;
}

// Number of pixels that are compared with a neighbor.
const COMPARED_PIXELS: u32 = 8u;

// Share of the pixels around a neighbor in the last frame that hold the same sample as the neighbor.
fn share_of_copies(s: Reservoir, at: vec2<u32>, rng: ptr<function, Rng>) -> f32 {
    if settings.decorrelation == 0.0 || s.ucw == 0.0 {
        return 0.0;
    }
    let identity = identity_of(neighbors[reservoir_index(at)]);
    var copies = 0u;
    for (var i = 0u; i < COMPARED_PIXELS; i++) {
        let position = position_around(at, rng);
        if is_in_picture(position) {
            copies += u32(all(identity_of(neighbors[reservoir_index(vec2<u32>(position))]) == identity));
        }
    }
    return f32(copies) / f32(COMPARED_PIXELS);
}

// Selects one of the inputs, and computes the share of each.
fn select_input(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, rng: ptr<function, Rng>) -> Stream {
    var stream = Stream(0.0, NONE);
    for (var j = 0u; j < (*mis).count; j++) {
        let u = rng_1(rng);
        let ucw = (*inputs).ucw[j];
        if ucw > 0.0 {
            (*inputs).shares[j] = mis_weight(mis, settings.mis, j) * ucw;
            _ = stream_add(&stream, j, (*inputs).shares[j] * target_of(mis, 0u, j), u);
        }
    }
    return stream;
}

// Stores the result of shifting an input to this pixel.
fn accept_shift(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, j: u32, s: Reservoir, e: Evaluated, value: f32) {
    (*inputs).contributions[j] = select(vec3<f32>(0.0), e.f, value > 0.0);
    if j == 0u {
        return;
    }
    let jacobian = jacobian_of(e);
    if !(jacobian > 0.0) {
        // The shift is not defined.
        (*inputs).ucw[j] = 0.0;
        return;
    }
    set_target(mis, j, j, guarded(known_target(inputs, j, s) / jacobian, GUARD_TARGET));
    (*inputs).shift_results[j] = shift_result_of(e);
    (*inputs).ucw[j] = guarded((*inputs).ucw[j] * jacobian, GUARD_CONTRIBUTION_WEIGHT);
}

// Whether p̂ of a neighbor's sample in its own pixel is known: from its reservoir, or from the contribution that a pass of this frame wrote.
fn knows_targets() -> bool {
    return stores_target() || !has(RESAMPLE_FROM_PREVIOUS);
}

fn known_target(inputs: ptr<function, Inputs>, j: u32, s: Reservoir) -> f32 {
    if stores_target() {
        return stored_target(s);
    }
    return luminance(textureLoad(own_contribution, (*inputs).pixels[j], 0).rgb);
}

// The next input, from `from_input` on, whose target at a pixel is needed and not known yet.
fn next_to_evaluate(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, at_pixel: u32, from_input: u32) -> u32 {
    for (var j = from_input; j < (*mis).count; j++) {
        // The pixel's own contribution is known, too; it is evaluated for the ray of a sample that has not been tested.
        let is_known = at_pixel == j && select(knows_targets(), !(*inputs).needs_ray[0], j == 0u);
        // Without a target at the pixel itself a sample is not selected and brings no light, so that its MIS weight does not matter.  Nor
        // do targets of a pixel without confidence.
        let matters = at_pixel == 0u || (target_of(mis, 0u, j) > 0.0 && (*mis).confidence[at_pixel] > 0.0);
        if matters && !is_known && (*inputs).ucw[j] > 0.0 && mis_needs_target(settings.mis, at_pixel, j) {
            return j;
        }
    }
    return (*mis).count;
}

// Whether input 1 is the pixel itself in the last frame, and nothing has changed since.  The shift, where a sample has one, is then the
// identity: both pixels have the same targets, and a sample that the last frame stored is visible.
fn is_same_pixel(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, ids: vec2<u32>) -> bool {
    return has(RESAMPLE_SAME_RAYS) && (*mis).count > 1u && all((*inputs).pixels[1] == (*inputs).pixels[0])
        && showed_same_surface(ids, (*inputs).pixels[0]);
}

// The targets at input 1, where its shift is the identity.
fn set_identity_targets(mis: ptr<function, MisInputs>, own: Reservoir) {
    for (var j = 0u; j < (*mis).count; j++) {
        set_target(mis, 1u, j, select(0.0, target_of(mis, 0u, j), j > 0u || can_be_shifted(own)));
    }
}

// A turn of `resample`, which evaluates samples at the pixel of an input.
struct Turn {
    at_pixel: u32,             // index of the input
    target_rays: bool,         // rays decide which targets are 0
    sees_second: bool,         // input 1 is known to be visible
    shading_rays: bool,        // rays decide which samples are shaded
}

// The target of sample j, which `e` evaluates at the pixel of a turn; 0 if targets include visibility and the sample is occluded.  A ray
// for shading only sets whether the sample is visible.
fn tested_value(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, turn: Turn, j: u32, r: Receiver, e: Evaluated, alpha_seed: u32) -> f32 {
    var value = target_value(e);
    // A sample is visible from the pixel that stores it; elsewhere a ray decides.
    let for_target = turn.target_rays && turn.at_pixel != j && !(turn.sees_second && j == 1u);
    let for_shading = turn.shading_rays && (*inputs).needs_ray[j];
    if value > 0.0 && (for_target || for_shading) {
        // Each pixel sees blended surfaces by random numbers of its own: with joint ones the MIS weights would not sum to 1.
        let visible = sees(r, e, alpha_seed + turn.at_pixel);
        if for_shading {
            (*inputs).visible[j] = visible;
        } else {
            value = select(0.0, value, visible);
            if turn.at_pixel == 0u && !visible && has(RESAMPLE_DISCARD_OCCLUDED) {
                (*mis).confidence[j] = 0.0;
                (*inputs).ucw[j] = 0.0;
            }
        }
    }
    return value;
}

// Evaluates the targets that the MIS weights need, and the visibility of the samples that are shaded; then selects an input.
fn resample(inputs: ptr<function, Inputs>, mis: ptr<function, MisInputs>, ids: vec2<u32>, r: Receiver, alpha_seed: u32, rng: ptr<function, Rng>) -> Stream {
    var stream = Stream(0.0, NONE);
    // One turn for each pixel whose targets are needed.  If only the selected sample is shaded, a last turn tests its visibility: in the
    // same loop, so that the program has one call that traces rays.
    let traces_selected = has(RESAMPLE_SHADE) && has(RESAMPLE_SHADING_RAYS) && !has(RESAMPLE_SHADE_ALL);
    set_target(mis, 0u, 0u, guarded(luminance((*inputs).contributions[0]), GUARD_TARGET));
    let is_same = !traces_selected && is_same_pixel(inputs, mis, ids);
    // Both loops test at their ends: after a `break` at the start, a CPU driver would run the whole body once more with all lanes off.
    let turns = (*mis).count + u32(traces_selected);
    var index = 0u;
    loop {
        let shades_selected = index == (*mis).count;
        let at_pixel = select(index, 0u, shades_selected);
        let target_rays = !shades_selected && has(select(RESAMPLE_MIS_RAYS, RESAMPLE_TARGET_RAYS, at_pixel == 0u));
        let shading_rays = at_pixel == 0u && has(RESAMPLE_SHADE) && shades_selected == traces_selected;
        var j = 0u;
        if shades_selected {
            count_confidence(mis);
            stream = select_input(inputs, mis, rng);
            j = min(stream.selected, (*mis).count);
        } else {
            j = next_to_evaluate(inputs, mis, at_pixel, 0u);
        }
        if j < (*mis).count {
            let receiver = receiver_in(inputs, at_pixel, r);
            loop {
                let s = sample_of(inputs, j, at_pixel > 0u || shades_selected);
                let e = evaluated_in(inputs, at_pixel, receiver, j, s);
                var value = tested_value(inputs, mis, Turn(at_pixel, target_rays, is_same && at_pixel == 0u, shading_rays), j, receiver, e, alpha_seed);
                if shades_selected {
                    break;
                }
                if at_pixel == 0u {
                    accept_shift(inputs, mis, j, s, e, value);
                } else {
                    value *= jacobian_of(e);
                }
                set_target(mis, at_pixel, j, guarded(value, GUARD_TARGET));
                j = next_to_evaluate(inputs, mis, at_pixel, j + 1u);
                if j >= (*mis).count {
                    break;
                }
            }
        }
        index += select(1u, 2u, is_same && index == 0u);
        if index >= turns {
            break;
        }
    }
    if is_same {
        set_identity_targets(mis, own_sample((*inputs).pixels[0]));
    }
    if !traces_selected {
        count_confidence(mis);
        stream = select_input(inputs, mis, rng);
    }
    return stream;
}

fn store_nothing(pixel: vec2<u32>, index: u32) {
    reservoirs[index] = reservoir_pack(no_reservoir());
    textureStore(resampled, pixel, vec4<f32>(0.0));
}

@compute @workgroup_size(8, 8)
fn reuse(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy + view.first_pixel;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel);
    let ids = textureLoad(visibility, pixel, 0).xy;
    if !receives_light(ids) || view.bounces == 0u {
        store_nothing(pixel, index);
        return;
    }
    let r = own_receiver(ids, pixel);
    if !resamples(r) {
        store_nothing(pixel, index);
        return;
    }
    var rng = iteration_rng(pixel);
    let alpha_seed = rng_bits(&rng).x;
    var inputs: Inputs;
    var mis: MisInputs;
    gather_inputs(&inputs, &mis, own_center(ids, pixel, r), pixel, &rng);
    inputs.contributions[0] = textureLoad(own_contribution, pixel, 0).rgb;
    let stream = resample(&inputs, &mis, ids, r, alpha_seed, &rng);
    let shown_by = shown_receiver(ids, pixel, r);
    var output = no_reservoir();
    var light = vec4<f32>(0.0);
    var contribution = vec3<f32>(0.0);
    if stream.selected != NONE {
        output = sample_of(&inputs, stream.selected, true);
        output.ucw = stream_ucw(stream, target_of(&mis, 0u, stream.selected));
        output.seen = inputs.visible[stream.selected];
        contribution = inputs.contributions[stream.selected];
        if !has(RESAMPLE_SHADE_ALL) {
            light = select(0.0, output.ucw, output.seen) * shown_contribution(&inputs, stream.selected, shown_by);
        }
    }
    output.confidence = 0.0;
    for (var j = 0u; j < mis.count; j++) {
        output.confidence += mis.confidence[j];
        if has(RESAMPLE_SHADE_ALL) {
            light += select(0.0, inputs.shares[j], inputs.visible[j]) * shown_contribution(&inputs, j, shown_by);
        }
    }
    output = completed(r, output, rng_bits(&rng).x);
    reservoirs[index] = stored(output, pixel);
    textureStore(resampled, pixel, select(vec4<f32>(contribution, 0.0), light, has(RESAMPLE_SHADE)));
    count_rays(pixel);
}

// The part of an input's contribution that is shown (`view/light_part.wgsl`).
#ifdef SPLIT_LIGHT
fn shown_contribution(inputs: ptr<function, Inputs>, j: u32, r: Receiver) -> vec4<f32> {
    let contribution = (*inputs).contributions[j];
    if !has(RESAMPLE_SHADE) || !any(contribution > vec3<f32>(0.0)) {
        return vec4<f32>(0.0);
    }
    let share = diffuse_share(r, sample_of(inputs, j, true), textureLoad(own_contribution, (*inputs).pixels[0], 0).a);
    return shown_light(contribution, share);
}
#else
fn shown_contribution(inputs: ptr<function, Inputs>, j: u32, r: Receiver) -> vec4<f32> {
    return shown_light((*inputs).contributions[j], vec3<f32>(0.0));
}
#endif

#ifdef PLANT_NAN
fn stored(r: Reservoir, pixel: vec2<u32>) -> PackedReservoir {
    let kind = (pixel.x + view.frame) & 3u;
    var broken = r;
    broken.ucw = broken_number(kind);
    broken.confidence = broken_number(3u - kind);
    if is_planted_pass() && all(pixel % 5u == vec2<u32>(2u)) {
        return reservoir_pack(broken);
    }
    return reservoir_pack(r);
}
#else
fn stored(r: Reservoir, pixel: vec2<u32>) -> PackedReservoir {
    return reservoir_pack(r);
}
#endif
