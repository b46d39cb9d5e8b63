// The domain of light paths that the camera sees at x1 and whose last edge, from x2 to x1, can be reconnected (Hedstrom et al. 2025, 5 and
// Fig. 4; `restir/bdpt/last_edge.wgsl`).  It defines the functions that the resampling routine (`pass/reuse.wgsl`) calls.
//
// A sample is a light, the random numbers of a light sub-path up to x2, and a place in the image.  The measure is the counting measure of
// lights times primary sample space times area in the image, in pixels.  A shift keeps the sub-path and the place within the pixel: x1
// becomes the point that the camera sees there in the other pixel.  This moves the place by whole pixels, so that the Jacobian is 1.
//
// In this measure, light sub-paths have the density p |cos θ'| / r² / (D |cos θ|), times their number.  p is the density of the direction from
// x2 to x1 in solid angle, r the length of the edge, and D the density of camera rays at x1 in an area perpendicular to them; θ' and θ are the
// angles of the edge and of the camera ray to the normal at x1.  The contribution is the value of a light sub-path (`restir/bdpt/splat.wgsl`)
// times this density.  The number, p, D and cos θ cancel, and power f(x2) |cos at x2| f(x1) |cos θ'| / r² is left, times the MIS weight of
// the shifted path.
//
// Within a frame the sub-path stays as it is.  If something moved between two frames, it is replayed in the other one.
#define_import_path bevy_restir::restir::reconnected::domain

#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_pdf}
#import bevy_restir::common::constants::{FAR, LEAST_DIVISOR, NONE}
#import bevy_restir::common::guard::{GUARD_SHIFT_CONTRIBUTION, guarded_3}
#import bevy_restir::common::math::{luminance, quantized_direction}
#import bevy_restir::common::ray::Ray
#import bevy_restir::light::remap::current_light_id
#import bevy_restir::light::select::light_pmf
#import bevy_restir::path::bidirectional_mis::{mis_arrive, mis_scatter, mis_splat_weight, MisState}
#import bevy_restir::path::light_path::{arrival_cosine, LightWalk, scattered_value, surface_towards}
#import bevy_restir::path::medium::{absorbs, medium_before, medium_towards}
#import bevy_restir::path::shadow_ray::ray_between
#import bevy_restir::restir::bdpt::last_edge::{can_reconnect, LastEdge}
#import bevy_restir::restir::bdpt::techniques::splat_share
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::connection::count::connections_of_vertex
#import bevy_restir::restir::connection::light_sub_path::{alpha_seeds_of, replayed_sub_path}
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::path_sample::quantized_barycentrics
#import bevy_restir::restir::reconnected::reservoir::Reservoir
#import bevy_restir::restir::types::RESAMPLE_MOVED
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::trace::trace::{trace_any, trace_drawn_closest}
#import bevy_restir::view::camera::{camera_density, camera_of, camera_ray, is_beyond_far_plane, near_position, pixel_cone}
#ifdef SPLIT_LIGHT
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::view::light_part::bsdf_diffuse_share
#endif

// A pixel of this frame or of the last one.
struct Receiver {
    pixel: vec2<u32>,
    previous: bool,
}

// Sample fields that a shift changes.
struct ShiftResult {
    instance: u32,
    triangle: u32,
    barycentrics: vec2<f32>,
    towards_light: vec3<f32>,
    power: vec3<f32>,
    state: MisState,
    target_value: f32,
}

// A sample, shifted to a receiver.
struct Evaluated {
    f: vec3<f32>,              // contribution, where x1 and x2 see each other
    result: ShiftResult,
    ray: Ray,                  // from x2 to x1
    alpha_seed: u32,           // of this ray
}

// The point of a sample that the camera sees.
struct SeenPoint {
    found: bool,
    surface: Surface,
    wo: vec3<f32>,             // towards the camera
    distance: f32,             // from the camera
}

// Every pixel: light paths land anywhere in it, also where its camera ray misses all surfaces.
fn receives_light(ids: vec2<u32>) -> bool {
    return true;
}

fn receiver_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Receiver {
    return Receiver(pixel, previous);
}

fn resamples(r: Receiver) -> bool {
    return true;
}

fn neighbor_radius(r: Receiver) -> f32 {
    return settings.radius;
}

// The point that the camera sees at the place of a sample in the pixel of the receiver.
fn seen_point(r: Receiver, s: Reservoir, alpha_seed: u32) -> SeenPoint {
    var x: SeenPoint;
    let camera = camera_of(r.previous);
    let at = vec2<f32>(r.pixel) + s.place;
    let ray = camera_ray(camera, at);
    let hit = trace_drawn_closest(Ray(near_position(camera, at), 0.0, ray.direction, FAR), alpha_seed, r.previous);
    if hit.instance == NONE {
        return x;
    }
    let position = near_position(camera, at) + hit.t * ray.direction;
    x.wo = -ray.direction;
    x.distance = distance(ray.origin, position);
    x.surface = surface_at(hit.instance, hit.triangle, hit.barycentrics, x.wo, pixel_cone(camera, ray, x.distance), r.previous);
    x.found = !is_beyond_far_plane(camera, x.surface.position);
    return x;
}

// A sample with the vertex x2 that a light sub-path has reached.
fn with_vertex(s: Reservoir, w: LightWalk) -> Reservoir {
    var t = s;
    t.instance = w.hit.instance;
    t.triangle = w.hit.triangle;
    t.barycentrics = quantized_barycentrics(w.hit.barycentrics);
    t.towards_light = quantized_direction(w.towards_light);
    t.power = w.throughput * light_pmf(s.light);
    t.state = w.state;
    return t;
}

// Whether a light sub-path has reached x2, by a ray that crossed no medium.
fn is_vertex_of(s: Reservoir, w: LightWalk) -> bool {
    return w.events + 1u == s.events && !absorbs(w.medium);
}

// Where something moved between the frames, the light sub-path is replayed in the frame of the receiver.
#ifdef WITHIN_FRAME
fn replays_light() -> bool {
    return false;
}
#else
fn replays_light() -> bool {
    return has(RESAMPLE_MOVED);
}
#endif

fn evaluate(r: Receiver, sample: Reservoir) -> Evaluated {
    var e: Evaluated;
    var s = sample;
    if replays_light() {
        let w = replayed_sub_path(s.path, s.frame, s.light, s.events - 1u, r.previous).walk;
        if !is_vertex_of(s, w) {
            return e;
        }
        s = with_vertex(s, w);
    }
    let seeds = alpha_seeds_of(s.path, s.frame, s.events);
    let x = seen_point(r, s, seeds.y);
    if !x.found {
        return e;
    }
    let lit = surface_at(s.instance, s.triangle, s.barycentrics, s.towards_light, Cone(0.0, 0.0), r.previous);
    e.f = guarded_3(contribution_of(s, x, lit, r.previous), GUARD_SHIFT_CONTRIBUTION);
    e.ray = ray_between(lit, x.surface);
    e.alpha_seed = seeds.x;
    e.result = ShiftResult(s.instance, s.triangle, s.barycentrics, s.towards_light, s.power, s.state, luminance(e.f));
    return e;
}

// Contribution of a path through x1 and x2 without the visibility between them; 0 if the path belongs to another domain.  `lit`: x2 as the
// light's side sees it.
fn contribution_of(s: Reservoir, x: SeenPoint, lit: Surface, previous: bool) -> vec3<f32> {
    let d = x.surface.position - lit.position;
    let d2 = max(dot(d, d), LEAST_DIVISOR);
    let direction = d * inverseSqrt(d2);
    let leaving = surface_towards(lit, direction);
    let pdf_forward = bsdf_pdf(lit.bsdf, s.towards_light, direction);
    let pdf_reverse = bsdf_pdf(x.surface.bsdf, x.wo, -direction);
    let crosses_medium = absorbs(medium_towards(lit, direction, vec3<f32>(0.0)))
        || absorbs(medium_before(surface_towards(x.surface, -direction), vec3<f32>(0.0)));
    let edge = LastEdge(lit.position, lit.bsdf.n_geo, pdf_forward, pdf_reverse);
    if crosses_medium || !(pdf_forward > 0.0) || !can_reconnect(x.surface, edge, previous) {
        return vec3<f32>(0.0);
    }
    let cos_out = abs(dot(lit.bsdf.n_geo, direction));
    var state = mis_scatter(s.state, cos_out, pdf_forward, bsdf_pdf(leaving.bsdf, direction, s.towards_light));
    state = mis_arrive(state, d2, arrival_cosine(x.surface, direction));
    state.last *= connections_of_vertex();
    let density = camera_density(camera_of(previous), x.wo, x.distance);
    let weight = mis_splat_weight(density, f32(settings.splats), abs(dot(x.surface.bsdf.n_geo, x.wo)), state, pdf_reverse);
    let arriving = s.power * scattered_value(leaving, direction, s.towards_light) * (cos_out / d2);
    return arriving * bsdf_eval(x.surface.bsdf, x.wo, -direction) * splat_share(weight);
}

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
    return e.result;
}

fn apply_shift(s: Reservoir, result: ShiftResult) -> Reservoir {
    var t = s;
    t.instance = result.instance;
    t.triangle = result.triangle;
    t.barycentrics = result.barycentrics;
    t.towards_light = result.towards_light;
    t.power = result.power;
    t.state = result.state;
    t.target_value = result.target_value;
    return t;
}

// Whether `evaluate` finds vertices of light sub-paths by rays, for a sample of this frame.
fn needs_replay(r: Receiver, s: Reservoir) -> bool {
    return false;
}

// Paired reuse keeps the contribution of a shift to a visible path, and restores the shift from it.
fn kept_shift(e: Evaluated) -> vec4<f32> {
    return vec4<f32>(e.f, 1.0);
}

fn shift_from(s: Reservoir, kept: vec4<f32>) -> Evaluated {
    var e: Evaluated;
    e.f = kept.rgb;
    e.result = ShiftResult(s.instance, s.triangle, s.barycentrics, s.towards_light, s.power, s.state, luminance(kept.rgb));
    return e;
}

// As long as nothing moved, the target in the sample's own pixel is the stored one.  MIS weights contain the probabilities of lights, which all
// pixels must take from the same frame.
fn stores_target() -> bool {
    return !has(RESAMPLE_MOVED);
}

fn stored_target(s: Reservoir) -> f32 {
    return s.target_value;
}

// Whether x1 and x2 see each other.  The ray has the alpha seed with which the light sub-path was traced.
fn is_visible(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return !trace_any(e.ray, e.alpha_seed, r.previous);
}

// Share of a sample's light that x1 scatters diffusely.
#ifdef SPLIT_LIGHT
fn diffuse_share(r: Receiver, s: Reservoir, packed_splat_share: f32) -> vec3<f32> {
    let x = seen_point(r, s, alpha_seeds_of(s.path, s.frame, s.events).y);
    if !x.found {
        return vec3<f32>(0.0);
    }
    let lit = surface_point(s.instance, s.triangle, s.barycentrics, r.previous);
    return bsdf_diffuse_share(x.surface.bsdf, x.wo, normalize(lit - x.surface.position));
}
#endif

fn completed(r: Receiver, s: Reservoir, bits: u32) -> Reservoir {
    return s;
}

// A sample of the last frame, with the light id of this frame.  A path from a light that was removed has the weight 0 and keeps its confidence.
fn in_current_frame(s: Reservoir) -> Reservoir {
    var t = s;
    t.light = current_light_id(s.light);
    t.ucw = select(s.ucw, 0.0, t.light == NONE);
    return t;
}
