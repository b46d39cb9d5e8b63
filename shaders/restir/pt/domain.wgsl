// ReSTIR PT: the domain of whole paths, which the hybrid shift takes from pixel to pixel (Lin et al. 2026).  It defines the
// functions that the resampling routine (`pass/reuse.wgsl`) calls.
#define_import_path bevy_restir::restir::pt::domain

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::light::remap::current_light_id
#import bevy_restir::light::types::ENVIRONMENT_LIGHT
#import bevy_restir::path::technique_weights::{LightShares, TechniqueCounts}
#import bevy_restir::path::walk::Vertex
#import bevy_restir::restir::connection::count::connections_of_vertex
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::path_sample::{PathSample, ShiftResult, shift_result, TERMINATION_ENVIRONMENT, TERMINATION_NEE, with_shift_result}
#import bevy_restir::restir::pt::initial_candidates::SelectedPath
#import bevy_restir::restir::shift::hybrid::{hybrid_shift, replays}
#import bevy_restir::restir::shift::reconnection::{separation_threshold, ShiftParameters}
#import bevy_restir::restir::shift::shifted_path::{is_unoccluded, ShiftedPath}
#import bevy_restir::restir::stored_path::Reservoir
#import bevy_restir::restir::types::{RESAMPLE_DIFFUSE_SECONDARY, RESAMPLE_MOVED, RESAMPLE_RETRACE_BACKWARD, RESAMPLE_RETRACE_FORWARD, RESAMPLE_SAME_DENSITIES}
#import bevy_restir::view::camera::{camera_density, camera_of, camera_position, eye_of}
#import bevy_restir::view::primary::primary_surface
#ifdef SPLIT_LIGHT
#import bevy_restir::bsdf::types::LOBE_DIFFUSE
#import bevy_restir::light::point_on_light::light_point_at
#import bevy_restir::restir::connection::connection::{connected_direction, ends_with_connection}
#import bevy_restir::path::scattering::drawn_choice
#import bevy_restir::path::walk::drawn_step
#import bevy_restir::view::light_part::bsdf_diffuse_share
#endif

// Paths of one scattering event, direct light, are among the candidates.
const SHORTEST_LENGTH: u32 = 2u;

// A pixel's surface, in this frame or the last, and the parameters of shifts to it.
struct Receiver {
    first: Vertex,
    shift: ShiftParameters,
    previous: bool,
}

// A path, shifted to a receiver.
struct Evaluated {
    f: vec3<f32>,              // contribution without visibility
    shifted: ShiftedPath,
}

fn receiver_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Receiver {
    let s = primary_surface(ids, pixel, previous);
    let v = Vertex(s.surface, s.wo, vec3<f32>(0.0), s.cone);
    return Receiver(v, shift_parameters(eye_of(s.surface.position, previous), v, previous), previous);
}

fn shift_parameters(eye: vec3<f32>, v: Vertex, previous: bool) -> ShiftParameters {
    return ShiftParameters(
        settings.reconnection,
        separation_threshold(settings.reconnection, settings.separation, eye, v.surface),
        settings.roughness,
        settings.jacobian_limit,
        technique_counts(),
        density_of_camera(v, previous),
        has(RESAMPLE_DIFFUSE_SECONDARY),
    );
}

// A candidate in the measure of the domain.
fn in_domain_measure(c: SelectedPath, r: Receiver) -> SelectedPath {
    return c;
}

// Numbers of samples that compete for the light of a path.
fn technique_counts() -> TechniqueCounts {
    let shares = LightShares(settings.nee_share, settings.caustic_share);
    return TechniqueCounts(settings.candidates, f32(settings.splats), connections_of_vertex(), shares);
}

#ifdef LIGHT_PATHS
fn density_of_camera(v: Vertex, previous: bool) -> f32 {
    return camera_density(camera_of(previous), v.wo, distance(v.surface.position, camera_position(previous)));
}
#else
fn density_of_camera(v: Vertex, previous: bool) -> f32 {
    return 0.0;
}
#endif

fn shifted_to(r: Receiver, path: PathSample) -> ShiftedPath {
    return hybrid_shift(path, r.first, r.shift, r.previous, retraces(r.previous));
}

// Where something moved between the frames, the path after the reconnection vertex is replayed in this frame, in the last one, or both.
#ifdef WITHIN_FRAME
fn retraces(previous: bool) -> bool {
    return false;
}
#else
fn retraces(previous: bool) -> bool {
    return has(RESAMPLE_MOVED) && has(select(RESAMPLE_RETRACE_FORWARD, RESAMPLE_RETRACE_BACKWARD, previous));
}
#endif

fn evaluate(r: Receiver, s: Reservoir) -> Evaluated {
    let shifted = shifted_to(r, s.path);
    return Evaluated(shifted.f, shifted);
}

// Whether the shift of a sample to its own pixel is defined.  With settings for which it may fail, `every_path_shifts_to_its_own_pixel` in
// src/technique/reuse_schedule.rs turns off the shortcut for unchanged frames, which alone asks.
fn can_be_shifted(s: Reservoir) -> bool {
    return true;
}

// Whether `evaluate` finds vertices by rays, for a sample of this frame.
fn needs_replay(r: Receiver, s: Reservoir) -> bool {
    return replays(s.path, r.first);
}

// Share of a path's light that the receiver scatters diffusely.  A path goes on by one lobe; NEE samples all of them at once.
#ifdef SPLIT_LIGHT
fn diffuse_share(r: Receiver, s: Reservoir, packed_splat_share: f32) -> vec3<f32> {
    let v = r.first;
    let path = s.path;
    if drawn_choice(v, path.seed, 1u).below {
        return vec3<f32>(1.0);
    }
    if path.termination == TERMINATION_NEE && path.length == 2u {
        return bsdf_diffuse_share(v.surface.bsdf, v.wo, light_point_at(path.light, v.surface.position, false).wi);
    }
    if ends_with_connection(path) && path.length == 2u {
        return bsdf_diffuse_share(v.surface.bsdf, v.wo, connected_direction(v.surface.position, path));
    }
    var lobe = path.lobe_before;
    if path.reconnection != 2u {
        lobe = drawn_step(v, path.seed, 1u).lobe;
    }
    return vec3<f32>(f32(lobe == LOBE_DIFFUSE));
}
#endif

// p̂: the resampling routine selects by it.
fn target_value(e: Evaluated) -> f32 {
    return luminance(e.f);
}

fn jacobian_of(e: Evaluated) -> f32 {
    return e.shifted.jacobian;
}

fn shift_result_of(e: Evaluated) -> ShiftResult {
    return e.shifted.result;
}

// Paired reuse keeps the contribution and the Jacobian of a shift to a visible path (`kept_shift`), and restores the shift from them
// (`shift_from`).  Within a frame the light after the reconnection vertex and its MIS coefficients stay as they are.
fn kept_shift(e: Evaluated) -> vec4<f32> {
    return vec4<f32>(e.f, e.shifted.jacobian);
}

fn shift_from(s: Reservoir, kept: vec4<f32>) -> Evaluated {
    var shifted: ShiftedPath;
    shifted.f = kept.rgb;
    shifted.jacobian = kept.a;
    shifted.density = kept.a * s.path.density;
    var path = s.path;
    path.density = shifted.density;
    path.target_value = luminance(kept.rgb);
    shifted.result = shift_result(path);
    return Evaluated(kept.rgb, shifted);
}

fn apply_shift(s: Reservoir, r: ShiftResult) -> Reservoir {
    return Reservoir(with_shift_result(s.path, r), s.ucw, s.confidence, s.seen);
}

// Whether p̂ in the sample's own pixel is known from the reservoir.  It is that of the last frame's scene, so that motion of objects leaves it
// as it is; but its MIS weights contain the probabilities of lights, and all pixels must use the same ones.  Copied weights stay as they are.
#ifdef COPIED_MIS
fn stores_target() -> bool {
    return true;
}
#else
fn stores_target() -> bool {
    return !has(RESAMPLE_MOVED) || has(RESAMPLE_SAME_DENSITIES);
}
#endif

fn stored_target(s: Reservoir) -> f32 {
    return s.path.target_value;
}

// The alpha seed of a path is its own, whichever pixel traces it.
fn is_visible(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return is_unoccluded(e.shifted, r.previous);
}

// Whether a pixel resamples; the reservoirs of others stay empty.
fn resamples(r: Receiver) -> bool {
    return true;
}

// Radius of the disk that neighbors are in, pixels.
fn neighbor_radius(r: Receiver) -> f32 {
    return settings.radius;
}

// The sample that a pixel stores.
fn completed(r: Receiver, s: Reservoir, bits: u32) -> Reservoir {
    return s;
}

// A sample of the last frame, with the light ids of this frame.  A path to a light that was removed has the weight 0 and keeps its
// confidence.
fn in_current_frame(s: Reservoir) -> Reservoir {
    let path = path_in_current_frame(s.path);
    return Reservoir(path, select(0.0, s.ucw, path.length > 0u), s.confidence, s.seen);
}

fn path_in_current_frame(path: PathSample) -> PathSample {
    var p = path;
    if path.termination == TERMINATION_NEE || path.light.light != NONE {
        p.light.light = current_light_id(path.light.light);
        p.length = select(path.length, 0u, p.light.light == NONE);
    } else if path.termination == TERMINATION_ENVIRONMENT && current_light_id(ENVIRONMENT_LIGHT) == NONE {
        p.length = 0u;
    }
    return p;
}
