//! A pass that may trace many rays runs over bands of the picture, and a frame that may trace many rays has several submissions.  The picture is
//! the same, bit by bit.

use crate::support::{
    app::{Rig, plant_edits},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{Research, Restir, Technique, testing::shader_library::ShaderEdit};

/// Four rows of workgroups, the last of which is not full.
const SIZE: [u32; 2] = [40, 28];

fn bands_scene(make: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = Rig::new(SIZE[0], SIZE[1])?;
    make(&mut rig);
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3, 0.2, 4.0).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
    Some(rig)
}

/// The third frame, its number of rays, and the bytes of the uniforms of bands.
fn picture(rig: &mut Rig, technique: Technique, rays_per_dispatch: u32) -> (Vec<[f32; 3]>, u64, u64) {
    let research = Research { rays_per_dispatch, ..default() };
    rig.set(|r| *r = Restir { technique, bounces: 3, research, ..default() });
    let pixels = rig.picture(3).pixels;
    // Counters come back some frames late.
    rig.set(|r| r.reset = true);
    rig.frames(6);
    let report = rig.report();
    let bytes = report.memory.iter().filter(|(name, _)| *name == "uniforms of bands").map(|(_, bytes)| bytes).sum();
    (pixels, report.rays, bytes)
}

/// Bytes of the uniforms of a band, in their stride.
const BYTES_OF_BAND: u64 = 768;

/// Each technique with the rays that its longest pass may trace for a pixel.
fn check(make: impl FnOnce(&mut Rig), techniques: &[(Technique, u32)]) {
    let Some(mut rig) = bands_scene(make) else { return };
    for &(technique, rays_of_pixel) in techniques {
        let (whole, rays, bytes) = picture(&mut rig, technique, u32::MAX);
        assert_eq!(bytes, 0, "{technique:?}");
        assert!(rays > 0, "{technique:?}");
        // One row of workgroups a band; then shorter passes take several bands at once; then two rows a band, and several passes in a submission.
        let of_row = rays_of_pixel * SIZE[0] * 8;
        for (limit, bands) in [(1, 4), (of_row, 4), (2 * of_row, 2)] {
            let (split, rays_of_split, bytes) = picture(&mut rig, technique, limit);
            assert_eq!(bytes, bands * BYTES_OF_BAND, "{technique:?}, at most {limit} rays");
            let differing = whole.iter().zip(&split).filter(|(a, b)| a != b).count();
            assert_eq!((differing, rays_of_split), (0, rays), "{technique:?}, at most {limit} rays");
        }
    }
    rig.assert_sound();
}

/// Plants an edit that only bands notice.
fn finds(
    make: impl FnOnce(&mut Rig),
    technique: Technique,
    module: &'static str,
    from: &'static str,
    to: &'static str,
) {
    let Some(mut rig) = bands_scene(make) else { return };
    let (whole, ..) = picture(&mut rig, technique, u32::MAX);
    plant_edits(&mut rig.app, &[ShaderEdit { module, from, to }]);
    assert!(picture(&mut rig, technique, u32::MAX).0 == whole, "{module}");
    assert!(picture(&mut rig, technique, 1).0 != whole, "{module}");
}

/// Also that a pass without an offset is found.
#[test]
#[ignore = "second tier: ./run test --more"]
fn bands_change_no_pixel_of_direct_light_and_reference_paths() {
    let room = |rig: &mut Rig| {
        room(rig);
    };
    check(room, &[(Technique::Reference, 6), (Technique::Di, 4)]);
    finds(room, Technique::Reference, "pass/reference.wgsl", "id.xy + view.first_pixel", "id.xy");
}

/// Mirrors replay paths and give the denoiser optical images.
#[test]
#[ignore = "second tier: ./run test --more"]
fn bands_change_no_pixel_of_paths_and_light_paths() {
    check(mirrors, &[(Technique::Gi, 24), (Technique::Pt, 24), (Technique::Bdpt, 24)]);
}

/// The queue of replays is longer than a band.
#[test]
#[ignore = "second tier: ./run test --more"]
fn bands_change_no_pixel_of_translucent_objects() {
    check(translucent_room, &[(Technique::Di, 31), (Technique::Pt, 31)]);
    finds(translucent_room, Technique::Pt, "pass/pair_shifts.wgsl", "first + view.band_rows", "view.band_rows");
}
