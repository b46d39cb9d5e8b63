// How a light path scatters light at a vertex, and how a path from the camera scatters it there.
#import bevy_restir::bsdf::bsdf::{bsdf_draw, bsdf_eval, bsdf_sample}
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::rng::{rng_3, rng_of_key}
#import bevy_restir::path::light_path::{delta_value, scattered_value}
#import bevy_restir::scene::lobes::lobes_towards
#import bevy_restir::scene::surface::Surface

struct Query {
    b: Bsdf,                   // as the camera's side sees it
    wo: vec3<f32>,             // to the camera
    seed: u32,
    wi: vec3<f32>,             // to the light
    pad: u32,
}

struct Answer {
    light: vec3<f32>,          // value of all lobes except deltas on a light path, times the cosine
    lobe: u32,                 // 1 + lobe of a delta that the light path has drawn; 0: none
    camera: vec3<f32>,         // the same value on a path from the camera
    cosine: f32,               // between the light and where the path from the camera goes by the same delta
    light_delta: vec3<f32>,    // weight of the delta on the light path
    pad_a: u32,
    camera_delta: vec3<f32>,   // and on the path from the camera, for power in place of radiance
    pad_b: u32,
}

@group(0) @binding(0) var<storage, read> queries: array<Query>;
@group(0) @binding(1) var<storage, read_write> answers: array<Answer>;

// Samples of the camera's side, until one has the same lobe.
const TRIES: u32 = 64u;

fn surface_of(b: Bsdf) -> Surface {
    var s: Surface;
    s.bsdf = b;
    return s;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&queries) {
        return;
    }
    let q = queries[id.x];
    let seen_from_light = surface_of(lobes_towards(q.b, q.wi));
    let seen_again = surface_of(lobes_towards(seen_from_light.bsdf, q.wo));
    var a: Answer;
    a.light = scattered_value(seen_again, q.wo, q.wi) * abs(dot(q.b.n_geo, q.wi));
    a.camera = bsdf_eval(q.b, q.wo, q.wi);
    var rng = rng_of_key(id.x, q.seed, 81u, 0u);
    let drawn = bsdf_draw(seen_from_light.bsdf, q.wi, rng_3(&rng));
    if drawn.valid != 0u && drawn.delta != 0u {
        let seen_from_camera = surface_of(lobes_towards(seen_from_light.bsdf, drawn.wi));
        a.light_delta = delta_value(seen_from_light, seen_from_camera, q.wi, drawn) * abs(dot(q.b.n_geo, drawn.wi));
        for (var i = 0u; i < TRIES; i++) {
            let back = bsdf_sample(seen_from_camera.bsdf, drawn.wi, rng_3(&rng));
            if back.valid != 0u && back.delta != 0u && back.lobe == drawn.lobe {
                a.lobe = 1u + drawn.lobe;
                a.camera_delta = back.weight * (back.eta * back.eta);
                a.cosine = dot(back.wi, q.wi);
                break;
            }
        }
    }
    answers[id.x] = a;
}
