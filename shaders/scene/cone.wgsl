// Ray cones: the footprint of a pixel on the surfaces that it sees, for texture filtering (Akenine-Möller et al. 2021, "Improved Shader and
// Texture Level of Detail Using Ray Cones").  A cone passes mirrors and clear glass as if they were flat.  After any other scattering it
// ends, and textures are sampled at their finest level: a reused path must not depend on the vertices before the reconnection, and hits of
// emitters must have the radiance that NEE samples.  Alpha is never filtered, so that all rays agree on where a surface is.
#define_import_path bevy_restir::scene::cone

struct Cone {
    width: f32,                // diameter at the current point, m; 0: no cone
    spread: f32,               // growth of the width per meter
}

// The cone after a distance along the ray.
fn cone_along(cone: Cone, distance: f32) -> Cone {
    return Cone(cone.width + cone.spread * distance, cone.spread);
}

// The cone after scattering by a lobe.
fn cone_after(cone: Cone, is_delta: bool) -> Cone {
    return Cone(select(0.0, cone.width, is_delta), select(0.0, cone.spread, is_delta));
}
