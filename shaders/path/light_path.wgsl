// Walks along light sub-paths (Veach 1997, 10): from a light towards the camera.  A vertex has the same BSDF value as in a path from the
// camera, for light that arrives from the light's side and leaves to the camera's side.  So radiance scales in glass as it does in camera
// paths (for delta lobes that cancels: `delta_value`), and shading normals need Veach's factor (ibid., 5.3).
#define_import_path bevy_restir::path::light_path

#import bevy_restir::bsdf::bsdf::{bsdf_draw, bsdf_eval, bsdf_pdf}
#import bevy_restir::bsdf::coat::coat_share
#import bevy_restir::bsdf::types::{BsdfSample, bsdf_is_thin, LOBE_COAT}
#import bevy_restir::common::constants::{FAR, LEAST_DIVISOR, LEAST_MAGNITUDE, NONE}
#import bevy_restir::common::guard::{GUARD_THROUGHPUT, guarded_3}
#import bevy_restir::common::math::max_component
#import bevy_restir::common::ray::{Hit, Ray}
#import bevy_restir::common::rng::{Rng, rng_1, rng_2, rng_3, rng_4, rng_bits}
#import bevy_restir::light::emission::{is_at_infinity, nee_pdf_scale, sample_emission_of}
#import bevy_restir::light::emitted_ray::EmittedRay
#import bevy_restir::light::select::light_select
#import bevy_restir::path::bidirectional_mis::{mis_arrive, mis_light_start, mis_scatter, mis_scatter_delta, MisState}
#import bevy_restir::path::medium::{absorbs, medium_towards, transmittance}
#import bevy_restir::path::roulette::{ROULETTE_FROM, survival_probability}
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::lobes::lobes_towards
#import bevy_restir::scene::offset::offset_point
#import bevy_restir::scene::subsurface::subsurface_at
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::trace::trace::trace_closest_in_frame

// The newest vertex of a light sub-path.
struct LightWalk {
    surface: Surface,          // seen from the vertex before
    hit: Hit,
    events: u32,               // scattering events up to this vertex, with it; 0: the sub-path has ended
    towards_light: vec3<f32>,  // direction to the vertex before
    throughput: vec3<f32>,     // power that arrives, over the density of the sub-path
    state: MisState,
    by_delta: bool,            // the vertex before scattered by a delta lobe
    pdf: f32,                  // density of the direction that it scattered to, over all lobes; 0: a delta lobe, or there is no such vertex
    normal_before: vec3<f32>,  // geometric normal there
    is_clear: bool,            // neither the last ray nor the one before crossed a medium that is known to absorb
    start_power: f32,          // largest component of the power that the light emitted
    medium: vec3<f32>,         // absorption of the medium that the last ray crossed, 1/m
    open_distance: f32,        // length of the path in a medium that no surface has identified yet, m
}

// Value of all lobes except deltas for light that arrives from `towards_light`, in path space: f times Veach's factor for shading normals.
// `s` is the surface as `wo`, the camera's side, sees it.
fn scattered_value(s: Surface, wo: vec3<f32>, towards_light: vec3<f32>) -> vec3<f32> {
    return bsdf_eval(s.bsdf, wo, towards_light) / arrival_cosine(s, towards_light);
}

// The surface as `wo` sees it.  `emission` stays that of the side that `s` was built for.  Light scatters below the front side only.
fn surface_towards(s: Surface, wo: vec3<f32>) -> Surface {
    var t = s;
    t.bsdf = lobes_towards(s.bsdf, wo);
    if dot(wo, s.bsdf.n_geo) < 0.0 {
        t.front = 1u - s.front;
        t.bsdf.subsurface = subsurface_at(s.instance, s.bsdf.base_color, t.front != 0u, 0.0, s.offset).weight;
    }
    return t;
}

// Density with which a sub-path that arrives from `wi` would be scattered to `wo`.
fn reverse_pdf(s: Surface, wi: vec3<f32>, wo: vec3<f32>) -> f32 {
    return bsdf_pdf(surface_towards(s, wi).bsdf, wi, wo);
}

// Cosine at which a ray arrives.  Values and MIS states are divided by it, so it is not 0 where the ray arrives edge-on.
fn arrival_cosine(s: Surface, direction: vec3<f32>) -> f32 {
    return max(abs(dot(s.bsdf.n_geo, direction)), 1.0e-9);
}

// The light that a sub-path with these random numbers chooses; it does not advance them.
fn chosen_light(rng: Rng) -> u32 {
    var first = rng;
    return light_select(rng_2(&first)).light;
}

// The first vertex of a sub-path from a light, now or (`previous`) in the last frame.  The numbers that choose the light are skipped, so
// that a replayed sub-path has the same light, whatever the probabilities are now.
fn begin_light_path(light: u32, rng: ptr<function, Rng>, previous: bool) -> LightWalk {
    let u = rng_4(rng);
    let ray = sample_emission_of(light, u.zw, rng_2(rng), previous);
    let alpha_seed = rng_bits(rng).x;
    var w: LightWalk;
    if ray.light == NONE {
        return w;
    }
    w.hit = trace_closest_in_frame(Ray(ray.origin, ray.t_min, ray.direction, FAR), alpha_seed, previous);
    if w.hit.instance == NONE {
        return w;
    }
    w.events = 1u;
    w.throughput = ray.power;
    w.start_power = max_component(ray.power);
    // Light from infinity is not absorbed on its way to the first vertex, as in `transmittance`.
    w.open_distance = select(w.hit.t, 0.0, is_at_infinity(ray.light));
    w = arrived(w, ray.direction, previous);
    w.state = mis_arrive(first_state(ray, w.surface.position), 1.0, arrival_cosine(w.surface, ray.direction));
    return w;
}

// State of the first ray before it arrives at `at`.
fn first_state(ray: EmittedRay, at: vec3<f32>) -> MisState {
    let d = at - ray.origin;
    let d2 = max(dot(d, d), LEAST_DIVISOR);
    var light_density = ray.pdf_point;
    var emission_density = ray.pdf_direction;
    if !is_at_infinity(ray.light) {
        emission_density /= d2;
        if ray.delta == 0u {
            light_density *= d2 / max(dot(ray.normal, ray.direction), LEAST_MAGNITUDE);
        }
    }
    return mis_light_start(nee_pdf_scale(ray, at) * light_density, light_density, emission_density, ray.delta != 0u);
}

// The surface at the new hit of a walk, and the medium on the way there.
fn arrived(walk: LightWalk, direction: vec3<f32>, previous: bool) -> LightWalk {
    var w = walk;
    w.towards_light = -direction;
    w.surface = surface_at(w.hit.instance, w.hit.triangle, w.hit.barycentrics, -direction, Cone(0.0, 0.0), previous);
    return with_medium_seen_from_inside(w);
}

// Continues the sub-path to the next vertex; `events` is 0 if it ends.
fn advance_light_path(walk: LightWalk, rng: ptr<function, Rng>, previous: bool) -> LightWalk {
    var w = walk;
    w.events = 0u;
    let s = walk.surface;
    let b = bsdf_draw(s.bsdf, walk.towards_light, rng_3(rng));
    let alpha_seed = rng_bits(rng).x;
    let u = rng_1(rng);
    if b.valid == 0u {
        return w;
    }
    w.by_delta = b.delta != 0u;
    w.pdf = 0.0;
    w.normal_before = s.bsdf.n_geo;
    let cos_out = abs(dot(s.bsdf.n_geo, b.wi));
    let out = surface_towards(s, b.wi);
    if b.delta != 0u {
        w.throughput *= delta_value(s, out, walk.towards_light, b) * cos_out;
        w.state = mis_scatter_delta(walk.state, cos_out);
    } else {
        let pdf = bsdf_pdf(s.bsdf, walk.towards_light, b.wi);
        if !(pdf > 0.0) {
            return w;
        }
        w.pdf = pdf;
        w.throughput *= scattered_value(out, b.wi, walk.towards_light) * (cos_out / pdf);
        w.state = mis_scatter(walk.state, cos_out, pdf, bsdf_pdf(out.bsdf, b.wi, walk.towards_light));
    }
    w.throughput = guarded_3(w.throughput, GUARD_THROUGHPUT);
    if !(max_component(w.throughput) > 0.0) {
        return w;
    }

    // Russian roulette.
    if walk.events >= ROULETTE_FROM {
        let q = survival_probability(w.throughput, 1.0 / walk.start_power);
        if !(u < q) {
            return w;
        }
        w.throughput /= q;
    }

    w = with_medium_behind(w, b.wi);
    w.hit = trace_closest_in_frame(Ray(offset_point(s.position, s.bsdf.n_geo, b.wi, s.offset), 0.0, b.wi, FAR), alpha_seed, previous);
    if w.hit.instance == NONE {
        return w;
    }
    w.events = walk.events + 1u;
    w = through_medium(w);
    w = arrived(w, b.wi, previous);
    w.is_clear = !absorbs(walk.medium) && !absorbs(w.medium);
    w.state = mis_arrive(w.state, w.hit.t * w.hit.t, arrival_cosine(w.surface, b.wi));
    return w;
}

// Value of a delta lobe, divided by its probability and by the geometric cosine of the new direction.  The sample `b` was drawn from the
// light's side, so two of its factors are corrected.  It scales radiance by 1/eta², as for light that goes the other way: that is undone.
// Light that goes to the camera's side has radiance scaled by eta² and projected solid angle by 1/eta², so that no factor takes its place.
// The share of the coat becomes that of the camera's side.
fn delta_value(s: Surface, out: Surface, towards_light: vec3<f32>, b: BsdfSample) -> vec3<f32> {
    var n = s.bsdf.n;
    var value = b.weight * (b.eta * b.eta);
    if b.lobe == LOBE_COAT {
        n = s.bsdf.coat_normal;
    } else {
        value *= (1.0 - coat_share(out.bsdf, b.wi)) / max(1.0 - coat_share(s.bsdf, towards_light), LEAST_MAGNITUDE);
    }
    let shading = abs(dot(n, towards_light)) / max(abs(dot(n, b.wi)), LEAST_MAGNITUDE);
    return value * (shading / arrival_cosine(s, towards_light));
}

// The medium around a light is not known at first.  It is identified by the first surface that the path meets from inside of an absorbing
// object, or by a connection to a camera sub-path.  Until then `open_distance` holds the length of the path.
#ifdef ATTENUATION
fn with_medium_seen_from_inside(walk: LightWalk) -> LightWalk {
    var w = walk;
    if w.surface.front == 0u && !bsdf_is_thin(w.surface.bsdf) && max_component(w.surface.attenuation) > 0.0 {
        w.medium = w.surface.attenuation;
        w.throughput *= transmittance(w.medium, w.open_distance);
        w.open_distance = 0.0;
    }
    return w;
}

// The medium of the next ray.  A path that enters an object comes from free space, so that its length so far needs no absorption.
fn with_medium_behind(walk: LightWalk, wi: vec3<f32>) -> LightWalk {
    var w = walk;
    w.medium = medium_towards(w.surface, wi, w.medium);
    if dot(wi, w.surface.bsdf.n_geo) < 0.0 && !bsdf_is_thin(w.surface.bsdf) {
        w.open_distance = 0.0;
    }
    return w;
}

fn through_medium(walk: LightWalk) -> LightWalk {
    var w = walk;
    if max_component(w.medium) > 0.0 {
        w.throughput *= transmittance(w.medium, w.hit.t);
    } else {
        w.open_distance += w.hit.t;
    }
    return w;
}
#else
fn with_medium_seen_from_inside(walk: LightWalk) -> LightWalk {
    return walk;
}

fn with_medium_behind(walk: LightWalk, wi: vec3<f32>) -> LightWalk {
    return walk;
}

fn through_medium(walk: LightWalk) -> LightWalk {
    return walk;
}
#endif
