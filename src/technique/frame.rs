//! The passes of a frame, as data: those of its technique, and the one that shows light or a debug view.

use super::{
    RowChoice, TechniqueRow, denoiser,
    domain::{Domain, LightPart, PRESAMPLE},
    pass::{ComputePass, Pass, PassResource as R},
    reference::BOUNCES,
    reuse_schedule::IterationKind,
    row,
};
use crate::{
    scene::SceneFeatures,
    settings::{DebugView, Restir, Technique},
};

/// Debug views of the visibility buffer.
const DEBUG_SURFACE: ComputePass = ComputePass { name: "debug", file: "debug", ..RADIANCE_PASS };
const DEBUG_RAYS: ComputePass = ComputePass { name: "debug_rays", file: "debug_counts", ..RADIANCE_PASS };
const DEBUG_GUARDS: ComputePass = ComputePass { name: "debug_guards", defs: &["SHOWS_GUARDS"], ..DEBUG_RAYS };
const RADIANCE_PASS: ComputePass = ComputePass::per_pixel("", &[R::Radiance]);
/// Name of the pass that draws the surfaces of the shown pixels where fewer are traced.
pub(crate) const SHOWN_SURFACES: &str = "visibility_shown";

/// Sums the light of all domains.
pub(super) const RESOLVE: ComputePass = ComputePass::per_pixel(
    "resolve",
    &[
        R::UnresampledLightRead,
        R::DirectLight,
        R::PathLight,
        R::SplatLight,
        R::SubsurfaceLight,
        R::ReconnectedLight,
        R::Radiance,
        R::Counters,
    ],
);
const STATISTICS: ComputePass = ComputePass::per_pixel("statistics", &[R::Counters]);
/// In frames that trace light sub-paths.
const LIGHT_PATH_COUNTS: ComputePass =
    ComputePass::per_pixel("light_path_counts", &[R::Settings, R::LightVerticesRead, R::LightMapRead, R::Counters]);

/// The content of a frame's picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
enum Show {
    #[default]
    Light,
    /// Rays that the technique traced.
    Rays,
    /// Guards that the technique raised.
    Guards,
    /// Scattering events of the reference tracer's paths.
    Bounces,
    /// Reservoirs or other samples of a domain, by the debug pass of this index.
    Samples(&'static Domain, usize),
    /// Contents of the visibility buffer.
    Surface,
}

/// Which iterations of a domain make pairs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
enum Pairing {
    #[default]
    Never,
    /// In some iterations, but not in all.
    Sometimes,
    Always,
}

impl Pairing {
    fn of(settings: &Restir, domain: &Domain) -> Self {
        let kinds = (domain.schedule)(settings).iteration_kinds();
        match [IterationKind::Pairs, IterationKind::Search].map(|kind| kinds.contains(&kind)) {
            [false, _] => Self::Never,
            [true, true] => Self::Sometimes,
            [true, false] => Self::Always,
        }
    }

    /// The kinds of iterations that occur.
    fn kinds(self) -> &'static [IterationKind] {
        match self {
            Self::Never => &[IterationKind::Search],
            Self::Sometimes => &[IterationKind::Search, IterationKind::Pairs],
            Self::Always => &[IterationKind::Pairs],
        }
    }
}

/// The frame that a camera runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct Frame {
    technique: Technique,
    choice: RowChoice,
    show: Show,
    /// The scene has `Subsurface`.
    subsurface: bool,
    /// By the parts of its light.
    pairing: [Pairing; LightPart::COUNT],
    /// Pairs replay paths in a pass of their own.
    compacts: bool,
    /// Iterations of the denoiser's filter; 0: no denoiser.
    filter_iterations: u32,
    /// The denoiser follows the rays of smooth mirrors and clear glass.  In a result of [`Frame::of`], the settings ask for it; in a result of
    /// [`Frame::of_scene`], the scene has such objects, too.
    images: bool,
    /// Passes count their rays.
    counts_rays: bool,
}

/// A step of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Step {
    pub pass: Pass,
    /// Name of its time span.
    pub name: &'static str,
    /// Domain whose resources the pass binds.
    pub domain: Option<&'static Domain>,
    /// Iteration of reuse, from 0.
    pub iteration: usize,
}

/// A step that occurs once in a frame.
fn compute(pass: &'static ComputePass, domain: Option<&'static Domain>) -> Step {
    Step { pass: Pass::Compute(pass), name: pass.name, domain, iteration: 0 }
}

impl Frame {
    /// The frame of some settings.
    pub(crate) fn of(settings: &Restir) -> Self {
        let (view, choice) = (settings.debug_view, RowChoice::of(settings));
        let row = row(settings.technique, choice);
        let show = match view {
            DebugView::Off | DebugView::DiffuseLight | DebugView::SpecularLight => Show::Light,
            DebugView::Rays => Show::Rays,
            DebugView::Guards => Show::Guards,
            DebugView::Bounces => Show::Bounces,
            _ => {
                let samples = |&domain: &&'static Domain| Some(Show::Samples(domain, domain.debug_pass_of(view)?));
                row.domains_with_subsurface.iter().find_map(samples).unwrap_or(Show::Surface)
            }
        };
        let technique = settings.technique;
        let mut pairing = [Pairing::Never; LightPart::COUNT];
        for domain in row.domains {
            pairing[domain.part as usize] = Pairing::of(settings, domain);
        }
        let compacts = settings.research.replay_compaction;
        let filter_iterations = settings.filter_iterations();
        // Direct light shows nothing in a mirror but lamps.
        let images = filter_iterations > 0 && technique.has_indirect_light() && settings.bounces > 1;
        let (subsurface, counts_rays) = (false, false);
        Self { technique, choice, show, subsurface, pairing, compacts, filter_iterations, images, counts_rays }
    }

    /// The frame of a scene with these features, which may have passes of their own.
    pub(crate) fn of_scene(self, features: SceneFeatures) -> Self {
        let images = self.images && features.contains(SceneFeatures::SMOOTH);
        let counts_rays = features.contains(SceneFeatures::COUNT_RAYS);
        Self { subsurface: features.contains(SceneFeatures::SUBSURFACE), images, counts_rays, ..self }
    }

    /// Whether the denoiser follows the rays of smooth mirrors and clear glass.
    pub(crate) fn has_images(self) -> bool {
        self.images
    }

    fn row(self) -> &'static TechniqueRow {
        row(self.technique, self.choice)
    }

    /// The domains of its light.
    fn domains_of_light(self) -> &'static [&'static Domain] {
        let row = self.row();
        if self.subsurface { row.domains_with_subsurface } else { row.domains }
    }

    /// The content of its picture.  Where the scene has no light of the shown domain, the pass for views of surfaces runs, and writes black.
    fn shown(self) -> Show {
        match self.show {
            Show::Samples(domain, _) if !self.domains_of_light().contains(&domain) => Show::Surface,
            show => show,
        }
    }

    /// Whether its passes can add a frame to the sum of the frames before.
    pub(crate) fn sums(self) -> bool {
        match self.shown() {
            Show::Light | Show::Rays | Show::Bounces => true,
            Show::Guards | Show::Samples(..) | Show::Surface => false,
        }
    }

    /// Domains that it resamples, and keeps a history of.
    pub(crate) fn domains(self) -> &'static [&'static Domain] {
        let domains = self.domains_of_light();
        match self.shown() {
            Show::Light | Show::Rays | Show::Guards => domains,
            // Their weights depend on light sub-paths, which one of them traces.
            Show::Samples(..) if domains.iter().any(|domain| domain.light_paths.is_some()) => domains,
            Show::Bounces | Show::Surface => &[],
            Show::Samples(shown, _) => {
                let index = domains.iter().position(|&domain| domain == shown).unwrap_or(0);
                &domains[index..=index]
            }
        }
    }

    /// Its steps in order.  `iterations`: the kinds of a domain's iterations of reuse, in order.
    pub(crate) fn steps(self, iterations: impl Fn(&Domain) -> Vec<IterationKind>) -> Vec<Step> {
        let mut steps = vec![Step { pass: Pass::Visibility, name: "visibility", domain: None, iteration: 0 }];
        let domains = self.domains();
        if let Some(&first) = domains.first() {
            steps.push(compute(&PRESAMPLE, Some(first)));
        }
        for &domain in domains {
            self.push_steps_of(domain, &iterations(domain), &mut steps);
        }
        self.push_steps_of_picture(&mut steps);
        // The passes that write light count guards themselves where this one does not follow.
        if self.counts_rays || self.show != Show::Light {
            steps.push(compute(&STATISTICS, None));
            let traces_light = |&&domain: &&&'static Domain| self.counts_rays && domain.light_paths.is_some();
            steps.extend(domains.iter().find(traces_light).map(|&domain| compute(&LIGHT_PATH_COUNTS, Some(domain))));
        }
        steps.push(Step { pass: Pass::Composite, name: "composite", domain: None, iteration: 0 });
        steps
    }

    /// The steps that resample a domain.
    fn push_steps_of(self, domain: &'static Domain, iterations: &[IterationKind], steps: &mut Vec<Step>) {
        steps.extend(domain.light_paths.iter().map(|pass| compute(pass, Some(domain))));
        steps.push(compute(&domain.candidates, Some(domain)));
        steps.extend(domain.forward.iter().map(|pass| compute(pass, Some(domain))));
        for (iteration, &kind) in iterations.iter().enumerate() {
            let names = &domain.names;
            let step = |pass, name| Step { name, iteration, ..compute(pass, Some(domain)) };
            let pairs = domain.pairs.as_ref().filter(|_| kind == IterationKind::Pairs);
            if let Some(pairs) = pairs {
                steps.push(step(&pairs.neighbors, names.pair_neighbors[iteration]));
                if let Some(passes) = pairs.compaction.as_ref().filter(|_| self.compacts) {
                    steps.push(step(&passes.short_shifts, names.pair_shifts[iteration]));
                    steps.push(step(&passes.replays, names.pair_replays[iteration]));
                } else {
                    steps.push(step(&pairs.shifts, names.pair_shifts[iteration]));
                }
            }
            steps.push(step(pairs.map_or(&domain.reuse, |pairs| &pairs.reuse), names.reuse[iteration]));
        }
    }

    /// The steps that sum up the light, or show something else.
    fn push_steps_of_picture(self, steps: &mut Vec<Step>) {
        let light = self.row().light_pass.unwrap_or(&RESOLVE);
        if self.show == Show::Guards {
            // The pass that sums the light may raise guards, too.
            steps.push(compute(light, None));
        }
        match self.shown() {
            Show::Light if self.filter_iterations > 0 => {
                let of_denoiser = denoiser::steps(self.filter_iterations, self.images);
                steps.extend(of_denoiser.map(|(name, pass, iteration)| Step {
                    name,
                    iteration,
                    ..compute(pass, None)
                }));
            }
            Show::Light => steps.push(compute(light, None)),
            Show::Guards => steps.push(compute(&DEBUG_GUARDS, None)),
            Show::Rays => steps.push(compute(self.row().rays_pass.unwrap_or(&DEBUG_RAYS), None)),
            Show::Bounces => steps.push(compute(&BOUNCES, None)),
            Show::Samples(domain, index) => steps.push(compute(&domain.debug[index].pass, Some(domain))),
            Show::Surface => steps.push(compute(&DEBUG_SURFACE, None)),
        }
    }

    /// Its passes, each once.
    pub(crate) fn passes(self) -> impl Iterator<Item = Pass> {
        // One iteration of each kind, because iterations of a kind share their passes.
        let kinds = |domain: &Domain| self.pairing[domain.part as usize].kinds().to_vec();
        self.steps(kinds).into_iter().map(|step| step.pass)
    }
}

/// The pipelines of a frame: its passes, compiled for the features of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct PipelineKey {
    pub frame: Frame,
    pub features: SceneFeatures,
}

impl PipelineKey {
    /// Whether its pipelines can render the settings of another key; the features of the scene may differ.
    pub(crate) fn serves_settings_of(self, wanted: Self) -> bool {
        let of_settings = SceneFeatures::ENERGY_COMPENSATION
            | SceneFeatures::MANY_NEIGHBORS
            | SceneFeatures::SPLIT_LIGHT
            | SceneFeatures::CONNECTIONS
            | SceneFeatures::COPIED_MIS;
        // This also clears `images`, so that new settings do not wait for the passes of optical images.
        let without_scene = |frame: Frame| frame.of_scene(SceneFeatures::empty());
        without_scene(self.frame) == without_scene(wanted.frame)
            && !(self.features ^ wanted.features).intersects(of_settings)
    }

    /// Whether its pipelines render the same pictures as those of another key, which may count rays or not.
    pub(crate) fn shows_pictures_of(self, wanted: Self) -> bool {
        let key = |key: Self| (Frame { counts_rays: false, ..key.frame }, key.features.of_pictures());
        key(self) == key(wanted)
    }

    /// Whether its pipelines can render the environment of another key.
    pub(crate) fn serves_environment_of(self, wanted: Self) -> bool {
        !(self.features ^ wanted.features).intersects(SceneFeatures::OF_ENVIRONMENT)
    }

    /// Whether these pipelines can read the reservoirs that the pipelines of another key have written.  Connections change the weights of all
    /// paths, and copied weights are stored in place of other numbers.  Other features do not matter: a feature adds code for its own subject,
    /// and leaves all other code and its random numbers unchanged.  Pairs, the denoiser and counts of rays do not matter, because reservoirs hold
    /// nothing of theirs.
    pub(crate) fn reads_reservoirs_of(self, last: Self) -> bool {
        let key = |frame| {
            let (pairing, compacts, filter_iterations, images, counts_rays) = Default::default();
            Frame { pairing, compacts, filter_iterations, images, counts_rays, ..frame }
        };
        let of_weights = SceneFeatures::CONNECTIONS | SceneFeatures::COPIED_MIS;
        key(self.frame) == key(last.frame) && !(self.features ^ last.features).intersects(of_weights)
    }

    /// Whether these pipelines sample paths that those of another key never sampled, such as paths to the first point light.  That light was
    /// in the scene while the pipelines were compiled, but the reservoirs of those frames could not hold it.
    pub(crate) fn samples_more_than(self, last: Self) -> bool {
        let gained = self.features.difference(last.features);
        let changes_alpha =
            self.features.contains(SceneFeatures::ALPHA) && gained.intersects(SceneFeatures::ALPHA_SOURCES);
        changes_alpha || gained.intersects(SceneFeatures::PATHS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_texture_adds_paths_where_surfaces_have_alpha() {
        let key = |features| PipelineKey { frame: Frame::of(&Restir::default()).of_scene(features), features };
        let gains = |before, after| key(before | after).samples_more_than(key(before));
        assert!(!gains(SceneFeatures::empty(), SceneFeatures::TEXTURES));
        assert!(gains(SceneFeatures::ALPHA, SceneFeatures::TEXTURES));
        assert!(gains(SceneFeatures::empty(), SceneFeatures::LAYER_TEXTURES));
    }

    #[test]
    fn pipelines_serve_new_settings_while_those_for_new_objects_are_compiled() {
        let key = |settings: &Restir, features| PipelineKey { frame: Frame::of(settings).of_scene(features), features };
        let settings = Restir::default();
        let compiled = key(&settings, SceneFeatures::empty());
        for feature in [SceneFeatures::SUBSURFACE, SceneFeatures::SMOOTH] {
            let wanted = key(&settings, feature);
            assert!(wanted.frame != compiled.frame && compiled.serves_settings_of(wanted), "{feature:?}");
        }
        let other = Restir { technique: Technique::Reference, ..settings };
        assert!(!compiled.serves_settings_of(key(&other, SceneFeatures::empty())));
    }
}
