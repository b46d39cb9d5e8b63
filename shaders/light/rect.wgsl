// Rectangular lights: uniform radiance from the front side, sampled uniformly in area.  Rays pass through them.
#define_import_path bevy_restir::light::rect

#import bevy_restir::common::constants::LEAST_MAGNITUDE
#import bevy_restir::light::emitted_ray::{area_emitted_ray, EmittedRay, no_emitted_ray}
#import bevy_restir::light::types::{area_density, LightSample, no_light_sample}
#import bevy_restir::scene::bindings::lights
#import bevy_restir::scene::triangle::safe_normalize

#ifdef LIGHT_RECTS
struct Rect {
    x: vec3<f32>,              // unit vectors along width and height
    y: vec3<f32>,
    normal: vec3<f32>,         // on the emitting side
    half_size: vec2<f32>,
}

// `direction` holds the rotation as modified Rodrigues parameters: the vector part of its quaternion over one plus the scalar.
fn rect_of(light: u32) -> Rect {
    let m = lights[light].direction;
    let m2 = dot(m, m);
    let q = vec4<f32>(2.0 * m, 1.0 - m2) / (1.0 + m2);
    let half_size = vec2<f32>(bitcast<f32>(lights[light].data.x), bitcast<f32>(lights[light].data.y));
    return Rect(
        rotate(q, vec3<f32>(1.0, 0.0, 0.0)),
        rotate(q, vec3<f32>(0.0, 1.0, 0.0)),
        rotate(q, vec3<f32>(0.0, 0.0, -1.0)),
        half_size,
    );
}

// Rotates a vector by a unit quaternion.
fn rotate(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}

// The point at `uv`, 0 to 1 along width and height.
fn rect_point(r: Rect, light: u32, uv: vec2<f32>) -> vec3<f32> {
    let at = (2.0 * uv - 1.0) * r.half_size;
    return lights[light].position + at.x * r.x + at.y * r.y;
}

// The light sample of the point at `uv` at the receiver `from_point`.
fn rect_light_at(light: u32, uv: vec2<f32>, from_point: vec3<f32>) -> LightSample {
    let r = rect_of(light);
    var s = no_light_sample();
    s.light = light;
    s.delta = 0u;
    s.normal = r.normal;
    s.position = rect_point(r, light, uv);
    let d = s.position - from_point;
    let d2 = dot(d, d);
    s.wi = safe_normalize(d);
    s.distance = sqrt(d2);
    s.pdf_solid_angle = area_density(d2, abs(dot(r.normal, d)) * 4.0 * r.half_size.x * r.half_size.y);
    if s.pdf_solid_angle > 0.0 {
        s.radiance = select(vec3<f32>(0.0), lights[light].emission, dot(s.wi, r.normal) < 0.0);
    }
    return s;
}

fn rect_emitted_ray(light: u32, u_point: vec2<f32>, u_direction: vec2<f32>) -> EmittedRay {
    let r = rect_of(light);
    let pdf_point = 0.25 / (r.half_size.x * r.half_size.y);
    return area_emitted_ray(light, rect_point(r, light, u_point), r.normal, lights[light].emission, pdf_point, u_direction);
}

// Coordinates of `LightPoint`.
fn rect_coordinates(uv: vec2<f32>) -> u32 {
    return pack2x16unorm(uv);
}

fn rect_uv(coordinates: u32) -> vec2<f32> {
    return unpack2x16unorm(coordinates);
}

// Distance at which a ray hits the front side; negative without a hit.
fn rect_distance(light: u32, origin: vec3<f32>, direction: vec3<f32>) -> f32 {
    let r = rect_of(light);
    let slope = dot(direction, r.normal);
    let t = dot(lights[light].position - origin, r.normal) / min(slope, -LEAST_MAGNITUDE);
    let uv = rect_uv_at(light, origin + t * direction);
    let is_hit = slope < 0.0 && t > 0.0 && all(uv >= vec2<f32>(0.0)) && all(uv <= vec2<f32>(1.0));
    return select(-1.0, t, is_hit);
}

// `uv` of a point in the plane of the rectangle.
fn rect_uv_at(light: u32, position: vec3<f32>) -> vec2<f32> {
    let r = rect_of(light);
    let d = position - lights[light].position;
    return 0.5 + 0.5 * vec2<f32>(dot(d, r.x), dot(d, r.y)) / r.half_size;
}
#else
fn rect_emitted_ray(light: u32, u_point: vec2<f32>, u_direction: vec2<f32>) -> EmittedRay {
    return no_emitted_ray();
}

fn rect_light_at(light: u32, uv: vec2<f32>, from_point: vec3<f32>) -> LightSample {
    return no_light_sample();
}

fn rect_coordinates(uv: vec2<f32>) -> u32 {
    return 0u;
}

fn rect_uv(coordinates: u32) -> vec2<f32> {
    return vec2<f32>(0.0);
}

fn rect_distance(light: u32, origin: vec3<f32>, direction: vec3<f32>) -> f32 {
    return -1.0;
}

fn rect_uv_at(light: u32, position: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(0.0);
}
#endif
