//! The app that renders the cases, and a second one where both ray back ends are compared.

use bevy_restir::RayBackend;

use super::{
    Args,
    case::Case,
    stage::{RESTARTS, Stage},
};
use crate::significance;

/// The share of pixels that may differ without further comparison: a ray that passes an edge within rounding hits it in one back end only.
const FLIPPED: f64 = 0.02;
/// Number of pixels that may differ so in the smallest pictures.
const FEWEST_FLIPPED: usize = 2;
/// Relative difference of a pixel that may be rounding.
const ROUNDING: f32 = 1e-3;

/// The apps that render cases.
pub struct Apps {
    stage: Stage,
    /// Traces by ray queries the same rays as the other one by software.
    twin: Option<Stage>,
}

impl Apps {
    pub fn new(args: &Args) -> Result<Self, String> {
        let stage = |backend| Stage::new(args.size, !args.specialized, backend, args.both_backends);
        if !args.both_backends {
            return Ok(Self { stage: stage(args.backend)?, twin: None });
        }
        let software = stage(RayBackend::Software)?;
        // Without ray queries the plugin would warn and trace by software.
        if let Some(missing) = software.missing_for_ray_queries() {
            return Err(format!("--both-backends needs ray queries, and this device has {missing}"));
        }
        Ok(Self { stage: software, twin: Some(stage(RayBackend::Hardware)?) })
    }

    /// Renders a case and removes it; an error is the reason why it fails.
    pub fn run(&mut self, case: &Case, against_reference: bool) -> Result<(), String> {
        let picture = self.stage.run(case)?;
        if let Some(twin) = &mut self.twin {
            let by_ray_queries = |error: String| format!("by ray queries: {error}");
            let other = twin.run(case).map_err(by_ray_queries)?;
            // Whether rays hit objects of extreme sizes depends on rounding, which differs.
            if case.is_ordinary && !is_same(&picture, &other) {
                compare_means(&mut self.stage, twin)?;
            }
            twin.clear().map_err(by_ray_queries)?;
        }
        if against_reference {
            self.stage.compare(case)?;
        }
        self.stage.clear()
    }

    pub fn have_failed(&self) -> bool {
        self.stage.has_failed() || self.twin.as_ref().is_some_and(Stage::has_failed)
    }
}

/// Whether two pictures of the same random numbers are equal, but for rounding and for few pixels whose rays hit something else.
fn is_same(a: &[[f32; 3]], b: &[[f32; 3]]) -> bool {
    let far = a.iter().zip(b).filter(|(p, q)| !is_close(p, q)).count();
    let most = ((FLIPPED * a.len() as f64) as usize).max(FEWEST_FLIPPED);
    a.len() == b.len() && far <= most
}

fn is_close(p: &[f32; 3], q: &[f32; 3]) -> bool {
    let brightest = p.iter().chain(q).fold(1e-6f32, |most, channel| most.max(*channel));
    p.iter().zip(q).all(|(p, q)| (p - q).abs() <= ROUNDING * brightest)
}

/// Compares the mean radiance of the scenes that a case has left in both apps.  Reuse hands a path that differs to all pixels around, so that
/// a few different hits can change the whole picture, but not its mean over restarts with other random numbers.
fn compare_means(software: &mut Stage, hardware: &mut Stage) -> Result<(), String> {
    let settings = software.settings()?;
    let [ours, others] = [software.means(&settings, 0)?, hardware.means(&settings, RESTARTS)?];
    software.counters()?;
    hardware.counters()?;
    let is_finite = |means: &[f64]| means.iter().all(|mean| mean.is_finite());
    if is_finite(&ours) != is_finite(&others) {
        return Err(format!("the mean is finite by one back end only: {ours:?}, by ray queries {others:?}"));
    }
    let (errors, limit) = (significance::difference(&ours, &others), significance::limit(2 * RESTARTS as usize));
    match errors.abs() > limit {
        true => Err(format!(
            "{:?} by ray queries differs from software rays by {errors:+.1} standard errors of at most {limit:.1}: {ours:?}, {others:?}",
            settings.technique
        )),
        false => Ok(()),
    }
}
