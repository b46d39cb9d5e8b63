// Light candidates: from the subset that a tile of pixels shares (Wyman and Panteleev 2021, 5), or from the whole table.
#define_import_path bevy_restir::restir::light_candidates

#import bevy_restir::common::constants::LIGHT_TRIANGLE
#import bevy_restir::common::rng::{pcg4d, Rng, rng_4}
#import bevy_restir::light::point_on_light::{aimed_point, LightPoint, light_point_at, light_point_sample}
#import bevy_restir::light::presampled::{presampled_at, presampled_point}
#import bevy_restir::light::select::light_select
#import bevy_restir::light::triangle::triangle_light_presence
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, LightSample}
#import bevy_restir::restir::bindings::{settings, subsets}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::render_layers::light_kind

struct Candidate {
    point: LightPoint,
    pmf: f32,                  // of the light, times what a point of it is aimed at more often than by its measure; 0: there is none
    light: LightSample,        // as it is seen
    presence: f32,             // probability that a ray meets the point
}

// The subset of a pixel at a vertex of its path.
fn subset_of(pixel: vec2<u32>, vertex: u32) -> u32 {
    let tile = pixel / settings.light_tile_size;
    return pcg4d(vec4<u32>(tile, view.frame, view.seed ^ 0x711e5u ^ (vertex << 24u))).x % max(settings.subset_count, 1u);
}

fn light_candidate(position: vec3<f32>, subset: u32, rng: ptr<function, Rng>) -> Candidate {
    let u = rng_4(rng);
    if settings.subset_count == 0u {
        let choice = light_select(u.xy);
        let p = aimed_point(light_point_sample(choice.light, u.zw), position, u.zw);
        let l = light_point_at(p, position, false);
        return Candidate(p, choice.pmf * l.aim, l, presence_of(l));
    }
    var s = subsets[subset * settings.subset_size + min(u32(u.x * f32(settings.subset_size)), settings.subset_size - 1u)];
    s.coordinates = aimed_point(presampled_point(s), position, u.zw).coordinates;
    let l = presampled_at(s, position);
    return Candidate(presampled_point(s), s.pmf * l.aim, l, s.presence);
}

fn presence_of(l: LightSample) -> f32 {
    if l.delta != 0u || l.light == ENVIRONMENT_LIGHT || light_kind(l.light) != LIGHT_TRIANGLE {
        return 1.0;
    }
    return triangle_light_presence(l.light, l.barycentrics);
}
