// Optional parts of a material: coat, anisotropy, diffuse transmission and thin walls.  Each has a shader definition; without it, the
// fields of the `Bsdf` stay unset and nothing reads them.
#define_import_path bevy_restir::scene::lobes

#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::constants::{ALPHA_DELTA, ALPHA_MIN, LEAST_MAGNITUDE}
#import bevy_restir::common::math::orthonormal_basis
#import bevy_restir::scene::directional_albedo::multiple_scattering
#import bevy_restir::scene::material::MaterialPoint

// The tangent space of a mesh at a point.
struct TangentFrame {
    normal: vec3<f32>,         // interpolated, without a normal map
    tangent: vec3<f32>,
    bitangent: vec3<f32>,
}

// Adds all optional parts to `b`.  `wo` is on the side of its normals and of `coat_normal`.
fn with_lobes(b: Bsdf, point: MaterialPoint, frame: TangentFrame, coat_normal: vec3<f32>, wo: vec3<f32>) -> Bsdf {
    let base = with_thin_wall(with_diffuse_transmission(with_anisotropy(b, point, frame, wo), point), point);
    return with_coat(base, point, coat_normal, wo);
}

// The lobes of a surface as seen from `wo`, which may lie on the side opposite to the normals of `b`.
fn lobes_towards(b: Bsdf, wo: vec3<f32>) -> Bsdf {
    var s = b;
    if dot(wo, b.n_geo) < 0.0 {
        s.n = -b.n;
        s.n_geo = -b.n_geo;
        s.coat_normal = -b.coat_normal;
        s.eta = 1.0 / b.eta;
    }
    s.compensation = multiple_scattering(mean_roughness(s), dot(wo, s.n));
    return with_coat_compensation(s, wo);
}

#ifdef CLEARCOAT
fn with_coat_compensation(b: Bsdf, wo: vec3<f32>) -> Bsdf {
    var s = b;
    s.coat_compensation = multiple_scattering(b.coat_roughness, dot(wo, b.coat_normal));
    return s;
}

fn with_coat(b: Bsdf, point: MaterialPoint, normal: vec3<f32>, wo: vec3<f32>) -> Bsdf {
    let perceptual_roughness = point.clearcoat_perceptual_roughness;
    var c = b;
    c.coat = point.clearcoat;
    c.coat_normal = normal;
    c.coat_roughness = max(perceptual_roughness * perceptual_roughness, ALPHA_MIN);
    return with_coat_compensation(c, wo);
}
#else
fn with_coat_compensation(b: Bsdf, wo: vec3<f32>) -> Bsdf {
    return b;
}

fn with_coat(b: Bsdf, point: MaterialPoint, normal: vec3<f32>, wo: vec3<f32>) -> Bsdf {
    return b;
}
#endif

#ifdef ANISOTROPY
// α along the tangent is mix(α, 1, strength²), and α across it (KHR_materials_anisotropy).  The lobe is a delta if both are below
// ALPHA_DELTA; if only one is, it is raised to ALPHA_DELTA, as the precision of f32 demands.
fn with_anisotropy(b: Bsdf, point: MaterialPoint, frame: TangentFrame, wo: vec3<f32>) -> Bsdf {
    let direction = point.anisotropy_direction;
    let strength = point.anisotropy_strength;
    var a = b;
    a.tangent = tangent_of(b.n, direction.x * frame.tangent + direction.y * frame.bitangent);
    a.roughness_along = mix(b.roughness, 1.0, strength * strength);
    if strength > 0.0 && a.roughness_along >= ALPHA_DELTA {
        a.roughness = max(b.roughness, ALPHA_DELTA);
        a.compensation = multiple_scattering(mean_roughness(a), dot(wo, b.n));
    }
    return a;
}

// The BSDF with isotropic microfacets: one α for both axes.
fn isotropic(b: Bsdf) -> Bsdf {
    var a = b;
    a.roughness_along = b.roughness;
    return a;
}

// α for the table of energy compensation, which is for isotropic lobes.  The root mean square of both α comes nearest: the albedo is right
// to a tenth, except across the grain at grazing angles.
fn mean_roughness(b: Bsdf) -> f32 {
    return sqrt(0.5 * (b.roughness * b.roughness + b.roughness_along * b.roughness_along));
}

// Unit tangent perpendicular to n, whatever mesh and normal map contain.
fn tangent_of(n: vec3<f32>, along: vec3<f32>) -> vec3<f32> {
    let t = along - dot(along, n) * n;
    let t2 = dot(t, t);
    return select(orthonormal_basis(n)[0], t * inverseSqrt(max(t2, LEAST_MAGNITUDE)), t2 > 1.0e-8);
}
#else
fn with_anisotropy(b: Bsdf, point: MaterialPoint, frame: TangentFrame, wo: vec3<f32>) -> Bsdf {
    return b;
}

fn isotropic(b: Bsdf) -> Bsdf {
    return b;
}

fn mean_roughness(b: Bsdf) -> f32 {
    return b.roughness;
}
#endif

#ifdef DIFFUSE_TRANSMISSION
fn with_diffuse_transmission(b: Bsdf, point: MaterialPoint) -> Bsdf {
    var d = b;
    d.diffuse_transmission = point.diffuse_transmission;
    return d;
}
#else
fn with_diffuse_transmission(b: Bsdf, point: MaterialPoint) -> Bsdf {
    return b;
}
#endif

#ifdef THIN_WALL
// A thin wall does not refract.
fn with_thin_wall(b: Bsdf, point: MaterialPoint) -> Bsdf {
    var t = b;
    if !(point.thickness > 0.0) {
        t.thin = 1u;
        t.eta = 1.0;
    }
    return t;
}
#else
fn with_thin_wall(b: Bsdf, point: MaterialPoint) -> Bsdf {
    return b;
}
#endif
