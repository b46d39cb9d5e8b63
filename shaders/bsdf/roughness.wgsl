// Local frame of the base's microfacets (x along the tangent, z the normal as the viewer sees it), and their α along x and y.  Without
// ANISOTROPY both α are equal.
#define_import_path bevy_restir::bsdf::roughness

#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::math::orthonormal_basis

// Least cosine between the normal and the direction to the viewer, as in Bevy.
const COS_VIEWER_MIN: f32 = 1.0e-4;

// The shading normal.  Where interpolation or a normal map turns it away from the viewer, who sees the front of the triangle all the same,
// it is bent towards the viewer: silhouettes would be black.  Light can pass a refracting surface in both directions, so its normal must
// not depend on the viewer.
fn normal_towards(b: Bsdf, wo: vec3<f32>) -> vec3<f32> {
    let c = dot(b.n, wo);
    let bent = normalize(b.n + (COS_VIEWER_MIN - c) * wo);
    return select(b.n, bent, c < COS_VIEWER_MIN && !(b.transmission > 0.0));
}

#ifdef ANISOTROPY
fn frame_of(b: Bsdf, wo: vec3<f32>) -> mat3x3<f32> {
    let n = normal_towards(b, wo);
    // Without ANISOTROPY isotropic lobes have this frame, and random numbers must lead to the same directions.
    if b.roughness_along == b.roughness {
        return orthonormal_basis(n);
    }
    // Orthogonal to the normal where that is bent.
    let tangent = normalize(b.tangent - dot(b.tangent, n) * n);
    return mat3x3<f32>(tangent, cross(n, tangent), n);
}

fn alpha_of(b: Bsdf) -> vec2<f32> {
    return vec2<f32>(b.roughness_along, b.roughness);
}
#else
fn frame_of(b: Bsdf, wo: vec3<f32>) -> mat3x3<f32> {
    return orthonormal_basis(normal_towards(b, wo));
}

fn alpha_of(b: Bsdf) -> vec2<f32> {
    return vec2<f32>(b.roughness);
}
#endif
