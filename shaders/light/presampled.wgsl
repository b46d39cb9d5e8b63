// Presampled points of lights (Wyman and Panteleev 2021, 5.2).  A record of 48 bytes has all data that a pixel needs to weight a candidate,
// so that it does not read the tables of lights, triangles and materials.
#define_import_path bevy_restir::light::presampled

#import bevy_restir::common::constants::{LEAST_DIVISOR, LIGHT_TRIANGLE, NONE}
#import bevy_restir::common::guard::{GUARD_LIGHT_SAMPLE, guarded, raise, raised_guards}
#import bevy_restir::common::math::max_component
#import bevy_restir::light::point_on_light::{light_point_at, light_point_sample, LightPoint}
#import bevy_restir::light::select::light_select
#import bevy_restir::light::triangle::{is_double_sided, triangle_light_color, triangle_light_opacity}
#import bevy_restir::light::types::{area_density, ENVIRONMENT_LIGHT, guarded_light_sample, LightSample, no_light_sample}
#import bevy_restir::scene::bindings::lights
#import bevy_restir::scene::triangle::{safe_normalize, world_triangle}
#import bevy_restir::view::render_layers::light_kind

struct PresampledLight {
    position: vec3<f32>,       // on the light; direction of the environment
    light: u32,
    normal: vec3<f32>,         // times the area of the triangle; environment: x is the density of the direction, y `SampledPoint::rounding`
    coordinates: u32,
    radiance_scale: f32,       // largest component of the radiance
    color: u32,                // components over the largest one, 3 x 10 bits; PRESAMPLED_*
    pmf: f32,                  // probability of the light; 0: no sample; STOPPED: dropped by the guards whose bits `coordinates` holds
    opacity: f32,              // probability that the alpha test keeps the surface at the point
}

// An analytic light, whose radiance depends on the receiver: the light is read from the table.
const PRESAMPLED_TABLE: u32 = 0x80000000u;
const PRESAMPLED_DOUBLE_SIDED: u32 = 0x40000000u;
// Guards are counted by pixel, and presampling has none: the pixels that draw such a record count its guards.
const STOPPED: f32 = -1.0;

fn presample_light(u: vec4<f32>) -> PresampledLight {
    var s = presample_unguarded(u);
    if raised_guards != 0u {
        s.pmf = STOPPED;
        s.coordinates = raised_guards;
    }
    return s;
}

fn presample_unguarded(u: vec4<f32>) -> PresampledLight {
    let choice = light_select(u.xy);
    let sampled = light_point_sample(choice.light, u.zw);
    let p = sampled.point;
    var s = PresampledLight(vec3<f32>(0.0), p.light, vec3<f32>(0.0), p.coordinates, 0.0, PRESAMPLED_TABLE, choice.pmf, 1.0);
    if p.light == NONE {
        s.pmf = 0.0;
        return s;
    }
    if p.light == ENVIRONMENT_LIGHT {
        let l = light_point_at(p, vec3<f32>(0.0), false);
        s.position = l.wi;
        s.normal = vec3<f32>(l.pdf_solid_angle, sampled.rounding, 0.0);
        return with_radiance(s, l.radiance, 0u);
    }
    if light_kind(p.light) != LIGHT_TRIANGLE {
        return s;
    }
    let instance = lights[p.light].data.x;
    let triangle = lights[p.light].data.y;
    let l = light_point_at(p, vec3<f32>(0.0), false);
    let t = world_triangle(instance, triangle, false);
    s.position = l.position;
    s.normal = t.normal * t.area;
    s.opacity = triangle_light_opacity(p.light, l.barycentrics);
    let sides = select(0u, PRESAMPLED_DOUBLE_SIDED, is_double_sided(instance));
    return with_radiance(s, triangle_light_color(instance, triangle, l.barycentrics), sides);
}

// Stores radiance.  Candidates are only selected by it, so that 10 bits are enough; but a positive component must stay positive, because a
// surface may reflect that channel alone.
fn with_radiance(s: PresampledLight, radiance: vec3<f32>, flags: u32) -> PresampledLight {
    var packed = s;
    packed.radiance_scale = max_component(radiance);
    let shares = 1023.0 * clamp(radiance / max(packed.radiance_scale, LEAST_DIVISOR), vec3<f32>(0.0), vec3<f32>(1.0));
    let share = select(vec3<u32>(shares + 0.5), vec3<u32>(1u), (radiance > vec3<f32>(0.0)) & (shares < vec3<f32>(1.0)));
    packed.color = share.x | (share.y << 10u) | (share.z << 20u) | flags;
    return packed;
}

fn presampled_radiance(s: PresampledLight) -> vec3<f32> {
    let share = vec3<u32>(s.color, s.color >> 10u, s.color >> 20u) & vec3<u32>(1023u);
    return s.radiance_scale * vec3<f32>(share) * (1.0 / 1023.0);
}

// Probability of the light.
fn presampled_pmf(s: PresampledLight) -> f32 {
    if s.pmf == STOPPED {
        raise(s.coordinates);
        return 0.0;
    }
    return guarded(s.pmf, GUARD_LIGHT_SAMPLE);
}

// `SampledPoint::rounding` of the point.
fn presampled_rounding(s: PresampledLight) -> f32 {
    return select(1.0, s.normal.y, s.light == ENVIRONMENT_LIGHT);
}

fn presampled_point(s: PresampledLight) -> LightPoint {
    return LightPoint(s.light, s.coordinates);
}

// `light_point_at` of the record's point, with less precise radiance.
fn presampled_at(s: PresampledLight, from_point: vec3<f32>) -> LightSample {
    if (s.color & PRESAMPLED_TABLE) != 0u {
        return light_point_at(presampled_point(s), from_point, false);
    }
    var l = no_light_sample();
    l.light = s.light;
    l.delta = 0u;
    l.position = s.position;
    if s.light == ENVIRONMENT_LIGHT {
        l.wi = s.position;
        l.radiance = presampled_radiance(s);
        l.pdf_solid_angle = s.normal.x;
        return guarded_light_sample(l);
    }
    let d = s.position - from_point;
    let d2 = dot(d, d);
    l.wi = safe_normalize(d);
    l.distance = sqrt(d2);
    l.pdf_solid_angle = area_density(d2, abs(dot(s.normal, d)));
    if l.pdf_solid_angle > 0.0 {
        let is_facing = (s.color & PRESAMPLED_DOUBLE_SIDED) != 0u || dot(l.wi, s.normal) < 0.0;
        l.radiance = select(vec3<f32>(0.0), presampled_radiance(s), is_facing);
    }
    return guarded_light_sample(l);
}
