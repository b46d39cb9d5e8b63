//! The table of techniques.  A technique is data: the domains that it resamples, with their passes, reservoirs and debug views.  A new
//! one takes a file here, a room in `shaders/restir/`, its settings in `src/settings/`, and a row in [`TECHNIQUES`];
//! `docs/architecture.md` lists all files.

mod bdpt;
mod di;
pub(crate) mod domain;
pub(crate) mod frame;
mod gi;
pub(crate) mod pass;
mod pt;
mod reference;
pub(crate) mod reuse_schedule;
mod sss;

use crate::{
    scene::SceneFeatures,
    settings::{DebugView, LightTechniques, Restir, Technique},
};
use domain::Domain;
use frame::Frame;
use pass::ComputePass;

/// A row of the table.
pub(crate) struct TechniqueRow {
    pub technique: Technique,
    /// Domains in the order of their passes; none for the reference tracer.
    pub domains: &'static [&'static Domain],
    /// Domains in a scene that has `Subsurface`, in place of `domains`.
    pub domains_with_subsurface: &'static [&'static Domain],
    /// Pass that writes the light of a technique without domains.
    pub light_pass: Option<&'static ComputePass>,
    /// Pass that writes the number of rays of each pixel, for the debug view of such a technique.
    pub rays_pass: Option<&'static ComputePass>,
}

/// All techniques.
pub(crate) const TECHNIQUES: &[TechniqueRow] = &[reference::ROW, di::ROW, gi::ROW, pt::ROW, bdpt::ROW];

/// Settings that choose among the rows of a technique.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct RowChoice {
    /// Direct light has reservoirs of its own, where the technique leaves the choice.
    separate: bool,
    /// The camera does not see light paths.
    without_splats: bool,
}

impl RowChoice {
    fn of(settings: &Restir) -> Self {
        let without_splats = settings.bdpt.techniques == LightTechniques::NoLightTracing;
        Self { separate: settings.paths.separate_direct_light, without_splats }
    }
}

/// The row of a technique.
pub(crate) fn row(technique: Technique, choice: RowChoice) -> &'static TechniqueRow {
    match technique {
        Technique::Pt if choice.separate => &pt::SEPARATE,
        Technique::Bdpt if choice.without_splats => &bdpt::WITHOUT_SPLATS,
        _ => TECHNIQUES.iter().find(|row| row.technique == technique).unwrap_or(&TECHNIQUES[0]),
    }
}

impl DebugView {
    /// Whether the technique of some settings has something to show.  Views of [`Subsurface`](crate::Subsurface) also need a scene that has it.
    pub fn shows(self, settings: &Restir) -> bool {
        let shows_it = |domain: &Domain| domain.debug_pass_of(self).is_some();
        let row = row(settings.technique, RowChoice::of(settings));
        row.domains_with_subsurface.iter().any(|domain| shows_it(domain)) || !all_domains().any(shows_it)
    }
}

/// Names of the passes that a camera runs with these settings, as time spans have them.  `features`: those of the last frame
/// ([`RestirReport::features`](crate::RestirReport::features)); a scene with [`Subsurface`](crate::Subsurface) has passes of its own.
pub fn pass_names(settings: &Restir, features: SceneFeatures) -> Vec<&'static str> {
    let settings = &settings.clone().clamped();
    let iterations = |domain: &Domain| (domain.schedule)(settings).iteration_kinds();
    let mut frame = Frame::of(settings);
    if features.contains(SceneFeatures::SUBSURFACE) {
        frame = frame.with_subsurface();
    }
    frame.steps(iterations).into_iter().map(|step| step.name).collect()
}

/// The domains of all techniques; those that techniques share come more than once.
pub(crate) fn all_domains() -> impl Iterator<Item = &'static Domain> {
    let rows = TECHNIQUES.iter().chain([&pt::SEPARATE]);
    rows.flat_map(|row| row.domains.iter().chain(row.domains_with_subsurface)).copied()
}

/// Place of a domain among those of its technique, from 0.  It does not depend on the debug view, nor on whether the scene has `Subsurface`.
pub(crate) fn place_in_technique(domain: &Domain) -> u32 {
    let place = |row: &TechniqueRow| row.domains_with_subsurface.iter().position(|other| *other == domain);
    TECHNIQUES.iter().chain([&pt::SEPARATE]).find_map(place).unwrap_or(0) as u32
}

/// Every shader of a pass that is a template, with the rooms (folders of `shaders/`) whose modules are put in.
pub fn shader_templates() -> Vec<(&'static str, &'static [&'static str])> {
    let domains = all_domains();
    let mut templates: Vec<_> = domains
        .flat_map(Domain::passes)
        .filter(|pass| !pass.technique_rooms.is_empty())
        .map(|pass| (pass.file, pass.technique_rooms))
        .collect();
    templates.sort();
    templates.dedup();
    templates
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shader_library::{MODULES, is_template};
    use bevy::reflect::{TypeInfo, Typed};

    #[test]
    fn every_technique_has_one_row() {
        let TypeInfo::Enum(info) = Technique::type_info() else { unreachable!() };
        let rows: Vec<_> = TECHNIQUES.iter().map(|row| format!("{:?}", row.technique)).collect();
        assert_eq!(rows, info.variant_names());
        assert!(TECHNIQUES.iter().map(|row| row.technique).eq(Technique::ALL));
    }

    #[test]
    fn names_of_passes_follow_settings_as_a_camera_uses_them() {
        let names = |spatial_iterations| {
            let mut settings = Restir { technique: Technique::Pt, ..Default::default() };
            settings.paths.reuse.spatial_iterations = spatial_iterations;
            pass_names(&settings, SceneFeatures::empty())
        };
        // At most four are allowed.
        for iterations in [9, u32::MAX] {
            assert_eq!(names(iterations), names(4), "{iterations}");
        }
    }

    #[test]
    fn light_paths_that_the_camera_does_not_see_have_no_passes() {
        let names = |techniques| {
            let mut settings = Restir { technique: Technique::Bdpt, ..Default::default() };
            settings.bdpt.techniques = techniques;
            pass_names(&settings, SceneFeatures::empty())
        };
        let splats = |names: &[&str]| names.iter().filter(|name| name.starts_with("splats")).count();
        assert_eq!(splats(&names(LightTechniques::Full)), 4);
        let names = names(LightTechniques::NoLightTracing);
        assert_eq!(splats(&names), 0);
        assert!(names.contains(&"light_paths") && names.contains(&"connections"), "{names:?}");
    }

    #[test]
    fn every_template_has_an_instance() {
        for (path, _) in MODULES.iter().filter(|(_, text)| is_template(text)) {
            assert!(shader_templates().iter().any(|(file, _)| *path == format!("pass/{file}.wgsl")), "{path}");
        }
    }

    #[test]
    fn domains_of_a_technique_have_different_places() {
        for row in TECHNIQUES.iter().chain([&pt::SEPARATE]) {
            let all = row.domains_with_subsurface;
            assert!(row.domains.iter().all(|domain| all.contains(domain)), "{:?}", row.technique);
            let places: Vec<_> = all.iter().map(|domain| place_in_technique(domain)).collect();
            assert!(places.iter().zip(0..).all(|(place, index)| *place == index), "{:?}: {places:?}", row.technique);
        }
    }

    #[test]
    fn passes_of_different_domains_have_different_names() {
        let mut domains: Vec<_> = all_domains().collect();
        domains.sort_by_key(|domain| domain.names.domain);
        domains.dedup();
        let mut names: Vec<_> =
            domains.iter().flat_map(|domain| domain.passes().map(|pass| (domain.names.domain, pass.name))).collect();
        names.sort_by_key(|(_, pass)| *pass);
        assert!(names.windows(2).all(|pair| pair[0].1 != pair[1].1), "{names:?}");
    }
}
