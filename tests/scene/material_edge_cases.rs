//! Edge cases of faces, emission, transparency, visibility, layers, shadows and backdrops, each in a small scene with a known radiance.

use crate::support::{app::*, expected_radiance::*};
use bevy::{
    camera::{
        ImageRenderTarget, RenderTarget,
        visibility::{RenderLayers, VisibilityRange},
    },
    light::NotShadowCaster,
    prelude::*,
    render::render_resource::Face,
};
use bevy_restir::{RestirIgnore, RestirMaterial};

#[test]
fn faces_are_seen_lit_and_culled_as_designed() {
    check(&[
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
    ]);
}

#[test]
fn emission_leaves_the_designed_sides() {
    check(&[
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
    ]);
}

#[test]
fn partial_transparency_is_right_in_the_mean() {
    check(&[
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
    ]);
}

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
    // At normal incidence, the interface reflects ((n-1)/(n+1))², and the radiance outside is that inside divided by n².
    check(&[
        ("index 1.5", |rig| lamp_in_glass(rig, 1.5), 3.0 * 0.96 / 2.25, NOISY),
        ("index 2", |rig| lamp_in_glass(rig, 2.0), 3.0 * (1.0 - 1.0 / 9.0) / 4.0, NOISY),
    ]);
}

fn lamp_in_glass(rig: &mut Rig, ior: f32) {
    rig.spawn(square(4.0), glass(ior), Transform::default());
    rig.spawn(square(4.0), lamp(3.0, 3.0, 3.0), at(0.0, 0.0, -1.0));
}

#[test]
fn hidden_objects_are_absent_for_all_rays() {
    check(&[
        (
            "a hidden lamp",
            |rig| {
                floor(rig, 0.5);
                let lamp = rig.spawn(square(2.0), both_sides(100.0), at(2.0, 0.0, 2.0));
                rig.insert(lamp, Visibility::Hidden);
            },
            0.0,
            EXACT,
        ),
        (
            "a hidden blind",
            |rig| {
                slanting_sun(rig);
                floor(rig, 0.5);
                let blind = rig.spawn(square(0.5), open(lambert(0.0)), blind());
                rig.insert(blind, Visibility::Hidden);
            },
            1.0,
            EXACT,
        ),
        (
            "a child of a hidden entity",
            |rig| {
                slanting_sun(rig);
                floor(rig, 0.5);
                let child = rig.spawn(square(0.5), open(lambert(0.0)), blind());
                let parent = rig.spawn_bundle((Transform::default(), Visibility::Hidden));
                rig.app.world_mut().entity_mut(parent).add_child(child);
            },
            1.0,
            EXACT,
        ),
        (
            "a hidden sun",
            |rig| {
                let sun = sun(rig);
                floor(rig, 0.5);
                rig.insert(sun, Visibility::Hidden);
            },
            0.0,
            EXACT,
        ),
        (
            "a blind on another layer",
            |rig| {
                slanting_sun(rig);
                floor(rig, 0.5);
                let blind = rig.spawn(square(0.5), open(lambert(0.0)), blind());
                rig.insert(blind, RenderLayers::layer(1));
            },
            1.0,
            EXACT,
        ),
        (
            "a lamp on another layer, and beyond the first 64",
            |rig| {
                floor(rig, 0.5);
                let lamp = rig.spawn(square(2.0), both_sides(100.0), at(2.0, 0.0, 2.0));
                rig.insert(lamp, RenderLayers::from_layers(&[77]));
            },
            0.0,
            EXACT,
        ),
        (
            "a sun on another layer",
            |rig| {
                let sun = sun(rig);
                floor(rig, 0.5);
                rig.insert(sun, RenderLayers::layer(1));
            },
            0.0,
            EXACT,
        ),
        (
            "everything on one of the camera's layers",
            |rig| {
                let entities =
                    [slanting_sun(rig), floor(rig, 0.5), rig.spawn(square(0.5), open(lambert(0.0)), blind())];
                for entity in entities {
                    rig.insert(entity, RenderLayers::from_layers(&[3, 70]));
                }
                rig.insert(rig.camera, RenderLayers::from_layers(&[2, 70]));
            },
            0.0,
            EXACT,
        ),
        (
            "objects on the default layer, which the camera lacks",
            |rig| {
                slanting_sun(rig);
                floor(rig, 0.5);
                rig.insert(rig.camera, RenderLayers::layer(1));
                rig.app.insert_resource(ClearColor(Color::linear_rgb(0.3, 0.3, 0.3)));
            },
            0.3,
            EXACT,
        ),
    ]);
}

#[test]
fn objects_without_shadows_are_visible_to_the_camera_alone() {
    check(&[
        (
            "its shadow",
            |rig| {
                slanting_sun(rig);
                floor(rig, 0.5);
                let blind = rig.spawn(square(0.5), open(lambert(0.0)), blind());
                rig.insert(blind, NotShadowCaster);
            },
            1.0,
            EXACT,
        ),
        (
            "its light",
            |rig| {
                floor(rig, 0.5);
                let lamp = rig.spawn(square(2.0), both_sides(100.0), at(2.0, 0.0, 2.0));
                rig.insert(lamp, NotShadowCaster);
            },
            0.0,
            EXACT,
        ),
        (
            "its appearance",
            |rig| {
                let lamp = rig.spawn(square(4.0), lamp(3.0, 3.0, 3.0), at(0.0, 0.0, 1.0));
                rig.insert(lamp, NotShadowCaster);
                sun(rig);
            },
            3.0,
            EXACT,
        ),
        (
            "the light that it reflects",
            |rig| {
                sun(rig);
                let square = rig.spawn(square(4.0), lambert(0.5), Transform::default());
                rig.insert(square, NotShadowCaster);
            },
            1.0,
            EXACT,
        ),
    ]);
}

#[test]
fn rays_alone_see_stand_ins_and_nothing_sees_ignored_objects() {
    fn stand_in(rig: &mut Rig, entity: Entity) {
        let material = rig.material_of(entity);
        rig.insert(entity, RestirMaterial(material));
        rig.app.world_mut().entity_mut(entity).remove::<MeshMaterial3d<StandardMaterial>>();
    }
    check(&[
        (
            "the shadow of a stand-in",
            |rig| {
                slanting_sun(rig);
                floor(rig, 0.5);
                let square = rig.spawn(square(0.5), open(lambert(0.0)), blind());
                stand_in(rig, square);
            },
            0.0,
            EXACT,
        ),
        (
            "the appearance of a stand-in",
            |rig| {
                sun(rig);
                let square = rig.spawn(square(4.0), lamp(3.0, 3.0, 3.0), Transform::default());
                stand_in(rig, square);
            },
            0.0,
            EXACT,
        ),
        (
            "the light that a stand-in emits, in the place of its own material",
            |rig| {
                floor(rig, 0.5);
                let inside = Sphere::new(20.0).mesh().uv(16, 8);
                let sphere = rig.spawn(inside, both_sides(3.0), Transform::default());
                let material = rig.material_of(sphere);
                let other = rig.add::<StandardMaterial>(lambert(0.0));
                rig.insert(sphere, (RestirMaterial(material), MeshMaterial3d(other)));
            },
            1.5,
            NOISY,
        ),
        (
            "the shadow of an ignored object",
            |rig| {
                slanting_sun(rig);
                floor(rig, 0.5);
                let square = rig.spawn(square(0.5), open(lambert(0.0)), blind());
                rig.insert(square, RestirIgnore);
            },
            1.0,
            EXACT,
        ),
        (
            "the appearance of an ignored object",
            |rig| {
                sun(rig);
                let square = rig.spawn(square(4.0), lamp(3.0, 3.0, 3.0), Transform::default());
                rig.insert(square, RestirIgnore);
            },
            0.0,
            EXACT,
        ),
    ]);
}

#[test]
fn camera_rays_that_miss_see_the_backdrop_and_other_rays_the_environment() {
    check(&[
        (
            "camera rays: the clear color",
            |rig| {
                rig.app.insert_resource(ClearColor(Color::linear_rgb(0.3, 0.3, 0.3)));
                sun(rig);
            },
            0.3,
            EXACT,
        ),
        (
            "others: nothing",
            |rig| {
                rig.app.insert_resource(ClearColor(Color::WHITE));
                floor(rig, 0.5);
            },
            0.0,
            EXACT,
        ),
        (
            "camera rays: the camera's own clear color",
            |rig| {
                let color = Color::linear_rgb(0.6, 0.6, 0.6);
                rig.get_mut::<Camera>(rig.camera).clear_color = ClearColorConfig::Custom(color);
            },
            0.6,
            EXACT,
        ),
        (
            "camera rays: the environment",
            |rig| {
                rig.app.insert_resource(ClearColor(Color::WHITE));
                rig.insert(rig.camera, sky(0.8));
            },
            0.8,
            EXACT,
        ),
        (
            "other rays: the environment",
            |rig| {
                rig.insert(rig.camera, sky(0.8));
                floor(rig, 0.5);
            },
            0.4,
            NOISY,
        ),
        (
            "rays through glass of index 1: the environment",
            |rig| {
                rig.app.insert_resource(ClearColor(Color::WHITE));
                rig.insert(rig.camera, sky(0.8));
                let clear = StandardMaterial { reflectance: 0.0, ..glass(1.0) };
                rig.spawn(square(4.0), clear, Transform::default());
            },
            0.8,
            NOISY,
        ),
    ]);
}

#[test]
fn of_several_levels_of_detail_the_one_in_range_is_hit() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.insert(rig.camera, orthographic(1.0, 1.0));
    // Both levels are at distance 5 from the camera at z = 5; the far level lies in front and would cover the near one.
    let level =
        |start: core::ops::Range<f32>, end| VisibilityRange { start_margin: start, end_margin: end, use_aabb: false };
    let near = rig.spawn(square(2.0), lamp(1.0, 0.0, 0.0), Transform::default());
    let far = rig.spawn(square(2.0), lamp(0.0, 1.0, 0.0), Transform::from_xyz(0.0, 0.0, 0.01));
    rig.insert(near, level(0.0..0.0, 8.0..10.0));
    rig.insert(far, level(8.0..10.0, 20.0..20.0));
    // The range of a camera that renders later is ignored.
    let image = rig.add::<Image>(target_image(UVec2::new(4, 4)));
    rig.spawn_bundle((
        Camera3d::default(),
        Camera { order: 1, ..default() },
        RenderTarget::Image(ImageRenderTarget::from(image)),
        Transform::from_xyz(0.0, 0.0, 15.0),
        plain(),
    ));
    for (z, color) in
        [(5.0, Vec3::X), (15.0, Vec3::Y), (8.5, Vec3::X), (9.5, Vec3::Y), (30.0, Vec3::ZERO), (5.0, Vec3::X)]
    {
        rig.get_mut::<Transform>(rig.camera).translation.z = z;
        assert_eq!(rig.picture(1).center(), color, "{z} away");
        assert_eq!(rig.report().instances, u64::from(color != Vec3::ZERO), "{z} away");
    }
    // With `use_aabb` the distance is that of the center of the bounding box.
    let aside =
        rig.spawn(square(2.0).translated_by(Vec3::new(0.0, 0.0, 3.0)), lamp(0.0, 0.0, 1.0), Transform::default());
    for (use_aabb, color) in [(false, Vec3::X), (true, Vec3::Z)] {
        rig.insert(aside, VisibilityRange { use_aabb, ..VisibilityRange::abrupt(0.0, 3.0) });
        assert_eq!(rig.picture(1).center(), color, "use_aabb: {use_aabb}");
    }
    rig.app.world_mut().entity_mut(near).remove::<VisibilityRange>();
    rig.app.world_mut().despawn(aside);
    rig.get_mut::<Transform>(rig.camera).translation.z = 30.0;
    assert_eq!(rig.picture(1).center(), Vec3::X, "without a range");
}
