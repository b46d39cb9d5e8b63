//! The table of lights follows one emitter that changes, appears or disappears without visiting or sending the triangles of the others.

use crate::support::app::*;
use bevy::prelude::*;
use bevy_restir::{RestirReport, testing::check_mirror};

/// A wall, two balls of 8,820 triangles that emit, a candle, and a guest that comes and goes.
struct Balls {
    rig: Rig,
    balls: [Entity; 2],
    candle: Entity,
    /// A square that emits, and whose mesh is loaded all the time.
    square: (Mesh3d, MeshMaterial3d<StandardMaterial>),
    guest: Option<Entity>,
}

/// Triangles of a ball.
const BALL: u64 = 8820;

impl Balls {
    fn new() -> Option<Self> {
        let mut rig = Rig::new(16, 16)?;
        let wall = rig.spawn(square(6.0), lambert(0.8), Transform::from_xyz(0.0, 0.0, -1.0));
        let mesh = rig.app.world().get::<Mesh3d>(wall).expect("it has a mesh").clone();
        let square = (mesh, MeshMaterial3d(rig.add::<StandardMaterial>(lamp(1.0, 1.0, 1.0))));
        let mut ball = |x: f32| {
            let mesh = Sphere::new(0.5).mesh().ico(20).expect("few enough triangles");
            rig.spawn(mesh, lamp(1.0, 1.0, 1.0), Transform::from_xyz(x, 0.0, 0.5))
        };
        let balls = [ball(-2.0), ball(2.0)];
        let light = PointLight { intensity: 200.0, ..default() };
        let candle = rig.spawn_bundle((light, Transform::from_xyz(0.0, 1.0, 1.0)));
        assert_eq!(rig.until_ready().lights, 2 * BALL + 1);
        // The first change sends bins to another place.
        rig.get_mut::<PointLight>(candle).intensity = 95.0;
        rig.frames(3);
        Some(Self { rig, balls, candle, square, guest: None })
    }

    /// Makes changes in consecutive frames, and asserts what each sends and visits.  `triangles`: those that the odd and the even changes visit.
    fn assert_small(&mut self, name: &str, bytes: u64, triangles: [u64; 2], change: fn(&mut Self, f32)) {
        for i in 1..=6u8 {
            change(self, f32::from(i));
            self.rig.frame();
            let report = self.rig.report();
            let sent = report.uploaded_bytes;
            eprintln!("{name}: {sent} bytes, {} triangles", visited(&report));
            assert!((1..=bytes).contains(&sent), "{name}: {sent} bytes");
            assert_eq!(visited(&report), triangles[usize::from(i + 1) % 2], "{name}: triangles");
        }
        self.rig.frames(2);
        assert_eq!(self.rig.report().uploaded_bytes, 0, "{name}: nothing is left to send");
    }

    fn come_or_go(&mut self, guest: impl Bundle) {
        come_or_go(&mut self.rig, &mut self.guest, guest);
    }
}

/// Spawns a guest, or despawns the one that is there.
fn come_or_go(rig: &mut Rig, there: &mut Option<Entity>, guest: impl Bundle) {
    match there.take() {
        Some(entity) => _ = rig.app.world_mut().despawn(entity),
        None => *there = Some(rig.spawn_bundle(guest)),
    }
}

/// Emissive triangles whose areas the last frame computed.
fn visited(report: &RestirReport) -> u64 {
    visited_of(report, "emissive_triangles")
}

/// Elements of a kind that the last frame looked at.
fn visited_of(report: &RestirReport, kind: &str) -> u64 {
    report.visited.iter().find(|(name, _)| *name == kind).map_or(0, |(_, count)| *count)
}

/// 0 and another value in turn.
fn on_and_off(i: f32, value: f32) -> f32 {
    if i % 2.0 == 1.0 { 0.0 } else { value }
}

#[test]
fn a_change_of_one_emitter_sends_no_triangles_of_the_others() {
    let Some(mut scene) = Balls::new() else { return };
    // The three bins of both frames, and uniforms.
    scene.assert_small("a candle flickers", 1024, [0; 2], |s, i| {
        s.rig.get_mut::<PointLight>(s.candle).intensity = 89.0 + i;
    });
    // Also its record, its box in the tree over instances, and the sphere around the scene.
    scene.assert_small("a ball grows", 4096, [0; 2], |s, i| {
        s.rig.get_mut::<Transform>(s.balls[0]).scale = Vec3::splat(1.0 + 0.1 * i);
    });
    // Its triangles have another slot in this frame, so that they have other records.
    scene.assert_small("a ball flickers", 64 * BALL + 8192, [0; 2], |s, i| {
        let glow = s.rig.material_of(s.balls[1]);
        s.rig.edit(&glow, |m| m.emissive = LinearRgba::rgb(1.0 + i, 1.0, 1.0));
    });
    scene.assert_small("a ball is stretched", 64 * BALL + 8192, [BALL; 2], |s, i| {
        s.rig.get_mut::<Transform>(s.balls[0]).scale.y = 1.6 + 0.1 * i;
    });
    // The picture is that of a scene that has never changed.
    let mut fresh = Balls::new().expect("there is an adapter");
    fresh.rig.get_mut::<Transform>(fresh.balls[0]).scale = Vec3::new(1.6, 2.2, 1.6);
    let glow = fresh.rig.material_of(fresh.balls[1]);
    fresh.rig.edit(&glow, |m| m.emissive = LinearRgba::rgb(7.0, 1.0, 1.0));
    assert_eq!(scene.rig.picture(4), fresh.rig.picture(4));
    // A light that goes changes the bins of the others, whose tables hold.
    for scene in [&mut scene, &mut fresh] {
        scene.rig.get_mut::<PointLight>(scene.candle).intensity = 0.0;
        scene.rig.frame();
        assert_eq!((visited(&scene.rig.report()), scene.rig.report().lights), (0, 2 * BALL));
    }
    assert_eq!(scene.rig.picture(4), fresh.rig.picture(4));
}

/// A motion without another size leaves the table as it is, so that the frame need not look at the other emitters.
#[test]
fn only_a_ball_that_changes_its_size_makes_a_frame_look_at_the_others() {
    type Edit = fn(&mut Transform, f32);
    let edits: [(&str, u64, Edit); 4] = [
        ("it moves", 1, |place, i| place.translation.x = 0.01 * i - 2.0),
        ("it turns on the spot", 1, |place, i| place.rotation = Quat::from_rotation_y(0.3 * i)),
        ("it grows", 3, |place, i| place.scale = Vec3::splat(1.0 + 0.1 * i)),
        ("it moves again", 1, |place, i| place.translation.x = -2.0 - 0.01 * i),
    ];
    let Some(mut scene) = Balls::new() else { return };
    for (name, emitters, edit) in edits {
        for i in 1..=4u8 {
            edit(&mut scene.rig.get_mut::<Transform>(scene.balls[0]), f32::from(i));
            scene.rig.frame();
            let report = scene.rig.report();
            assert_eq!((visited_of(&report, "emitters"), visited(&report)), (emitters, 0), "{name}");
        }
        scene.rig.frame();
        assert_eq!(visited_of(&scene.rig.report(), "emitters"), 0, "{name}: it rests");
    }
    let mut fresh = Balls::new().expect("there is an adapter");
    let last = *scene.rig.get_mut::<Transform>(scene.balls[0]);
    *fresh.rig.get_mut::<Transform>(fresh.balls[0]) = last;
    assert_eq!(scene.rig.picture(4), fresh.rig.picture(4));
}

#[test]
fn emitters_that_come_and_go_send_no_triangles_of_the_others() {
    let Some(mut scene) = Balls::new() else { return };
    scene.assert_small("a candle dims to black and lights up", 1024, [0; 2], |s, i| {
        s.rig.get_mut::<PointLight>(s.candle).intensity = on_and_off(i, 95.0);
    });
    scene.assert_small("a lamp appears and disappears", 1024, [0; 2], |s, _| {
        s.come_or_go((PointLight { intensity: 50.0, ..default() }, Transform::from_xyz(1.0, 1.0, 1.0)));
    });
    scene.assert_small("a sphere appears and disappears", 2048, [0; 2], |s, _| {
        let light = PointLight { intensity: 50.0, radius: 0.1, ..default() };
        s.come_or_go((light, Transform::from_xyz(1.0, 1.0, 1.0)));
    });
    // The tree over instances is built again.
    scene.assert_small("an emissive square appears and disappears", 8192, [2, 0], |s, _| {
        s.come_or_go((s.square.clone(), Transform::from_xyz(0.0, -1.0, 0.5)));
    });
    scene.come_or_go((scene.square.clone(), Transform::from_xyz(0.0, -1.0, 0.5)));
    scene.rig.frames(3);
    scene.assert_small("an emissive square dims to black and lights up", 8192, [0, 2], |s, i| {
        let glow = s.square.1.0.clone();
        let value = on_and_off(i, 1.0);
        s.rig.edit(&glow, |m| m.emissive = LinearRgba::rgb(value, value, value));
    });
    scene.come_or_go(());
    // A ball that goes sends nothing of the other one, and comes back with its own triangles.
    scene.assert_small("a ball is hidden and shown", 64 * BALL + 8192, [0, BALL], |s, i| {
        *s.rig.get_mut::<Visibility>(s.balls[0]) =
            if i % 2.0 == 1.0 { Visibility::Hidden } else { Visibility::Inherited };
    });
    // The picture is that of a scene that has never changed.
    let mut fresh = Balls::new().expect("there is an adapter");
    assert_eq!(scene.rig.picture(4), fresh.rig.picture(4));
}

/// A million emissive triangles, a candle beside them, and a guest.
struct Million {
    rig: Rig,
    candle: Entity,
    square: (Mesh3d, MeshMaterial3d<StandardMaterial>),
    guest: Option<Entity>,
}

impl Million {
    fn new() -> Option<Self> {
        let mut rig = Rig::new(16, 16)?;
        // The comparison with a mirror from scratch visits all triangles, which takes longer than the stages that are measured.
        check_mirror(&mut rig.app, false);
        let wall = rig.spawn(square(6.0), lambert(0.8), Transform::from_xyz(0.0, 0.0, -1.0));
        let wall_mesh = rig.app.world().get::<Mesh3d>(wall).expect("it has a mesh").clone();
        // 10 balls of 100,820 triangles.
        let mesh = rig.add::<Mesh>(Sphere::new(0.1).mesh().ico(70).expect("few enough triangles"));
        let glow = rig.add::<StandardMaterial>(lamp(1.0, 1.0, 1.0));
        for i in 0..10u8 {
            let place = Transform::from_xyz(0.3 * f32::from(i) - 1.4, 0.0, 0.5);
            rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(glow.clone()), place));
        }
        let square = (wall_mesh, MeshMaterial3d(rig.add::<StandardMaterial>(lamp(1.0, 1.0, 1.0))));
        let candle = rig.spawn_bundle((PointLight::default(), Transform::from_xyz(0.0, 1.0, 1.0)));
        let lights = rig.until_ready().lights;
        assert!(lights > 1_000_000, "{lights}");
        Some(Self { rig, candle, square, guest: None })
    }

    /// Makes changes in consecutive frames.  Asserts that each sends little, and prints the time of the stages that look at lights.
    fn measure(&mut self, name: &str, mut change: impl FnMut(&mut Self, f32)) {
        let (mut times, mut most) = (Vec::new(), 0);
        for i in 0..16u8 {
            change(self, f32::from(i));
            self.rig.frame();
            let report = self.rig.report();
            let of = |stage| report.cpu_ms.iter().find(|(name, _)| *name == stage).map_or(0.0, |(_, ms)| *ms);
            times.push(of("lights") + of("upload"));
            if i > 2 {
                assert!(visited(&report) <= 2, "{name}: {} triangles", visited(&report));
                most = most.max(report.uploaded_bytes);
            }
        }
        times.drain(..3);
        times.sort_by(f32::total_cmp);
        println!("{name}: at most {most} bytes, {:.3} ms of the CPU", times[times.len() / 2]);
        assert!(most <= 16384, "{name}: {most} bytes");
    }
}

/// Prints the time of the stages that look at lights.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_candle_and_a_guest_beside_a_million_emissive_triangles() {
    let Some(mut scene) = Million::new() else { return };
    scene.measure("a candle flickers", |s, i| s.rig.get_mut::<PointLight>(s.candle).intensity = 90.0 + i);
    scene.measure("a candle dims to black and lights up", |s, i| {
        s.rig.get_mut::<PointLight>(s.candle).intensity = on_and_off(i, 90.0);
    });
    scene.measure("a lamp appears and disappears", |s, _| {
        come_or_go(&mut s.rig, &mut s.guest, (PointLight::default(), Transform::from_xyz(1.0, 1.0, 1.0)));
    });
    scene.measure("an emissive square appears and disappears", |s, _| {
        let square = (s.square.clone(), Transform::from_xyz(0.0, -1.0, 0.5));
        come_or_go(&mut s.rig, &mut s.guest, square);
    });
}
