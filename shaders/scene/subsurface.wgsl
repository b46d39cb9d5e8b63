// Parameters of subsurface scattering at a point.  Without SUBSURFACE nothing scatters below its surface.
#define_import_path bevy_restir::scene::subsurface

#import bevy_restir::common::constants::{INSTANCE_SUBSURFACE, INSTANCE_SUBSURFACE_SHIFT, LEAST_MAGNITUDE}
#import bevy_restir::scene::bindings::{element_texel, instances, subsurfaces}

struct SubsurfacePoint {
    weight: vec3<f32>,         // share of reflected diffuse light that scatters below the surface
    radius: vec3<f32>,         // length d of the profile, m; 0 where the weight is 0
}

#ifdef SUBSURFACE
// A channel is diffuse where its length is below a hundredth of a pixel, or too small for the precision of positions, because diffuse
// reflection then looks the same.  Up to twice that length, both are mixed.
const PIXEL_SHARE: f32 = 0.01;
const OFFSET_FACTOR: f32 = 16.0;

// `footprint`: diameter of the pixel, or 0 where the path does not track it; `offset`: rounding error of the position, both in m.
fn subsurface_at(instance: u32, base_color: vec3<f32>, front: bool, footprint: f32, offset: f32) -> SubsurfacePoint {
    let flags = instances[instance].flags;
    if (flags & INSTANCE_SUBSURFACE) == 0u || !front {
        return SubsurfacePoint(vec3<f32>(0.0), vec3<f32>(0.0));
    }
    let index = flags >> INSTANCE_SUBSURFACE_SHIFT;
    let record = textureLoad(subsurfaces, element_texel(index, 1u), 0);
    let radius = subsurface_radius(record.rgb, base_color);
    let smallest = max(max(PIXEL_SHARE * footprint, OFFSET_FACTOR * offset), LEAST_MAGNITUDE);
    let ramp = clamp(radius / smallest - 1.0, vec3<f32>(0.0), vec3<f32>(1.0));
    return SubsurfacePoint(record.a * ramp, select(vec3<f32>(0.0), radius, ramp > vec3<f32>(0.0)));
}

// Length d of the profile for a mean free path and an albedo: the fit of Christensen and Burley (2015) for diffuse transmission.
fn subsurface_radius(mean_free_path: vec3<f32>, albedo: vec3<f32>) -> vec3<f32> {
    let a = albedo - 0.8;
    return mean_free_path / (1.9 - albedo + 3.5 * a * a);
}
#else
fn subsurface_at(instance: u32, base_color: vec3<f32>, front: bool, footprint: f32, offset: f32) -> SubsurfacePoint {
    return SubsurfacePoint(vec3<f32>(0.0), vec3<f32>(0.0));
}
#endif
