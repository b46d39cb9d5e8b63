//! Which rays see which objects: visibility, layers, shadows, stand-ins, backdrops and levels of detail, each in a small scene with a
//! known radiance.

use crate::support::{app::*, expected_radiance::*};
use bevy::{
    camera::{
        ImageRenderTarget, RenderTarget,
        visibility::{RenderLayers, VisibilityRange},
    },
    light::NotShadowCaster,
    prelude::*,
};
use bevy_restir::{RestirIgnore, RestirMaterial, SceneFeatures, Technique};

#[test]
fn hidden_objects_are_absent_for_all_rays() {
    check(HIDDEN);
}

const HIDDEN: &[Row] = &[
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
            let entities = [slanting_sun(rig), floor(rig, 0.5), rig.spawn(square(0.5), open(lambert(0.0)), blind())];
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
];

#[test]
fn objects_without_shadows_are_visible_to_the_camera_alone() {
    check(WITHOUT_SHADOWS);
}

const WITHOUT_SHADOWS: &[Row] = &[
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
];

#[test]
fn rays_alone_see_stand_ins_and_nothing_sees_ignored_objects() {
    check(STAND_INS);
}

fn stand_in(rig: &mut Rig, entity: Entity) {
    let material = rig.material_of(entity);
    rig.insert(entity, RestirMaterial(material));
    rig.app.world_mut().entity_mut(entity).remove::<MeshMaterial3d<StandardMaterial>>();
}

const STAND_INS: &[Row] = &[
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
];

#[test]
fn camera_rays_that_miss_see_the_backdrop_and_other_rays_the_environment() {
    check(BACKDROP);
}

const BACKDROP: &[Row] = &[
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
];

#[test]
#[ignore = "second tier: ./run test --more"]
fn resampled_paths_see_the_same_objects() {
    check_with(Technique::Pt, &[HIDDEN, WITHOUT_SHADOWS, STAND_INS, BACKDROP]);
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

#[test]
fn a_light_that_no_camera_sees_restarts_no_history() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    sun(&mut rig);
    floor(&mut rig, 0.5);
    rig.set(|restir| restir.technique = Technique::Di);
    rig.until_ready();
    rig.frames(3);
    let before = rig.report().history_resets;
    rig.spawn_bundle((DirectionalLight::default(), RenderLayers::layer(5)));
    rig.frames(3);
    rig.until_ready();
    rig.frames(3);
    assert_eq!(rig.report().history_resets, before);
}

fn spawn_second_camera(rig: &mut Rig, layers: RenderLayers) {
    let image = rig.add::<Image>(target_image(UVec2::new(4, 4)));
    let target = RenderTarget::Image(ImageRenderTarget::from(image));
    rig.spawn_bundle((Camera3d::default(), Camera { order: 1, ..default() }, target, layers, plain()));
}

#[test]
fn an_object_of_another_camera_that_comes_back_restarts_no_history() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    sun(&mut rig);
    floor(&mut rig, 0.5);
    rig.set(|restir| restir.technique = Technique::Di);
    spawn_second_camera(&mut rig, RenderLayers::from_layers(&[0, 1]));
    let aside = Transform::from_xyz(50.0, 0.0, 0.0);
    let appear = |rig: &mut Rig| {
        let object = rig.spawn(Cuboid::from_length(1.0), lambert(0.5), aside);
        rig.insert(object, RenderLayers::layer(1));
        rig.until_ready();
        rig.frames(3);
        rig.app.world_mut().despawn(object);
        rig.frames(3);
        rig.report().history_resets
    };
    let first = appear(&mut rig);
    assert_eq!(appear(&mut rig), first);
}

/// It keeps its place in the table of lights, whose records are replaced.
#[test]
fn a_light_that_becomes_brighter_stays_hidden_from_other_cameras() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, orthographic(0.1, 0.1));
    rig.set(|restir| restir.accumulate = true);
    sun(&mut rig);
    floor(&mut rig, 0.5);
    spawn_second_camera(&mut rig, RenderLayers::layer(1));
    let other = rig.spawn_bundle((DirectionalLight::default(), Transform::default(), RenderLayers::layer(1)));
    for illuminance in [1.0, 10.0, 20.0] {
        rig.get_mut::<DirectionalLight>(other).illuminance = illuminance;
        // Whether a sample chooses the visible sun is random.
        let mean = rig.picture(32).mean();
        assert!((mean - 1.0).abs() < 0.15, "{mean} beside a sun of {illuminance} lux for another camera");
    }
    rig.assert_sound();
}

/// Rays test the layers of instances only where an object is hidden from their camera.
#[test]
fn rays_see_stand_ins_beside_objects_of_another_camera() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.insert(rig.camera, orthographic(0.1, 0.1));
    slanting_sun(&mut rig);
    floor(&mut rig, 0.5);
    spawn_second_camera(&mut rig, RenderLayers::layer(1));
    let hidden = rig.spawn(square(0.5), lambert(0.5), at(50.0, 0.0, 0.0));
    rig.insert(hidden, RenderLayers::layer(1));
    let square = rig.spawn(square(0.5), open(lambert(0.0)), blind());
    stand_in(&mut rig, square);
    assert!(rig.picture(2).mean() < 1e-4, "its shadow");
    assert!(rig.report().features.contains(SceneFeatures::RENDER_LAYERS));
    rig.assert_sound();
}
