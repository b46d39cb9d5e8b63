//! Rays are counted where the app asks for it.  Otherwise shaders have no code for it, and pictures are the same.

use crate::support::{app::*, small_scenes::room};
use bevy_restir::{Denoiser, Restir, RestirReport, RestirStatistics, Technique, pass_names};

/// Counts rays from the next frame on, or stops to count them.  Apps of tests count them from the start.
pub fn count_rays(rig: &Rig, is_on: bool) {
    rig.app.world().resource::<RestirStatistics>().count_rays(is_on);
}

/// Four frames whose random numbers are always the same, and the report about them.
fn frames(rig: &mut Rig) -> (Picture, RestirReport) {
    let picture = rig.picture(4);
    // Counters come back some frames late.
    rig.frames(2);
    (picture, rig.report())
}

/// Whether there are pipelines of the pass that sums rays, and pipelines that count them.
fn code_for_counts(report: &RestirReport) -> (bool, bool) {
    let any = |is_one: fn(&str, &[&str]) -> bool| report.pipelines.iter().any(|p| is_one(p.name, &p.defs));
    (any(|name, _| name == "statistics"), any(|_, defs| defs.contains(&"COUNT_RAYS")))
}

/// Compares frames without counts with the same frames with counts, in one app.
fn check(settings: &Restir) {
    let Some(mut rig) = Rig::new(24, 16) else { return };
    room(&mut rig);
    rig.set(|restir| *restir = settings.clone());
    let sums_rays = |report: &RestirReport| pass_names(settings, report.features).contains(&"statistics");
    count_rays(&rig, false);
    let (picture, report) = frames(&mut rig);
    assert_eq!((report.rays, code_for_counts(&report)), (0, (false, false)));
    assert!(!sums_rays(&report));

    count_rays(&rig, true);
    let reports: Vec<_> = (0..8)
        .map(|_| {
            rig.frame();
            rig.report()
        })
        .collect();
    assert!(reports.iter().all(|report| report.ready), "pictures do not wait for counts");
    let (counted_picture, report) = frames(&mut rig);
    assert!(report.rays > 24 * 16 && code_for_counts(&report) == (true, true) && sums_rays(&report), "{report:?}");
    // The first count must not contain the rays of all frames before it.
    assert!(reports.iter().all(|earlier| earlier.rays < 2 * report.rays), "{} rays a frame", report.rays);
    assert_eq!(counted_picture, picture);
    let restarts: Vec<_> = report.history_resets.iter().filter(|(_, count)| *count > 0).collect();
    assert!(restarts.iter().all(|(reason, _)| ["start", "requested"].contains(reason)), "{restarts:?}");
}

#[test]
fn rays_are_counted_on_request_only() {
    check(&Restir { technique: Technique::Di, ..plain() });
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn rays_of_paths_and_denoised_light_are_counted_on_request_only() {
    check(&Restir { accumulate: true, bounces: 3, ..plain() });
    check(&Restir { technique: Technique::Di, denoiser: Denoiser::ON, ..plain() });
    check(&Restir { technique: Technique::Pt, bounces: 3, ..plain() });
}
