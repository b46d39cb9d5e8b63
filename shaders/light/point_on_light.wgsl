// A point of a light in eight bytes, independent of the receiver: the sample that ReSTIR DI resamples.  Its measure is uniform on the light
// (area of a triangle, sphere or rectangle; solid angle of the disk of a sun; sampling density of the environment; a delta otherwise), so
// that moving receivers and rigidly moving lights need no Jacobian.  Sampling rounds the coordinates at once, so that the point that is
// weighted is the one that is stored.  Rounding may take a direction of the environment into a cell of another density: a sample has the
// ratio of both.
#define_import_path bevy_restir::light::point_on_light

#import bevy_restir::common::constants::{LIGHT_RECT, LIGHT_SPHERE, LIGHT_SUN, LIGHT_TRIANGLE, NONE}
#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::light::environment::{environment_pdf, environment_sample, into_environment, out_of_environment}
#import bevy_restir::light::light::{environment_light, record_sample}
#import bevy_restir::light::rect::{rect_coordinates, rect_light_at, rect_uv}
#import bevy_restir::light::remap::light_record
#import bevy_restir::light::sphere::{sample_sphere_area, sample_sphere_solid_angle, sphere_coordinates, sphere_light_at, sphere_normal}
#import bevy_restir::light::sun::{sun_coordinates, sun_light_at, sun_uv}
#import bevy_restir::light::triangle::{triangle_light_at, uniform_barycentrics}
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, guarded_light_sample, LightSample, no_light_sample}
#import bevy_restir::scene::bindings::scene
#import bevy_restir::view::render_layers::{light_in_layers, light_kind}

struct LightPoint {
    light: u32,                // id in the table, ENVIRONMENT_LIGHT or NONE
    coordinates: u32,          // triangle, rectangle, disk of a sun: 2 x unorm16; octahedral: normal of a sphere, direction in the
                               // frame of the environment
}

fn no_light_point() -> LightPoint {
    return LightPoint(NONE, 0u);
}

fn triangle_light_point(light: u32, barycentrics: vec2<f32>) -> LightPoint {
    return LightPoint(light, pack2x16unorm(barycentrics));
}

// The point turns with the environment, as points of other lights move with their light, so that its density stays the same.
fn environment_light_point(direction: vec3<f32>) -> LightPoint {
    return LightPoint(ENVIRONMENT_LIGHT, octahedral_encode(into_environment(direction, false)));
}

fn environment_direction(p: LightPoint, previous: bool) -> vec3<f32> {
    return out_of_environment(octahedral_decode(p.coordinates), previous);
}

// A point that was sampled, rounded as it is stored.
struct SampledPoint {
    point: LightPoint,
    rounding: f32,             // density of the point before it was rounded, over that of the rounded one
}

// Samples a point of a light with the density of its measure.
fn light_point_sample(light: u32, u: vec2<f32>) -> SampledPoint {
    if light == ENVIRONMENT_LIGHT {
        let e = environment_sample(u, false);
        if !(e.pdf_solid_angle > 0.0) {
            return SampledPoint(no_light_point(), 1.0);
        }
        let point = environment_light_point(e.direction);
        let density = environment_pdf(environment_direction(point, false), false);
        return SampledPoint(point, select(1.0, e.pdf_solid_angle / density, density > 0.0));
    }
    return SampledPoint(point_of_table(light, u), 1.0);
}

fn point_of_table(light: u32, u: vec2<f32>) -> LightPoint {
    if light >= scene.lights_end {
        return no_light_point();
    }
    switch light_kind(light) {
        case LIGHT_TRIANGLE: {
            return triangle_light_point(light, uniform_barycentrics(u));
        }
        case LIGHT_SPHERE: {
            return LightPoint(light, sphere_coordinates(sample_sphere_area(u)));
        }
        case LIGHT_RECT: {
            return LightPoint(light, rect_coordinates(u));
        }
        case LIGHT_SUN: {
            return LightPoint(light, sun_coordinates(u));
        }
        default: {
            return LightPoint(light, 0u);
        }
    }
}

// Replaces a point of a sphere by one that is sampled by solid angle at `from_point`; the ratio of densities is `LightSample::pdf_scale`.
#ifdef LIGHT_SPHERES
fn point_by_solid_angle(p: LightPoint, from_point: vec3<f32>, u: vec2<f32>) -> LightPoint {
    if p.light >= scene.lights_end || light_kind(p.light) != LIGHT_SPHERE {
        return p;
    }
    return LightPoint(p.light, sphere_coordinates(sample_sphere_solid_angle(p.light, from_point, u)));
}
#else
fn point_by_solid_angle(p: LightPoint, from_point: vec3<f32>, u: vec2<f32>) -> LightPoint {
    return p;
}
#endif

// The light sample of a point at the receiver `from_point`, now or (`previous`) in the last frame.
fn light_point_at(p: LightPoint, from_point: vec3<f32>, previous: bool) -> LightSample {
    return guarded_light_sample(sample_at_point(p, from_point, previous));
}

fn sample_at_point(p: LightPoint, from_point: vec3<f32>, previous: bool) -> LightSample {
    if p.light == ENVIRONMENT_LIGHT {
        let wi = environment_direction(p, previous);
        return environment_light(wi, environment_pdf(wi, previous), previous);
    }
    let record = light_record(p.light, previous);
    if record == NONE || !light_in_layers(record) {
        return no_light_sample();
    }
    switch light_kind(record) {
        case LIGHT_TRIANGLE: {
            // Rounding may put a point beyond the diagonal.
            let b = unpack2x16unorm(p.coordinates);
            return triangle_light_at(record, b / max(1.0, b.x + b.y), from_point, previous);
        }
        case LIGHT_SPHERE: {
            return sphere_light_at(record, sphere_normal(p.coordinates), from_point);
        }
        case LIGHT_RECT: {
            return rect_light_at(record, rect_uv(p.coordinates), from_point);
        }
        case LIGHT_SUN: {
            return sun_light_at(record, sun_uv(p.coordinates));
        }
        default: {
            return record_sample(record, from_point, vec2<f32>(0.5));
        }
    }
}
