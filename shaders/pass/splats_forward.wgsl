// Replays the sample of each pixel of the last frame in this one, and adds it to the list of the pixel that it lands in (Hedstrom et al.
// 2025, 5 and A).  Where nothing changed it lands where it was, with the same contribution.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_SHIFT_CONTRIBUTION, guarded_3}
#import bevy_restir::common::math::luminance
#import bevy_restir::light::remap::current_light_id
#import bevy_restir::restir::bdpt::splat::replayed_splat
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::splats::domain::{contribution_of, has_changed}
#import bevy_restir::restir::splats::reservoir::{PackedReservoir, Reservoir, reservoir_unpack, WORD_CONFIDENCE, WORD_DIFFUSE, WORD_FRAME, WORD_HEAD, WORD_LIGHT, WORD_NEXT, WORD_RED, WORD_UCW, WORDS}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::ray_counter::count_rays

// The reservoirs of the last frame.  Their lists are empty.
@group(2) @binding(1) var<storage, read_write> words: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn splats_forward(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy + view.first_pixel;
    if any(pixel >= view.size) || settings.temporal_samples == 0u {
        return;
    }
    let index = reservoir_index(pixel);
    let r = reservoir_at(index);
    if r.ucw > 0.0 {
        forward(r, index, pixel);
    }
    count_rays(pixel);
}

fn reservoir_at(index: u32) -> Reservoir {
    let at = index * WORDS;
    return reservoir_unpack(PackedReservoir(
        atomicLoad(&words[at]),
        atomicLoad(&words[at + WORD_FRAME]),
        atomicLoad(&words[at + WORD_LIGHT]),
        bitcast<f32>(atomicLoad(&words[at + WORD_UCW])),
        bitcast<f32>(atomicLoad(&words[at + WORD_RED])),
        bitcast<f32>(atomicLoad(&words[at + WORD_RED + 1u])),
        bitcast<f32>(atomicLoad(&words[at + WORD_RED + 2u])),
        bitcast<f32>(atomicLoad(&words[at + WORD_CONFIDENCE])),
        atomicLoad(&words[at + WORD_DIFFUSE]),
        0u,
        0u,
    ));
}

fn forward(r: Reservoir, index: u32, pixel: vec2<u32>) {
    var to = index;
    var f = r.f;
    var diffuse = r.diffuse;
    let light = current_light_id(r.light);
    if has_changed() {
        if light == NONE {
            return;
        }
        let splat = replayed_splat(r.path, r.frame, light, r.events, false);
        if splat.pixel == NONE {
            return;
        }
        f = guarded_3(contribution_of(splat, light), GUARD_SHIFT_CONTRIBUTION);
        diffuse = splat.diffuse;
        to = reservoir_index(vec2<u32>(splat.pixel % view.size.x, splat.pixel / view.size.x));
    }
    if !(luminance(f) > 0.0) {
        return;
    }
    let at = index * WORDS;
    atomicStore(&words[at + WORD_LIGHT], light);
    atomicStore(&words[at + WORD_RED], bitcast<u32>(f.x));
    atomicStore(&words[at + WORD_RED + 1u], bitcast<u32>(f.y));
    atomicStore(&words[at + WORD_RED + 2u], bitcast<u32>(f.z));
    atomicStore(&words[at + WORD_DIFFUSE], diffuse);
    atomicStore(&words[at + WORD_NEXT], atomicExchange(&words[to * WORDS + WORD_HEAD], index + 1u));
}
