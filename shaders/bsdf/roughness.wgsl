// Local frame of the base's microfacets (x along the tangent, z the shading normal), and their α along x and y.  Without ANISOTROPY both
// α are equal.
#define_import_path bevy_restir::bsdf::roughness

#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::math::orthonormal_basis

#ifdef ANISOTROPY
fn frame_of(b: Bsdf) -> mat3x3<f32> {
    return mat3x3<f32>(b.tangent, cross(b.n, b.tangent), b.n);
}

fn alpha_of(b: Bsdf) -> vec2<f32> {
    return vec2<f32>(b.roughness_along, b.roughness);
}
#else
fn frame_of(b: Bsdf) -> mat3x3<f32> {
    return orthonormal_basis(b.n);
}

fn alpha_of(b: Bsdf) -> vec2<f32> {
    return vec2<f32>(b.roughness);
}
#endif
