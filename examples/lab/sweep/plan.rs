//! The configurations of a sweep, as data.

use bevy_restir::{Preset, Restir, Technique};
use bevy_restir_support::fields;

/// Settings to measure: a preset, a technique and changes.
#[derive(Clone, Debug)]
pub struct Configuration {
    pub section: &'static str,
    pub label: String,
    pub technique: Technique,
    pub preset: Preset,
    /// Fields of `Restir` as `PATH=VALUE`.
    pub changes: Vec<String>,
    /// Whether it is also measured under a moving camera.
    pub moves: bool,
    /// Whether it is measured without `--full`, too.
    pub is_first: bool,
}

/// The section of the reference tracer.
pub const REFERENCE: &str = "Reference tracer";
/// The section of the presets as they come.
pub const PRESETS: &str = "Presets";

/// Which configurations are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    Presets,
    Settings,
    Full,
}

/// The reference tracer with the bounces of a preset.
pub fn reference(preset: Preset) -> Configuration {
    let (label, changes) = (format!("{preset:?}"), Vec::new());
    Configuration {
        section: REFERENCE,
        label,
        technique: Technique::Reference,
        preset,
        changes,
        moves: false,
        is_first: true,
    }
}

/// All configurations, the reference tracer first.  With the presets come the techniques without reuse, which presets must beat.
pub fn configurations(extent: Extent) -> Vec<Configuration> {
    let mut all = vec![reference(Preset::Balanced), reference(Preset::Unbiased)];
    for technique in Technique::ALL.into_iter().filter(|t| *t != Technique::Reference) {
        all.extend(Preset::ALL.map(|preset| Configuration {
            section: PRESETS,
            label: format!("{technique:?} {preset:?}"),
            technique,
            preset,
            changes: Vec::new(),
            moves: true,
            is_first: true,
        }));
    }
    let is_full = extent == Extent::Full;
    let mut add = |section, technique, is_first, rows: &[Row]| {
        let is_measured = |row: &&Row| match extent {
            Extent::Presets => row.0 == NO_REUSE.0,
            Extent::Settings => is_first,
            Extent::Full => true,
        };
        all.extend(rows.iter().filter(is_measured).map(|(label, changes)| Configuration {
            section,
            label: (*label).into(),
            technique,
            preset: Preset::Balanced,
            changes: changes.split_whitespace().map(String::from).collect(),
            moves: is_full,
            is_first,
        }));
    };
    for (section, technique, first, more) in [
        ("ReSTIR PT, Balanced with a change", Technique::Pt, &PATHS[..], &MORE_PATHS[..]),
        ("ReSTIR BDPT, Balanced with a change", Technique::Bdpt, &LIGHT_PATHS[..], &MORE_LIGHT_PATHS[..]),
        ("ReSTIR GI, Balanced with a change", Technique::Gi, &INDIRECT[..], &MORE_INDIRECT[..]),
        ("ReSTIR DI, Balanced with a change", Technique::Di, &DIRECT[..], &MORE_DIRECT[..]),
    ] {
        add(section, technique, true, first);
        add(section, technique, false, more);
    }
    let grid: Vec<(String, String)> = grid().collect();
    let rows: Vec<Row> = grid.iter().map(|(label, changes)| (label.as_str(), changes.as_str())).collect();
    add("ReSTIR PT, combinations", Technique::Pt, false, &rows);
    all
}

/// A label and changes.
type Row<'a> = (&'a str, &'a str);

/// Candidates alone.
const NO_REUSE: Row = (
    "no reuse",
    "direct.reuse.temporal=false direct.reuse.spatial_samples=0 paths.reuse.temporal=false paths.reuse.spatial_samples=0 \
     subsurface.reuse.temporal=false subsurface.reuse.spatial_samples=0",
);

/// Neighbors, confidence and radius together.
fn grid() -> impl Iterator<Item = (String, String)> {
    [1, 2, 4, 5].into_iter().flat_map(|neighbors| {
        let caps = [5, 10, 20, 30].into_iter();
        caps.flat_map(move |cap| {
            [20, 60, 120].map(|radius| {
                (
                    format!("{neighbors} neighbors within {radius} pixels, confidence {cap}"),
                    format!(
                        "paths.reuse.spatial_samples={neighbors} paths.reuse.confidence_cap={cap} \
                         paths.reuse.radius={radius}"
                    ),
                )
            })
        })
    })
}

// The settings with the greatest effect on time or error.  `--full` measures the others, too.

const PATHS: [Row; 16] = [
    NO_REUSE,
    ("temporal reuse only", "paths.reuse.spatial_samples=0"),
    ("spatial reuse only", "paths.reuse.temporal=false"),
    ("1 neighbor", "paths.reuse.spatial_samples=1"),
    ("3 neighbors", "paths.reuse.spatial_samples=3"),
    ("radius 20", "paths.reuse.radius=20"),
    ("confidence 5", "paths.reuse.confidence_cap=5"),
    ("confidence 30", "paths.reuse.confidence_cap=30"),
    ("one reservoir for direct and bounced light", "paths.separate_direct_light=false"),
    ("bright pixels without a limit", "firefly_limit=0"),
    ("without the denoiser", "denoiser.iterations=0"),
    ("2 bounces", "bounces=2"),
    ("3 bounces", "bounces=3"),
    ("1 neighbor, 3 bounces", "paths.reuse.spatial_samples=1 bounces=3"),
    ("half the width and height", "resolution_scale=0.5"),
    ("three quarters of the width and height", "resolution_scale=0.75"),
];

const MORE_PATHS: [Row; 14] = [
    ("2 neighbors", "paths.reuse.spatial_samples=2"),
    ("4 neighbors", "paths.reuse.spatial_samples=4"),
    ("2 spatial iterations of 1 neighbor", "paths.reuse.spatial_samples=1 paths.reuse.spatial_iterations=2"),
    ("neighbors without pairs", "paths.reuse.paired=false"),
    ("radius 60", "paths.reuse.radius=60"),
    ("confidence 20", "paths.reuse.confidence_cap=20"),
    ("4 light candidates", "paths.candidates=4"),
    ("32 light candidates", "paths.candidates=32"),
    ("only the kept path is shaded", "paths.reuse.shade_all=false"),
    ("denoiser within 14 pixels", "denoiser.iterations=3"),
    ("thresholds of Lin et al. 2022", "paths.reconnection=Distance"),
    ("5 bounces", "bounces=5"),
    ("16 bounces", "bounces=16"),
    ("a quarter of the width and height", "resolution_scale=0.25"),
];

const LIGHT_PATHS: [Row; 2] = [NO_REUSE, ("no connections", "bdpt.techniques=Lightweight")];

const MORE_LIGHT_PATHS: [Row; 4] = [
    ("copied MIS weights", "bdpt.mis=Copied"),
    ("1 neighbor", "paths.reuse.spatial_samples=1"),
    ("a quarter of the light paths", "bdpt.light_paths=0.25"),
    ("half the width and height", "resolution_scale=0.5"),
];

const INDIRECT: [Row; 1] = [NO_REUSE];

const MORE_INDIRECT: [Row; 3] = [
    ("1 neighbor", "paths.reuse.spatial_samples=1"),
    ("diffuse secondary vertex", "paths.assume_diffuse_secondary=true"),
    ("half the width and height", "resolution_scale=0.5"),
];

const DIRECT: [Row; 3] = [
    NO_REUSE,
    ("8 candidates", "direct.candidates=8"),
    (
        "1 neighbor of the last frame within 30 pixels, confidence 20",
        "direct.reuse.order=Spatiotemporal direct.reuse.spatial_samples=1 direct.reuse.mis=Balance direct.reuse.radius=30 \
         direct.reuse.confidence_cap=20",
    ),
];

const MORE_DIRECT: [Row; 1] = [(
    "visibility reused within 30 pixels",
    "direct.visibility=Decoupled direct.bias_correction=HeuristicsAndMis direct.visibility_radius=30",
)];

impl Configuration {
    /// The settings; `shared` changes come before those of the configuration.
    pub fn settings(&self, shared: &[String]) -> Result<Restir, String> {
        let mut settings = Restir { technique: self.technique, ..Restir::preset(self.preset) };
        fields::set_in_range(&mut settings, shared.iter().chain(&self.changes).map(String::as_str))?;
        Ok(settings)
    }

    /// Lines of Rust that make these settings.
    pub fn code(&self, shared: &[String]) -> Result<String, String> {
        let settings = self.settings(shared)?;
        let mut code = format!(
            "let mut restir = Restir::preset(Preset::{:?});\nrestir.technique = Technique::{:?};\n",
            self.preset, self.technique
        );
        for assignment in shared.iter().chain(&self.changes) {
            let path = fields::path_of(assignment);
            code += &format!("restir.{path} = {};\n", fields::expression(&settings, path));
        }
        Ok(code)
    }

    /// Whether this configuration changes a field that the `shared` changes also set.
    pub fn overrides(&self, shared: &[String]) -> bool {
        self.changes.iter().any(|own| shared.iter().any(|other| fields::path_of(own) == fields::path_of(other)))
    }

    /// Whether it belongs to the table of the presets: a preset, or what presets are compared with.
    pub fn is_of_presets(&self) -> bool {
        [PRESETS, REFERENCE].contains(&self.section) || self.label == NO_REUSE.0
    }

    /// Whether its picture has bounced light.
    pub fn has_bounced_light(&self, shared: &[String]) -> bool {
        self.technique.has_indirect_light() && self.settings(shared).is_ok_and(|settings| settings.bounces > 1)
    }

    /// The section and the label.
    pub fn name(&self) -> String {
        format!("{}: {}", self.section, self.label)
    }

    /// A name for files.
    pub fn id(&self) -> String {
        let name = self.name().to_lowercase();
        let words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
        words.collect::<Vec<_>>().join("-")
    }
}
