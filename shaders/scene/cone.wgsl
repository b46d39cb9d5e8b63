// What a pixel covers of the surfaces that it sees: a cone round its ray (Akenine-Möller et al. 2021, "Improved Shader and Texture Level
// of Detail Using Ray Cones"), from the camera on through mirrors and clear glass, as if these were flat.  After any other scattering there
// is none, and textures are taken as they are: a path that is reused from there on depends on nothing that was before, and light that is
// met is the light that is aimed at.  Alpha goes by no cone at all: all rays meet the same surfaces, and the mean of a frame's jitter is
// that of the level.
#define_import_path bevy_restir::scene::cone

struct Cone {
    width: f32,                // where it is, m; 0: no cone
    spread: f32,               // what a metre adds
}

// Further on along the ray.
fn cone_along(cone: Cone, distance: f32) -> Cone {
    return Cone(cone.width + cone.spread * distance, cone.spread);
}

// After scattering by a lobe.
fn cone_after(cone: Cone, is_delta: bool) -> Cone {
    return Cone(select(0.0, cone.width, is_delta), select(0.0, cone.spread, is_delta));
}
