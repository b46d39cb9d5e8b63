// What a surface is to light, and what sampling it gives.  wo and wi are unit vectors in the world, away from the surface.
#define_import_path bevy_restir::bsdf::types

const LOBE_DIFFUSE: u32 = 0u;
const LOBE_REFLECTION: u32 = 1u;     // coat, metal and thick interface: they share the microfacets
const LOBE_TRANSMISSION: u32 = 2u;
const LOBE_COUNT: u32 = 3u;

struct Bsdf {
    n: vec3<f32>,              // shading normal, on wo's side
    metallic: f32,
    n_geo: vec3<f32>,          // geometric normal, on wo's side
    roughness: f32,            // GGX α, at least ALPHA_MIN; below ALPHA_DELTA a mirror
    base_color: vec3<f32>,
    transmission: f32,         // of a thick body
    dielectric_reflectance: vec3<f32>,
    eta: f32,                  // index on the far side / index on wo's side
    compensation: f32,         // light that bounces between microfacets / light reflected at once: 0 where it is not asked for
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

// A pair of directions in the frame where the shading normal is z.
struct LocalPair {
    wo: vec3<f32>,
    wi: vec3<f32>,
    carries: bool,             // both directions are on one side of n and n_geo each
}

fn no_bsdf_sample() -> BsdfSample {
    return BsdfSample(vec3<f32>(0.0, 0.0, 1.0), 0.0, vec3<f32>(0.0), LOBE_DIFFUSE, 0u, 1.0, 0u);
}
