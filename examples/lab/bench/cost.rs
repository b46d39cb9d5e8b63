//! Times of the passes of a frame.

/// Passes that compute no lighting.
const OTHER_PASSES: [&str; 5] = ["visibility", "visibility_shown", "statistics", "light_path_counts", "composite"];

/// Cost of a frame: median times.
#[derive(Clone, Debug)]
pub struct Cost {
    pub(super) passes: Vec<(&'static str, f64)>,
    /// Mean number of rays per pixel.
    pub rays: f64,
    /// Whether the times are GPU times; otherwise they are CPU times.
    pub has_gpu_times: bool,
}

impl Cost {
    /// A cost without any pass.
    pub const NONE: Self = Self { passes: Vec::new(), rays: 0.0, has_gpu_times: false };

    /// The same passes with times that are not known.
    pub fn unknown(&self) -> Self {
        Self { passes: self.passes.iter().map(|(name, _)| (*name, f64::NAN)).collect(), rays: f64::NAN, ..self.clone() }
    }

    fn sum(&self, counts: impl Fn(&str) -> bool) -> f64 {
        self.passes.iter().filter(|(name, _)| counts(name)).map(|(_, ms)| ms).sum()
    }

    /// Milliseconds of presampling the light subsets.
    pub fn presample(&self) -> f64 {
        self.sum(|name| name == "presample")
    }

    /// Milliseconds of the initial candidates.
    pub fn candidates(&self) -> f64 {
        self.sum(|name| name.ends_with("_candidates"))
    }

    /// Milliseconds of reuse over all iterations.
    pub fn reuse(&self) -> f64 {
        self.sum(|name| name.contains("_reuse") || name.contains("_pair_"))
    }

    /// Name and milliseconds of every pass.
    pub fn every_pass(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        self.passes.iter().copied()
    }

    /// Name and milliseconds of every lighting pass.
    pub fn of_passes(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        self.every_pass().filter(|(name, _)| !OTHER_PASSES.contains(name))
    }

    /// Milliseconds of reuse and of resolving its light.
    pub fn reuse_and_shade(&self) -> f64 {
        self.reuse() + self.sum(|name| name == "resolve")
    }

    /// Milliseconds of all lighting passes.
    pub fn lighting(&self) -> f64 {
        self.sum(|name| !OTHER_PASSES.contains(&name))
    }
}
