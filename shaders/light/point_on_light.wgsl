// A point of an emitter, kept in eight bytes and independent of who looks at it: the sample that direct lighting resamples.  Its
// measure is uniform on the light (area of a triangle, the sampling density of the environment, a delta else), so that moving
// receivers and rigidly moving lights need no Jacobian.  Coordinates are used as they are decoded, everywhere (trap T6).
#define_import_path bevy_restir::light::point_on_light

#import bevy_restir::common::constants::{LIGHT_TRIANGLE, NONE}
#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::light::environment::{environment_pdf, environment_radiance, environment_sample}
#import bevy_restir::light::light::record_sample
#import bevy_restir::light::remap::light_record
#import bevy_restir::light::triangle::{triangle_light_at, uniform_barycentrics}
#import bevy_restir::light::types::{ENVIRONMENT_LIGHT, LightSample, no_light_sample}
#import bevy_restir::scene::bindings::scene
#import bevy_restir::view::mask::light_kind

struct LightPoint {
    light: u32,                // id in the table, ENVIRONMENT_LIGHT or NONE
    coordinates: u32,          // triangle: barycentrics, 2 x unorm16; environment: octahedral direction
}

fn no_light_point() -> LightPoint {
    return LightPoint(NONE, 0u);
}

fn triangle_light_point(light: u32, barycentrics: vec2<f32>) -> LightPoint {
    return LightPoint(light, pack2x16unorm(barycentrics));
}

fn environment_light_point(direction: vec3<f32>) -> LightPoint {
    return LightPoint(ENVIRONMENT_LIGHT, octahedral_encode(direction));
}

// Draws a point of a light from its measure.
fn light_point_sample(light: u32, u: vec2<f32>) -> LightPoint {
    if light == ENVIRONMENT_LIGHT {
        let e = environment_sample(u);
        if !(e.pdf_solid_angle > 0.0) {
            return no_light_point();
        }
        return environment_light_point(e.direction);
    }
    if light >= scene.light_count {
        return no_light_point();
    }
    if light_kind(light) == LIGHT_TRIANGLE {
        return triangle_light_point(light, uniform_barycentrics(u));
    }
    return LightPoint(light, 0u);
}

// The point as `from_point` sees it, or saw it in the last frame.
fn light_point_at(p: LightPoint, from_point: vec3<f32>, previous: bool) -> LightSample {
    if p.light == ENVIRONMENT_LIGHT {
        var s = no_light_sample();
        s.light = ENVIRONMENT_LIGHT;
        s.delta = 0u;
        s.wi = octahedral_decode(p.coordinates);
        s.position = s.wi;
        s.radiance = environment_radiance(s.wi);
        s.pdf_solid_angle = environment_pdf(s.wi);
        return s;
    }
    let record = light_record(p.light, previous);
    if record == NONE {
        return no_light_sample();
    }
    if light_kind(record) == LIGHT_TRIANGLE {
        // Rounding may put a point beyond the diagonal.
        let b = unpack2x16unorm(p.coordinates);
        return triangle_light_at(record, b / max(1.0, b.x + b.y), from_point, previous);
    }
    return record_sample(record, from_point, vec2<f32>(0.5));
}
