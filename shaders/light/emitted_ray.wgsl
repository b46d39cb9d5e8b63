// Rays that lights emit, the first of a light sub-path, and their densities as surfaces see them.
#define_import_path bevy_restir::light::emitted_ray

#import bevy_restir::common::constants::{INV_PI, NONE, PI, TWO_PI}
#import bevy_restir::common::math::orthonormal_basis
#import bevy_restir::light::types::LightSample
#import bevy_restir::scene::bindings::scene

struct EmittedRay {
    origin: vec3<f32>,
    t_min: f32,
    direction: vec3<f32>,
    light: u32,                // index in the table, ENVIRONMENT_LIGHT, or NONE: no ray was sampled
    power: vec3<f32>,          // radiance · |cos| / density of the ray; over many rays its mean is the power of the lights
    delta: u32,                // 1: a light that no ray hits
    normal: vec3<f32>,         // geometric normal on the emitting side; 0 for points, spots and lights at infinity
    pdf_point: f32,            // of the point, 1/m²; of the direction for lights at infinity; 1 for deltas
    pdf_direction: f32,        // of the direction, given the point; for lights at infinity of the point on the disk, 1/m²
}

fn no_emitted_ray() -> EmittedRay {
    return EmittedRay(vec3<f32>(0.0), 0.0, vec3<f32>(0.0, 0.0, 1.0), NONE, vec3<f32>(0.0), 0u, vec3<f32>(0.0), 0.0, 0.0);
}

// A ray from a point of an area light, by the cosine.
fn area_emitted_ray(light: u32, position: vec3<f32>, normal: vec3<f32>, radiance: vec3<f32>, pdf_point: f32, u: vec2<f32>) -> EmittedRay {
    let cosine = sqrt(1.0 - u.y);
    let r = sqrt(u.y);
    let direction = normalize(orthonormal_basis(normal) * vec3<f32>(r * cos(TWO_PI * u.x), r * sin(TWO_PI * u.x), cosine));
    return EmittedRay(position, 0.0, direction, light, radiance * PI / pdf_point, 0u, normal, pdf_point, cosine * INV_PI);
}

// Density of the rays of one side of an area light, for each unit of area perpendicular to the ray.
fn area_emission_density(l: LightSample) -> f32 {
    return abs(dot(l.normal, l.wi)) * INV_PI / (l.distance * l.distance);
}

// A sphere around the scene.
struct SceneSphere {
    center: vec3<f32>,
    radius: f32,
}

// The sphere around the scene, now or (`previous`) in the last frame.
fn scene_sphere(previous: bool) -> SceneSphere {
    if previous {
        return SceneSphere(scene.previous_center, scene.previous_radius);
    }
    return SceneSphere(scene.center, scene.radius);
}

// A ray that comes from the direction `wi`, through a disk that is as wide as the scene.
fn infinite_emitted_ray(
    light: u32,
    wi: vec3<f32>,
    radiance: vec3<f32>,
    pdf_wi: f32,
    delta: u32,
    u: vec2<f32>,
    sphere: SceneSphere,
) -> EmittedRay {
    // A light without a sample, such as a sun for which shaders are still being compiled.
    if !(pdf_wi > 0.0) {
        return no_emitted_ray();
    }
    let r = sphere.radius * sqrt(u.y);
    let frame = orthonormal_basis(wi);
    // A little outside of the sphere around the scene.
    let origin = sphere.center + frame * vec3<f32>(r * cos(TWO_PI * u.x), r * sin(TWO_PI * u.x), 1.01 * sphere.radius);
    let density = INV_PI / (sphere.radius * sphere.radius);
    return EmittedRay(origin, 0.0, -wi, light, radiance / (pdf_wi * density), delta, vec3<f32>(0.0), pdf_wi, density);
}

// 0 if rays find nothing in the scene.
fn infinite_emission_density() -> f32 {
    let area = PI * scene.radius * scene.radius;
    return select(0.0, 1.0 / area, area > 0.0);
}
