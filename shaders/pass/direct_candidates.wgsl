// Initial candidates of direct lighting (Wyman and Panteleev 2021, 3 and 5): points of lights from a presampled subset, and one from the
// BSDF, joined by MIS in one measure; one of them is kept, and one ray says whether it is seen.  What only the BSDF can find (mirrors,
// lights beyond the table) is written as light.

#import bevy_restir::bsdf::bsdf::{bsdf_is_delta, bsdf_sample}
#import bevy_restir::bsdf::types::BsdfSample
#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::math::max_component
#import bevy_restir::common::rng::{Rng, rng_1, rng_3, rng_bits, rng_new, STREAM_CANDIDATES}
#import bevy_restir::light::environment::environment_radiance
#import bevy_restir::light::point_on_light::{environment_light_point, LightPoint, light_point_at, no_light_point, triangle_light_point}
#import bevy_restir::light::select::{environment_pmf, light_pmf}
#import bevy_restir::light::shape::{crossing_point, CROSSINGS_MAX, next_crossing, Way}
#import bevy_restir::light::types::LightSample
#import bevy_restir::path::medium::{medium_towards, transmittance}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::candidate::{light_candidate, presence_of, subset_of}
#import bevy_restir::restir::direct::{bsdf_pdf_of, evaluate, evaluate_arriving, evaluate_sample, is_visible, Receiver, receiver_of, target_value}
#import bevy_restir::restir::reservoir::{no_reservoir, PackedReservoir, Reservoir, reservoir_pack}
#import bevy_restir::restir::stream::{Stream, stream_add, stream_ucw}
#import bevy_restir::restir::types::{RESAMPLE_BSDF_CANDIDATE, RESAMPLE_CANDIDATE_RAYS, RESAMPLE_SIMPLE_TARGET}
#import bevy_restir::restir::tiling::reservoir_index
#import bevy_restir::scene::cone::{cone_after, cone_along}
#import bevy_restir::scene::surface::surface_at
#import bevy_restir::trace::offset::offset_point
#import bevy_restir::trace::ray::{Ray, rays_traced, trace_flags}
#import bevy_restir::trace::trace::trace_closest
#import bevy_restir::view::bindings::{ray_counts, view, visibility}

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(3) var unresampled: texture_storage_2d<rgba32float, write>;

// What candidates are chosen by; any target that is positive where light is will do (Wyman and Panteleev 2021, 3.3).
fn candidate_target(r: Receiver, l: LightSample) -> f32 {
    if (settings.flags & RESAMPLE_SIMPLE_TARGET) != 0u {
        return target_value(evaluate_arriving(r, l));
    }
    return target_value(evaluate_sample(r, l));
}

// What a sample of the BSDF finds: a point of a light, or light that no table knows; and the way there.
struct Found {
    point: LightPoint,
    light: vec3<f32>,
    weight: vec3<f32>,         // f·|cos| over the density
    delta: bool,
    way: Way,
}

fn found_by(point: LightPoint, light: vec3<f32>, b: BsdfSample, way: Way) -> Found {
    return Found(point, light, b.weight, b.delta != 0u, way);
}

fn bsdf_candidate(r: Receiver, rng: ptr<function, Rng>) -> Found {
    let u = rng_3(rng);
    let alpha_seed = rng_bits(rng).x;
    let b = bsdf_sample(r.surface.bsdf, r.wo, u);
    if b.valid == 0u {
        return nothing_found();
    }
    let origin = offset_point(r.surface.position, r.surface.bsdf.n_geo, b.wi, r.surface.offset);
    let hit = trace_closest(Ray(origin, 0.0, b.wi, FAR), alpha_seed);
    let way = Way(origin, hit.t, b.wi);
    if hit.instance == NONE {
        let radiance = environment_radiance(b.wi);
        if b.delta != 0u || !(environment_pmf() > 0.0) {
            return found_by(no_light_point(), b.weight * radiance, b, way);
        }
        return found_by(environment_light_point(b.wi), vec3<f32>(0.0), b, way);
    }
    let cone = cone_along(cone_after(r.cone, b.delta != 0u), hit.t);
    let s = surface_at(hit.instance, hit.triangle, hit.barycentrics, -b.wi, cone, false);
    if !(max_component(s.emission) > 0.0) {
        return found_by(no_light_point(), vec3<f32>(0.0), b, way);
    }
    if b.delta != 0u || !(light_pmf(s.light) > 0.0) {
        // Through the inside of a body.
        let carried = transmittance(medium_towards(r.surface, b.wi, vec3<f32>(0.0)), hit.t);
        return found_by(no_light_point(), b.weight * s.emission * carried, b, way);
    }
    return found_by(triangle_light_point(s.light, hit.barycentrics), vec3<f32>(0.0), b, way);
}

fn nothing_found() -> Found {
    return Found(no_light_point(), vec3<f32>(0.0), vec3<f32>(0.0), true, Way(vec3<f32>(0.0), 0.0, vec3<f32>(0.0, 0.0, 1.0)));
}

@compute @workgroup_size(8, 8)
fn direct_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel, view.size, settings.tiling);
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || view.bounces == 0u {
        reservoirs[index] = reservoir_pack(no_reservoir());
        textureStore(unresampled, pixel, vec4<f32>(0.0));
        return;
    }
    var rng = rng_new(pixel, view.frame, STREAM_CANDIDATES, view.seed);
    let r = receiver_of(ids, pixel, false);
    let subset = subset_of(pixel, 0u);
    let with_bsdf = (settings.flags & RESAMPLE_BSDF_CANDIDATE) != 0u;

    // p̂ over the sum of both techniques' densities is the balance heuristic's weight of a candidate.
    var stream = Stream(0.0, NONE);
    var chosen = no_light_point();
    let count = f32(settings.candidates);
    let lights = select(settings.candidates, 0u, bsdf_is_delta(r.surface.bsdf));
    // The value that a candidate was weighed by is the one that its contribution weight is divided by, exact or not.
    var chosen_target = 0.0;
    for (var i = 0u; i < lights; i++) {
        let c = light_candidate(r.surface.position, subset, &rng);
        let value = candidate_target(r, c.light);
        let u = rng_1(&rng);
        let of_bsdf = select(0.0, bsdf_pdf_of(r, c.light, c.presence), with_bsdf);
        if c.pmf > 0.0 && stream_add(&stream, i, value / both_densities(count * c.pmf, of_bsdf), u) {
            chosen = c.point;
            chosen_target = value;
        }
    }
    var found = nothing_found();
    if with_bsdf {
        found = bsdf_candidate(r, &rng);
    }
    // Of the surface, then of every light that the ray passes on its way there.
    var point = found.point;
    var first = 0u;
    for (var i = 0u; i < CROSSINGS_MAX; i++) {
        if point.light != NONE {
            let l = light_point_at(point, r.surface.position, false);
            let pmf = light_pmf(point.light);
            if found.delta || !(pmf > 0.0) {
                let carried = transmittance(medium_towards(r.surface, l.wi, vec3<f32>(0.0)), l.distance);
                found.light += found.weight * l.radiance * carried;
            } else {
                let value = candidate_target(r, l);
                let weight = value / both_densities(count * pmf * l.aim, bsdf_pdf_of(r, l, presence_of(l)));
                if stream_add(&stream, settings.candidates + i, weight, rng_1(&rng)) {
                    chosen = point;
                    chosen_target = value;
                }
            }
        }
        let light = next_crossing(found.way, first);
        if !(found.way.reach > 0.0) || light == NONE {
            break;
        }
        point = crossing_point(light, light, found.way);
        first = light + 1u;
    }

    // The chosen one is seen or it is nothing; that counts as a candidate all the same.  The BSDF's ray has seen its own.
    var reservoir = Reservoir(chosen, 0.0, 1.0, true);
    if chosen.light != NONE {
        let is_known = stream.selected >= settings.candidates || (settings.flags & RESAMPLE_CANDIDATE_RAYS) == 0u;
        if is_known || is_visible(r, evaluate(r, reservoir), rng_bits(&rng).x) {
            reservoir.ucw = stream_ucw(stream, chosen_target);
        }
    }
    reservoirs[index] = reservoir_pack(reservoir);
    textureStore(unresampled, pixel, vec4<f32>(found.light, 0.0));
    let counted = textureLoad(ray_counts, pixel).x;
    textureStore(ray_counts, pixel, vec4<u32>((counted + rays_traced) | trace_flags << 24u));
}

// Of the lights' technique and of the BSDF's.
#ifdef PLANT_MISSING_DENSITY
fn both_densities(lights: f32, bsdf: f32) -> f32 {
    return select(bsdf, lights, lights > 0.0);
}
#else
fn both_densities(lights: f32, bsdf: f32) -> f32 {
    return lights + bsdf;
}
#endif
