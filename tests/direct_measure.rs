//! Temporary: noise and cost.
use crate::support::{app::*, direct::*, equivalence::Length, proof::Proof, stats};
use bevy::prelude::*;
use bevy_restir::{Direct, Restir, Technique};
use std::time::Instant;

fn env(name: &str, default: &str) -> String {
    std::env::var(name).unwrap_or(default.into())
}

#[test]
#[ignore = "temporary"]
fn measure_noise() {
    let sizes: Vec<u32> = env("SIZES", "32,64").split(',').map(|s| s.parse().unwrap()).collect();
    let frames: u32 = env("FRAMES", "8").parse().unwrap();
    let restarts: u32 = env("RESTARTS", "24").parse().unwrap();
    for name in env("SCENES", "cornell,glossy,many_lights,punctual,furnace").split(',') {
        for &size in &sizes {
            let mut rig = Rig::load(name, size).unwrap();
            rig.set(|r| r.bounces = 0);
            let emission = rig.picture(1);
            rig.set(|r| r.bounces = 1);
            let list: Vec<(&str, Option<Direct>)> = vec![
                ("reference", None),
                (
                    "candidates",
                    Some(Direct { temporal: false, spatial_taps: 0, disocclusion_taps: 0, ..Default::default() }),
                ),
                ("default", Some(Direct::default())),
            ];
            for (what, direct) in list {
                rig.set(|r| {
                    r.accumulate = true;
                    r.technique = if direct.is_some() { Technique::Di } else { Technique::Reference };
                    r.direct = direct.clone().unwrap_or_default();
                });
                rig.until_ready();
                let start = Instant::now();
                let mut means = Vec::new();
                for i in 0..restarts {
                    rig.set(|r: &mut Restir| r.seed = 100 + i);
                    rig.frames(frames - 1);
                    let p = rig.next();
                    assert_eq!(p.samples, frames);
                    means.push(p.mean() - emission.mean());
                }
                let ms = start.elapsed().as_secs_f64() * 1000.0 / f64::from(frames * restarts);
                let (mean, error) = stats::mean_and_error(means.iter().copied());
                let sd = error * f64::from(restarts).sqrt() / mean;
                eprintln!(
                    "{name} {size} {what}: mean {mean:.5} sd of a restart {:.3} %, times sqrt(frames) {:.3} %, {ms:.1} ms a frame; se of all {:.4} %, s for 0.2 %: {:.1}",
                    100.0 * sd,
                    100.0 * sd * f64::from(frames).sqrt(),
                    100.0 * error / mean,
                    ms / 1000.0 * f64::from(frames) * (sd / 0.002).powi(2)
                );
            }
        }
    }
}

/// Which pixels the noise is of.
fn noisy_pixels(rig: &mut Rig, what: &str, restarts: u32, frames: u32) {
    let (technique, direct) = {
        let r = rig.get_mut::<Restir>(rig.camera);
        (r.technique, r.direct.clone())
    };
    rig.set(|r| (r.technique, r.bounces) = (Technique::Reference, 0));
    rig.until_ready();
    let emissions: Vec<Picture> = (0..restarts)
        .map(|i| {
            rig.set(|r| r.seed = 100 + i);
            rig.frames(frames - 1);
            rig.next()
        })
        .collect();
    rig.set(|r| (r.technique, r.bounces, r.direct) = (technique, 1, direct));
    rig.until_ready();
    let n = (0..restarts).fold(None::<(UVec2, Vec<[f64; 2]>)>, |sums, i| {
        rig.set(|r| r.seed = 100 + i);
        rig.frames(frames - 1);
        let p = rig.next();
        let mut sums = sums.unwrap_or((p.size, vec![[0.0; 2]; p.pixels.len()]));
        for ((s, c), e) in sums.1.iter_mut().zip(&p.pixels).zip(&emissions[i as usize].pixels) {
            let v = f64::from(c[0] + c[1] + c[2] - e[0] - e[1] - e[2]) / 3.0;
            s[0] += v;
            s[1] += v * v;
        }
        Some(sums)
    });
    let (size, sums) = n.unwrap();
    let n = f64::from(restarts);
    let mut pixels: Vec<(usize, f64, f64)> = sums
        .iter()
        .enumerate()
        .map(|(i, s)| {
            let m = s[0] / n;
            (i, m, (s[1] / n - m * m).max(0.0))
        })
        .collect();
    let (total, light) = (pixels.iter().map(|p| p.2).sum::<f64>(), pixels.iter().map(|p| p.1).sum::<f64>());
    pixels.sort_by(|a, b| b.2.total_cmp(&a.2));
    eprint!("{what} {size}: relative sd of the mean {:.3} %; ", 100.0 * total.sqrt() / light);
    for share in [0.001, 0.005, 0.02, 0.1] {
        let k = ((pixels.len() as f64 * share) as usize).max(1);
        let var: f64 = pixels[..k].iter().map(|p| p.2).sum();
        let of: f64 = pixels[..k].iter().map(|p| p.1).sum();
        eprint!("top {k}: {:.1} % of the variance, {:.1} % of the light; ", 100.0 * var / total, 100.0 * of / light);
    }
    eprintln!();
    for p in &pixels[..12] {
        eprint!("({},{}) mean {:.2} sd {:.2}; ", p.0 as u32 % size.x, p.0 as u32 / size.x, p.1, p.2.sqrt());
    }
    eprintln!();
}

#[test]
#[ignore = "temporary"]
fn measure_pixels() {
    let size: u32 = env("SIZES", "32").parse().unwrap();
    let frames: u32 = env("FRAMES", "4").parse().unwrap();
    let restarts: u32 = env("RESTARTS", "100").parse().unwrap();
    for name in env("SCENES", "cornell,glossy,many_lights,punctual,furnace").split(',') {
        let mut rig = match name {
            "made_glossy" => scene(size, glossy),
            "made_blended" => scene(size, blended),
            "made_punctual" => scene(size, punctual),
            _ => Rig::load(name, size),
        }
        .unwrap();
        for what in ["reference", "candidates", "both"] {
            rig.set(|r| {
                r.accumulate = true;
                r.technique = if what == "reference" { Technique::Reference } else { Technique::Di };
                r.direct = if what == "both" { both() } else { candidates_only() };
            });
            noisy_pixels(&mut rig, &format!("{name}, {what}"), restarts, frames);
        }
    }
}

#[test]
#[ignore = "temporary"]
fn measure_proof() {
    let n = |name: &str, default: &str| -> u32 { env(name, default).parse().unwrap() };
    let proof = Proof {
        ours: Length { restarts: n("RESTARTS", "24"), frames: n("FRAMES", "8") },
        truth: Length { restarts: n("TRUTH", "24"), frames: n("TRUTH_FRAMES", "32") },
        margin: 0.01,
        pose: None,
        blended: env("BLENDED", "") != "",
    };
    for name in env("SCENES", "cornell").split(',') {
        for size in env("SIZES", "64").split(',') {
            let size: u32 = size.parse().unwrap();
            let mut rig = match name {
                "made_glossy" => scene(size, glossy),
                "made_blended" => scene(size, blended),
                "made_punctual" => scene(size, punctual),
                _ => Rig::load(name, size),
            }
            .unwrap();
            let start = Instant::now();
            let t0 = start.elapsed().as_secs_f64();
            let truth = proof.truth(&mut rig, 1000);
            let t1 = start.elapsed().as_secs_f64() - t0;
            let sd = |r: &crate::support::equivalence::Restarts, l: Length, t: f64| {
                let (m, e) = stats::mean_and_error(r.images.iter().copied());
                let per_frame = e / m * f64::from(l.restarts * l.frames).sqrt();
                let regions: Vec<String> = (0..r.regions[0].len())
                    .map(|i| {
                        let (m2, e) = stats::mean_and_error(r.regions.iter().map(|x| x[i]));
                        format!(
                            "{:.2} of light {:.1} %",
                            m2 / m,
                            100.0 * e / m2 * f64::from(l.restarts * l.frames).sqrt()
                        )
                    })
                    .collect();
                eprintln!(
                    "    a frame: sd {:.2} %, {:.1} ms; {t:.1} s; regions {regions:?}",
                    100.0 * per_frame,
                    1000.0 * t / f64::from(l.restarts * l.frames)
                );
            };
            eprintln!("{name} {size}, pilot {t0:.1} s");
            sd(&truth, proof.truth, t1);
            let list = [
                ("candidates", Direct { temporal: false, spatial_taps: 0, disocclusion_taps: 0, ..Default::default() }),
                ("default", Direct::default()),
                ("small candidates", candidates_only()),
                ("small both", both()),
                ("short both", Direct { confidence_cap: 4.0, ..both() }),
                ("balance", careless(bevy_restir::Mis::Balance)),
                ("with balance", with_mis(bevy_restir::Mis::Balance)),
            ];
            for (what, direct) in list.iter().filter(|l| env("WHAT", "candidates,default").split(',').any(|w| w == l.0))
            {
                let start = Instant::now();
                let ours = proof.resampled(&mut rig, direct, 2000);
                let t = start.elapsed().as_secs_f64();
                eprintln!("  {what}: {}", ours.compare(&truth, 0.01));
                sd(&ours, proof.ours, t);
            }
        }
    }
}

#[test]
#[ignore = "temporary"]
fn measure_signs() {
    use bevy_restir::{BiasCorrection as B, VisibilityReuse as V};
    let proof = Proof::of((24, 24), (40, 24));
    for name in env("SCENES", "cornell,room").split(',') {
        let size: u32 = env("SIZES", "64").parse().unwrap();
        let mut rig = match name {
            "room" => scene(size, |r| {
                room(r);
            }),
            "made_punctual" => scene(size, punctual),
            _ => Rig::load(name, size),
        }
        .unwrap();
        let truth = proof.truth(&mut rig, 1000);
        let d = Direct::default();
        let list = [
            ("ignored", Direct { visibility: V::Ignored, ..d.clone() }),
            ("ignored, no bsdf", Direct { visibility: V::Ignored, bsdf_candidate: false, ..d.clone() }),
            ("shading", Direct { visibility: V::Shading, ..d.clone() }),
            ("shading, no bsdf", Direct { visibility: V::Shading, bsdf_candidate: false, ..d.clone() }),
            ("candidates", Direct { visibility: V::Candidates, ..d.clone() }),
            (
                "candidates, heuristics",
                Direct { visibility: V::Candidates, bias_correction: B::HeuristicsAndMis, ..d.clone() },
            ),
            ("discard", Direct { visibility: V::Discard, ..d.clone() }),
            (
                "discard, heuristics",
                Direct { visibility: V::Discard, bias_correction: B::HeuristicsAndMis, ..d.clone() },
            ),
            ("resampled", d.clone()),
            ("resampled, heuristics", Direct { bias_correction: B::HeuristicsAndMis, ..d.clone() }),
            ("decoupled", Direct { visibility: V::Decoupled, ..d.clone() }),
            ("decoupled 30", Direct { visibility: V::Decoupled, visibility_radius: 30.0, ..d.clone() }),
            (
                "decoupled 30, heuristics",
                Direct {
                    visibility: V::Decoupled,
                    visibility_radius: 30.0,
                    bias_correction: B::HeuristicsAndMis,
                    ..d.clone()
                },
            ),
        ];
        // In shadow: less than half of what is there without.
        let mut lit: Option<Vec<f64>> = None;
        let mean = |r: &crate::support::equivalence::Restarts, i: usize| {
            r.tiles.iter().map(|t| t[i]).sum::<f64>() / r.tiles.len() as f64
        };
        for (what, direct) in &list {
            let start = Instant::now();
            let ours = proof.resampled(&mut rig, direct, 2000);
            let n = ours.tiles[0].len();
            let lit = lit.get_or_insert_with(|| (0..n).map(|i| mean(&ours, i)).collect());
            let part = |shadow: bool| {
                let of: Vec<usize> =
                    (0..n).filter(|&i| (mean(&truth, i) < 0.6 * lit[i]) == shadow && lit[i] > 1e-6).collect();
                let (a, b): (f64, f64) = of
                    .iter()
                    .map(|&i| (mean(&ours, i), mean(&truth, i)))
                    .fold((0.0, 0.0), |s, x| (s.0 + x.0, s.1 + x.1));
                format!("{} tiles {:+.2} %", of.len(), 100.0 * (a / b - 1.0))
            };
            eprintln!(
                "{name}, {what}: {}, in shadow {}, out of it {}, {:.0} s",
                ours.compare(&truth, 0.01),
                part(true),
                part(false),
                start.elapsed().as_secs_f64()
            );
        }
    }
}
