// The material with its textures at points of triangle 0 of instance 0.
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::material::{alpha_at, emission_at, material_at}
#import bevy_restir::scene::triangle::world_triangle

struct Query {
    barycentrics: vec2<f32>,
    width: f32,
    pad: f32,
    wo: vec3<f32>,
    pad_b: f32,
}

struct Point {
    base_color: vec3<f32>,
    metallic: f32,
    emission: vec3<f32>,
    perceptual_roughness: f32,
    dielectric_reflectance: vec3<f32>,
    specular_transmission: f32,
    normal: vec3<f32>,
    alpha: f32,
    emission_of_light: vec3<f32>,
    diffuse_transmission: f32,
    coat_normal: vec3<f32>,
    thickness: f32,
    anisotropy_direction: vec2<f32>,
    anisotropy_strength: f32,
    clearcoat: f32,
    clearcoat_perceptual_roughness: f32,
    pad: vec3<f32>,
}

@group(2) @binding(0) var<storage, read> queries: array<Query>;
@group(2) @binding(1) var<storage, read_write> points: array<Point>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&queries) {
        return;
    }
    let q = queries[id.x];
    let m = material_at(0u, 0u, q.barycentrics, world_triangle(0u, 0u, false), q.wo, Cone(q.width, 0.0));
    points[id.x] = Point(
        m.base_color, m.metallic, m.emission, m.perceptual_roughness, m.dielectric_reflectance, m.specular_transmission, m.normal,
        alpha_at(0u, 0u, q.barycentrics), emission_at(0u, 0u, q.barycentrics), m.diffuse_transmission,
        m.coat_normal, m.thickness, m.anisotropy_direction, m.anisotropy_strength, m.clearcoat, m.clearcoat_perceptual_roughness,
        vec3<f32>(0.0),
    );
}
