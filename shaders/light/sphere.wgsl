// Spherical lights (point lights with a radius), of uniform radiance.  A ray passes through them: it receives the radiance once, where it
// enters the sphere, or where it leaves the sphere if it starts inside.
//
// The measure of a stored point is uniform in area.  Vertices sample by solid angle: uniformly in the cone that the sphere subtends, or
// over all directions from inside (Shirley, Wang and Zimmerman 1996).  `LightSample::pdf_scale` is the ratio of the two densities.
#define_import_path bevy_restir::light::sphere

#import bevy_restir::common::constants::{FOUR_PI, LEAST_DIVISOR, LEAST_MAGNITUDE, TWO_PI}
#import bevy_restir::common::math::{octahedral_decode, octahedral_encode, orthonormal_basis}
#import bevy_restir::light::emitted_ray::{area_emission_density, area_emitted_ray, EmittedRay, no_emitted_ray}
#import bevy_restir::light::types::{area_density, LightSample, no_light_sample}
#import bevy_restir::scene::bindings::lights
#import bevy_restir::scene::triangle::safe_normalize

#ifdef LIGHT_SPHERES
fn sphere_radius(light: u32) -> f32 {
    return bitcast<f32>(lights[light].data.x);
}

// The light sample of the point with this normal at the receiver `from_point`.
fn sphere_light_at(light: u32, normal: vec3<f32>, from_point: vec3<f32>) -> LightSample {
    let radius = sphere_radius(light);
    var s = no_light_sample();
    s.light = light;
    s.delta = 0u;
    s.normal = normal;
    s.position = lights[light].position + radius * normal;
    let d = s.position - from_point;
    let d2 = dot(d, d);
    s.wi = safe_normalize(d);
    s.distance = sqrt(d2);
    s.pdf_solid_angle = area_density(d2, abs(dot(normal, d)) * FOUR_PI * radius * radius);
    if !(s.pdf_solid_angle > 0.0) {
        return s;
    }
    s.pdf_scale = sphere_solid_angle_pdf(light, from_point) / s.pdf_solid_angle;
    // From outside, only the near side is visible.
    let is_facing = is_inside(light, from_point) || dot(normal, d) < 0.0;
    s.radiance = select(vec3<f32>(0.0), lights[light].emission, is_facing);
    return s;
}

// A ray to the outside.  Surfaces inside of the sphere receive none: next-event estimation and BSDF sampling light them.
fn sphere_emitted_ray(light: u32, u_point: vec2<f32>, u_direction: vec2<f32>) -> EmittedRay {
    let normal = sample_sphere_area(u_point);
    let radius = sphere_radius(light);
    let position = lights[light].position + radius * normal;
    return area_emitted_ray(light, position, normal, lights[light].emission, 1.0 / (FOUR_PI * radius * radius), u_direction);
}

fn sphere_emission_density(l: LightSample) -> f32 {
    return select(0.0, area_emission_density(l), dot(l.normal, l.wi) < 0.0);
}

// `LightSample::pdf_scale` where an emitted ray arrives.
fn sphere_pdf_scale(ray: EmittedRay, at: vec3<f32>) -> f32 {
    let d = at - ray.origin;
    let radius = sphere_radius(ray.light);
    let projected = max(dot(ray.normal, ray.direction), LEAST_MAGNITUDE) * FOUR_PI * radius * radius;
    return sphere_solid_angle_pdf(ray.light, at) * projected / dot(d, d);
}

// Density of `sample_sphere_solid_angle`, solid angle; the same for all visible points.
fn sphere_solid_angle_pdf(light: u32, from_point: vec3<f32>) -> f32 {
    return 1.0 / (TWO_PI * subtended_cone(light, from_point).x);
}

// (1 - cosine, squared sine) of the angular radius of the sphere; inside, the first is 2, for all directions.
fn subtended_cone(light: u32, from_point: vec3<f32>) -> vec2<f32> {
    let radius = sphere_radius(light);
    let d = lights[light].position - from_point;
    let sine2 = clamp(radius * radius / max(dot(d, d), LEAST_DIVISOR), LEAST_MAGNITUDE, 1.0);
    if is_inside(light, from_point) {
        return vec2<f32>(2.0, 1.0);
    }
    // 1 - cos without cancellation.
    return vec2<f32>(sine2 / (1.0 + sqrt(1.0 - sine2)), sine2);
}

fn is_inside(light: u32, from_point: vec3<f32>) -> bool {
    let d = lights[light].position - from_point;
    return dot(d, d) <= sphere_radius(light) * sphere_radius(light);
}

// Samples a visible point by solid angle at `from_point`; returns its normal.
fn sample_sphere_solid_angle(light: u32, from_point: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    let radius = sphere_radius(light);
    let to_center = lights[light].position - from_point;
    let cone = subtended_cone(light, from_point);
    let one_minus_cosine = u.x * cone.x;
    let cosine = 1.0 - one_minus_cosine;
    let sine2 = one_minus_cosine * (2.0 - one_minus_cosine);
    let phi = TWO_PI * u.y;
    let around = vec2<f32>(cos(phi), sin(phi));
    if is_inside(light, from_point) {
        // Uniform over all directions; the point is where the direction leaves the sphere.
        let wi = vec3<f32>(sqrt(max(sine2, 0.0)) * around, cosine);
        let b = dot(to_center, wi);
        let t = b + sqrt(max(b * b + radius * radius - dot(to_center, to_center), 0.0));
        return safe_normalize(t * wi - to_center);
    }
    // The angle at the center between `from_point` and the sampled point, by the law of sines.
    let ratio = min(sine2 / cone.y, 1.0);
    let central_sine = sqrt(sine2) * (cosine - sqrt(max((1.0 - ratio) * cone.y, 0.0))) / sqrt(cone.y);
    let central_cosine = (sine2 + cosine * sqrt(max((1.0 - ratio) * cone.y, 0.0))) / sqrt(cone.y);
    let frame = orthonormal_basis(safe_normalize(-to_center));
    return normalize(frame * vec3<f32>(central_sine * around, central_cosine));
}

// Coordinates of `LightPoint`.
fn sphere_coordinates(normal: vec3<f32>) -> u32 {
    return octahedral_encode(normal);
}

fn sphere_normal(coordinates: u32) -> vec3<f32> {
    return octahedral_decode(coordinates);
}

// Samples a point uniformly in area; returns its normal.
fn sample_sphere_area(u: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - 2.0 * u.x;
    let r = 2.0 * sqrt(max(u.x * (1.0 - u.x), 0.0));
    return vec3<f32>(r * cos(TWO_PI * u.y), r * sin(TWO_PI * u.y), z);
}

// Distance at which a ray with a unit direction hits the sphere; negative without a hit.
fn sphere_distance(light: u32, origin: vec3<f32>, direction: vec3<f32>) -> f32 {
    let radius = sphere_radius(light);
    let to_center = lights[light].position - origin;
    let along = dot(to_center, direction);
    // Vector from the ray to the center.  A difference of squares instead would lose the radius at great distances.
    let aside = to_center - along * direction;
    let half2 = radius * radius - dot(aside, aside);
    if !(half2 > 0.0) {
        return -1.0;
    }
    let half = sqrt(half2);
    // From inside, the ray hits the sphere where it leaves.
    return select(along - half, along + half, is_inside(light, origin));
}
#else
fn sphere_emitted_ray(light: u32, u_point: vec2<f32>, u_direction: vec2<f32>) -> EmittedRay {
    return no_emitted_ray();
}

fn sphere_emission_density(l: LightSample) -> f32 {
    return 0.0;
}

fn sphere_pdf_scale(ray: EmittedRay, at: vec3<f32>) -> f32 {
    return 1.0;
}

fn sphere_light_at(light: u32, normal: vec3<f32>, from_point: vec3<f32>) -> LightSample {
    return no_light_sample();
}

fn sample_sphere_solid_angle(light: u32, from_point: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    return vec3<f32>(0.0, 0.0, 1.0);
}

fn sphere_coordinates(normal: vec3<f32>) -> u32 {
    return 0u;
}

fn sphere_normal(coordinates: u32) -> vec3<f32> {
    return vec3<f32>(0.0, 0.0, 1.0);
}

fn sample_sphere_area(u: vec2<f32>) -> vec3<f32> {
    return vec3<f32>(0.0, 0.0, 1.0);
}

fn sphere_distance(light: u32, origin: vec3<f32>, direction: vec3<f32>) -> f32 {
    return -1.0;
}
#endif
