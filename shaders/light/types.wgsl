// A sample of a light as seen from a receiver.
#define_import_path bevy_restir::light::types

#import bevy_restir::common::constants::{FAR, NONE}
#import bevy_restir::common::guard::{GUARD_LIGHT_SAMPLE, guard_holds, guarded, guarded_3}
#import bevy_restir::common::math::is_finite_3

// Id of the environment; other lights have their index in the table.
const ENVIRONMENT_LIGHT: u32 = 0xfffffffeu;

// Whether a ray can find light: the scene has emissive surfaces, an environment or analytic lights with an extent.
#ifdef LIGHT_TRIANGLES
const RAYS_FIND_LIGHT: bool = true;
#else ifdef ENVIRONMENT
const RAYS_FIND_LIGHT: bool = true;
#else ifdef LIGHT_SHAPES
const RAYS_FIND_LIGHT: bool = true;
#else
const RAYS_FIND_LIGHT: bool = false;
#endif

struct LightSample {
    wi: vec3<f32>,
    distance: f32,             // to the light, m; FAR for lights at infinity
    radiance: vec3<f32>,       // radiance towards the receiver; of a delta light the irradiance at normal incidence
    pdf_solid_angle: f32,      // density of the light's own measure, as solid angle at the receiver; 1 for a delta; 0: no sample
    position: vec3<f32>,       // on the light; for a light at infinity its direction
    delta: u32,                // 1: a delta light, which BSDF sampling cannot hit
    normal: vec3<f32>,         // geometric normal of the light; 0 for point lights, spots and lights at infinity
    light: u32,
    barycentrics: vec2<f32>,   // of a point of a triangle
    pdf_scale: f32,            // density of sampling at the receiver / `pdf_solid_angle`; 1 except for spheres
}

fn no_light_sample() -> LightSample {
    return LightSample(
        vec3<f32>(0.0, 0.0, 1.0), FAR, vec3<f32>(0.0), 0.0, vec3<f32>(0.0), 1u, vec3<f32>(0.0), NONE, vec2<f32>(0.0), 1.0,
    );
}

// Density, solid angle, of a point that is sampled uniformly in area: d²/(|cos| area).  `projected` is |n·d| times the area, so that no cosine
// is computed.  0 where the point is seen edge-on; a density above 1e37 counts as edge-on, because products with it would overflow.
fn area_density(d2: f32, projected: f32) -> f32 {
    let cubed = d2 * sqrt(d2);
    if !(projected > 0.0) || !(cubed < projected * 1.0e37) {
        return 0.0;
    }
    return cubed / projected;
}

// The sample with its guards: `light_sample`, `light_point_at` and `presampled_at` return no other.  A light that is seen edge-on, or from so
// far or so near that f32 cannot hold its density, legally has the density 0.
fn guarded_light_sample(sample: LightSample) -> LightSample {
    var s = sample;
    // Without this test, comparisons with NaN would make the light invisible.
    if !guard_holds(is_finite_3(s.wi) && is_finite_3(s.position), GUARD_LIGHT_SAMPLE) {
        return no_light_sample();
    }
    s.radiance = guarded_3(s.radiance, GUARD_LIGHT_SAMPLE);
    s.pdf_solid_angle = guarded(s.pdf_solid_angle, GUARD_LIGHT_SAMPLE);
    s.pdf_scale = guarded(s.pdf_scale, GUARD_LIGHT_SAMPLE);
    return s;
}
