//! An app switches cameras, effects, environment images and devices while it runs, and adds plugins in either order.  No frame is black,
//! and nothing is allocated anew without need.

use crate::support::app::*;
use bevy::{
    app::MainScheduleOrder,
    camera::Hdr,
    core_pipeline::prepass::{DepthPrepass, MotionVectorPrepass},
    ecs::schedule::ScheduleLabel,
    light::Skybox,
    prelude::*,
    render::{
        Render, RenderApp, RenderSystems,
        gpu_readback::{Readback, ReadbackComplete},
        settings::WgpuLimits,
        view::ViewDepthTexture,
    },
};
use bevy_restir::{
    RadianceCapture, RayBackend, Restir, RestirEnvironment, RestirStatus, Technique,
    testing::storage::allocation::plant_failed_allocations,
};
use std::time::{Duration, Instant};

/// How often histories restarted for a reason.
fn resets(rig: &Rig, reason: &str) -> u64 {
    rig.report().history_resets.iter().find(|(name, _)| *name == reason).map_or(0, |(_, count)| *count)
}

/// Asserts that we render the next frames.
fn assert_ours(rig: &mut Rig, frames: u32, what: &str) {
    for frame in 0..frames {
        assert!(rig.next_if_any().is_some(), "{what}: frame {frame} is not ours");
    }
}

#[test]
fn another_environment_image_needs_no_memory_for_the_view() {
    let Some(mut rig) = Rig::new(20, 16) else { return };
    rig.spawn(square(1.0), lambert(0.5), Transform::default());
    let map = |value| texture(4, 2, |_, _| [value, value, value, 255]);
    let [dark, bright] = [60, 255].map(|value| rig.add(map(value)));
    let lit_by = |image| RestirEnvironment { image: Some(image), ..sky(0.3) };
    rig.insert(rig.camera, lit_by(dark));
    rig.set(|restir| restir.technique = Technique::Di);
    let before = rig.picture(2);
    plant_failed_allocations(&rig.app, &["view", "history"]);
    rig.insert(rig.camera, lit_by(bright));
    rig.frames(3);
    assert_ours(&mut rig, 3, "a brighter sky");
    let after = rig.next();
    assert!(before.at(0, 0).x < 0.05 && (after.at(0, 0).x - 0.3).abs() < 1e-3, "the new sky: {}", after.at(0, 0));
    assert!(after.center().x > 5.0 * before.center().x, "its light: {} and {}", before.center(), after.center());
    plant_failed_allocations(&rig.app, &[]);
    rig.assert_sound();
}

/// Samples of the last frame have the light of the old pixels, which the history leaves out: either half of the sky lights the square, which
/// faces both, alike.
#[test]
fn a_sky_with_other_pixels_has_its_light_at_once_and_restarts_no_history() {
    for technique in [Technique::Di, Technique::Pt] {
        let Some(mut rig) = Rig::new(24, 16) else { return };
        rig.spawn(square(1.0), lambert(0.5), Transform::default());
        let image = rig.add::<Image>(half_white(true));
        rig.insert(rig.camera, RestirEnvironment { image: Some(image.clone()), ..sky(0.3) });
        rig.set(|restir| *restir = Restir { technique, ..plain() });
        rig.picture(20);
        let restarts = rig.report().history_resets;
        let is_inner = |at: UVec2| (10..14).contains(&at.x) && (6..10).contains(&at.y);
        let sides = [UVec2::new(4, 1), UVec2::new(20, 1)];
        let [before, at_once] = light_when_halves_change(&mut rig, &image, sides, is_inner);
        assert!((at_once / before - 1.0).abs() < 0.08, "{technique:?}: {before} before, and then {at_once}");
        assert_eq!(rig.report().history_resets, restarts, "{technique:?}");
        rig.assert_sound();
    }
}

/// A sky that comes is a light that was dark, and one that goes is a light that is gone.
#[test]
fn skies_that_come_and_go_restart_no_history() {
    let Some(mut rig) = Rig::new(16, 12) else { return };
    rig.spawn(square(1.0), lambert(0.5), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    let image = rig.add::<Image>(texture(4, 2, |_, _| [90, 90, 90, 255]));
    rig.set(|restir| *restir = Restir { technique: Technique::Di, ..plain() });
    rig.picture(3);
    let restarts = rig.report().history_resets;
    let skies = [Some(sky(0.2)), Some(RestirEnvironment { image: Some(image), ..sky(0.3) }), None, Some(sky(0.1))];
    for (step, sky) in skies.into_iter().enumerate() {
        let mut camera = rig.app.world_mut().entity_mut(rig.camera);
        match sky {
            Some(sky) => camera.insert(sky),
            None => camera.remove::<RestirEnvironment>(),
        };
        rig.until_ready();
        rig.frames(3);
        assert_eq!(rig.report().history_resets, restarts, "step {step}");
    }
    rig.assert_sound();
}

/// The old pixels stay for one frame, because temporal reuse evaluates samples in the scene of the last frame: either half of the wall lights
/// the floor in front of it alike.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_wall_with_other_pixels_has_its_light_at_once_and_restarts_no_history() {
    for technique in [Technique::Di, Technique::Pt] {
        let Some(mut rig) = Rig::new(72, 48) else { return };
        let floor = Transform::from_xyz(0.0, -1.0, 0.0).looking_to(Vec3::NEG_Y, Vec3::Z);
        rig.spawn(square(4.0), lambert(0.5), floor);
        let image = rig.add::<Image>(half_white(true));
        let glow = StandardMaterial { emissive_texture: Some(image.clone()), ..lamp(4.0, 4.0, 4.0) };
        rig.spawn(square(2.0), glow, Transform::from_xyz(0.0, 0.0, -2.0));
        rig.set(|restir| *restir = Restir { technique, ..plain() });
        rig.picture(20);
        let restarts = rig.report().history_resets;
        let is_floor = |at: UVec2| (21..51).contains(&at.x) && (33..42).contains(&at.y);
        let sides = [UVec2::new(31, 23), UVec2::new(40, 23)];
        let [before, at_once] = light_when_halves_change(&mut rig, &image, sides, is_floor);
        assert!((at_once / before - 1.0).abs() < 0.15, "{technique:?}: {before} before, and then {at_once}");
        assert_eq!(rig.report().history_resets, restarts, "{technique:?}");
        rig.assert_sound();
    }
}

/// An image that is white on one side and black on the other.
fn half_white(is_left: bool) -> Image {
    texture(8, 2, |x, _| if (x < 4) == is_left { [255; 4] } else { [0, 0, 0, 255] })
}

/// Exchanges the halves of an image six times.  Returns the sums of the light of some pixels in the frames before, and in the first frames
/// with the new pixels.  `sides`: pixels in which the halves are seen.
fn light_when_halves_change(
    rig: &mut Rig,
    image: &Handle<Image>,
    sides: [UVec2; 2],
    is_counted: impl Fn(UVec2) -> bool,
) -> [f32; 2] {
    let light = |picture: &Picture| picture.iter().filter(|(at, _)| is_counted(*at)).map(|(_, c)| c.x).sum::<f32>();
    let is_left_bright = |picture: &Picture| {
        let [left, right] = sides.map(|at| picture.at(at.x, at.y).x);
        left > right
    };
    let [mut before, mut at_once] = [0.0; 2];
    for turn in 0..6 {
        let mut old = rig.next();
        rig.edit(image, |image| *image = half_white(turn % 2 == 1));
        let new = (0..4).find_map(|_| {
            let next = rig.next();
            if is_left_bright(&next) != is_left_bright(&old) {
                return Some(next);
            }
            old = next;
            None
        });
        before += light(&old);
        at_once += light(&new.expect("the image has other pixels"));
        rig.frames(8);
    }
    [before, at_once]
}

/// Changes a camera's environment, and asserts that the corner of each frame has one of two radiances: first the old one, then the new one.
fn assert_replaced(rig: &mut Rig, environment: impl Bundle, [old, new]: [f32; 2]) {
    let is = |got: f32, wanted: f32| (got - wanted).abs() < 1e-3 * wanted;
    rig.insert(rig.camera, environment);
    let mut seen = vec![];
    while !seen.last().is_some_and(|&got| is(got, new)) {
        assert!(seen.len() < 5000, "{new} does not appear");
        seen.push(rig.next().at(0, 0).x);
        let got = seen[seen.len() - 1];
        assert!(is(got, old) || is(got, new), "{got} between {old} and {new}, frame {}", seen.len());
    }
    assert!(seen.len() > 2, "pipelines are compiled in the background");
}

/// The pipelines of one kind of environment cannot render another kind.
#[test]
fn a_sky_stays_until_the_pipelines_of_the_next_one_are_compiled() {
    let Some(mut rig) = Rig::compiling_in_background(16, 16) else { return };
    rig.spawn(square(1.0), lambert(0.5), Transform::default());
    let image = rig.add(texture(4, 2, |_, _| [255; 4]));
    let cube = rig.add::<Image>(cube_texture(255));
    rig.insert(rig.camera, RestirEnvironment { image: Some(image), ..sky(0.3) });
    rig.set(|restir| restir.technique = Technique::Reference);
    rig.until_ready();
    assert_replaced(&mut rig, sky(0.5), [0.3, 0.5]);
    rig.app.world_mut().entity_mut(rig.camera).remove::<RestirEnvironment>();
    let skybox = Skybox { image: Some(cube), brightness: 0.7, ..default() };
    assert_replaced(&mut rig, skybox, [0.5, 0.7]);
    rig.assert_sound();
}

#[test]
fn effects_that_change_the_target_leave_no_frame_out() {
    let Some(mut rig) = Rig::compiling_in_background(16, 12) else { return };
    rig.spawn(square(4.0), lamp(1.0, 1.0, 1.0), Transform::default());
    rig.until_ready();
    // The pipeline for a target with motion vectors is compiled in the background.
    for _ in 0..300 {
        if rig.report().pipelines.iter().filter(|pipeline| pipeline.name == "composite").count() >= 2 {
            break;
        }
        rig.frame();
    }
    let camera = rig.camera;
    rig.insert(camera, (DepthPrepass, MotionVectorPrepass));
    assert_ours(&mut rig, 4, "with a prepass");
    // `Restir` inserts it again.
    rig.app.world_mut().entity_mut(camera).remove::<Hdr>();
    assert_ours(&mut rig, 4, "with a prepass, after HDR was removed");
    assert!(rig.app.world().get::<Hdr>(camera).is_some());
    rig.app.world_mut().entity_mut(camera).remove::<(DepthPrepass, MotionVectorPrepass)>();
    assert_ours(&mut rig, 4, "without a prepass");
    rig.assert_sound();
}

#[test]
fn a_camera_that_is_switched_on_renders_from_its_first_frame_on() {
    let Some(mut rig) = Rig::compiling_in_background(16, 12) else { return };
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 500.0, ..default() }, Transform::from_xyz(0.0, 0.0, 2.0)));
    rig.until_ready();
    let camera = rig.camera;
    rig.get_mut::<Camera>(camera).is_active = false;
    rig.frames(2);
    // Meanwhile the scene needs pipelines that no camera requests, and the settings request others.
    let glass = StandardMaterial { specular_transmission: 1.0, ..lambert(1.0) };
    rig.spawn(Cuboid::from_length(0.5), glass, Transform::from_xyz(0.0, 0.0, 1.0));
    rig.set(|restir| restir.technique = Technique::Di);
    rig.frames(3);
    assert!(rig.next_if_any().is_none(), "the camera is off");
    rig.get_mut::<Camera>(camera).is_active = true;
    assert_ours(&mut rig, 6, "the camera is on again");
    rig.assert_sound();
}

/// The corner of the picture in each frame.
#[derive(Resource, Default)]
struct Corners(Vec<[u8; 4]>);

impl Corners {
    /// Whether each corner shows a sky instead of the clear color, which is nearly black.
    fn are_lit(&self) -> impl Iterator<Item = bool> {
        self.0.iter().map(|corner| corner[0] > 20)
    }
}

#[test]
fn no_frame_lacks_a_sky_when_our_picture_takes_the_place_of_bevys() {
    let Some(mut rig) = Rig::compiling_in_background(16, 12) else { return };
    rig.spawn(square(1.0), lambert(0.5), Transform::default());
    let (camera, target) = (rig.camera, rig.target.clone());
    let image = rig.add::<Image>(cube_texture(200));
    // Bevy's picture has one sky, and ours has another.
    let skybox = Skybox { image: Some(image), brightness: 1.0, ..default() };
    rig.insert(camera, (Msaa::Off, skybox, sky(0.1)));
    let settings = rig.app.world_mut().entity_mut(camera).take::<Restir>().expect("it has some");
    rig.app.init_resource::<Corners>();
    rig.app.world_mut().spawn(Readback::texture(target)).observe(
        |picture: On<ReadbackComplete>, mut corners: ResMut<Corners>| {
            corners.0.extend(picture.data.first_chunk::<4>());
        },
    );
    let start = Instant::now();
    while !rig.app.world().resource::<Corners>().are_lit().any(|is_lit| is_lit) {
        assert!(start.elapsed() < Duration::from_secs(300), "Bevy's sky does not appear");
        rig.frame();
    }
    rig.insert(camera, settings);
    rig.until_ready();
    rig.frames(6);
    let corners = rig.app.world().resource::<Corners>();
    let first = corners.are_lit().position(|is_lit| is_lit).expect("there is one");
    let unlit = corners.are_lit().skip(first).filter(|is_lit| !is_lit).count();
    assert_eq!(unlit, 0, "frames without a sky: {:?}", &corners.0[first..]);
    assert_ne!(corners.0.last(), corners.0.get(first), "our sky is not shown");
    rig.assert_sound();
}

/// A schedule of the app that runs after all others.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
struct AfterLast;

/// Whether the app turns multisampling on in this frame.
#[derive(Resource, Default)]
struct Multisamples(bool);

#[test]
fn multisampling_that_is_turned_on_at_the_end_of_a_frame_costs_one_frame() {
    let add_schedule = |app: &mut App| {
        app.init_schedule(AfterLast).init_resource::<Multisamples>();
        app.world_mut().resource_mut::<MainScheduleOrder>().insert_after(Last, AfterLast);
        app.add_systems(AfterLast, |mut wanted: ResMut<Multisamples>, mut cameras: Query<&mut Msaa, With<Restir>>| {
            if core::mem::take(&mut wanted.0) {
                cameras.iter_mut().for_each(|mut msaa| *msaa = Msaa::Sample4);
            }
        });
    };
    let Some(mut rig) = Rig::beside(add_schedule, 16, 12) else { return };
    rig.spawn(square(4.0), lamp(1.0, 1.0, 1.0), Transform::default());
    rig.until_ready();
    rig.app.insert_resource(Multisamples(true));
    rig.frames(2);
    assert_ours(&mut rig, 2, "with one sample again");
    rig.assert_sound();
}

#[test]
fn the_plugin_may_be_added_before_bevys_plugins() {
    let look = |rig: &mut Rig| {
        rig.spawn(square(4.0), lamp(1.0, 0.5, 0.25), Transform::default());
        let picture = rig.picture(2);
        (picture, rig.report().backend, rig.app.world().resource::<RestirStatus>().clone())
    };
    let Some(mut usual) = Rig::starting(Start { backend: RayBackend::Hardware, ..default() }, 16, 12) else { return };
    let start = Start { backend: RayBackend::Hardware, before_bevy: true, ..default() };
    let mut before = Rig::starting(start, 16, 12).expect("there is an adapter");
    assert_eq!(look(&mut before), look(&mut usual));
    // A device that is too small is turned away in either order.
    let limits = WgpuLimits { max_storage_buffer_binding_size: (1 << 20) - 4096, ..default() };
    let start = Start { limits: Some(limits), backend: RayBackend::Software, before_bevy: true, ..default() };
    let rig = Rig::starting(start, 16, 12).expect("there is an adapter");
    let status = rig.app.world().resource::<RestirStatus>();
    assert!(matches!(status, RestirStatus::Off(reason) if reason.contains("1 MiB")), "{status:?}");
}

#[test]
fn a_view_that_finds_no_memory_keeps_its_counts() {
    let Some(mut rig) = Rig::new(16, 12) else { return };
    rig.spawn(square(4.0), lamp(1.0, 1.0, 1.0), Transform::default());
    rig.set(|restir| restir.technique = Technique::Di);
    rig.picture(2);
    let before = resets(&rig, "requested");
    assert!(before > 0);
    plant_failed_allocations(&rig.app, &["view"]);
    let target = rig.target.clone();
    rig.edit(&target, |image| *image = target_image(UVec2::new(20, 12)));
    rig.frames(3);
    assert!(rig.next_if_any().is_none(), "there is no memory");
    assert_eq!(resets(&rig, "requested"), before, "while there is none");
    plant_failed_allocations(&rig.app, &[]);
    rig.until_ready();
    assert_eq!(resets(&rig, "requested"), before, "afterwards");
    rig.assert_sound();
}

#[test]
fn a_reset_of_a_camera_that_is_off_waits_until_it_is_on() {
    let Some(mut rig) = Rig::new(16, 12) else { return };
    rig.spawn(square(4.0), lamp(1.0, 1.0, 1.0), Transform::default());
    rig.set(|restir| restir.technique = Technique::Di);
    rig.picture(2);
    let before = resets(&rig, "requested");
    let camera = rig.camera;
    rig.get_mut::<Camera>(camera).is_active = false;
    rig.frames(2);
    rig.set(|restir| restir.reset = true);
    rig.frames(2);
    assert_eq!(resets(&rig, "requested"), before, "the camera is off");
    assert_eq!(rig.report().samples, 0, "no camera is rendered");
    rig.get_mut::<Camera>(camera).is_active = true;
    rig.frames(4);
    assert_eq!(resets(&rig, "requested"), before + 1, "the camera is on again");
    rig.assert_sound();
}

/// Whether another renderer takes the depth textures of all cameras away, so that nothing can be drawn.
#[derive(Resource, Default)]
struct TakesDepth(bool);

#[test]
fn a_frame_whose_passes_did_not_run_is_no_history() {
    let take_depth = |app: &mut App| {
        let render_app = app.sub_app_mut(RenderApp).init_resource::<TakesDepth>();
        render_app.add_systems(
            Render,
            (|takes: Res<TakesDepth>, views: Query<Entity, With<ViewDepthTexture>>, mut commands: Commands| {
                let views = views.iter().filter(|_| takes.0);
                views.for_each(|view| _ = commands.entity(view).remove::<ViewDepthTexture>());
            })
            .in_set(RenderSystems::PrepareBindGroups),
        );
    };
    let Some(mut rig) = Rig::beside(take_depth, 16, 12) else { return };
    rig.spawn(square(4.0), lamp(1.0, 1.0, 1.0), Transform::default());
    rig.set(|restir| restir.technique = Technique::Di);
    rig.picture(2);
    let before = resets(&rig, "start");
    rig.app.sub_app_mut(RenderApp).insert_resource(TakesDepth(true));
    rig.capture.request();
    rig.frame();
    assert_eq!(rig.capture.take(), None);
    rig.app.sub_app_mut(RenderApp).insert_resource(TakesDepth(false));
    rig.frame();
    assert!(rig.capture.take().is_some(), "the request waits for a frame");
    rig.frames(2);
    assert_eq!(resets(&rig, "start"), before + 1);
    rig.assert_sound();
}

/// A capture that is requested while a frame is rendered.
#[derive(Resource)]
struct LateRequest(RadianceCapture);

/// With pipelined rendering, the app runs while the render world works on the frame before.
#[test]
fn a_capture_does_not_get_a_frame_that_began_before_its_request() {
    let request = |late: Option<Res<LateRequest>>, mut commands: Commands| {
        if let Some(late) = late {
            late.0.request();
            commands.remove_resource::<LateRequest>();
        }
    };
    let add =
        |app: &mut App| _ = app.sub_app_mut(RenderApp).add_systems(Render, request.in_set(RenderSystems::Prepare));
    let Some(mut rig) = Rig::beside(add, 16, 12) else { return };
    rig.spawn(square(4.0), lamp(1.0, 1.0, 1.0), Transform::default());
    rig.until_ready();
    let capture = rig.capture.clone();
    rig.app.sub_app_mut(RenderApp).insert_resource(LateRequest(capture));
    rig.frame();
    assert_eq!(rig.capture.take(), None);
    rig.frame();
    assert!(rig.capture.take().is_some());
}
