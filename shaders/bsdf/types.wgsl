// Parameters of a BSDF, and a sample of it.  wo and wi are unit vectors in world space that point away from the surface.
#define_import_path bevy_restir::bsdf::types

// Lobes.  Reservoirs of paths store a lobe in three bits.
const LOBE_DIFFUSE: u32 = 0u;        // reflects, and with diffuse transmission transmits
const LOBE_REFLECTION: u32 = 1u;     // of dielectric, metal and interface, which share the microfacets
const LOBE_TRANSMISSION: u32 = 2u;   // through the same microfacets
const LOBE_COAT: u32 = 3u;           // reflection of the clearcoat
// Scattering below the surface, stored in place of a lobe: the path goes on where light enters the translucent object
// (`path/scattering.wgsl`).  No lobe may have this number.
const LOBE_BELOW: u32 = 4u;

struct Bsdf {
    n: vec3<f32>,              // shading normal, on wo's side
    metallic: f32,
    n_geo: vec3<f32>,          // geometric normal, on wo's side
    roughness: f32,            // GGX α, at least ALPHA_MIN; a delta below ALPHA_DELTA
    base_color: vec3<f32>,
    transmission: f32,         // specular transmission: share of the dielectric that is a transmissive interface
    dielectric_reflectance: vec3<f32>,
    eta: f32,                  // index of refraction on the far side / on wo's side; 1 for a thin wall
    tangent: vec3<f32>,        // direction of greatest roughness, perpendicular to n; where both α differ only
    roughness_along: f32,      // GGX α along the tangent, at least `roughness`, which is across it
    coat_normal: vec3<f32>,    // of the clearcoat, on wo's side of n_geo; all coat fields with CLEARCOAT only
    coat: f32,                 // strength of the clearcoat
    coat_roughness: f32,       // like `roughness`
    coat_compensation: f32,    // like `compensation`
    compensation: f32,         // (1 - E)/E for multiple scattering between microfacets; 0 without ENERGY_COMPENSATION
    diffuse_transmission: f32, // share of diffuse light that is transmitted; with DIFFUSE_TRANSMISSION only
    thin: u32,                 // 1: a thin wall, without a volume inside; with THIN_WALL only
    subsurface: vec3<f32>,     // share of reflected diffuse light that scatters below the surface; both fields with SUBSURFACE only
    entry_reflectance: vec3<f32>, // F0 of the interface that light crosses where it enters a body; 0 for other surfaces
}

struct BsdfSample {
    wi: vec3<f32>,
    pdf: f32,                  // marginal density over all lobes, solid angle; 0 for a delta
    weight: vec3<f32>,         // f·|cos|/pdf of all lobes; for a delta its own value / its probability
    lobe: u32,                 // LOBE_*
    delta: u32,
    eta: f32,                  // index of refraction on wi's side / on wo's side; 1 unless refracted
    valid: u32,                // 0: no direction was sampled, and the path ends
}

fn no_bsdf_sample() -> BsdfSample {
    return BsdfSample(vec3<f32>(0.0, 0.0, 1.0), 0.0, vec3<f32>(0.0), LOBE_DIFFUSE, 0u, 1.0, 0u);
}

// A thin wall does not refract, and has no volume inside.
#ifdef THIN_WALL
fn bsdf_is_thin(b: Bsdf) -> bool {
    return b.thin != 0u;
}
#else
fn bsdf_is_thin(b: Bsdf) -> bool {
    return false;
}
#endif
