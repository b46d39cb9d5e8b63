//! Paired spatial reuse: partners are a random involution of the pixels, both pixels of a pair agree whether they use it, and the picture
//! equals the reference with half as many rays of spatial reuse.

use crate::support::{
    app::{Rig, plant_edits},
    gpu::{Bound, Gpu, gpu},
    oracle::pairs::partner,
    proof::{AllLight, Bidirectional, Indirect, Proof, Subject},
    reuse_settings::{di, paths},
    small_scenes::*,
    stats::{Random, assert_family, chi_squared},
};
use bevy::prelude::*;
use bevy_restir::{
    Direct, Jitter, LightTechniques, Mis, Paths, Reuse, ReuseOrder, testing::shader_library::ShaderEdit,
};

/// Pixel, logarithm of the tiles' side, frame, stream, slot.
type Case = [u32; 6];

fn partners(gpu: &Gpu, cases: &[Case]) -> Vec<[u32; 2]> {
    let (input, output) = (gpu.storage(cases), gpu.zeroed::<[u32; 2]>(cases.len()));
    let kernel = gpu.kernel("pairs", include_str!("../support/kernels/pairs.wgsl"), &[]);
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    kernel.run([(cases.len() as u32).div_ceil(64), 1, 1], &bound);
    gpu.read(&output)
}

fn case(random: &mut Random, bits: u32) -> Case {
    let [x, y, frame, stream] = [0; 4].map(|_| (random.bits() >> 40) as u32 & 0xfff);
    [x, y, bits, frame, stream, random.bits() as u32 & 15]
}

#[test]
fn the_partner_of_a_partner_is_the_pixel() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random(7);
    // Far from the left and the upper border, so that no partner has a negative coordinate.
    let cases: Vec<Case> = (0..40_000)
        .map(|i| {
            let [x, y, rest @ ..] = case(&mut random, 2 + i % 9);
            [2048 + x, 2048 + y, rest[0], rest[1], rest[2], rest[3]]
        })
        .collect();
    let there = partners(gpu, &cases);
    let back: Vec<Case> = cases.iter().zip(&there).map(|(c, p)| [p[0], p[1], c[2], c[3], c[4], c[5]]).collect();
    for ((c, there), back) in cases.iter().zip(&there).zip(partners(gpu, &back)) {
        assert_eq!(back, [c[0], c[1]], "{c:?}");
        assert_ne!(*there, back, "{c:?}");
        assert!((0..2).all(|i| there[i].abs_diff(back[i]) < 1 << c[2]), "{c:?}: {there:?}");
    }
}

#[test]
fn partners_equal_those_of_the_oracle() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random(8);
    // Small coordinates, too: a partner left of the image or above has huge coordinates.
    let cases: Vec<Case> = (0..4000)
        .map(|i| {
            let [x, y, rest @ ..] = case(&mut random, 2 + i % 4);
            let from = [x, x % 16][i as usize / 4 % 2];
            [from, y % 64, rest[0], rest[1], rest[2], rest[3]]
        })
        .collect();
    for (c, found) in cases.iter().zip(partners(gpu, &cases)) {
        let expected = partner([c[0], c[1]], c[2], c[3], c[4], c[5]);
        assert_eq!(found.map(|x| i64::from(x as i32)), expected, "{c:?}");
    }
}

/// All ordered pairs of different pixels of a tile are equally frequent.
#[test]
fn partners_are_uniform_in_a_tile() {
    let Some(gpu) = gpu() else { return };
    let kinds = [2, 3, 4].into_iter().flat_map(|bits| [false, true].map(|one_frame| (bits, one_frame)));
    assert_family(kinds.map(|(bits, one_frame)| {
        let test = move |seed: u32| {
            let mut random = Random(u64::from(seed));
            let side = 1i32 << bits;
            let cases: Vec<Case> = (0..60_000u32)
                .map(|i| {
                    let [x, y, rest @ ..] = case(&mut random, bits);
                    // Tiles or frames and slots differ, so that the cases are independent.
                    if one_frame {
                        [(i & 255) << 4 | x & 15, (i >> 8) << 4 | y & 15, bits, 5, seed, 3]
                    } else {
                        [x, y, bits, rest[1], rest[2] << 16 | i, rest[3]]
                    }
                })
                .collect();
            let cells = (2 * side - 1) as usize;
            let mut counts = vec![0.0; cells * cells];
            for (c, p) in cases.iter().zip(partners(gpu, &cases)) {
                let [dx, dy] = [0, 1].map(|i| (p[i].wrapping_sub(c[i]) as i32 + side - 1) as usize);
                counts[dy * cells + dx] += 1.0;
            }
            let pairs = f64::from(side * side) * f64::from(side * side - 1) / cases.len() as f64;
            let expected: Vec<f64> = (0..cells * cells)
                .map(|i| {
                    let [dx, dy] = [i % cells, i / cells].map(|d| (d as i32 - side + 1).abs());
                    if (dx, dy) == (0, 0) { 0.0 } else { f64::from((side - dx) * (side - dy)) / pairs }
                })
                .collect();
            chi_squared(&counts, &expected)
        };
        (format!("tiles of {} pixels, one frame: {one_frame}", 1 << bits), Box::new(test) as Box<dyn Fn(u32) -> f64>)
    }));
}

fn paired(paths: Paths) -> Paths {
    Paths { reuse: Reuse { paired: true, ..paths.reuse }, ..paths }
}

const PROOF: Proof = Proof { bounces: 4, ..Proof::of((12, 6), (10, 24)) };

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_in_pairs_equal_the_reference() {
    let Some(mut rig) = shared(64, "room") else { return };
    PROOF.check(
        "room",
        &mut rig,
        &[
            ("pairs, both", paired(paths::all_reuse())),
            ("pairs of similar surfaces", Paths { heuristics: true, ..paired(paths::spatial()) }),
        ],
    );
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_in_pairs_equal_the_reference_with_further_settings() {
    let Some(mut rig) = shared(64, "room") else { return };
    let with = |change: fn(&mut Reuse)| {
        let mut paths = paired(paths::all_reuse());
        change(&mut paths.reuse);
        paths
    };
    PROOF.check(
        "room",
        &mut rig,
        &[
            ("two iterations", with(|r| r.spatial_iterations = 2)),
            ("five neighbors", with(|r| r.spatial_samples = 5)),
            ("only the kept path is shaded", with(|r| r.shade_all = false)),
            ("direct light apart", Paths { separate_direct_light: true, ..paired(paths::all_reuse()) }),
        ],
    );
    let Some(mut rig) = shared(64, "mirrors") else { return };
    let proof = Proof { bounces: 3, margin: 0.02, ..Proof::of((16, 6), (16, 24)) };
    proof.check("mirrors", &mut rig, &[("both", paired(paths::all_reuse()))]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_in_pairs_equals_the_reference() {
    let Some(mut rig) = shared(64, "room") else { return };
    let proof = Proof { bounces: 4, ..Proof::of((12, 6), (10, 24)) };
    proof.check("room", &mut rig, &[("pairs", Indirect(di::all_reuse(), paired(paths::all_reuse())))]);
}

/// Direct light whose pixels are paired.
fn paired_direct(direct: Direct) -> Direct {
    Direct { reuse: Reuse { order: ReuseOrder::TemporalThenSpatial, paired: true, ..direct.reuse }, ..direct }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_in_pairs_equals_the_reference() {
    let Some(mut rig) = shared(64, "room") else { return };
    Proof::of((12, 8), (12, 24)).check(
        "room",
        &mut rig,
        &[
            ("pairs, both", paired_direct(di::all_reuse())),
            ("pairs across edges", paired_direct(di::across_edges(Mis::DefensivePairwise))),
            ("pairs, spatial", paired_direct(di::spatial())),
        ],
    );
}

/// Rays see blended surfaces by random numbers.
#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_in_pairs_past_blended_panes_equals_the_reference() {
    let Some(mut rig) = scene(64, blended) else { return };
    let proof = Proof { blended: true, margin: 0.015, ..Proof::of((24, 14), (24, 24)) };
    proof.check("blended", &mut rig, &[("pairs", paired_direct(di::across_edges(Mis::DefensivePairwise)))]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn bidirectional_paths_in_pairs_equal_the_reference() {
    let Some(mut rig) = room_scene(32) else { return };
    rig.set(|r| r.jitter = Jitter::Always);
    let proof = Proof { bounces: 4, blended: true, margin: 0.02, ..Proof::of((24, 6), (24, 16)) };
    let pairs = Bidirectional(LightTechniques::Full, paired(paths::all_reuse()));
    proof.check("room", &mut rig, &[("pairs", pairs)]);
}

/// Spatial reuse traces half as many rays, and the history outlives the change of the setting.
#[test]
#[ignore = "second tier: ./run test --more"]
fn pairs_halve_the_rays_of_spatial_reuse() {
    const SIZE: u32 = 64;
    let Some(mut rig) = room_scene(SIZE) else { return };
    let mut rays = |subject: AllLight| {
        rig.set(|r| {
            subject.apply_to(r);
            (r.bounces, r.accumulate, r.seed) = (3, false, 1);
        });
        rig.until_ready();
        // Counters come back some frames late.
        rig.frames(6);
        let report = rig.report();
        (report.rays as f64, report.history_resets.clone(), report.memory_bytes())
    };
    let spatial = |samples, is_paired| {
        let reuse =
            Reuse { spatial_samples: samples, paired: is_paired, disocclusion_samples: 0, ..paths::all_reuse().reuse };
        Paths { reuse, heuristics: true, ..paths::all_reuse() }
    };
    let (without, ..) = rays(AllLight::Pt(spatial(0, false)));
    let (neighbors, resets, bytes) = rays(AllLight::Pt(spatial(2, false)));
    let (pairs, resets_after, bytes_of_pairs) = rays(AllLight::Pt(spatial(2, true)));
    let share = (pairs - without) / (neighbors - without);
    eprintln!("rays without spatial reuse {without}, with neighbors {neighbors}, with pairs {pairs}: {share}");
    assert!((0.42..0.62).contains(&share), "{share}");
    assert_eq!(resets, resets_after);
    assert_eq!(bytes_of_pairs - bytes, u64::from(SIZE * SIZE) * (4 + 3 * 16 + 8) + 16, "masks, shifts, replay queue");
    rig.assert_sound();
}

/// Replay compaction changes no pixel and no count of rays: on mirrors, where paths replay rays, and below translucent surfaces, where they
/// replay probes.
#[test]
#[ignore = "second tier: ./run test --more"]
fn replay_compaction_changes_no_pixel() {
    check_replay_compaction(false);
}

/// Also of indirect light, and a queue that lacks shifts is found.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_replay_compaction_of_paths_and_indirect_light_changes_no_pixel() {
    check_replay_compaction(true);
}

fn check_replay_compaction(all: bool) {
    let paths = || paired(paths::all_reuse());
    let subjects = [AllLight::Gi(di::all_reuse(), paths()), AllLight::Pt(paths())];
    let few_workgroups = ShaderEdit {
        module: "pass/pair_shifts.wgsl",
        from: "MAX_WORKGROUPS: u32 = 65535u",
        to: "MAX_WORKGROUPS: u32 = 1u",
    };
    // Edits of `replays` by which shifts that trace rays count as shifts that trace none.
    let no_paths = ("return !(s.reconnection == 2u || ends_at_first) || drawn_choice", "return drawn_choice");
    let no_probes = ("ends_at_first) || drawn_choice(first, s.seed, 1u).below;", "ends_at_first);");
    for (make, planted) in [(mirrors as fn(&mut Rig), no_paths), (translucent_room, no_probes)] {
        let Some(mut rig) = scene(32, make) else { return };
        let mut picture = |subject: &AllLight, is_compacted, edits: &[ShaderEdit]| {
            plant_edits(&mut rig.app, edits);
            rig.set(|r| {
                subject.apply_to(r);
                (r.bounces, r.accumulate, r.seed) = (4, false, 1);
                r.research.replay_compaction = is_compacted;
            });
            let pixels = rig.picture(4).pixels;
            // Counters come back some frames late.
            rig.set(|r| r.reset = true);
            rig.frames(6);
            (pixels, rig.report().rays)
        };
        let [gi, pt] = &subjects;
        if all {
            assert_eq!(picture(gi, true, &[]), picture(gi, false, &[]));
        }
        let together = picture(pt, false, &[]);
        assert_eq!(picture(pt, true, &[]), together);
        // One workgroup for the whole queue, so that each of its threads takes several entries.
        assert_eq!(picture(pt, true, &[few_workgroups]), together);
        let planted = ShaderEdit { module: "restir/shift/hybrid.wgsl", from: planted.0, to: planted.1 };
        if all {
            assert_ne!(picture(pt, true, &[planted]).0, picture(pt, false, &[planted]).0);
        }
        rig.assert_sound();
    }
}
