//! Trees of paths carry what the reference carries, and a path is its own image in its own pixel.

use crate::support::{app::*, direct::*, equivalence::Restarts};
use bevy::prelude::*;
use bevy_restir::{Technique, plant_shader_defs};

const BOUNCES: u32 = 4;

fn restarts(rig: &mut Rig, technique: Technique, first_seed: u32, frames: u32) -> Restarts {
    let mut restarts = Restarts::new(emission(rig));
    rig.set(|r| (r.technique, r.bounces) = (technique, BOUNCES));
    rig.until_ready();
    for i in 0..24 {
        rig.set(|r| r.seed = first_seed + i);
        rig.frames(frames - 1);
        restarts.add(&rig.next());
    }
    restarts
}

#[test]
fn trees_of_paths_carry_what_the_reference_carries() {
    type Make = fn(&mut Rig);
    let scenes: [(&str, Make); 3] = [
        ("room", |rig| {
            room(rig);
        }),
        ("mirrors", mirrors),
        ("surrounded", |rig| surrounded(rig, true)),
    ];
    for (name, make) in scenes {
        let Some(mut rig) = scene(32, make) else { return };
        let truth = restarts(&mut rig, Technique::Reference, 100, 32);
        for def in ["", "TEST_SELF_SHIFT"] {
            plant_shader_defs(&mut rig.app, if def.is_empty() { &[] } else { core::slice::from_ref(&def) });
            let ours = restarts(&mut rig, Technique::Pt, 500, 32);
            let (z, relative) = ours.difference(&truth);
            eprintln!("{name} {def}: {:.3} % ({z:.1} σ), TOST p = {:.1e}, tiles p = {:.1e}", 100.0 * relative, ours.tost(&truth, 0.01), ours.tiles_p(&truth));
        }
        plant_shader_defs(&mut rig.app, &["TEST_SHIFT_REASON"]);
        rig.set(|r| (r.technique, r.bounces) = (Technique::Pt, BOUNCES));
        rig.until_ready();
        let mut reasons = std::collections::BTreeMap::<(u32, u32), (u32, f32)>::new();
        let shown = emission(&mut rig);
        rig.set(|r| (r.technique, r.bounces) = (Technique::Pt, BOUNCES));
        for seed in 0..20 {
            rig.set(|r| r.seed = seed);
            for ((at, c), (_, e)) in rig.next().iter().zip(shown.iter()) {
                let _ = at;
                if e == Vec3::ZERO && c.y > 0.0 {
                    let entry = reasons.entry((c.y.round() as u32, c.x.round() as u32)).or_default();
                    *entry = (entry.0 + 1, entry.1.max(c.z));
                }
            }
        }
        eprintln!("{name}: (end + 10 length + 1000 k, reason): (count, largest error) {reasons:#?}");
        plant_shader_defs(&mut rig.app, &[]);
    }
}
