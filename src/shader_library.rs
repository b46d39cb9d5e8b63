//! The WGSL modules, and the templates among them.  A file `shaders/a/b.wgsl` is the module `bevy_restir::a::b`; only files in
//! `shaders/pass/` hold entry points.
//!
//! A pass that serves several domains is a template: its line `#import domain::{a, b}` stands for imports from the rooms of one
//! domain.  Each name comes from the first room that defines it, so that a room can extend another one.  Tests compose every module and
//! every instance of a template, with every feature, without a GPU.

use bevy::{
    asset::{Assets, Handle},
    ecs::resource::Resource,
    platform::collections::{HashMap, HashSet},
    shader::Shader,
};
use std::borrow::Cow;

macro_rules! modules {
    ($($path:literal),* $(,)?) => {
        &[$(($path, include_str!(concat!("../shaders/", $path)))),*]
    };
}

/// Path below `shaders/` and text of every file, in an order in which each comes after its imports.
pub const MODULES: &[(&str, &str)] = modules![
    "common/constants.wgsl",
    "common/math.wgsl",
    "common/guard.wgsl",
    "common/ray.wgsl",
    "common/rng.wgsl",
    "common/texel.wgsl",
    "bsdf/fresnel.wgsl",
    "bsdf/ggx.wgsl",
    "bsdf/types.wgsl",
    "bsdf/coat.wgsl",
    "bsdf/diffuse.wgsl",
    "bsdf/roughness.wgsl",
    "bsdf/transmission.wgsl",
    "bsdf/reflection.wgsl",
    "bsdf/lobe_choice.wgsl",
    "bsdf/bsdf.wgsl",
    "scene/types.wgsl",
    "scene/bindings.wgsl",
    "scene/cone.wgsl",
    "scene/directional_albedo.wgsl",
    "scene/texture.wgsl",
    "scene/triangle.wgsl",
    "scene/corners.wgsl",
    "scene/material.wgsl",
    "scene/lobes.wgsl",
    "scene/offset.wgsl",
    "scene/subsurface.wgsl",
    "scene/surface.wgsl",
    "deformation/types.wgsl",
    "deformation/bindings.wgsl",
    "deformation/pose.wgsl",
    "deformation/refit.wgsl",
    "view/types.wgsl",
    "view/bindings.wgsl",
    "view/pixel.wgsl",
    "view/counter_bindings.wgsl",
    "view/ray_counter.wgsl",
    "view/guard_counter.wgsl",
    "view/alpha_seed.wgsl",
    "view/camera.wgsl",
    "view/debug_shift.wgsl",
    "view/false_color.wgsl",
    "view/light_part.wgsl",
    "view/pixel_light.wgsl",
    "view/primary.wgsl",
    "view/render_layers.wgsl",
    "trace/drawn_sides.wgsl",
    "trace/alpha.wgsl",
    "trace/space.wgsl",
    "trace/triangle.wgsl",
    "trace/probe_hits.wgsl",
    "trace/hardware.wgsl",
    "trace/tree.wgsl",
    "trace/software.wgsl",
    "trace/trace.wgsl",
    "subsurface/profile.wgsl",
    "subsurface/probe.wgsl",
    "subsurface/entry.wgsl",
    "light/cube.wgsl",
    "light/environment.wgsl",
    "light/types.wgsl",
    "light/emitted_ray.wgsl",
    "light/directional.wgsl",
    "light/point.wgsl",
    "light/rect.wgsl",
    "light/sphere.wgsl",
    "light/sun.wgsl",
    "light/triangle.wgsl",
    "light/light.wgsl",
    "light/remap.wgsl",
    "light/point_on_light.wgsl",
    "light/analytic_area_light.wgsl",
    "light/backdrop.wgsl",
    "light/direct_view.wgsl",
    "denoiser/types.wgsl",
    "denoiser/albedo.wgsl",
    "denoiser/guide.wgsl",
    "denoiser/mean.wgsl",
    "denoiser/optical_image.wgsl",
    "light/select.wgsl",
    "light/emission.wgsl",
    "light/presampled.wgsl",
    "path/medium.wgsl",
    "path/bidirectional_mis.wgsl",
    "path/random.wgsl",
    "path/roulette.wgsl",
    "path/walk.wgsl",
    "path/scattering.wgsl",
    "path/nee.wgsl",
    "path/shadow_ray.wgsl",
    "path/light_path.wgsl",
    "path/technique_weights.wgsl",
    "path/reference_integrator.wgsl",
    "restir/types.wgsl",
    "restir/bindings.wgsl",
    "restir/iteration_rng.wgsl",
    "restir/flags.wgsl",
    "restir/plants.wgsl",
    "restir/light_candidates.wgsl",
    "restir/mis.wgsl",
    "restir/neighbors.wgsl",
    "restir/pairing.wgsl",
    "restir/pairs.wgsl",
    "restir/path_sample.wgsl",
    "restir/reservoir_layout.wgsl",
    "restir/reservoir_sampling.wgsl",
    "restir/stored_path.wgsl",
    "restir/connection/light_vertex.wgsl",
    "restir/connection/bindings.wgsl",
    "restir/connection/count.wgsl",
    "restir/connection/light_sub_path.wgsl",
    "restir/connection/connection.wgsl",
    "restir/shift/reconnection.wgsl",
    "restir/shift/shifted_path.wgsl",
    "restir/shift/path_end.wgsl",
    "restir/shift/hybrid.wgsl",
    "restir/pt/initial_candidates.wgsl",
    "restir/pt/domain.wgsl",
    "restir/pt/reservoir.wgsl",
    "restir/pt_indirect/domain.wgsl",
    "restir/gi/domain.wgsl",
    "restir/gi/reservoir.wgsl",
    "restir/di/reservoir.wgsl",
    "restir/di/domain.wgsl",
    "restir/di/initial_candidates.wgsl",
    "restir/sss/reservoir.wgsl",
    "restir/sss/domain.wgsl",
    "restir/sss/initial_candidates.wgsl",
    "restir/bdpt/techniques.wgsl",
    "restir/bdpt/last_edge.wgsl",
    "restir/bdpt/splat.wgsl",
    "restir/bdpt/light_map.wgsl",
    "restir/bdpt/map_bindings.wgsl",
    "restir/bdpt/landed.wgsl",
    "restir/bdpt/count_bindings.wgsl",
    "restir/bdpt/light_counts.wgsl",
    "restir/bdpt/reservoir.wgsl",
    "restir/splats/reservoir.wgsl",
    "restir/splats/domain.wgsl",
    "restir/reconnected/reservoir.wgsl",
    "restir/reconnected/domain.wgsl",
    "pass/atlas.wgsl",
    "pass/composite.wgsl",
    "pass/debug.wgsl",
    "pass/debug_di.wgsl",
    "pass/debug_paths.wgsl",
    "pass/debug_counts.wgsl",
    "pass/debug_light_map.wgsl",
    "pass/debug_light_vertices.wgsl",
    "pass/debug_splats.wgsl",
    "pass/debug_sss.wgsl",
    "pass/deform.wgsl",
    "pass/di_candidates.wgsl",
    "pass/environment.wgsl",
    "pass/light_path_counts.wgsl",
    "pass/light_paths.wgsl",
    "pass/pair_neighbors.wgsl",
    "pass/pair_shifts.wgsl",
    "pass/path_candidates.wgsl",
    "pass/presample.wgsl",
    "pass/reconnected.wgsl",
    "pass/reference.wgsl",
    "pass/resolve.wgsl",
    "pass/denoiser_images.wgsl",
    "pass/denoiser_temporal.wgsl",
    "pass/denoiser_filter.wgsl",
    "pass/denoiser_output.wgsl",
    "pass/reuse.wgsl",
    "pass/splats.wgsl",
    "pass/splats_forward.wgsl",
    "pass/splats_gather.wgsl",
    "pass/sss_candidates.wgsl",
    "pass/statistics.wgsl",
    "pass/visibility.wgsl",
];

/// Start of the line that makes a shader a template.
const TEMPLATE_IMPORT: &str = "#import domain::{";

/// Whether a shader is a template.
pub fn is_template(wgsl: &str) -> bool {
    wgsl.contains(TEMPLATE_IMPORT)
}

/// The room that every domain extends.
const COMMON_ROOM: &str = "restir";

/// Puts the modules of a domain into a template.  `rooms`: folders of `shaders/`; each name comes from the first one that defines it, or else
/// from `restir`.  A template may have further such imports, behind shader definitions that only some domains set: from these, names that no
/// room defines are left out.
///
/// # Panics
///
/// If no room defines a name: a mistake in this crate, which its tests find.
pub fn instantiate(wgsl: &str, rooms: &[&str]) -> String {
    let mut parts = wgsl.split(TEMPLATE_IMPORT);
    let mut instance = parts.next().unwrap_or_default().to_string();
    for (i, part) in parts.enumerate() {
        let (names, after) = part.split_once("}\n").unwrap_or_else(|| panic!("the import of a template has no end"));
        for name in names.split(", ") {
            let module = rooms.iter().chain([&COMMON_ROOM]).find_map(|room| module_that_defines(name, room));
            assert!(module.is_some() || i > 0, "none of {rooms:?} defines {name}");
            let module = module.map(|module| module.trim_end_matches(".wgsl").replace('/', "::"));
            instance.extend(module.map(|module| format!("#import bevy_restir::{module}::{name}\n")));
        }
        instance += after;
    }
    instance
}

/// The module of a room, without its subfolders, that defines a function, struct or constant.
fn module_that_defines(name: &str, room: &str) -> Option<&'static str> {
    let definitions = [format!("\nfn {name}("), format!("\nstruct {name} "), format!("\nconst {name}:")];
    let in_room = |path: &str| path.rsplit_once('/').is_some_and(|(folder, _)| folder == room);
    let defines = |text: &str| definitions.iter().any(|definition| text.contains(definition));
    MODULES.iter().find(|(path, text)| in_room(path) && defines(text)).map(|&(path, _)| path)
}

/// Definitions that the shader of a pass, or a module that it imports, asks for.  `path`: `pass/NAME.wgsl`; `rooms`: those of the domain, if
/// the shader is a template.
pub(crate) fn definitions_read_by(path: &str, rooms: &[&str]) -> HashSet<String> {
    let mut names = HashSet::default();
    let mut seen: HashSet<&str> = HashSet::default();
    let mut texts: Vec<Cow<'static, str>> = MODULES.iter().filter(|m| m.0 == path).map(|m| m.1.into()).collect();
    while let Some(text) = texts.pop() {
        let text = if is_template(&text) { instantiate(&text, rooms).into() } else { text };
        for line in text.lines().filter(|line| line.starts_with('#')) {
            names.extend(line.split_once("ifdef ").map(|(_, name)| name.to_string()));
            texts.extend(imported_module(line).filter(|m| seen.insert(m.0)).map(|m| Cow::from(m.1)));
        }
    }
    names
}

/// The module that a line imports.
fn imported_module(line: &str) -> Option<(&'static str, &'static str)> {
    let names = line.strip_prefix("#import bevy_restir::")?;
    let (module, _) = names.split_once("::{").or_else(|| names.rsplit_once("::"))?;
    let path = format!("{}.wgsl", module.replace("::", "/"));
    MODULES.iter().find(|m| m.0 == path).copied()
}

/// A passage of a module that a test replaces.
#[cfg(feature = "testing")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShaderEdit {
    /// Path below `shaders/`.
    pub module: &'static str,
    /// The passage, which must occur exactly once.
    pub from: &'static str,
    pub to: &'static str,
}

/// The text of a module after the edits that concern it.
///
/// # Panics
///
/// If a passage does not occur exactly once: the test no longer plants its error.
#[cfg(feature = "testing")]
pub fn edited(path: &str, text: &str, edits: &[ShaderEdit]) -> String {
    edits.iter().filter(|edit| edit.module == path).fold(text.to_string(), |text, edit| {
        assert_eq!(text.matches(edit.from).count(), 1, "{path} holds this passage exactly once: {}", edit.from);
        text.replacen(edit.from, edit.to, 1)
    })
}

/// Handles that keep the modules alive, by path and by the first room of a template.
#[derive(Resource, Clone)]
pub(crate) struct ShaderLibrary(HashMap<(&'static str, Option<&'static str>), Handle<Shader>>);

impl ShaderLibrary {
    /// Adds every module, and every instance of a template, to Bevy's shaders.  `templates`: name of a pass and rooms of a domain.
    pub(crate) fn new(shaders: &mut Assets<Shader>, templates: &[(&'static str, &'static [&'static str])]) -> Self {
        let mut handles = HashMap::default();
        for &(path, text) in MODULES {
            for (room, shader) in Self::shaders_of(path, text, templates) {
                handles.insert((path, room), shaders.add(shader));
            }
        }
        Self(handles)
    }

    /// The shader of a module, or every instance of a template with the first room of its domain.
    fn shaders_of(
        path: &str,
        text: &str,
        templates: &[(&'static str, &'static [&'static str])],
    ) -> Vec<(Option<&'static str>, Shader)> {
        let name = format!("embedded://bevy_restir/{path}");
        if !is_template(text) {
            return vec![(None, Shader::from_wgsl(text.to_string(), name))];
        }
        let instances = templates.iter().filter(|(file, _)| path == format!("pass/{file}.wgsl"));
        instances
            .map(|(_, rooms)| {
                let name = format!("{name}/{}", rooms[0]);
                (Some(rooms[0]), Shader::from_wgsl(instantiate(text, rooms), name))
            })
            .collect()
    }

    /// Replaces the modules that `edits` concern, and restores those that only `before` concerns.
    #[cfg(feature = "testing")]
    pub(crate) fn edit(
        &self,
        shaders: &mut Assets<Shader>,
        templates: &[(&'static str, &'static [&'static str])],
        before: &[ShaderEdit],
        edits: &[ShaderEdit],
    ) {
        for edit in before.iter().chain(edits) {
            let module = MODULES.iter().find(|(path, _)| *path == edit.module);
            let &(path, text) = module.unwrap_or_else(|| panic!("{} is not in the shader library", edit.module));
            for (room, shader) in Self::shaders_of(path, &edited(path, text, edits), templates) {
                if let Some(handle) = self.0.get(&(path, room)) {
                    let _ = shaders.insert(handle.id(), shader);
                }
            }
        }
    }

    /// The shader of a pass.  `path`: `pass/NAME.wgsl`; `rooms`: those of the domain, if the shader is a template.
    pub(crate) fn pass(&self, path: &str, rooms: &[&'static str]) -> Handle<Shader> {
        let missing = || panic!("{path} with {rooms:?} is not in the shader library");
        self.0.get(&(path, rooms.first().copied())).unwrap_or_else(missing).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_template_takes_each_name_from_the_first_room_that_defines_it() {
        let template = "// Header.\n#import domain::{jacobian_of, receiver_of, no_reservoir}\nfn f() {}\n";
        let rooms = ["restir/gi", "restir/pt"];
        let expected = "// Header.\n#import bevy_restir::restir::gi::domain::jacobian_of\n#import \
                        bevy_restir::restir::pt::domain::receiver_of\n#import \
                        bevy_restir::restir::stored_path::no_reservoir\nfn f() {}\n";
        assert_eq!(instantiate(template, &rooms), expected);
    }
}
