// What a surface is to light, and what sampling it gives.  wo and wi are unit vectors in the world, away from the surface.
#define_import_path bevy_restir::bsdf::types

// Reservoirs keep a lobe in two bits.
const LOBE_DIFFUSE: u32 = 0u;        // to wo's side and, where the material lets it, to the other
const LOBE_REFLECTION: u32 = 1u;     // dielectric, metal and interface: they share the microfacets
const LOBE_TRANSMISSION: u32 = 2u;   // through the same microfacets
const LOBE_COAT: u32 = 3u;           // the clearcoat's reflection
const LOBE_COUNT: u32 = 4u;

struct Bsdf {
    n: vec3<f32>,              // shading normal, on wo's side
    metallic: f32,
    n_geo: vec3<f32>,          // geometric normal, on wo's side
    roughness: f32,            // GGX α, at least ALPHA_MIN; below ALPHA_DELTA a mirror
    base_color: vec3<f32>,
    transmission: f32,         // share of light that is offered to the interface
    dielectric_reflectance: vec3<f32>,
    eta: f32,                  // index on the far side / index on wo's side; 1 for a thin wall
    tangent: vec3<f32>,        // along which microfacets are roughest, perpendicular to n: read with ANISOTROPY only
    roughness_along: f32,      // GGX α there, at least `roughness`: that one is across
    coat_normal: vec3<f32>,    // of the clearcoat, on the side of n_geo that wo is on: this and what follows is read with CLEARCOAT only
    coat: f32,
    coat_roughness: f32,       // as `roughness`
    coat_compensation: f32,    // as `compensation`
    compensation: f32,         // light that bounces between microfacets / light reflected at once: 0 where it is not asked for
    diffuse_transmission: f32, // share of diffuse light that leaves on the other side: read with DIFFUSE_TRANSMISSION only
    thin: u32,                 // 1: a wall without an inside: read with THIN_WALL only
}

struct BsdfSample {
    wi: vec3<f32>,
    pdf: f32,                  // solid angle, of all lobes; 0 for a delta
    weight: vec3<f32>,         // f·|cos|/pdf of all lobes; of a delta its own value / its probability
    lobe: u32,                 // LOBE_*
    delta: u32,
    eta: f32,                  // index on wi's side / index on wo's side: 1 unless refracted
    valid: u32,                // 0: nothing was sampled, the path ends
}

fn no_bsdf_sample() -> BsdfSample {
    return BsdfSample(vec3<f32>(0.0, 0.0, 1.0), 0.0, vec3<f32>(0.0), LOBE_DIFFUSE, 0u, 1.0, 0u);
}

// Nothing is bent by a thin wall, and no body is entered.
#ifdef THIN_WALL
fn bsdf_is_thin(b: Bsdf) -> bool {
    return b.thin != 0u;
}
#else
fn bsdf_is_thin(b: Bsdf) -> bool {
    return false;
}
#endif
