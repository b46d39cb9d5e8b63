//! The table of techniques.  A technique is data: the domains that it resamples, with their passes, reservoirs and debug views.  A new
//! one takes a file here, a room in `shaders/restir/`, its settings in `src/settings/`, and a row in [`ROWS`];
//! `docs/architecture.md` lists all files.

mod bdpt;
pub(crate) mod denoiser;
mod di;
pub(crate) mod domain;
pub(crate) mod frame;
mod gi;
pub(crate) mod pass;
mod pt;
pub(crate) mod rays;
mod reference;
pub(crate) mod reuse_schedule;
mod sss;

use crate::{
    scene::SceneFeatures,
    settings::{DebugView, Restir, Technique},
};
use domain::Domain;
use frame::{Frame, SHOWN_SURFACES};
use pass::ComputePass;

/// A row of the table.
#[derive(PartialEq)]
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

/// All rows.  The first one of a technique is that of the default choice.
const ROWS: &[&TechniqueRow] = &[
    &reference::ROW,
    &di::ROW,
    &gi::ROW,
    &pt::ROW,
    &pt::SEPARATE,
    &bdpt::ROW,
    &bdpt::WITHOUT_SPLATS,
    &bdpt::RECONNECTED,
];

/// Settings that choose among the rows of a technique; the default where the technique has one row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct RowChoice {
    /// Direct light has reservoirs of its own, where the technique leaves the choice.
    separate: bool,
    /// The camera does not see light paths.
    without_splats: bool,
    /// Light paths that can be reconnected have reservoirs of their own.
    reconnects: bool,
}

impl RowChoice {
    fn of(settings: &Restir) -> Self {
        let bdpt = &settings.bdpt;
        let (without_splats, reconnects) = (!bdpt.splats(), bdpt.reconnects());
        match settings.technique {
            Technique::Pt => Self { separate: settings.paths.separate_direct_light, ..Self::default() },
            Technique::Bdpt => Self { without_splats, reconnects, ..Self::default() },
            Technique::Reference | Technique::Di | Technique::Gi => Self::default(),
        }
    }
}

/// The row of a technique.
pub(crate) fn row(technique: Technique, choice: RowChoice) -> &'static TechniqueRow {
    match technique {
        Technique::Pt if choice.separate => &pt::SEPARATE,
        Technique::Bdpt if choice.without_splats => &bdpt::WITHOUT_SPLATS,
        Technique::Bdpt if choice.reconnects => &bdpt::RECONNECTED,
        _ => ROWS.iter().copied().find(|row| row.technique == technique).unwrap_or(ROWS[0]),
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
    let frame = Frame::of(settings).of_scene(features);
    let shown = (settings.resolution_scale < 1.0).then_some(SHOWN_SURFACES);
    frame.steps(iterations).into_iter().map(|step| step.name).chain(shown).collect()
}

/// The domains of all techniques; those that techniques share come more than once.
pub(crate) fn all_domains() -> impl Iterator<Item = &'static Domain> {
    ROWS.iter().flat_map(|row| row.domains.iter().chain(row.domains_with_subsurface)).copied()
}

/// Place of a domain among those of its technique, from 0.  It does not depend on the debug view, nor on whether the scene has `Subsurface`.
pub(crate) fn place_in_technique(domain: &Domain) -> u32 {
    let place = |row: &&TechniqueRow| row.domains_with_subsurface.iter().position(|other| *other == domain);
    ROWS.iter().find_map(place).unwrap_or(0) as u32
}

/// Every shader of a pass that is a template, with the rooms (folders of `shaders/`) whose modules are put in.
pub fn shader_templates() -> Vec<(&'static str, &'static [&'static str])> {
    let domains = all_domains();
    let mut templates: Vec<_> = domains
        .flat_map(Domain::passes)
        .filter(|pass| !pass.domain_rooms.is_empty())
        .map(|pass| (pass.file, pass.domain_rooms))
        .collect();
    templates.sort();
    templates.dedup();
    templates
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        settings::{Denoiser, LightTechniques},
        shader_library::{MODULES, is_template},
    };
    use bevy::reflect::{TypeInfo, Typed};

    #[test]
    fn every_technique_has_a_row() {
        let TypeInfo::Enum(info) = Technique::type_info() else { unreachable!() };
        let mut techniques: Vec<_> = ROWS.iter().map(|row| row.technique).collect();
        techniques.dedup();
        assert_eq!(techniques, Technique::ALL);
        let names: Vec<_> = techniques.iter().map(|technique| format!("{technique:?}")).collect();
        assert_eq!(names, info.variant_names());
    }

    #[test]
    fn the_row_of_every_choice_is_in_the_table() {
        for technique in Technique::ALL {
            for bits in 0..8 {
                let [separate, without_splats, reconnects] = [1, 2, 4].map(|bit| bits & bit != 0);
                let choice = RowChoice { separate, without_splats, reconnects };
                let row = row(technique, choice);
                assert!(row.technique == technique && ROWS.contains(&row), "{technique:?}, {choice:?}");
            }
        }
    }

    #[test]
    fn settings_of_other_techniques_choose_nothing() {
        for technique in Technique::ALL {
            let choice = |separate, techniques| {
                let mut settings = Restir { technique, ..Default::default() };
                settings.paths.separate_direct_light = separate;
                settings.bdpt.techniques = techniques;
                RowChoice::of(&settings)
            };
            let both = [false, true].map(|separate| choice(separate, LightTechniques::Full));
            assert_eq!(both[0] != both[1], technique == Technique::Pt, "{technique:?}");
            let both =
                [LightTechniques::Full, LightTechniques::NoLightTracing].map(|techniques| choice(true, techniques));
            assert_eq!(both[0] != both[1], technique == Technique::Bdpt, "{technique:?}");
        }
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
    fn the_denoiser_takes_the_place_of_the_sum_of_light() {
        let names = |iterations, accumulate| {
            let denoiser = Denoiser { iterations, ..Denoiser::ON };
            let settings = Restir { denoiser, accumulate, ..Default::default() };
            pass_names(&settings, SceneFeatures::empty())
        };
        let of_denoiser = |name: &str| name.starts_with("denoiser_");
        let denoised = names(3, false);
        let expected = [
            "denoiser_input",
            "denoiser_temporal",
            "denoiser_filter",
            "denoiser_filter_2",
            "denoiser_filter_3",
            "denoiser_output",
        ];
        assert!(
            denoised.iter().copied().filter(|name| of_denoiser(name)).eq(expected) && !denoised.contains(&"resolve")
        );
        for without in [names(0, false), names(3, true)] {
            assert!(!without.iter().any(|name| of_denoiser(name)) && without.contains(&"resolve"), "{without:?}");
        }
    }

    #[test]
    fn light_paths_that_the_camera_does_not_see_have_no_passes() {
        let names = |techniques, light_paths| {
            let mut settings = Restir { technique: Technique::Bdpt, ..Default::default() };
            (settings.bdpt.techniques, settings.bdpt.light_paths) = (techniques, light_paths);
            pass_names(&settings, SceneFeatures::empty())
        };
        let splats = |names: &[&str]| names.iter().filter(|name| name.starts_with("splats")).count();
        assert_eq!(splats(&names(LightTechniques::Full, 1.0)), 4);
        let unseen = names(LightTechniques::NoLightTracing, 1.0);
        assert_eq!(splats(&unseen), 0);
        assert!(unseen.contains(&"light_paths"), "{unseen:?}");
        assert_eq!(splats(&names(LightTechniques::Full, 0.0)), 0);
    }

    #[test]
    fn light_paths_are_reconnected_where_the_camera_sees_them() {
        let passes = |techniques, reconnect_light_paths| {
            let mut settings = Restir { technique: Technique::Bdpt, ..Default::default() };
            settings.bdpt.techniques = techniques;
            settings.bdpt.reconnect_light_paths = reconnect_light_paths;
            let names = pass_names(&settings, SceneFeatures::empty());
            names.iter().filter(|name| name.starts_with("reconnected")).count()
        };
        for techniques in [LightTechniques::Full, LightTechniques::Lightweight] {
            assert_eq!(passes(techniques, false), 0, "{techniques:?}");
            assert!(passes(techniques, true) > 2, "{techniques:?}");
        }
        assert_eq!(passes(LightTechniques::NoLightTracing, true), 0);
    }

    #[test]
    fn every_template_has_an_instance() {
        for (path, _) in MODULES.iter().filter(|(_, text)| is_template(text)) {
            assert!(shader_templates().iter().any(|(file, _)| *path == format!("pass/{file}.wgsl")), "{path}");
        }
    }

    #[test]
    fn domains_of_a_technique_have_different_places() {
        for row in ROWS {
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
