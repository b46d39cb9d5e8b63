// Light candidates of a vertex: from the presampled subset that a tile of pixels shares (Wyman and Panteleev 2021, 5), or from the whole
// table of lights.
#define_import_path bevy_restir::restir::light_candidates

#import bevy_restir::common::constants::LIGHT_TRIANGLE
#import bevy_restir::common::rng::{pcg4d, Rng, rng_4}
#import bevy_restir::light::point_on_light::{light_point_at, light_point_sample, LightPoint, point_by_solid_angle}
#import bevy_restir::light::presampled::{presampled_at, presampled_pmf, presampled_point, presampled_rounding}
#import bevy_restir::light::select::light_select
#import bevy_restir::light::triangle::triangle_light_opacity
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, LightSample, RAYS_FIND_LIGHT}
#import bevy_restir::restir::bindings::{settings, subsets}
#import bevy_restir::scene::bindings::scene
#import bevy_restir::view::bindings::view
#import bevy_restir::view::render_layers::light_kind

struct Candidate {
    point: LightPoint,
    pmf: f32,                  // probability of the light, times `LightSample::pdf_scale`; 0: no candidate
    rounding: f32,             // `SampledPoint::rounding`
    light: LightSample,        // the point as seen from the vertex
    opacity: f32,              // probability that the alpha test keeps the surface at the point
}

// Index of the subset for a pixel, at a vertex of its path.  The constant keeps these random numbers apart from those of other hashes.
fn subset_of(pixel: vec2<u32>, vertex: u32) -> u32 {
    let tile = pixel / settings.light_tile_size;
    return pcg4d(vec4<u32>(tile, view.frame, view.seed ^ 0x711e5u ^ (vertex << 24u))).x % max(settings.subset_count, 1u);
}

// Number of candidates, of as many as the settings ask for: those of a single light without an area are all the same.
fn useful_candidates(count: u32) -> u32 {
    return select(count, 1u, !RAYS_FIND_LIGHT && scene.light_bins == 1u);
}

fn light_candidate(position: vec3<f32>, subset: u32, rng: ptr<function, Rng>) -> Candidate {
    let u = rng_4(rng);
    if settings.subset_count == 0u {
        let choice = light_select(u.xy);
        let sampled = light_point_sample(choice.light, u.zw);
        let p = point_by_solid_angle(sampled.point, position, u.zw);
        let l = light_point_at(p, position, false);
        return Candidate(p, choice.pmf * l.pdf_scale, sampled.rounding, l, opacity_of(l));
    }
    var s = subsets[subset * settings.subset_size + min(u32(u.x * f32(settings.subset_size)), settings.subset_size - 1u)];
    // Before `coordinates` is overwritten: a record that a guard stopped keeps the guard's bits there.
    let pmf = presampled_pmf(s);
    s.coordinates = point_by_solid_angle(presampled_point(s), position, u.zw).coordinates;
    let l = presampled_at(s, position);
    return Candidate(presampled_point(s), pmf * l.pdf_scale, presampled_rounding(s), l, s.opacity);
}

// Probability that the alpha test keeps the surface at the point of a light.
fn opacity_of(l: LightSample) -> f32 {
    if l.delta != 0u || l.light == ENVIRONMENT_LIGHT || light_kind(l.light) != LIGHT_TRIANGLE {
        return 1.0;
    }
    return triangle_light_opacity(l.light, l.barycentrics);
}
