//! The one table of WGSL modules.  A file `shaders/a/b.wgsl` is the module `bevy_restir::a::b`; those under `pass/` hold the entry
//! points and nothing else does.  The tests compose every row, with every feature, without a GPU.

use bevy::{
    asset::{Assets, Handle},
    ecs::resource::Resource,
    platform::collections::HashMap,
    shader::Shader,
};

macro_rules! table {
    ($($path:literal),* $(,)?) => {
        &[$(($path, include_str!(concat!("../shaders/", $path)))),*]
    };
}

/// Path below `shaders/` and text of every module.
pub const MODULES: &[(&str, &str)] = table![
    "common/constants.wgsl",
    "common/math.wgsl",
    "common/texel.wgsl",
    "common/rng.wgsl",
    "scene/types.wgsl",
    "scene/bindings.wgsl",
    "scene/texture.wgsl",
    "scene/cone.wgsl",
    "scene/material.wgsl",
    "scene/albedo.wgsl",
    "scene/triangle.wgsl",
    "view/types.wgsl",
    "bsdf/types.wgsl",
    "bsdf/fresnel.wgsl",
    "bsdf/ggx.wgsl",
    "bsdf/diffuse.wgsl",
    "bsdf/roughness.wgsl",
    "bsdf/transmission.wgsl",
    "bsdf/reflection.wgsl",
    "bsdf/coat.wgsl",
    "bsdf/lobe_choice.wgsl",
    "bsdf/bsdf.wgsl",
    "light/types.wgsl",
    "light/cube.wgsl",
    "light/environment.wgsl",
    "light/triangle.wgsl",
    "light/point.wgsl",
    "light/directional.wgsl",
    "light/sphere.wgsl",
    "light/rect.wgsl",
    "light/sun.wgsl",
    "light/light.wgsl",
    "light/select.wgsl",
    "light/remap.wgsl",
    "light/point_on_light.wgsl",
    "light/shape.wgsl",
    "light/presampled.wgsl",
    "restir/mis.wgsl",
    "restir/stream.wgsl",
    "restir/reservoir.wgsl",
    "restir/types.wgsl",
    "restir/bindings.wgsl",
    "restir/candidate.wgsl",
    "restir/shape.wgsl",
    "restir/tiling.wgsl",
    "restir/kept_path.wgsl",
    "restir/path_reservoir.wgsl",
    "view/primary.wgsl",
    "restir/direct.wgsl",
    "view/backdrop.wgsl",
    "path/medium.wgsl",
    "path/shadow.wgsl",
    "trace/ray.wgsl",
    "trace/triangle.wgsl",
    "trace/offset.wgsl",
    "trace/space.wgsl",
    "trace/tree.wgsl",
    "trace/software.wgsl",
    "trace/hardware.wgsl",
    "trace/trace.wgsl",
    "scene/lobes.wgsl",
    "scene/surface.wgsl",
    "view/bindings.wgsl",
    "view/mask.wgsl",
    "view/alpha_seed.wgsl",
    "view/false_color.wgsl",
    "view/camera.wgsl",
    "trace/alpha.wgsl",
    "path/estimate.wgsl",
    "path/sample.wgsl",
    "path/random.wgsl",
    "path/walk.wgsl",
    "shift/connect.wgsl",
    "path/tree.wgsl",
    "shift/hybrid.wgsl",
    "restir/paths.wgsl",
    "restir/indirect_reservoir.wgsl",
    "restir/indirect.wgsl",
    "pass/atlas.wgsl",
    "pass/visibility.wgsl",
    "pass/reference.wgsl",
    "pass/debug.wgsl",
    "pass/presample.wgsl",
    "pass/path_candidates.wgsl",
    "pass/direct_candidates.wgsl",
    "pass/reuse.wgsl",
    "pass/debug_reservoirs.wgsl",
    "pass/debug_paths.wgsl",
    "pass/debug_rays.wgsl",
    "pass/resolve.wgsl",
    "pass/statistics.wgsl",
    "pass/composite.wgsl",
    "pass/environment.wgsl",
];

/// The handles that keep the modules alive, by path.
#[derive(Resource, Clone)]
pub(crate) struct ShaderTable(HashMap<&'static str, Handle<Shader>>);

impl ShaderTable {
    /// Hands every module to Bevy.
    pub(crate) fn new(shaders: &mut Assets<Shader>) -> Self {
        Self(
            MODULES
                .iter()
                .map(|&(path, text)| {
                    let name = format!("embedded://bevy_restir/{path}");
                    (path, shaders.add(Shader::from_wgsl(text, name)))
                })
                .collect(),
        )
    }

    /// The handle of a pass: `pass/NAME.wgsl`.
    pub(crate) fn pass(&self, path: &str) -> Handle<Shader> {
        self.0.get(path).unwrap_or_else(|| panic!("{path} is not in the table of shaders")).clone()
    }
}
