//! The confidence of reservoirs follows its recursion exactly, frame by frame: the candidates of a frame count 1, and each neighbor adds
//! its own confidence up to the cap, whatever sample it holds.  A wrong confidence changes noise and no mean, so no picture shows it.

use crate::support::{app::*, proof::AllLight, proof::Indirect, proof::Subject, reuse_settings::*};
use bevy::prelude::*;
use bevy_restir::{
    BiasCorrection, DebugView, Direct, Mis, Paths, Reuse, ReuseOrder,
    testing::{plant_shader_defs, shader_library::ShaderEdit},
};

const SIZE: u32 = 32;
/// Pixels nearer to the edge miss neighbors that lie outside of the image: two pixels more in every frame.
const EDGE: u32 = 12;
const FRAMES: usize = 5;

/// A wall that fills the view, lit in one half only: the other half has no samples.
fn wall() -> Option<Rig> {
    let mut rig = Rig::new(SIZE, SIZE)?;
    rig.spawn(square(40.0), lambert(0.5), Transform::default());
    let spot = SpotLight { intensity: 100.0, outer_angle: 0.5, inner_angle: 0.4, ..default() };
    rig.spawn_bundle((spot, Transform::from_xyz(-1.4, 0.0, 3.0).looking_to(Vec3::NEG_Z, Vec3::Y)));
    Some(rig)
}

/// The confidence after each frame in the interior of the image, where samples of the last frame lose the share `loss` of their confidence.
fn expected(reuse: &Reuse, loss: f64) -> Vec<f64> {
    let (cap, neighbors) = (f64::from(reuse.confidence_cap), f64::from(reuse.spatial_samples));
    let temporal = f64::from(u8::from(reuse.temporal));
    let mut last: Option<f64> = None;
    (0..FRAMES)
        .map(|_| {
            let history = last.map_or(0.0, |c| c.min(cap) * (1.0 - loss));
            let now = match reuse.order {
                // All inputs are those of the last frame.
                ReuseOrder::Spatiotemporal => 1.0 + (temporal + neighbors) * history,
                // Each pixel resamples its history first, and then neighbors that have done the same: they count as much as the pixel itself.
                _ => (1.0 + neighbors) * (1.0 + temporal * history),
            };
            last = Some(now);
            now
        })
        .collect()
}

/// The greatest relative error of the confidence in any frame, in any pixel of the interior.
fn error(rig: &mut Rig, subject: &impl Subject, view: DebugView, reuse: &Reuse) -> f64 {
    error_with_loss(rig, subject, view, reuse, 0.0)
}

fn error_with_loss(rig: &mut Rig, subject: &impl Subject, view: DebugView, reuse: &Reuse, loss: f64) -> f64 {
    rig.set(|r| {
        subject.apply_to(r);
        (r.debug_view, r.bounces) = (view, 2);
    });
    rig.until_ready();
    // A change of the seed restarts the history.
    rig.set(|r| r.seed += 1);
    let mut worst = 0.0f64;
    for wanted in expected(reuse, loss) {
        let picture = rig.next();
        let inside = |at: &UVec2| at.min_element() >= EDGE && at.max_element() < SIZE - EDGE;
        for (_, c) in picture.iter().filter(|(at, _)| inside(at)) {
            worst = worst.max((f64::from(c.x) / wanted - 1.0).abs());
        }
    }
    worst
}

fn reuses() -> [(&'static str, Reuse); 5] {
    let base = Reuse {
        radius: pixels(2.0, SIZE),
        spatial_samples: 2,
        disocclusion_samples: 0,
        confidence_cap: 2.5,
        ..Reuse::SPATIOTEMPORAL
    };
    let separate = ReuseOrder::TemporalThenSpatial;
    [
        ("temporal", Reuse { spatial_samples: 0, ..base.clone() }),
        ("spatiotemporal", Reuse { confidence_cap: 20.0, ..base.clone() }),
        ("temporal, then spatial", Reuse { order: separate, ..base.clone() }),
        ("pairs", Reuse { order: separate, paired: true, mis: Mis::DefensivePairwise, ..base.clone() }),
        ("spatial", Reuse { order: separate, temporal: false, ..base }),
    ]
}

fn direct(reuse: &Reuse) -> Direct {
    Direct { reuse: reuse.clone(), bias_correction: BiasCorrection::UnbiasedMis, ..di::all_reuse() }
}

fn of_paths(reuse: &Reuse) -> Paths {
    Paths { reuse: reuse.clone(), ..paths::all_reuse() }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn confidence_follows_its_recursion_whatever_the_samples_are() {
    let Some(mut rig) = wall() else { return };
    for (name, reuse) in reuses() {
        let errors = [
            error(&mut rig, &direct(&reuse), DebugView::ReservoirConfidence, &reuse),
            error(&mut rig, &AllLight::Pt(of_paths(&reuse)), DebugView::PathConfidence, &reuse),
            error(&mut rig, &Indirect(direct(&reuse), of_paths(&reuse)), DebugView::PathConfidence, &reuse),
        ];
        eprintln!("{name}: {:?}, errors {errors:?}", expected(&reuse, 0.0));
        assert!(errors.iter().all(|e| *e < 1e-6), "{name}: {errors:?}");
    }
    rig.assert_sound();
}

/// Samples that fill the pixels around them lose the share of their confidence that `Paths::decorrelation` states; samples that have no copies
/// lose nothing.
#[test]
#[ignore = "second tier: ./run test --more"]
fn copies_of_a_sample_lower_its_confidence() {
    let Some(mut rig) = wall() else { return };
    let reuse = &reuses()[0].1;
    let paths = Paths { decorrelation: 0.75, ..of_paths(reuse) };
    let off = |rig: &mut Rig, loss| {
        error_with_loss(rig, &AllLight::Pt(paths.clone()), DebugView::PathConfidence, reuse, loss)
    };
    // Without spatial reuse, no pixel has the sample of another one; pixels without light have no sample.
    let alone = off(&mut rig, 0.0);
    assert!(alone < 1e-6, "samples without copies: {alone}");
    let all_equal = ShaderEdit {
        module: "restir/pt/reservoir.wgsl",
        from: "return vec2<u32>(p.path.y, p.path.z & 0xffffu);",
        to: "return vec2<u32>(7u);",
    };
    plant_edits(&mut rig.app, &[all_equal]);
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    let copied = off(&mut rig, 0.75);
    // Confidence is stored in sixteenths.
    assert!(copied < 1.0 / 32.0, "samples that are copied everywhere: {copied}");
    rig.assert_sound();
}

/// Spatial reuse copies samples: the mean confidence falls.
#[test]
#[ignore = "second tier: ./run test --more"]
fn spatial_reuse_makes_copies() {
    let Some(mut rig) = wall() else { return };
    let reuse = Reuse { radius: pixels(8.0, SIZE), confidence_cap: 20.0, ..reuses()[2].1.clone() };
    let mut mean = |decorrelation| {
        rig.set(|r| {
            AllLight::Pt(Paths { decorrelation, ..of_paths(&reuse) }).apply_to(r);
            (r.debug_view, r.bounces, r.reset) = (DebugView::PathConfidence, 2, true);
        });
        rig.picture(24).mean()
    };
    let (free, decorrelated) = (mean(0.0), mean(1.0));
    assert!(decorrelated < 0.995 * free && decorrelated > 0.1 * free, "{free} to {decorrelated}");
}

/// Its own sample would count twice.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_pixel_is_not_its_own_neighbor() {
    let Some(mut rig) = wall() else { return };
    let reuse = Reuse { radius: pixels(2.0, SIZE), ..reuses()[4].1.clone() };
    let marked = ShaderEdit {
        module: "pass/reuse.wgsl",
        from: "(*mis).confidence[count] = s.confidence *",
        to: "(*mis).confidence[count] = select(1.0, 100.0, all(at == pixel)) * s.confidence *",
    };
    let anywhere = ShaderEdit { module: "restir/neighbors.wgsl", from: "min(OWN_RADIUS, center.radius)", to: "0.0" };
    let mut greatest = |edits: &[ShaderEdit]| {
        plant_edits(&mut rig.app, edits);
        rig.set(|r| {
            AllLight::Pt(of_paths(&reuse)).apply_to(r);
            (r.debug_view, r.bounces) = (DebugView::PathConfidence, 2);
        });
        rig.picture(1).iter().map(|(_, c)| c.x).fold(0.0, f32::max)
    };
    let (found, planted) = (greatest(&[marked]), greatest(&[marked, anywhere]));
    assert!(found < 50.0 && planted > 50.0, "{found}, with any position {planted}");
}

pub const WRONG: [(&str, &str, &str, &str); 4] = [
    ("no cap", "pass/reuse.wgsl", "min(s.confidence, settings.confidence_cap)", "s.confidence"),
    (
        "half of a neighbor's",
        "pass/reuse.wgsl",
        "(*mis).confidence[count] = s.confidence *",
        "(*mis).confidence[count] = 0.5 * s.confidence *",
    ),
    (
        "the last input only",
        "pass/reuse.wgsl",
        "output.confidence += mis.confidence[j];",
        "output.confidence = mis.confidence[j];",
    ),
    ("candidates count twice", "pass/path_candidates.wgsl", "selected.ucw, 1.0, true)", "selected.ucw, 2.0, true)"),
];

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_wrong_confidence_is_found() {
    let Some(mut rig) = wall() else { return };
    let (_, reuse) = &reuses()[2];
    let found = |rig: &mut Rig| error(rig, &AllLight::Pt(of_paths(reuse)), DebugView::PathConfidence, reuse);
    for (name, module, from, to) in WRONG {
        plant_edits(&mut rig.app, &[ShaderEdit { module, from, to }]);
        let error = found(&mut rig);
        eprintln!("{name}: off by {error}");
        assert!(error > 0.05, "{name} is not found: {error}");
    }
    plant_edits(&mut rig.app, &[]);
    plant_shader_defs(&mut rig.app, &["PLANT_CONFIDENCE_OF_SUCCESS"]);
    let error = found(&mut rig);
    assert!(error > 0.05, "confidence of successful shifts only is not found: {error}");
}
