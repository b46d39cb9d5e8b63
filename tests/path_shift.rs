//! What ReSTIR PT is built on: a path is its own image in its own pixel.

use crate::support::{
    app::*,
    direct::*,
    proof::{Subject, emission},
};
use bevy::prelude::*;
use bevy_restir::{Paths, plant_shader_defs};
use std::collections::BTreeMap;

const BOUNCES: u32 = 4;

/// Number of paths, by how they end, their length and where others reconnect to them, that cannot be shifted into their own pixel for a
/// reason; and the largest relative error of what they carry there.
type Census = BTreeMap<(u32, u32), (u32, f32)>;

fn census(rig: &mut Rig, seeds: u32) -> Census {
    let emitted = emission(rig);
    plant_shader_defs(&mut rig.app, &["TEST_SHIFT_REASON"]);
    let alone = Paths { temporal: false, spatial_taps: 0, ..Default::default() };
    rig.set(|r| {
        alone.ask(r);
        r.bounces = BOUNCES;
    });
    rig.until_ready();
    let mut census = Census::new();
    for seed in 0..seeds {
        rig.set(|r| r.seed = seed);
        for ((_, c), (_, e)) in rig.next().iter().zip(emitted.iter()) {
            // (reason, end + 10 length + 1000 k, error) where there is a path.
            if e == Vec3::ZERO && c.y > 0.0 {
                let entry = census.entry((c.y.round() as u32, c.x.round() as u32)).or_default();
                *entry = (entry.0 + 1, entry.1.max(c.z));
            }
        }
    }
    plant_shader_defs(&mut rig.app, &[]);
    census
}

#[test]
fn a_path_is_its_own_image_in_its_own_pixel() {
    type Make = fn(&mut Rig);
    let scenes: [(&str, Make); 3] = [
        ("room", |rig| {
            room(rig);
        }),
        ("mirrors", mirrors),
        ("surrounded", |rig| surrounded(rig, true)),
    ];
    let mut kinds = std::collections::BTreeSet::new();
    for (name, make) in scenes {
        let Some(mut rig) = scene(32, make) else { return };
        let census = census(&mut rig, 40);
        let paths: u32 = census.values().map(|(count, _)| count).sum();
        let failed: u32 = census.iter().filter(|((_, reason), _)| *reason != 0).map(|(_, (count, _))| count).sum();
        let worst = census.iter().filter(|((_, reason), _)| *reason == 0).map(|(_, (_, e))| *e).fold(0.0, f32::max);
        eprintln!("{name}: {paths} paths, {failed} not shifted, error at most {worst}: {census:?}");
        assert!(paths > 10_000 && failed as f32 <= 1e-4 * paths as f32, "{name}: {failed} of {paths}");
        // Directions and places are kept in 16 bits.
        assert!(worst < 0.02, "{name}: {worst}");
        kinds.extend(census.keys().map(|(kind, _)| (kind % 10, kind / 1000 == 0, kind / 10 % 100 == kind / 1000)));
    }
    // (end, replayed whole, reconnected at the light): aimed at a light before it and at it, met by a whole replay, before, at it.
    for kind in [(1, false, false), (1, false, true), (2, true, false), (2, false, true), (3, false, true)] {
        assert!(kinds.contains(&kind), "{kind:?} of {kinds:?}");
    }
}
