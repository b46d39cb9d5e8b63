//! ReSTIR BDPT equals the reference in small scenes of 32 x 32 pixels, with lights and materials of every kind.  Two
//! one-sided tests at α = 0.01 compare the image mean, and chi-squared compares the 8 x 8 tiles.
//!
//! The camera jitters, as in every test of this technique, because light paths end anywhere in a pixel.  Each restart therefore has its own
//! emission.

use crate::support::{
    app::*,
    equivalence::Length,
    proof::{Bidirectional, Proof},
    reuse_settings::paths,
    small_scenes::*,
};
use LightTechniques::*;
use bevy::prelude::*;
use bevy_restir::{Jitter, LightTechniques, Paths, Reuse, ReuseOrder};

/// The margins of the image means, and the numbers of restarts and frames.
const PROOF: Proof = Proof { bounces: 4, blended: true, margin: 0.02, ..Proof::of((24, 6), (24, 16)) };

/// For scenes whose margin is 5 %.
const COARSE: Proof = {
    let short = Proof::of((28, 4), (16, 16));
    Proof { margin: 0.05, ours: short.ours, truth: short.truth, ..PROOF }
};

fn check(name: &str, proof: Proof, make: impl FnOnce(&mut Rig)) {
    let Some(mut rig) = scene(32, make) else { return };
    rig.set(|r| r.jitter = Jitter::Always);
    let all = [
        ("candidates of all techniques", Bidirectional(Full, paths::candidates_only())),
        ("both kinds of reuse, lightweight", Bidirectional(Lightweight, paths::all_reuse())),
        ("both kinds of reuse, all techniques", Bidirectional(Full, paths::all_reuse())),
    ];
    proof.check(name, &mut rig, &all);
}

#[test]
fn light_paths_in_a_room_equal_the_reference() {
    let Some(mut rig) = room_scene(32) else { return };
    rig.set(|r| r.jitter = Jitter::Always);
    let all = [
        ("candidates", Bidirectional(Full, paths::candidates_only())),
        ("both, all techniques", Bidirectional(Full, paths::all_reuse())),
    ];
    let quick = Proof::of((20, 4), (12, 16));
    Proof { ours: quick.ours, truth: quick.truth, ..PROOF }.check("room", &mut rig, &all);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_in_a_room_equal_the_reference_for_every_kind_of_reuse() {
    let Some(mut rig) = room_scene(32) else { return };
    rig.set(|r| r.jitter = Jitter::Always);
    let often_replayed = Paths { footprint: 20.0, ..paths::all_reuse() };
    let all = [
        ("lightweight candidates", Bidirectional(Lightweight, paths::candidates_only())),
        ("temporal", Bidirectional(Lightweight, paths::temporal())),
        ("spatial", Bidirectional(Lightweight, paths::spatial())),
        ("both", Bidirectional(Lightweight, paths::all_reuse())),
        ("both, no light tracing", Bidirectional(NoLightTracing, paths::all_reuse())),
        ("temporal, all techniques", Bidirectional(Full, paths::temporal())),
        ("spatial, all techniques", Bidirectional(Full, paths::spatial())),
        ("both, by paths that are often replayed", Bidirectional(Full, often_replayed)),
    ];
    PROOF.check("room", &mut rig, &all);
}

/// The resampling routine has seven inputs: the pixel's own sample, that of the last frame where it is resampled in the same pass, and those of
/// neighbors.
#[test]
fn six_neighbors_are_in_range_where_the_last_frame_has_a_pass_of_its_own() {
    for (order, most) in [(ReuseOrder::TemporalThenSpatial, 6), (ReuseOrder::Spatiotemporal, 5)] {
        for asked in [most, most + 1] {
            let mut settings = plain();
            (settings.paths.reuse.order, settings.paths.reuse.spatial_samples) = (order, asked);
            let warnings = settings.validate();
            let is_reported = warnings.iter().any(|warning| warning.contains("spatial_samples"));
            assert_eq!(is_reported, asked > most, "{order:?}, {asked}: {warnings:?}");
            assert_eq!(settings.paths.reuse.spatial_samples, most, "{order:?}, {asked}");
        }
    }
}

/// The settings for pictures offline (Hedstrom et al. 2025, 7.2), and the same with pairs.
#[test]
#[ignore = "second tier: ./run test --more"]
fn three_rounds_of_six_neighbors_equal_the_reference() {
    let Some(mut rig) = room_scene(32) else { return };
    rig.set(|r| r.jitter = Jitter::Always);
    let offline = |paired| {
        let all = paths::all_reuse();
        let reuse = Reuse { temporal: false, spatial_samples: 6, spatial_iterations: 3, paired, ..all.reuse.clone() };
        Bidirectional(Full, Paths { reuse, ..all })
    };
    PROOF.check("room", &mut rig, &[("three rounds of six", offline(false)), ("in pairs", offline(true))]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_any_number_of_light_paths_gives_the_picture_of_the_reference() {
    let Some(mut rig) = room_scene(32) else { return };
    rig.set(|r| r.jitter = Jitter::Always);
    let full = |count| (count, Bidirectional(Full, paths::all_reuse()));
    let all = [("one for ten pixels", full(0.1)), ("three for each pixel", full(3.0)), ("none", full(0.0))];
    PROOF.check("room", &mut rig, &all);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_over_glossy_surfaces_equal_the_reference() {
    check("glossy", Proof { bounces: 2, ..COARSE }, glossy);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_by_mirrors_equal_the_reference() {
    check("mirrors", Proof { bounces: 3, ..COARSE }, mirrors);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_of_points_and_directional_lights_equal_the_reference() {
    check("punctual", PROOF, punctual);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_of_spheres_rectangles_and_suns_equal_the_reference() {
    check("shapes", COARSE, shapes);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_of_an_environment_image_equal_the_reference() {
    let longer = Length { restarts: 32, ..PROOF.ours };
    check("an image", Proof { bounces: 3, ours: longer, ..PROOF }, |rig| surrounded(rig, true));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_of_a_uniform_environment_equal_the_reference() {
    check("a uniform environment", Proof { bounces: 3, ..PROOF }, |rig| surrounded(rig, false));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_over_every_lobe_equal_the_reference() {
    check("every lobe", Proof { bounces: 3, margin: 0.05, ..PROOF }, |rig| {
        every_lobe(rig);
        // Lobes that depend on the side that they are seen from must be those of the camera's side.
        rig.set(|r| r.energy_compensation = true);
    });
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_in_textured_scenes_equal_the_reference() {
    check("textured", Proof { bounces: 3, margin: 0.05, ..PROOF }, textured);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_through_blended_panes_equal_the_reference() {
    check("blended", Proof { bounces: 2, margin: 0.05, ..PROOF }, blended);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_an_orthographic_camera_sees_light_paths() {
    check("orthographic", PROOF, |rig| {
        room(rig);
        rig.insert(rig.camera, orthographic(3.0, 3.0));
    });
}

/// A closed box of tinted glass with a lamp inside, next to a wall: the light path starts in the absorbing body.
fn lamp_in_glass(rig: &mut Rig) {
    let floor = Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(4.0), lambert(0.7), floor);
    rig.spawn(square(4.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -1.2));
    let glass = StandardMaterial {
        specular_transmission: 1.0,
        thickness: 0.8,
        ior: 1.4,
        attenuation_color: Color::linear_rgb(0.8, 0.5, 0.3),
        attenuation_distance: 0.4,
        ..shiny(Color::WHITE, 0.0, 0.0)
    };
    let place = Transform::from_xyz(0.0, -0.3, 0.0).with_rotation(Quat::from_rotation_y(0.4));
    rig.spawn(Cuboid::new(1.2, 1.0, 0.8), glass, place);
    rig.spawn(Cuboid::new(0.5, 0.3, 0.3), lamp(9.0, 9.0, 9.0), place);
    // An opaque block in the glass, which light paths and connections meet before the surface of the body.
    rig.spawn(Cuboid::new(0.2, 0.8, 0.3), lambert(0.6), place * Transform::from_xyz(0.4, 0.0, 0.0));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_from_inside_of_an_absorbing_body_equal_the_reference() {
    check("a lamp in glass", Proof { bounces: 4, margin: 0.05, ..PROOF }, lamp_in_glass);
}

/// The back sides of walls between the camera and the room are not drawn, and still stop all other rays.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_behind_culled_walls_equal_the_reference() {
    check("culled walls", PROOF, |rig| {
        room(rig);
        rig.spawn(
            square(6.0),
            lambert(0.6),
            Transform::from_xyz(0.0, 0.0, 2.5).with_rotation(Quat::from_rotation_y(core::f32::consts::PI)),
        );
    });
}

/// A polished floor whose perceptual roughness grows from 0 to 0.1 from left to right, and a wall on which it throws the light of a lamp
/// behind the camera.  From a roughness of 0.0316 on, the floor has no delta lobe, and other techniques find its light.
fn ramp(rig: &mut Rig) {
    let mut steps = texture(256, 1, |x, _| [255, x as u8, 255, 255]);
    steps.texture_descriptor.format = bevy::render::render_resource::TextureFormat::Rgba8Unorm;
    let polished = StandardMaterial {
        metallic_roughness_texture: Some(rig.add::<Image>(steps)),
        ..shiny(Color::linear_rgb(0.9, 0.9, 0.9), 0.1, 1.0)
    };
    let floor = Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(4.0), polished, floor);
    rig.spawn(square(4.0), lambert(0.6), Transform::from_xyz(0.0, 0.0, -1.2));
    let place = facing(Vec3::new(0.0, 1.2, 3.0), Vec3::new(0.0, -1.2, 0.0));
    rig.spawn(Rectangle::new(2.5, 0.5), lamp(8.0, 8.0, 8.0), place);
}

/// A seam at the threshold would show in its tiles.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_across_the_threshold_of_delta_lobes_equal_the_reference() {
    check("ramp of roughness", Proof { bounces: 3, margin: 0.05, ..PROOF }, ramp);
}

/// A cube of clear glass with this side: around the camera alone, which sees the room by refraction, or around the camera and the room.
pub fn in_glass(rig: &mut Rig, side: f32) -> Entity {
    room(rig);
    let glass = StandardMaterial {
        specular_transmission: 1.0,
        thickness: 0.5,
        ior: 1.4,
        // The camera sees the inner side.
        cull_mode: None,
        ..shiny(Color::WHITE, 0.0, 0.0)
    };
    let place = if side < 1.0 { Transform::from_xyz(0.3, 0.2, 4.0) } else { Transform::default() };
    rig.spawn(Cuboid::from_length(side), glass, place)
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_around_a_camera_in_clear_glass_equal_the_reference() {
    for side in [0.6, 14.0] {
        check("in glass", Proof { bounces: 3, margin: 0.05, ..PROOF }, |rig| _ = in_glass(rig, side));
    }
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_nan_stays_in_the_reservoirs_of_paths_and_of_light_paths() {
    let Some(mut rig) = room_scene(32) else { return };
    rig.set(|r| r.jitter = Jitter::Always);
    let length = Proof::of((48, 8), (32, 32));
    let proof = Proof { bounces: 3, ours: length.ours, truth: length.truth, ..PROOF };
    proof.survives_nan(&mut rig, &[Bidirectional(Lightweight, paths::all_reuse())]);
}
