// ReSTIR PT's initial candidates, with the vertices of a path and of its shift to another pixel in place of contributions.  Tests run it
// instead of `shaders/pass/path_candidates.wgsl`.
//
// A block of 8 x 4 pixels shows one path, which one invocation follows: the left half shows the path in the block's own pixel, and the
// right half the path after the shift to the partner.  The first pixel of a half holds a header, and each vertex takes three more pixels.
// Values are positive, because reuse drops contributions without luminance.

#import domain::{in_domain_measure, PackedReservoir, receiver_of, Reservoir, reservoir_pack, reservoir_unpack, SHORTEST_LENGTH}
#import bevy_restir::bsdf::bsdf::{bsdf_is_diffuse, bsdf_pdf}
#import bevy_restir::bsdf::types::{LOBE_COAT, LOBE_DIFFUSE}
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::ray::{Hit, Ray}
#import bevy_restir::common::rng::{rng_new, STREAM_PATH_CANDIDATES}
#import bevy_restir::light::point_on_light::light_point_at
#import bevy_restir::path::random::{DIMENSION_RAY, path_alpha_seed}
#import bevy_restir::path::walk::{sampled_step, Step, step_cone, step_medium, step_towards, Vertex}
#import bevy_restir::restir::path_sample::{no_path_sample, PathSample, TERMINATION_EMITTER, TERMINATION_ENVIRONMENT, TERMINATION_NEE}
#import bevy_restir::restir::pt::initial_candidates::sample_candidates
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::shift::hybrid::hybrid_shift
#import bevy_restir::scene::offset::{offset_point, surface_point}
#import bevy_restir::scene::surface::surface_at
#import bevy_restir::trace::trace::trace_closest
#import bevy_restir::view::bindings::{view, visibility}

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(3) var contribution: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn path_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    // A sample of weight 1, so that the picture shows the contribution.
    let stored = Reservoir(no_path_sample(), 1.0, 1.0, true);
    reservoirs[reservoir_index(pixel)] = reservoir_pack(stored);
    if all(pixel < view.size / BLOCK) {
        show(pixel);
    }
}

const BLOCK: vec2<u32> = vec2<u32>(8u, 4u);
// The pixel of a block whose path is shown; and the bits in which the coordinates of partner blocks differ.
const MIDDLE: vec2<u32> = vec2<u32>(3u, 1u);
const PARTNER: vec2<u32> = vec2<u32>(2u, 4u);
// Added to values that may be negative.
const BIAS: f32 = 64.0;
const VERTICES: u32 = 5u;

fn put(block: vec2<u32>, is_shifted: bool, channel: u32, value: vec3<f32>) {
    let at = vec2<u32>(channel & 3u, channel >> 2u) + select(vec2<u32>(0u), vec2<u32>(4u, 0u), is_shifted);
    textureStore(contribution, block * BLOCK + at, vec4<f32>(value, 0.0));
}

fn show(block: vec2<u32>) {
    for (var channel = 0u; channel < 16u; channel++) {
        put(block, false, channel, vec3<f32>(0.0));
        put(block, true, channel, vec3<f32>(0.0));
    }
    let at = block * BLOCK + MIDDLE;
    let partner = (block ^ PARTNER) * BLOCK + MIDDLE;
    let ids = textureLoad(visibility, at, 0).xy;
    let other = textureLoad(visibility, partner, 0).xy;
    if ids.x == NONE || other.x == NONE {
        return;
    }
    let r = receiver_of(ids, at, false);
    let to = receiver_of(other, partner, false);
    var rng = rng_new(at, view.frame, STREAM_PATH_CANDIDATES, view.seed);
    let selected = in_domain_measure(sample_candidates(r.first, at, SHORTEST_LENGTH, r.shift, &rng), r);
    let path = reservoir_unpack(reservoir_pack(Reservoir(selected.path, selected.ucw, 1.0, true))).path;
    if path.length < 2u {
        return;
    }
    let header = vec3<f32>(f32(path.reconnection), f32(path.termination), f32(path.length));
    let reason = hybrid_shift(path, to.first, to.shift, false, false).reason;
    put(block, false, 0u, header);
    put(block, true, 0u, header + 1.0 + f32(reason));
    // One call for both, because each copy of the walk takes compile time.
    for (var side = 0u; side < 2u; side++) {
        var first = r.first;
        if side == 1u {
            first = to.first;
        }
        show_vertices(path, first, block, side == 1u);
    }
}

fn show_vertices(path: PathSample, first: Vertex, block: vec2<u32>, is_shifted: bool) {
    let ends_with_nee = path.termination == TERMINATION_NEE;
    let surfaces = path.length - u32(path.termination != TERMINATION_EMITTER);
    var v = first;
    for (var index = 1u; index <= min(surfaces, VERTICES); index++) {
        let is_last = index == surfaces;
        var pdf = 0.0;
        var roughness = 1.0;
        var step: Step;
        if is_last && ends_with_nee {
            pdf = bsdf_pdf(v.surface.bsdf, v.wo, light_point_at(path.light, v.surface.position, false).wi);
        } else if !is_last || path.termination == TERMINATION_ENVIRONMENT {
            step = step_from(path, v, index);
            if !step.valid {
                return;
            }
            pdf = step.pdf;
            let alpha = select(v.surface.bsdf.roughness, v.surface.bsdf.coat_roughness, step.lobe == LOBE_COAT);
            roughness = select(sqrt(alpha), 1.0, step.lobe == LOBE_DIFFUSE);
        }
        let flags = 1u | u32(step.delta) << 1u | u32(bsdf_is_diffuse(v.surface.bsdf)) << 2u;
        put(block, is_shifted, 3u * index - 2u, v.surface.position + BIAS);
        put(block, is_shifted, 3u * index - 1u, v.surface.bsdf.n_geo + 2.0);
        put(block, is_shifted, 3u * index, vec3<f32>(pdf, roughness, f32(flags)));
        if is_last || (path.reconnection != 0u && index >= path.reconnection) {
            return;
        }
        let hit = next_hit(path, v, step, index);
        if hit.instance == NONE {
            return;
        }
        let cone = step_cone(v, step, hit.t);
        let s = surface_at(hit.instance, hit.triangle, hit.barycentrics, -step.wi, cone, false);
        v = Vertex(s, -step.wi, step_medium(v, step.wi), cone);
    }
}

// The step from the vertex of this index: to the reconnection vertex, in the stored direction after it, or by the path's random numbers.
fn step_from(path: PathSample, v: Vertex, index: u32) -> Step {
    if index + 1u == path.reconnection {
        if path.termination == TERMINATION_ENVIRONMENT && path.reconnection == path.length {
            return step_towards(v, path.wi, path.lobe_before);
        }
        let kept = surface_point(path.instance, path.triangle, path.barycentrics, false);
        return step_towards(v, normalize(kept - v.surface.position), path.lobe_before);
    }
    if index == path.reconnection {
        return step_towards(v, path.wi, path.lobe_after);
    }
    return sampled_step(v, path.seed, index);
}

fn next_hit(path: PathSample, v: Vertex, step: Step, index: u32) -> Hit {
    let origin = offset_point(v.surface.position, v.surface.bsdf.n_geo, step.wi, v.surface.offset);
    var hit = trace_closest(Ray(origin, 0.0, step.wi, FAR), path_alpha_seed(path.seed, index, DIMENSION_RAY));
    if index + 1u == path.reconnection {
        hit.instance = path.instance;
        hit.triangle = path.triangle;
        hit.barycentrics = path.barycentrics;
    }
    return hit;
}
