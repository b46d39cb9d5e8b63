// Fresnel reflectance at c = |wo·h|: Schlick's approximation for coats, metals, opaque dielectrics and thin walls; the exact equations for
// refraction.
#define_import_path bevy_restir::bsdf::fresnel

// Schlick's approximation with F90 = 1, or 0 in a channel where F0 = 0: a black F0 switches the interface off.
fn schlick(f0: vec3<f32>, c: f32) -> vec3<f32> {
    let m = clamp(1.0 - c, 0.0, 1.0);
    let m2 = m * m;
    let f90 = select(vec3<f32>(0.0), vec3<f32>(1.0), f0 > vec3<f32>(0.0));
    return f0 + (f90 - f0) * (m2 * m2 * m);
}

// Squared cosine of the refracted direction; zero or negative at total internal reflection.  It is exactly c² for eta = 1.
fn refraction_cosine_squared(c: f32, eta: f32) -> f32 {
    return ((eta - 1.0) * (eta + 1.0) + c * c) / (eta * eta);
}

// Unpolarized reflectance between dielectrics.
fn dielectric_fresnel(c: f32, eta: f32) -> f32 {
    if eta == 1.0 {
        return 0.0;
    }
    let t2 = refraction_cosine_squared(c, eta);
    if !(t2 > 0.0) {
        return 1.0;
    }
    let t = sqrt(t2);
    let parallel = (eta * c - t) / (eta * c + t);
    let perpendicular = (c - eta * t) / (c + eta * t);
    return clamp(0.5 * (parallel * parallel + perpendicular * perpendicular), 0.0, 1.0);
}
