//! ReSTIR DI with translucent bodies equals the reference at one bounce, with every shift, still and moving, and planted errors are found.

use crate::support::{
    app::*,
    equivalence::Restarts,
    proof::{Indirect, Proof},
    reuse_settings::{di, paths, subsurface},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{Direct, Mis, Reuse, ReuseOrder, Subsurface, SubsurfaceSampling, SubsurfaceShift};

const SHIFTS: [SubsurfaceShift; 4] =
    [SubsurfaceShift::Reconnection, SubsurfaceShift::Delayed, SubsurfaceShift::Hybrid, SubsurfaceShift::Sequential];

fn with(sampling: SubsurfaceSampling) -> (Direct, SubsurfaceSampling) {
    // Pixels of a tile share a subset of the lights, so that small pictures with subsets are noisy as a whole.
    (Direct { subset_count: 0, ..di::all_reuse() }, sampling)
}

#[test]
fn candidates_in_translucent_bodies_equal_the_reference() {
    let Some(mut rig) = scene(32, |rig| _ = translucent(rig)) else { return };
    Proof::DEFAULT.check("bodies", &mut rig, &[("not presampled", with(subsurface::candidates_only()))]);
}

#[test]
fn every_shift_in_translucent_bodies_equals_the_reference() {
    let Some(mut rig) = scene(32, |rig| _ = translucent(rig)) else { return };
    let mut cases = Vec::new();
    for shift in SHIFTS {
        for (name, sampling) in [
            ("temporal", subsurface::temporal()),
            ("spatial", subsurface::spatial()),
            ("both", subsurface::all_reuse()),
        ] {
            cases.push((format!("{shift:?}, {name}"), with(SubsurfaceSampling { shift, ..sampling })));
        }
    }
    for (name, mis) in [("balance", Mis::Balance), ("1/|Z|", Mis::OneOverZ), ("spatiotemporal", Mis::Pairwise)] {
        let order = if mis == Mis::Pairwise { ReuseOrder::Spatiotemporal } else { ReuseOrder::TemporalThenSpatial };
        let reuse = Reuse { mis, order, ..subsurface::all_reuse().reuse };
        cases.push((format!("Hybrid, {name}"), with(SubsurfaceSampling { reuse, ..subsurface::all_reuse() })));
    }
    let cases: Vec<_> = cases.iter().map(|(name, case)| (name.as_str(), case.clone())).collect();
    Proof::DEFAULT.check("bodies", &mut rig, &cases);
}

#[test]
fn every_shift_of_moving_bodies_and_lights_equals_the_reference() {
    for shift in SHIFTS {
        let mut moving = [Entity::PLACEHOLDER; 2];
        let Some(mut rig) = scene(32, |rig| moving = translucent(rig)) else { return };
        let pose = |rig: &mut Rig, step: u32| {
            let step = step as f32;
            let mut body = rig.get_mut::<Transform>(moving[0]);
            body.rotation = Quat::from_rotation_y(0.2 * step);
            body.scale = Vec3::new(1.0 + 0.05 * step, 1.0, 1.0);
            rig.get_mut::<Transform>(moving[1]).translation.x = 0.6 - 0.1 * step;
        };
        let proof = Proof { margin: 0.015, pose: Some(&pose), ..Proof::of((120, 1), (40, 64)) };
        proof.check(
            "moving",
            &mut rig,
            &[(&*format!("{shift:?}"), with(SubsurfaceSampling { shift, ..subsurface::all_reuse() }))],
        );
    }
}

/// The direct light of a picture with translucent bodies, and the indirect light of one with diffuse bodies.
fn direct_translucent_and_indirect_diffuse(rig: &mut Rig, proof: &Proof) -> Restarts {
    let mut truth = Proof { bounces: 1, ..*proof }.truth(rig, 1000);
    let world = rig.app.world_mut();
    for mut body in world.query::<&mut Subsurface>().iter_mut(world) {
        body.weight *= -1.0;
    }
    let all = proof.truth(rig, 3000);
    let direct = Proof { bounces: 1, ..*proof }.truth(rig, 5000);
    let world = rig.app.world_mut();
    for mut body in world.query::<&mut Subsurface>().iter_mut(world) {
        body.weight *= -1.0;
    }
    let add = |to: &mut [f64], all: &[f64], direct: &[f64]| {
        to.iter_mut().zip(all.iter().zip(direct)).for_each(|(to, (all, direct))| *to += all - direct);
    };
    add(&mut truth.images, &all.images, &direct.images);
    add(&mut truth.pixels, &all.pixels, &direct.pixels);
    for i in 0..truth.images.len() {
        add(&mut truth.regions[i], &all.regions[i], &direct.regions[i]);
        add(&mut truth.tiles[i], &all.tiles[i], &direct.tiles[i]);
    }
    truth
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn frames_of_restir_gi_have_translucent_bodies_under_direct_light() {
    let Some(mut rig) = scene(64, |rig| _ = translucent(rig)) else { return };
    let proof = Proof { bounces: 3, margin: 0.02, ..Proof::of((24, 8), (12, 64)) };
    let truth = direct_translucent_and_indirect_diffuse(&mut rig, &proof);
    let direct = Direct { subset_count: 0, ..di::all_reuse() };
    let subject = (Indirect(direct, paths::all_reuse()), subsurface::all_reuse());
    let result = proof.resampled(&mut rig, &subject, 7000).compare(&truth, proof.margin);
    println!("{result}");
    assert!(result.is_equal() && result.is_powerful(), "{result}");
    rig.assert_sound();
}

#[test]
fn planted_errors_in_translucent_bodies_are_found() {
    let Some(mut rig) = scene(32, |rig| _ = translucent(rig)) else { return };
    let reference = Proof::DEFAULT.truth(&mut rig, 1000);
    let of = |shift| with(SubsurfaceSampling { shift, ..subsurface::all_reuse() });
    let planted = [
        ("TEST_ONE_AXIS", with(subsurface::candidates_only())),
        ("PLANT_NO_JACOBIAN", of(SubsurfaceShift::Delayed)),
        ("PLANT_STALE_PROBE", of(SubsurfaceShift::Sequential)),
        ("PLANT_SWAPPED_MIS", of(SubsurfaceShift::Hybrid)),
    ];
    Proof::DEFAULT.finds(&mut rig, &reference, planted);
}

#[test]
fn nan_stays_in_its_reservoir_of_translucent_bodies() {
    let Some(mut rig) = scene(32, |rig| _ = translucent(rig)) else { return };
    Proof::DEFAULT.survives_nan(&mut rig, &[with(subsurface::all_reuse())]);
}

#[test]
#[ignore = "scratch"]
fn scratch_noise() {
    let Some(mut rig) = scene(std::env::var("N").map_or(32, |n| n.parse().unwrap()), |rig| _ = translucent(rig)) else {
        return;
    };
    let show = |name: &str, r: &crate::support::equivalence::Restarts, frames: u32| {
        let n = r.tiles.len() as f64;
        for t in 0..r.tiles[0].len() {
            let m = r.tiles.iter().map(|x| x[t]).sum::<f64>() / n;
            let v = r.tiles.iter().map(|x| (x[t] - m).powi(2)).sum::<f64>() / (n - 1.0);
            print!("{m:.4}±{:.3} ", v.sqrt() * (frames as f64).sqrt());
            if t % 4 == 3 && r.tiles[0].len() == 16 {
                println!()
            }
        }
        let m = r.mean();
        let v = r.images.iter().map(|x| (x - m).powi(2)).sum::<f64>() / (n - 1.0);
        println!("{name} {m:.5} rel sd per frame {:.4}", v.sqrt() / m * (frames as f64).sqrt());
    };
    let var = |name: &str, default: u32| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default);
    let frames = var("F", 16);
    let proof = Proof::of((var("R", 20), frames), (var("TR", 20), 64));
    let t = std::time::Instant::now();
    let truth = proof.truth(&mut rig, 1000);
    show("reference", &truth, 64);
    println!("{:?}", t.elapsed());
    let which = std::env::var("W").unwrap_or_default();
    let plant = std::env::var("PLANT").unwrap_or_default();
    if !plant.is_empty() {
        bevy_restir::testing::plant_shader_defs(&mut rig.app, &[Box::leak(plant.into_boxed_str())]);
    }
    for (n, s) in [
        ("candidates", subsurface::candidates_only()),
        ("temporal", subsurface::temporal()),
        ("spatial", subsurface::spatial()),
        ("both", subsurface::all_reuse()),
    ] {
        for shift in SHIFTS {
            let case = format!("{n} {shift:?}");
            if !which.split(',').any(|w| case.starts_with(w)) {
                continue;
            }
            let t = std::time::Instant::now();
            let ours = proof.resampled(
                &mut rig,
                &with(SubsurfaceSampling { shift, candidates: var("C", 4), ..s.clone() }),
                2000,
            );
            show(&case, &ours, frames);
            println!("{} {:?}", ours.compare(&truth, 0.01), t.elapsed());
        }
    }
}
