//! Pipelines for objects and lights that an app expects are compiled ahead: the first of a kind is lit in its first frame.

use super::mirror::feature_steps;
use crate::support::{app::*, images::texture, picture::Picture};
use bevy::{light::SunDisk, prelude::*};
use bevy_restir::{Denoiser, RestirExpected, Subsurface, Technique};

const EVERYTHING: RestirExpected = RestirExpected {
    emissive_meshes: true,
    point_lights: true,
    sphere_lights: true,
    spot_lights: true,
    rect_lights: true,
    directional_lights: true,
    sun_disks: true,
    textures: true,
    normal_maps: true,
    layer_textures: true,
    vertex_colors: true,
    alpha: true,
    glass: true,
    diffuse_transmission: true,
    clearcoat: true,
    anisotropy: true,
    smooth_materials: true,
    subsurface: true,
    bending_meshes: true,
    render_layers: true,
};

/// A dim room without any lamp.  Returns the material of a ball.
fn dim(rig: &mut Rig) -> Handle<StandardMaterial> {
    rig.insert(rig.camera, sky(0.05));
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    let ball = rig.spawn(Sphere::new(0.4).mesh().uv(16, 10), lambert(0.8), Transform::from_xyz(0.0, 0.0, 0.5));
    rig.set(|r| {
        (r.technique, r.bounces, r.seed) = (Technique::Gi, 3, 1);
        // Smooth materials have passes of their own in the denoiser.
        r.denoiser = Denoiser::ON;
    });
    rig.material_of(ball)
}

/// The frames before and after a spot light and glass appear, and how many pipelines are compiled for them.
fn first_pictures(rig: &mut Rig, expected: RestirExpected) -> ([Picture; 2], usize) {
    rig.app.insert_resource(expected);
    let ball = dim(rig);
    rig.until_ready();
    rig.set(|r| r.reset = true);
    rig.frames(3);
    let before = rig.next();
    let (compiled, resets) = (rig.report().pipelines.len(), rig.report().history_resets);
    rig.edit(&ball, |m| (m.specular_transmission, m.thickness, m.perceptual_roughness) = (1.0, 0.5, 0.0));
    let place = Transform::from_xyz(1.0, 1.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
    rig.spawn_bundle((SpotLight { intensity: 100.0, ..default() }, place));
    let after = rig.next();
    rig.until_ready();
    let report = rig.report();
    if expected != RestirExpected::default() {
        assert_eq!(report.history_resets, resets);
    }
    ([before, after], report.pipelines.len() - compiled)
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn expected_objects_are_lit_in_their_first_frame() {
    let expected = RestirExpected { spot_lights: true, glass: true, ..default() };
    let (Some(mut rig), Some(mut waiting), Some(mut unprepared)) =
        (Rig::compiling_in_background(24, 24), Rig::new(24, 24), Rig::compiling_in_background(24, 24))
    else {
        return;
    };
    let ([before, after], compiled) = first_pictures(&mut rig, expected);
    assert_eq!(compiled, 0);
    assert!(after.mean() > 2.0 * before.mean(), "{} and {}", before.mean(), after.mean());
    // An app that waits for its pipelines in every frame.
    let ([_, same], _) = first_pictures(&mut waiting, expected);
    assert!((after.mean() - same.mean()).abs() < 0.01 * same.mean(), "{} and {}", after.mean(), same.mean());
    // Without the resource, the frame has the old light, and pipelines are compiled.
    let ([before, after], compiled) = first_pictures(&mut unprepared, RestirExpected::default());
    assert!(compiled > 0);
    assert!(after.mean() < 1.2 * before.mean(), "{} and {}", before.mean(), after.mean());
    for rig in [&mut rig, &mut waiting, &mut unprepared] {
        rig.assert_sound();
    }
}

/// Also that shaders with all features show the same picture as those without, bit by bit.  A CPU driver did not finish compiling these shaders
/// in half an hour, beside other tests.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_nothing_is_compiled_for_what_is_expected() {
    let Some(mut rig) = Rig::new(24, 24) else { return };
    dim(&mut rig);
    let plain = rig.picture(4);
    rig.app.insert_resource(EVERYTHING);
    let prepared = rig.picture(4);
    assert!(plain.iter().eq(prepared.iter()), "{} and {}", plain.mean(), prepared.mean());
    let before = rig.report();
    let same = |rig: &mut Rig, name: &str| {
        let report = rig.until_ready();
        assert_eq!(report.pipelines.len(), before.pipelines.len(), "{name}");
        assert_eq!(report.features, before.features, "{name}");
    };
    for (name, _, add) in feature_steps().into_iter().filter(|(name, ..)| *name != "environment map") {
        add(&mut rig);
        same(&mut rig, name);
    }
    let above = Transform::from_xyz(0.0, 0.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
    rig.spawn_bundle((PointLight { radius: 0.1, ..default() }, above));
    rig.spawn_bundle((SpotLight::default(), above));
    rig.spawn_bundle((RectLight::default(), above));
    rig.spawn_bundle((DirectionalLight::default(), SunDisk::EARTH, above));
    same(&mut rig, "lights");
    let image = rig.add::<Image>(texture(2, 2, |_, _| [128; 4]));
    let rough = StandardMaterial { metallic_roughness_texture: Some(image), ..lambert(0.5) };
    rig.spawn(square(0.5), rough, Transform::from_xyz(-1.5, 0.0, 0.2));
    same(&mut rig, "texture of roughness");
    let wax = rig.spawn(Cuboid::from_length(0.5), lambert(0.5), Transform::from_xyz(-1.0, 1.0, 0.5));
    rig.insert(wax, Subsurface { mean_free_path: Vec3::splat(0.1), weight: 1.0 });
    same(&mut rig, "wax");
    rig.assert_sound();
}
