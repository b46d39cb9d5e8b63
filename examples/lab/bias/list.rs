//! The settings that add bias, from the documentation of `Restir`.

use bevy_restir::Technique;

/// A biased setting: its name, and the fields of `Restir` that it changes.
pub struct Setting {
    pub technique: Technique,
    pub name: &'static str,
    pub fields: &'static str,
    /// It is biased where something moves.
    pub in_motion: bool,
}

const fn at_rest(technique: Technique, name: &'static str, fields: &'static str) -> Setting {
    Setting { technique, name, fields, in_motion: false }
}

const fn in_motion(technique: Technique, name: &'static str, fields: &'static str) -> Setting {
    Setting { technique, name, fields, in_motion: true }
}

// These trace no rays for MIS weights, which `direct.bias_correction` would otherwise ask for.
const CANDIDATES: &str = "direct.bias_correction=HeuristicsAndMis direct.visibility=Candidates";
const DECOUPLED: &str = "direct.bias_correction=HeuristicsAndMis direct.visibility=Decoupled";
const WITHIN: &str = "direct.bias_correction=HeuristicsAndMis direct.visibility=Decoupled direct.visibility_radius=30";
/// Shadows of `Preset::Performance`.
const SHADOWS: &str = "direct.bias_correction=HeuristicsAndMis direct.visibility=Decoupled direct.visibility_radius=30 \
    direct.reuse.order=Spatiotemporal direct.reuse.spatial_samples=1 direct.reuse.normal_threshold=0.9";

/// The name of the row of the preset without changes.
pub const UNCHANGED: &str = "unchanged";

/// Each setting alone.  The first row of a technique is the preset without changes, which must equal the reference tracer within noise.
pub static SETTINGS: [Setting; 35] = {
    use Technique::{Bdpt, Gi, Pt};
    [
        at_rest(Pt, UNCHANGED, ""),
        at_rest(Pt, "16 bounces", "bounces=16"),
        at_rest(Pt, "8 bounces", "bounces=8"),
        at_rest(Pt, "5 bounces", "bounces=5"),
        at_rest(Pt, "no energy compensation", "energy_compensation=false"),
        at_rest(Pt, "firefly_limit: 10", "firefly_limit=10"),
        at_rest(Pt, "firefly_limit: 2.5", "firefly_limit=2.5"),
        at_rest(Pt, "denoiser", "denoiser.iterations=5"),
        at_rest(Pt, "direct.bsdf_candidate: off", "direct.bsdf_candidate=false"),
        at_rest(Pt, "direct.bias_correction: HeuristicsAndMis", "direct.bias_correction=HeuristicsAndMis"),
        at_rest(Pt, "direct.bias_correction: Heuristics", "direct.bias_correction=Heuristics"),
        at_rest(Pt, "direct.bias_correction: Off", "direct.bias_correction=Off"),
        at_rest(Pt, "direct.visibility: Shading", "direct.visibility=Shading"),
        at_rest(Pt, "direct.visibility: Discard", "direct.visibility=Discard"),
        at_rest(Pt, "direct.visibility: Candidates", CANDIDATES),
        at_rest(Pt, "direct.visibility: Decoupled", DECOUPLED),
        at_rest(Pt, "direct.visibility: Decoupled within 30 pixels", WITHIN),
        at_rest(Pt, "shadows as in Performance", SHADOWS),
        at_rest(Pt, "direct.visibility: Ignored", "direct.visibility=Ignored"),
        at_rest(Pt, "paths.decorrelation: 0.5", "paths.decorrelation=0.5"),
        at_rest(Pt, "paths.decorrelation: 1", "paths.decorrelation=1"),
        at_rest(Gi, UNCHANGED, ""),
        at_rest(Gi, "paths.assume_diffuse_secondary", "paths.assume_diffuse_secondary=true"),
        at_rest(Bdpt, UNCHANGED, ""),
        at_rest(Bdpt, "bdpt.mis: Copied", "bdpt.mis=Copied"),
        in_motion(Pt, UNCHANGED, ""),
        in_motion(Pt, "denoiser", "denoiser.iterations=5"),
        in_motion(Pt, "shadows as in Performance", SHADOWS),
        in_motion(Pt, "paths.decorrelation: 1", "paths.decorrelation=1"),
        in_motion(Pt, "paths.suffix_retrace: ForwardOnly", "paths.suffix_retrace=ForwardOnly"),
        in_motion(Pt, "paths.suffix_retrace: Off", "paths.suffix_retrace=Off"),
        in_motion(Gi, UNCHANGED, ""),
        in_motion(Gi, "paths.assume_diffuse_secondary", "paths.assume_diffuse_secondary=true"),
        in_motion(Bdpt, UNCHANGED, ""),
        in_motion(Bdpt, "bdpt.mis: Copied", "bdpt.mis=Copied"),
    ]
};

impl Setting {
    /// The heading above its rows.
    pub fn section(&self) -> String {
        let motion = if self.in_motion { "while an object passes" } else { "at rest" };
        format!("{:?}, {motion}", self.technique)
    }

    /// Section and name, for `--only`.
    pub fn full_name(&self) -> String {
        format!("{}: {}", self.section(), self.name)
    }
}
