// The domain of splats: light sub-paths whose end the camera sees.  Samples are reused from the last frame only, by random replay (Hedstrom
// et al. 2025, 5 and A).  It defines the functions that the resampling routine (`pass/reuse.wgsl`) calls.
//
// The measure is the counting measure of lights times primary sample space, so that the Jacobian of the shift is 1.  A replayed sub-path
// lands in a pixel of its own choice.  Two passes before the routine (`pass/splats_forward.wgsl`, `pass/splats_gather.wgsl`) replay the
// samples of the last frame in this one and give each pixel one of those that land in it, which is its only neighbor.
#define_import_path bevy_restir::restir::splats::domain

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::common::rng::Rng
#import bevy_restir::light::select::light_pmf
#import bevy_restir::restir::bdpt::splat::replayed_splat
#import bevy_restir::restir::bdpt::splat::Splat
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::neighbors::ReuseCenter
#import bevy_restir::restir::splats::reservoir::Reservoir
#import bevy_restir::restir::types::RESAMPLE_STILL
#import bevy_restir::view::bindings::view
#ifdef SPLIT_LIGHT
#import bevy_restir::view::light_part::unpack_share
#endif

// Receiver of a sample: any pixel of this frame, or of the last one, since a replayed sub-path chooses its pixel.
struct Receiver {
    previous: bool,
}

// A sample, shifted to a receiver.
struct Evaluated {
    f: vec3<f32>,
}

struct ShiftResult {
    f: vec3<f32>,
}

// Whether the samples of the last frame must be replayed.
fn has_changed() -> bool {
    return !has(RESAMPLE_STILL);
}

// `Reservoir::f` of a splat.
fn contribution_of(s: Splat, light: u32) -> vec3<f32> {
    return s.value * (f32(settings.splats) * light_pmf(light));
}

// Every pixel: light paths land anywhere in it, also where its camera ray misses all surfaces.
fn receives_light(ids: vec2<u32>) -> bool {
    return true;
}

fn receiver_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Receiver {
    return Receiver(previous);
}

fn resamples(r: Receiver) -> bool {
    return true;
}

// Samples have no neighbors in other pixels.
fn neighbor_radius(r: Receiver) -> f32 {
    return 0.0;
}

fn reuse_center(ids: vec2<u32>, pixel: vec2<u32>, radius: f32) -> ReuseCenter {
    var center: ReuseCenter;
    center.position = vec2<f32>(pixel) + 0.5;
    return center;
}

fn find_neighbor(center: ReuseCenter, is_temporal: bool, rng: ptr<function, Rng>) -> vec2<u32> {
    return vec2<u32>(center.position);
}

// Both samples of a pixel are stored with their contribution to it.
fn evaluate(r: Receiver, s: Reservoir) -> Evaluated {
    if !r.previous || !has_changed() {
        return Evaluated(s.f);
    }
    let splat = replayed_splat(s.path, s.frame, s.light, s.events, true);
    return Evaluated(select(contribution_of(splat, s.light), vec3<f32>(0.0), splat.pixel == NONE));
}

// Share of a sample's light that the surface of its vertex scatters diffusely.  The pixel's own sample stands for all splats of this
// frame with their color (`pass/splats.wgsl`), and `packed_splat_share` holds the share of all of them.
#ifdef SPLIT_LIGHT
fn diffuse_share(r: Receiver, s: Reservoir, packed_splat_share: f32) -> vec3<f32> {
    return unpack_share(select(bitcast<f32>(s.diffuse), packed_splat_share, s.frame == view.frame));
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
    return 1.0;
}

fn shift_result_of(e: Evaluated) -> ShiftResult {
    return ShiftResult(e.f);
}

fn apply_shift(s: Reservoir, r: ShiftResult) -> Reservoir {
    return s;
}

// The target in the last frame is known as long as nothing changed.
fn stores_target() -> bool {
    return !has_changed();
}

fn stored_target(s: Reservoir) -> f32 {
    return luminance(s.f);
}

// A vertex that the camera does not see has the contribution 0.
fn is_visible(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return true;
}

fn completed(r: Receiver, s: Reservoir, bits: u32) -> Reservoir {
    return s;
}

// The neighbor is of this frame already.
fn in_current_frame(s: Reservoir) -> Reservoir {
    return s;
}
