// Area lights: a sample from a point, the hit of a ray in its direction or a given one, and all hits of that ray.
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::rng::{rng_2, rng_of_key}
#import bevy_restir::light::light::light_sample
#import bevy_restir::light::point_on_light::{point_by_solid_angle, light_point_at, light_point_sample}
#import bevy_restir::light::analytic_area_light::{light_hit_point, LIGHT_HITS_MAX, next_light_hit, RaySegment}
#import bevy_restir::light::types::LightSample

struct Query {
    point: vec3<f32>,
    light: u32,
    direction: vec3<f32>,
    reach: f32,
    seed: u32,
    mode: u32,             // 0: sample like the reference; 1: like candidates; 2: in the light's own measure; 3: a given direction
    pad_a: u32,
    pad_b: u32,
}

struct Sample {
    wi: vec3<f32>,
    distance: f32,
    radiance: vec3<f32>,
    pdf: f32,
    position: vec3<f32>,
    met: u32,              // the light, if the ray hits it
    normal: vec3<f32>,
    met_pdf: f32,
    met_position: vec3<f32>,
    met_distance: f32,
    met_radiance: vec3<f32>,
    crossings: u32,
    mask: vec4<u32>,       // ids below 128 that the ray hits
}

@group(2) @binding(0) var<storage, read> queries: array<Query>;
@group(2) @binding(1) var<storage, read_write> samples: array<Sample>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&samples) {
        return;
    }
    let q = queries[min(id.x, arrayLength(&queries) - 1u)];
    var rng = rng_of_key(id.x, q.seed, 81u, 0u);
    let u = rng_2(&rng);
    var l: LightSample;
    if q.mode == 0u {
        l = light_sample(q.light, q.point, u);
    } else if q.mode == 1u {
        l = light_point_at(point_by_solid_angle(light_point_sample(q.light, u).point, q.point, u), q.point, false);
    } else if q.mode == 2u {
        l = light_point_at(light_point_sample(q.light, u).point, q.point, false);
        l.pdf_scale = 1.0;
    }
    var way = RaySegment(q.point, q.reach, l.wi);
    if q.mode == 3u {
        way.direction = q.direction;
    }
    let p = light_hit_point(q.light, q.light, way);
    let m = light_point_at(p, q.point, false);
    var mask = vec4<u32>(0u);
    var first = 0u;
    var crossings = 0u;
    for (var i = 0u; i < LIGHT_HITS_MAX; i++) {
        let light = next_light_hit(way, first);
        if light == NONE {
            break;
        }
        mask[light >> 5u] |= 1u << (light & 31u);
        crossings += 1u;
        first = light + 1u;
    }
    samples[id.x] = Sample(
        l.wi, l.distance, l.radiance, l.pdf_solid_angle * l.pdf_scale, l.position, p.light, l.normal, m.pdf_solid_angle * m.pdf_scale, m.position,
        m.distance, m.radiance, crossings, mask,
    );
}
