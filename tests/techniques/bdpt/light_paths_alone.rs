//! Light paths that the camera sees find all direct light on their own, with any camera and on any material: their pictures, without the other
//! techniques and without MIS weights, equal the reference.

use crate::support::{
    app::*,
    expected_radiance::{leaning, turned_by},
    small_scenes::*,
};
use bevy::{
    camera::{CameraProjection, SubCameraView},
    light::NotShadowCaster,
    math::Vec3A,
    prelude::*,
    render::render_resource::TextureFormat,
};
use bevy_restir::{Jitter, LightTechniques, Restir, Subsurface, Technique, testing::plant_shader_defs};

fn bidirectional(bounces: u32) -> Restir {
    let mut settings = Restir { technique: Technique::Bdpt, bounces, jitter: Jitter::Always, ..plain() };
    settings.bdpt.techniques = LightTechniques::Lightweight;
    settings
}

/// A floor that faces a lamp and the camera.
fn floor(rig: &mut Rig, material: StandardMaterial) -> Entity {
    rig.spawn(square(1.0), lamp(9.0, 7.0, 5.0), facing(Vec3::new(2.0, 0.5, 1.5), Vec3::ZERO));
    rig.spawn(square(8.0), material, Transform::default())
}

/// Asserts that light paths alone have the mean of the reference, with single bounces.
fn check(name: &str, make: impl FnOnce(&mut Rig)) {
    let Some(mut rig) = scene(32, make) else { return };
    rig.set(|r| *r = Restir { technique: Technique::Reference, ..bidirectional(1) });
    let (truth, truth_error) = rig.mean_over(0..4, 32);
    rig.set(|r| *r = bidirectional(1));
    plant_shader_defs(&mut rig.app, &["TEST_SPLATS", "TEST_ALONE"]);
    let (mean, error) = rig.mean_over(0..8, 16);
    let error = error.hypot(truth_error);
    eprintln!("{name}: {mean}, reference {truth} ± {error}");
    assert!(error < 0.02 * truth, "{name}: ± {error} of {truth}");
    assert!((mean - truth).abs() < 4.0 * error + 0.005 * truth, "{name}: {mean}, reference {truth} ± {error}");
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_alone_light_the_pictures_of_cameras_with_a_scale() {
    for scale in [Vec3::ONE, Vec3::splat(2.0), Vec3::new(1.0, 0.5, 3.0)] {
        let scaled = |rig: &mut Rig| {
            floor(rig, lambert(0.5));
            rig.get_mut::<Transform>(rig.camera).scale = scale;
        };
        check(&format!("perspective, {scale}"), scaled);
        check(&format!("orthographic, {scale}"), |rig| {
            scaled(rig);
            rig.insert(rig.camera, orthographic(2.0, 2.0));
        });
    }
}

/// The lamp lights the back of the floor, which a camera with inverted culling sees.
#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_alone_light_back_faces_for_a_camera_that_inverts_culling() {
    check("back faces", |rig| {
        let floor = floor(rig, lambert(0.5));
        // This wall is in front of the floor and faces the camera, which does not see it.
        rig.spawn(square(0.5), lambert(0.9), Transform::from_xyz(0.5, 0.0, 0.5));
        rig.get_mut::<Transform>(floor).rotate_y(core::f32::consts::PI);
        rig.get_mut::<Camera>(rig.camera).invert_culling = true;
    });
}

/// A perspective image with left and right exchanged, as of a rear-view mirror.
#[derive(Clone, Debug)]
struct Mirrored(PerspectiveProjection);

impl CameraProjection for Mirrored {
    fn get_clip_from_view(&self) -> Mat4 {
        Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0)) * self.0.get_clip_from_view()
    }

    fn get_clip_from_view_for_sub(&self, sub_view: &SubCameraView) -> Mat4 {
        Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0)) * self.0.get_clip_from_view_for_sub(sub_view)
    }

    fn update(&mut self, width: f32, height: f32) {
        self.0.update(width, height);
    }

    fn far(&self) -> f32 {
        self.0.far()
    }

    fn get_frustum_corners(&self, near: f32, far: f32) -> [Vec3A; 8] {
        self.0.get_frustum_corners(near, far)
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_alone_light_the_picture_of_a_mirrored_projection() {
    check("mirrored projection", |rig| {
        floor(rig, lambert(0.5));
        rig.insert(rig.camera, Projection::custom(Mirrored(PerspectiveProjection::default())));
        rig.get_mut::<Camera>(rig.camera).invert_culling = true;
    });
}

/// Two squares back to back are one wall.  The camera does not see the square that faces away, and the other one hides what is behind it.
#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_alone_stay_behind_walls_of_two_squares() {
    for turned_first in [false, true] {
        let wall = |rig: &mut Rig| {
            for is_turned in [turned_first, !turned_first] {
                let turn = if is_turned { Quat::from_xyzw(0.0, 1.0, 0.0, 0.0) } else { Quat::IDENTITY };
                rig.spawn(square(8.0), lambert(0.5), Transform::from_rotation(turn));
            }
            let behind = Vec3::new(0.0, 0.0, -3.0);
            rig.spawn(square(1.0), lamp(9.0, 7.0, 5.0), facing(Vec3::new(0.0, 0.0, -1.0), behind));
            rig.spawn(square(8.0), lambert(0.5), Transform::from_translation(behind));
        };
        let Some(mut rig) = scene(32, wall) else { return };
        rig.set(|r| *r = bidirectional(1));
        plant_shader_defs(&mut rig.app, &["TEST_SPLATS", "TEST_ALONE"]);
        assert_eq!(rig.picture(8).mean(), 0.0, "turned first: {turned_first}");
        rig.assert_sound();
    }
}

/// The lamp and the camera see the plane with different normals.
#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_alone_light_surfaces_whose_normals_face_away_from_the_camera() {
    for material in [lambert(0.5), shiny(Color::linear_rgb(0.6, 0.6, 0.6), 0.6, 0.5)] {
        check("leaning normals", |rig| {
            let lamp_at = facing(Vec3::new(2.0, 0.5, 1.5), Vec3::ZERO);
            rig.spawn(square(1.0), lamp(9.0, 7.0, 5.0), lamp_at);
            rig.spawn(leaning(8.0, 40.0), material, turned_by(75.0));
        });
    }
}

/// A light path meets a point of a surface, and the camera a pixel of it.
#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_alone_light_surfaces_whose_points_are_polished_and_whose_pixels_are_not() {
    check("polished texels", |rig| {
        let mut texels =
            texture(256, 256, |x, y| if (x + y) % 2 == 0 { [255, 0, 255, 255] } else { [255, 255, 0, 255] });
        texels.texture_descriptor.format = TextureFormat::Rgba8Unorm;
        let texels = Some(rig.add::<Image>(texels));
        let gray = Color::linear_rgb(0.6, 0.6, 0.6);
        floor(rig, StandardMaterial { metallic_roughness_texture: texels, ..shiny(gray, 1.0, 1.0) });
    });
    check("a translucent floor far away", |rig| {
        let material = StandardMaterial { reflectance: 0.0, ..shiny(Color::linear_rgb(0.6, 0.6, 0.6), 0.0, 0.0) };
        let floor = floor(rig, material);
        rig.insert(floor, Subsurface { mean_free_path: Vec3::splat(1e-5), weight: 1.0 });
    });
}

/// White light has a color after this distance, in meters.
fn tinted_glass(roughness: f32, distance: f32) -> StandardMaterial {
    StandardMaterial {
        specular_transmission: 1.0,
        thickness: 1.0,
        attenuation_color: Color::linear_rgb(0.1, 0.5, 0.9),
        attenuation_distance: distance,
        cull_mode: None,
        ..shiny(Color::WHITE, roughness, 0.0)
    }
}

/// The mean of the picture of every technique, with the same random numbers.
fn means(rig: &mut Rig) -> Vec<(Technique, f64)> {
    let mean = |technique| {
        rig.set(|r| *r = Restir { technique, ..bidirectional(2) });
        (technique, rig.mean_over(0..2, 8).0)
    };
    Technique::ALL.into_iter().map(mean).collect()
}

/// Light from infinity has no distance over which an object could absorb it.  Its paths are inside of an open object to the end.
#[test]
#[ignore = "second tier: ./run test --more"]
fn open_objects_absorb_no_light_from_infinity() {
    for roughness in [0.0, 0.5] {
        let Some(mut rig) = scene(16, |rig| {
            rig.insert(rig.camera, sky(1.0));
            let sun = DirectionalLight { illuminance: 1.0, ..default() };
            rig.spawn_bundle((sun, Transform::default().looking_to(Vec3::new(0.1, 0.1, 1.0), Vec3::Y)));
        }) else {
            return;
        };
        let pane = rig.spawn(square(8.0), tinted_glass(roughness, f32::INFINITY), Transform::default());
        // Another object absorbs in both cases, so that shaders are the same.
        rig.spawn(Sphere::new(0.2), tinted_glass(roughness, 0.1), Transform::from_xyz(0.0, 9.0, 0.0));
        let clear = means(&mut rig);
        let pane = rig.material_of(pane);
        rig.edit(&pane, |m| m.attenuation_distance = 0.1);
        for ((technique, clear), (_, tinted)) in clear.into_iter().zip(means(&mut rig)) {
            assert!(
                (tinted / clear - 1.0).abs() < 1e-4,
                "{technique:?}, roughness {roughness}: {tinted}, clear {clear}"
            );
        }
        rig.assert_sound();
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn an_opaque_object_absorbs_nothing_behind_its_surface() {
    let Some(mut rig) = scene(16, |rig| {
        rig.insert(rig.camera, sky(0.5));
    }) else {
        return;
    };
    let glass = tinted_glass(0.0, 0.1);
    rig.spawn(Sphere::new(0.2), glass.clone(), Transform::from_xyz(0.0, 9.0, 0.0));
    rig.spawn(square(1.0), lamp(9.0, 7.0, 5.0), facing(Vec3::new(0.5, 1.0, 4.0), Vec3::ZERO));
    let turned = Transform::from_rotation(Quat::from_rotation_y(core::f32::consts::PI));
    let wall = rig.spawn(square(8.0), StandardMaterial { cull_mode: None, ..lambert(0.5) }, turned);
    let plain = means(&mut rig);
    let wall = rig.material_of(wall);
    rig.edit(&wall, |m| {
        (m.thickness, m.attenuation_color, m.attenuation_distance) = (1.0, glass.attenuation_color, 0.1);
    });
    assert_eq!(plain, means(&mut rig));
}

/// A scene without a size: shadow rays find none of its objects.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_plane_that_no_ray_finds_has_its_closed_form_below_a_sky() {
    let Some(mut rig) = scene(16, |rig| {
        let plane = rig.spawn(square(20.0), lambert(0.5), Transform::default());
        rig.insert(plane, NotShadowCaster);
        rig.insert(rig.camera, sky(2.0));
    }) else {
        return;
    };
    for techniques in [LightTechniques::Full, LightTechniques::Lightweight] {
        rig.set(|r| *r = bidirectional(2));
        rig.set(|r| r.bdpt.techniques = techniques);
        let (mean, error) = rig.mean_over(0..8, 8);
        assert!(error < 0.01 && (mean - 1.0).abs() < 4.0 * error + 1e-3, "{techniques:?}: {mean} ± {error}");
    }
    rig.assert_sound();
}
