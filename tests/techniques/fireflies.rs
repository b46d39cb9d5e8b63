//! The limit of bright pixels equals the same limit in f64, and leaves histories and means of frames untouched.

use crate::support::{
    app::*,
    proof::{AllLight, Subject},
    reuse_settings::paths,
    small_scenes::*,
};
use bevy::{math::DVec3, prelude::*};
use bevy_restir::{DebugView, Restir};

const SIZE: u32 = 48;
const LIMIT: f32 = 1.5;

fn room(limit: f32) -> impl Fn(&mut Restir) {
    move |settings| {
        *settings = Restir { bounces: 3, firefly_limit: limit, ..plain() };
        AllLight::Pt(paths::candidates_only()).apply_to(settings);
    }
}

fn luminance(light: DVec3) -> f64 {
    light.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// The light of a pixel, limited by the pixels around it that show the same object.
fn limited(light: &[DVec3], objects: &Picture, at: UVec2) -> DVec3 {
    let index = |at: IVec2| (at.y * SIZE as i32 + at.x) as usize;
    let at = at.as_ivec2();
    let inside = |p: &IVec2| p.min_element() >= 0 && p.max_element() < SIZE as i32;
    let around = (-1..=1).flat_map(|y| (-1..=1).map(move |x| at + IVec2::new(x, y)));
    let around = around.filter(|p| *p != at && inside(p) && objects.pixels[index(*p)] == objects.pixels[index(at)]);
    let around: Vec<f64> = around.map(|p| luminance(light[index(p)])).collect();
    let own = light[index(at)];
    if around.len() < 3 {
        return own;
    }
    let brightest = around.into_iter().fold(0.0, f64::max);
    own * (f64::from(LIMIT) * brightest / luminance(own).max(1e-30)).min(1.0)
}

#[test]
fn light_is_limited_to_a_multiple_of_that_of_the_pixels_around() {
    let Some(mut rig) = room_scene(SIZE) else { return };
    // Objects of one to four pixels, of which some have too few neighbors for a limit.
    for i in 0..36 {
        let at = Vec3::new(0.3 * (i % 6) as f32 - 0.7, 0.3 * (i / 6) as f32 - 0.9, 0.8);
        rig.spawn(square(0.09), lambert(0.8), Transform::from_translation(at));
    }
    let mut show = |change: &dyn Fn(&mut Restir)| {
        rig.set(|settings| change(settings));
        rig.picture(4)
    };
    let free = show(&room(0.0));
    let shown = show(&room(LIMIT));
    let emitted = show(&|settings| {
        room(0.0)(settings);
        settings.bounces = 0;
    });
    let objects = show(&|settings| {
        room(0.0)(settings);
        settings.debug_view = DebugView::Instances;
    });
    let scattered: Vec<DVec3> = free.iter().zip(emitted.iter()).map(|((_, a), (_, b))| (a - b).as_dvec3()).collect();
    let mut changed = 0;
    for (((at, shown), (_, free)), (_, emitted)) in shown.iter().zip(free.iter()).zip(emitted.iter()) {
        let expected = limited(&scattered, &objects, at) + emitted.as_dvec3();
        let error = (shown.as_dvec3() - expected).abs().max_element();
        assert!(error <= 1e-5 * (1.0 + free.max_element() as f64), "{at}: {shown}, expected {expected}");
        changed += usize::from(shown != free);
    }
    assert!((20..SIZE * SIZE / 2).contains(&(changed as u32)), "{changed} pixels are limited");
    assert!(shown.mean() < free.mean(), "a limit can only darken");

    // Histories keep the light, and means of frames are not limited.
    let resets = rig.report().history_resets;
    rig.set(|settings| settings.firefly_limit = 0.0);
    rig.frames(4);
    assert_eq!(rig.report().history_resets, resets);
    let mut mean = |limit: f32| {
        rig.set(|settings| {
            room(limit)(settings);
            settings.accumulate = true;
        });
        rig.picture(2)
    };
    assert_eq!(mean(0.0), mean(LIMIT));
}
