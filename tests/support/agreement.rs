//! Compares all techniques with the reference by their mean radiance alone, for scenes that matter for their extremes.

use super::app::*;
use bevy_restir::{Restir, Technique};

/// Restarts and frames of each mean, and how many standard errors it may be off.
const RESTARTS: u32 = 8;
const FRAMES: u32 = 6;
const ERRORS: f64 = 4.5;

/// Asserts that every technique has the mean of the reference: DI at one bounce, the others at the bounces of the camera.  The relative
/// standard error must be below `precision`; otherwise the test has no power.
pub fn assert_techniques_agree(rig: &mut Rig, what: &str, precision: f64) {
    let bounces = rig.get_mut::<Restir>(rig.camera).bounces;
    for (bounces, techniques) in [(1, &[Technique::Di][..]), (bounces, &[Technique::Gi, Technique::Pt])] {
        rig.set(|r| (r.technique, r.bounces) = (Technique::Reference, bounces));
        let (truth, truth_error) = rig.mean_over(1000..1000 + RESTARTS, 4 * FRAMES);
        for &technique in techniques {
            rig.set(|r| r.technique = technique);
            let (mean, error) = rig.mean_over(2000..2000 + RESTARTS, FRAMES);
            let (difference, error) = ((mean - truth) / truth, error.hypot(truth_error) / truth);
            let found = format!("{what}, {technique:?}: {mean:.5}, off by {difference:+.4} ± {error:.4}");
            eprintln!("{found}");
            assert!(error < precision, "the test has no power: {found}");
            assert!(difference.abs() < ERRORS * error, "{found}");
        }
    }
    rig.set(|r| r.bounces = bounces);
}
