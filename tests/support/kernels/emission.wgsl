// Rays that lights emit, and their densities as a point on the ray sees them.
#import bevy_restir::common::rng::{rng_2, rng_4, rng_of_key}
#import bevy_restir::light::emission::{emission_density, is_at_infinity, nee_pdf_scale, sample_emission_of}
#import bevy_restir::light::select::light_select
#import bevy_restir::light::types::no_light_sample
#import bevy_restir::common::constants::NONE

struct Query {
    seed: u32,
    distance: f32,             // of the point from the light, m
}

struct Ray {
    origin: vec3<f32>,
    light: u32,
    direction: vec3<f32>,
    delta: u32,
    power: vec3<f32>,
    pdf_point: f32,
    normal: vec3<f32>,
    pdf_direction: f32,
    density: f32,
    scale: f32,
    infinite: u32,
    start: f32,
}

@group(2) @binding(0) var<storage, read> queries: array<Query>;
@group(2) @binding(1) var<storage, read_write> rays: array<Ray>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let q = queries[0];
    var rng = rng_of_key(id.x, q.seed, 79u, 0u);
    let u = rng_4(&rng);
    let r = sample_emission_of(light_select(u.xy).light, u.zw, rng_2(&rng), false);
    if r.light == NONE {
        rays[id.x].light = NONE;
        return;
    }
    let at = r.origin + q.distance * r.direction;
    var l = no_light_sample();
    l.light = r.light;
    l.wi = -r.direction;
    l.distance = q.distance;
    l.normal = r.normal;
    rays[id.x] = Ray(
        r.origin, r.light, r.direction, r.delta, r.power, r.pdf_point, r.normal, r.pdf_direction, emission_density(l), nee_pdf_scale(r, at),
        u32(is_at_infinity(r.light)), r.t_min,
    );
}
