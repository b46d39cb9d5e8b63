//! Settings of reuse have their documented effect on the choice of neighbors, in direct light and in paths.  Views of the confidence show
//! it without noise: a pixel that finds no neighbor has the confidence of its own candidates, which is 1.

use crate::support::{app::*, proof::Subject, reuse_settings::*, small_scenes::*};
use bevy::prelude::*;
use bevy_restir::{DebugView, Direct, Jitter, Paths, Reuse, VisibilityReuse};

#[derive(Clone, Copy, Debug)]
enum Domain {
    DirectLight,
    Paths,
}

const DOMAINS: [Domain; 2] = [Domain::DirectLight, Domain::Paths];

impl Domain {
    fn reuse(self) -> Reuse {
        match self {
            Self::DirectLight => di::all_reuse().reuse,
            Self::Paths => paths::all_reuse().reuse,
        }
    }
}

/// Shows the confidence of a domain with this reuse, from the first frame of a history on.
fn show(rig: &mut Rig, domain: Domain, reuse: Reuse) {
    rig.set(|r| {
        *r = plain();
        match domain {
            Domain::DirectLight => {
                Direct { reuse, ..di::all_reuse() }.apply_to(r);
                r.debug_view = DebugView::ReservoirConfidence;
            }
            Domain::Paths => {
                Paths { reuse, heuristics: true, ..paths::all_reuse() }.apply_to(r);
                r.debug_view = DebugView::PathConfidence;
            }
        }
        r.bounces = 2;
    });
    rig.until_ready();
    rig.set(|r| r.reset = true);
}

/// Reuse of the surface's own sample alone.
fn temporal(domain: Domain) -> Reuse {
    Reuse { spatial_samples: 0, disocclusion_samples: 0, ..domain.reuse() }
}

/// Of 64 pixels beside the seam of two squares, those that find no neighbor in one attempt.
fn lone_pixels(rig: &mut Rig, domain: Domain, reuse: Reuse) -> usize {
    let radius = pixels(10.0, 40);
    show(rig, domain, Reuse { temporal: false, spatial_samples: 1, neighbor_attempts: 1, radius, ..reuse });
    rig.frame();
    // Far from the borders of the image.
    let is_near_seam = |at: &UVec2| (18..22).contains(&at.x) && (12..28).contains(&at.y);
    rig.next().iter().filter(|(at, c)| is_near_seam(at) && c.x == 1.0).count()
}

/// Two squares with a seam in the middle of the picture, of which the right one differs from the left one in a single respect.
#[test]
fn neighbors_are_similar_by_normal_depth_and_material() {
    let Some(mut rig) = Rig::new(40, 40) else { return };
    rig.spawn(square(10.0), lambert(0.3), Transform::from_xyz(-5.0, 0.0, 0.0));
    let right = rig.spawn(square(10.0), lambert(0.6), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    // The cosine of the angle between the normals is 0.940.
    let angle = 20f32.to_radians();
    let turned = Transform::from_xyz(5.0 * angle.cos(), 0.0, -5.0 * angle.sin());
    // It is 5 to 5.5 m away from the camera, so that its depth differs by a tenth.
    let behind = Transform::from_xyz(5.0, 0.0, -0.5);
    for domain in DOMAINS {
        let any = || Reuse { normal_threshold: -1.0, depth_threshold: 1e6, same_material: false, ..domain.reuse() };
        let by_normal = |normal_threshold| Reuse { normal_threshold, ..any() };
        let by_depth = |depth_threshold| Reuse { depth_threshold, ..any() };
        let by_material = Reuse { same_material: true, ..any() };
        for (name, place, accepting, rejecting) in [
            ("normals", turned.with_rotation(Quat::from_rotation_y(angle)), by_normal(0.93), by_normal(0.95)),
            ("depths", behind, by_depth(0.2), by_depth(0.05)),
            ("materials", Transform::from_xyz(5.0, 0.0, 0.0), any(), by_material),
        ] {
            *rig.get_mut::<Transform>(right) = place;
            let [accepted, rejected] = [accepting, rejecting].map(|reuse| lone_pixels(&mut rig, domain, reuse));
            // About half of the disk around such a pixel is on the other side.
            assert!(
                accepted == 0 && (16..48).contains(&rejected),
                "{name}, {domain:?}: {accepted} and {rejected} of 64 find no neighbor"
            );
        }
    }
    rig.assert_sound();
}

#[test]
fn more_neighbor_attempts_find_more_neighbors_except_in_pairs() {
    let Some(mut rig) = room_scene(48) else { return };
    let mut mean = |domain: Domain, paired, neighbor_attempts| {
        let radius = pixels(20.0, 48);
        let reuse = Reuse { paired, neighbor_attempts, temporal: false, spatial_samples: 2, radius, ..domain.reuse() };
        show(&mut rig, domain, reuse);
        rig.frame();
        rig.next().mean()
    };
    for domain in DOMAINS {
        let (one, three) = (mean(domain, false, 1), mean(domain, false, 3));
        assert!(three > 1.1 * one, "{domain:?}: {one} to {three}");
    }
    assert_eq!(mean(Domain::Paths, true, 1), mean(Domain::Paths, true, 3), "pairs have places of their own");
}

#[test]
fn more_temporal_attempts_keep_the_history_along_edges() {
    // Bars that are a few pixels wide, in front of a wall.
    let Some(mut rig) = Rig::new(48, 48) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -3.0));
    for i in -6..6 {
        let place = Transform::from_xyz(0.3 * i as f32, 0.0, 0.0).with_scale(Vec3::new(1.0, 40.0, 1.0));
        rig.spawn(square(0.15), lambert(0.5), place);
    }
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    for domain in DOMAINS {
        let [one, five] = [1, 5].map(|temporal_attempts| {
            show(&mut rig, domain, Reuse { temporal_attempts, ..temporal(domain) });
            rig.set(|r| (r.jitter, r.reset) = (Jitter::Always, true));
            rig.frames(7);
            rig.next().iter().filter(|(_, c)| c.x == 1.0).count()
        });
        eprintln!("{domain:?}: {one} pixels without history, {five} with five places");
        assert!(one > 100 && 4 * five < one, "{domain:?}: {one} to {five}");
    }
}

#[test]
fn a_bilinear_history_comes_from_the_pixels_around_the_reprojected_position() {
    let Some(mut rig) = Rig::new(24, 24) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    // The camera moves by 0.3 pixels.  The nearest pixel is the pixel itself; bilinear lookups of 30 % of the pixels at a border fall
    // outside of the image.
    rig.insert(rig.camera, orthographic(24.0, 24.0));
    for domain in DOMAINS {
        let [nearest, bilinear] = [false, true].map(|bilinear| {
            rig.get_mut::<Transform>(rig.camera).translation.x = 0.0;
            show(&mut rig, domain, Reuse { bilinear, temporal_attempts: 1, ..temporal(domain) });
            rig.frames(4);
            rig.get_mut::<Transform>(rig.camera).translation.x = 0.3;
            rig.next().iter().filter(|(_, c)| c.x == 1.0).count()
        });
        assert!(nearest == 0 && (2..=14).contains(&bilinear), "{domain:?}: {nearest} and {bilinear} of 24");
    }
}

/// A bar jumps to the side, farther than to the partners of the pixels that it uncovers.
#[test]
fn new_surfaces_use_more_pairs() {
    let Some(mut rig) = Rig::new(48, 48) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -2.0));
    let tall = Transform::from_scale(Vec3::new(1.0, 20.0, 1.0));
    let bar = rig.spawn(square(0.5), lambert(0.5), tall);
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    let mut after_a_jump = |spatial_samples, disocclusion_samples| {
        rig.get_mut::<Transform>(bar).translation.x = -0.3;
        let reuse = Reuse {
            spatial_samples,
            disocclusion_samples,
            paired: true,
            dual_motion: false,
            temporal_attempts: 1,
            confidence_cap: 5.0,
            radius: pixels(6.0, 48),
            ..Domain::Paths.reuse()
        };
        show(&mut rig, Domain::Paths, reuse);
        rig.frames(8);
        rig.get_mut::<Transform>(bar).translation.x = 1.0;
        rig.next()
    };
    let (alone, few, many) = (after_a_jump(0, 0), after_a_jump(1, 1), after_a_jump(1, 5));
    let (mut new, mut gained) = (0, 0);
    for (((at, alone), (_, few)), (_, many)) in alone.iter().zip(few.iter()).zip(many.iter()) {
        assert!(many.x >= few.x, "{at}: {few} to {many}");
        new += u32::from(alone.x == 1.0);
        gained += u32::from(alone.x == 1.0 && many.x > few.x);
    }
    eprintln!("{gained} of {new} new pixels gain neighbors");
    assert!(new > 200 && 10 * gained > 8 * new, "{gained} of {new}");
}

/// Subsets of one light each: all pixels of a tile take the same light.
#[test]
fn pixels_of_a_tile_share_a_light_subset() {
    let Some(mut rig) = Rig::new(32, 32) else { return };
    rig.spawn(square(40.0), lambert(0.5), Transform::default());
    for i in 0..64 {
        let place = Transform::from_xyz(0.5 * (i % 8) as f32 - 1.75, 0.5 * (i / 8) as f32 - 1.75, 3.0);
        rig.spawn_bundle((PointLight { intensity: 10.0, ..default() }, place));
    }
    for size in [1, 4, 16] {
        rig.set(|r| {
            *r = plain();
            let direct = Direct { candidates: 1, subset_count: 256, subset_size: 1, ..di::candidates_only() };
            Direct { bsdf_candidate: false, visibility: VisibilityReuse::Ignored, ..direct }.apply_to(r);
            (r.research.light_tile_size, r.debug_view) = (size, DebugView::ReservoirLights);
        });
        let lights = rig.picture(1);
        let tile = |at: UVec2| lights.at(at.x / size * size, at.y / size * size);
        assert!(lights.iter().all(|(at, light)| light == tile(at) && light != Vec3::ZERO), "tiles of {size} pixels");
        // Neighboring tiles have the same light in one of 64 cases.
        let borders: Vec<UVec2> = lights.iter().map(|(at, _)| at).filter(|at| at.x > 0 && at.x % size == 0).collect();
        let changes = borders.iter().filter(|at| lights.at(at.x, at.y) != lights.at(at.x - 1, at.y)).count();
        assert!(4 * changes > borders.len(), "tiles of {size} pixels: {changes} of {} borders", borders.len());
    }
}
