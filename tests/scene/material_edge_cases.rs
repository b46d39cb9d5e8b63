//! Edge cases of faces, emission and transparency, each in a small scene with a known radiance.

use crate::support::{app::*, expected_radiance::*};
use bevy::{prelude::*, render::render_resource::Face};
use bevy_restir::{Subsurface, Technique};

#[test]
fn faces_are_seen_lit_and_culled_as_designed() {
    check(FACES);
}

const FACES: &[Row] = &[
    (
        "a back face is lit with flipped normals",
        |rig| {
            sun(rig);
            rig.spawn(square(4.0), open(lambert(0.5)), turned(Transform::default()));
        },
        1.0,
        EXACT,
    ),
    (
        "a culled face is seen through",
        |rig| {
            rig.spawn(square(4.0), lamp(3.0, 3.0, 3.0), at(0.0, 0.0, -1.0));
            rig.spawn(square(4.0), lambert(0.5), turned(Transform::default()));
        },
        3.0,
        EXACT,
    ),
    (
        "a culled face still casts its shadow",
        |rig| {
            sun(rig);
            rig.spawn(square(4.0), lambert(0.5), at(0.0, 0.0, -1.0));
            rig.spawn(square(4.0), lambert(0.5), turned(Transform::default()));
        },
        0.0,
        EXACT,
    ),
    (
        "front faces are culled under `Face::Front`",
        |rig| {
            rig.spawn(square(4.0), lamp(3.0, 3.0, 3.0), at(0.0, 0.0, -1.0));
            let inside_out = StandardMaterial { cull_mode: Some(Face::Front), ..lambert(0.5) };
            rig.spawn(square(4.0), inside_out, Transform::default());
        },
        3.0,
        EXACT,
    ),
    (
        "mirroring turns a back face into a front face",
        |rig| {
            sun(rig);
            let mirrored = Transform::default().with_scale(Vec3::new(-1.0, 1.0, 1.0));
            rig.spawn(square(4.0), lambert(0.5), mirrored);
        },
        1.0,
        EXACT,
    ),
];

/// The normal of a plane at a steep angle points away from the viewer, who sees it from the side instead.
#[test]
fn normals_that_face_away_are_bent_towards_the_viewer() {
    check(LEANING);
}

const LEANING: &[Row] = &[
    (
        "a plane at 80 degrees whose normal is at 120",
        |rig| {
            slanting_sun(rig);
            rig.spawn(leaning(4.0, 40.0), lambert(0.5), turned_by(80.0));
        },
        1.0,
        EXACT,
    ),
    (
        "light leaves such a plane that is translucent; it enters by the normal as it is",
        |rig| {
            slanting_sun(rig);
            let plane = rig.spawn(leaning(4.0, 40.0), lambert(0.5), turned_by(80.0));
            rig.insert(plane, Subsurface { mean_free_path: Vec3::splat(0.02), weight: 1.0 });
        },
        // The cosine between the normal at 120 degrees and the sun at 45, relative to that of the first row.
        0.366,
        NOISY,
    ),
];

#[test]
fn emission_leaves_the_designed_sides() {
    check(EMISSION);
}

const EMISSION: &[Row] = &[
    (
        "in front",
        |rig| {
            rig.spawn(square(4.0), lamp(3.0, 3.0, 3.0), Transform::default());
        },
        3.0,
        EXACT,
    ),
    (
        "behind",
        |rig| {
            rig.spawn(square(4.0), open(lamp(3.0, 3.0, 3.0)), turned(Transform::default()));
        },
        0.0,
        EXACT,
    ),
    (
        "behind, double-sided",
        |rig| {
            rig.spawn(square(4.0), both_sides(3.0), turned(Transform::default()));
        },
        3.0,
        EXACT,
    ),
    (
        "the inside of an emissive sphere lights nothing",
        |rig| {
            floor(rig, 0.5);
            rig.spawn(Sphere::new(20.0).mesh().uv(16, 8), lamp(3.0, 3.0, 3.0), Transform::default());
        },
        0.0,
        EXACT,
    ),
    (
        "a double-sided one lights its inside",
        |rig| {
            floor(rig, 0.5);
            rig.spawn(Sphere::new(20.0).mesh().uv(16, 8), both_sides(3.0), Transform::default());
        },
        1.5,
        NOISY,
    ),
    (
        "an unlit material shows its base color to the camera",
        |rig| {
            sun(rig);
            let unlit = StandardMaterial { unlit: true, ..Color::linear_rgb(0.7, 0.7, 0.7).into() };
            rig.spawn(square(4.0), unlit, Transform::default());
        },
        0.7,
        EXACT,
    ),
    (
        "an unlit material is black to other rays",
        |rig| {
            floor(rig, 0.5);
            let unlit = StandardMaterial { unlit: true, ..Color::WHITE.into() };
            rig.spawn(Cuboid::from_length(3.0), StandardMaterial { cull_mode: None, ..unlit }, at(3.0, 0.0, 0.0));
            rig.insert(rig.camera, sky(0.0));
        },
        0.0,
        EXACT,
    ),
];

#[test]
fn partial_transparency_is_right_in_the_mean() {
    check(TRANSPARENCY);
}

const TRANSPARENCY: &[Row] = &[
    // (1 - T) base E/π + T base L; the index of refraction is 1, so nothing bends or reflects.
    (
        "partial transmission",
        |rig| {
            sun(rig);
            let half = StandardMaterial {
                specular_transmission: 0.4,
                reflectance: 0.0,
                base_color: Color::linear_rgb(0.5, 0.5, 0.5),
                ..glass(1.0)
            };
            rig.spawn(square(4.0), half, Transform::default());
            rig.spawn(square(4.0), lamp(3.0, 3.0, 3.0), at(0.0, 0.0, -1.0));
        },
        0.6 * 0.5 * 2.0 + 0.4 * 0.5 * 3.0,
        NOISY,
    ),
    ("blend", |rig| pane(rig, AlphaMode::Blend), 2.5, NOISY),
    ("premultiplied", |rig| pane(rig, AlphaMode::Premultiplied), 2.5, NOISY),
    ("add", |rig| pane(rig, AlphaMode::Add), 2.5, NOISY),
    (
        "the shadow of a blended surface",
        |rig| {
            slanting_sun(rig);
            floor(rig, 0.5);
            rig.spawn(square(0.5), alpha(AlphaMode::Blend, 0.25, open(lambert(0.0))), blind());
        },
        0.75,
        NOISY,
    ),
    ("below the cutoff of a mask", |rig| pane_of(rig, AlphaMode::Mask(0.7), 0.69), 2.0, EXACT),
    ("above the cutoff of a mask", |rig| pane_of(rig, AlphaMode::Mask(0.3), 0.31), 4.0, EXACT),
    ("less coverage than half", |rig| pane_of(rig, AlphaMode::AlphaToCoverage, 0.49), 2.0, EXACT),
    ("more coverage than half", |rig| pane_of(rig, AlphaMode::AlphaToCoverage, 0.51), 4.0, EXACT),
    (
        "a mask below its cutoff casts no shadow",
        |rig| {
            slanting_sun(rig);
            floor(rig, 0.5);
            rig.spawn(square(0.5), alpha(AlphaMode::Mask(0.5), 0.25, open(lambert(0.0))), blind());
        },
        1.0,
        EXACT,
    ),
];

/// Radiance 4 in front of radiance 2.
fn pane(rig: &mut Rig, mode: AlphaMode) {
    pane_of(rig, mode, 0.25);
}

fn pane_of(rig: &mut Rig, mode: AlphaMode, share: f32) {
    rig.spawn(square(4.0), alpha(mode, share, lamp(4.0, 4.0, 4.0)), Transform::default());
    rig.spawn(square(4.0), lamp(2.0, 2.0, 2.0), at(0.0, 0.0, -1.0));
}

#[test]
fn a_lamp_inside_glass_emits_its_radiance_in_the_glass() {
    check(LAMPS_IN_GLASS);
}

/// At normal incidence, the interface reflects ((n-1)/(n+1))², and the radiance outside is that inside divided by n².
const LAMPS_IN_GLASS: &[Row] = &[
    ("index 1.5", |rig| lamp_in_glass(rig, 1.5), 3.0 * 0.96 / 2.25, NOISY),
    ("index 2", |rig| lamp_in_glass(rig, 2.0), 3.0 * (1.0 - 1.0 / 9.0) / 4.0, NOISY),
];

#[test]
#[ignore = "second tier: ./run test --more"]
fn resampled_paths_have_these_radiances_too() {
    check_with(Technique::Pt, &[FACES, LEANING, EMISSION, TRANSPARENCY, LAMPS_IN_GLASS]);
}

fn lamp_in_glass(rig: &mut Rig, ior: f32) {
    rig.spawn(square(4.0), glass(ior), Transform::default());
    rig.spawn(square(4.0), lamp(3.0, 3.0, 3.0), at(0.0, 0.0, -1.0));
}
