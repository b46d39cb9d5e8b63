//! The table of lights follows one emitter that changes without visiting or sending the triangles of the others.

use crate::support::app::*;
use bevy::prelude::*;
use bevy_restir::RestirReport;

/// A wall, two balls of 8,820 triangles that emit, and a candle.
struct Balls {
    rig: Rig,
    balls: [Entity; 2],
    candle: Entity,
}

/// Triangles of a ball.
const BALL: u64 = 8820;

impl Balls {
    fn new() -> Option<Self> {
        let mut rig = Rig::new(16, 16)?;
        rig.spawn(square(6.0), lambert(0.8), Transform::from_xyz(0.0, 0.0, -1.0));
        let mut ball = |x: f32| {
            let mesh = Sphere::new(0.5).mesh().ico(20).expect("few enough triangles");
            rig.spawn(mesh, lamp(1.0, 1.0, 1.0), Transform::from_xyz(x, 0.0, 0.5))
        };
        let balls = [ball(-2.0), ball(2.0)];
        let light = PointLight { intensity: 200.0, ..default() };
        let candle = rig.spawn_bundle((light, Transform::from_xyz(0.0, 1.0, 1.0)));
        assert_eq!(rig.until_ready().lights, 2 * BALL + 1);
        // The first change sends the whole table, of which the GPU then has that of the last frame, too.
        rig.get_mut::<PointLight>(candle).intensity = 95.0;
        rig.frames(3);
        Some(Self { rig, balls, candle })
    }

    /// Makes changes in consecutive frames, and asserts what each sends and visits.
    fn assert_small(&mut self, name: &str, bytes: u64, triangles: u64, change: fn(&mut Self, f32)) {
        for i in 1..=5u8 {
            change(self, f32::from(i));
            self.rig.frame();
            let report = self.rig.report();
            let sent = report.uploaded_bytes;
            eprintln!("{name}: {sent} bytes, {} triangles", visited(&report));
            assert!((1..=bytes).contains(&sent), "{name}: {sent} bytes");
            assert_eq!(visited(&report), triangles, "{name}: triangles");
        }
        self.rig.frames(2);
        assert_eq!(self.rig.report().uploaded_bytes, 0, "{name}: nothing is left to send");
    }
}

/// Emissive triangles whose areas the last frame computed.
fn visited(report: &RestirReport) -> u64 {
    report.visited.iter().find(|(name, _)| *name == "emissive_triangles").map_or(0, |(_, count)| *count)
}

#[test]
fn a_change_of_one_emitter_sends_no_triangles_of_the_others() {
    let Some(mut scene) = Balls::new() else { return };
    // The three bins of both frames, and uniforms.
    scene.assert_small("a candle flickers", 1024, 0, |s, i| s.rig.get_mut::<PointLight>(s.candle).intensity = 90.0 + i);
    // Also its record, its box in the tree over instances, and the sphere around the scene.
    scene.assert_small("a ball grows", 4096, 0, |s, i| {
        s.rig.get_mut::<Transform>(s.balls[0]).scale = Vec3::splat(1.0 + 0.1 * i);
    });
    // Its triangles have another slot in this frame, and that of the last frame in the other table.
    scene.assert_small("a ball flickers", 2 * 64 * BALL + 8192, 0, |s, i| {
        let glow = s.rig.material_of(s.balls[1]);
        s.rig.edit(&glow, |m| m.emissive = LinearRgba::rgb(1.0 + i, 1.0, 1.0));
    });
    scene.assert_small("a ball is stretched", 2 * 64 * BALL + 8192, BALL, |s, i| {
        s.rig.get_mut::<Transform>(s.balls[0]).scale.y = 1.5 + 0.1 * i;
    });
    // The picture is that of a scene that has never changed.
    let mut fresh = Balls::new().expect("there is an adapter");
    fresh.rig.get_mut::<Transform>(fresh.balls[0]).scale = Vec3::new(1.5, 2.0, 1.5);
    let glow = fresh.rig.material_of(fresh.balls[1]);
    fresh.rig.edit(&glow, |m| m.emissive = LinearRgba::rgb(6.0, 1.0, 1.0));
    assert_eq!(scene.rig.picture(4), fresh.rig.picture(4));
    // A light that comes or goes changes the ids of the others, whose tables hold.
    for scene in [&mut scene, &mut fresh] {
        scene.rig.get_mut::<PointLight>(scene.candle).intensity = 0.0;
        scene.rig.frame();
        assert_eq!((visited(&scene.rig.report()), scene.rig.report().lights), (0, 2 * BALL));
    }
    assert_eq!(scene.rig.picture(4), fresh.rig.picture(4));
}

/// Prints the time of the stages that look at lights.  Only the first change makes the whole table again.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_candle_flickers_beside_a_million_emissive_triangles() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(6.0), lambert(0.8), Transform::from_xyz(0.0, 0.0, -1.0));
    // 10 balls of 100,820 triangles.
    let mesh = rig.add::<Mesh>(Sphere::new(0.1).mesh().ico(70).expect("few enough triangles"));
    let glow = rig.add::<StandardMaterial>(lamp(1.0, 1.0, 1.0));
    for i in 0..10u8 {
        let place = Transform::from_xyz(0.3 * f32::from(i) - 1.4, 0.0, 0.5);
        rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(glow.clone()), place));
    }
    let candle = rig.spawn_bundle((PointLight::default(), Transform::from_xyz(0.0, 1.0, 1.0)));
    let lights = rig.until_ready().lights;
    assert!(lights > 1_000_000, "{lights}");
    let mut times = Vec::new();
    for i in 0..16u8 {
        rig.get_mut::<PointLight>(candle).intensity = 90.0 + f32::from(i);
        rig.frame();
        let report = rig.report();
        let of = |stage| report.cpu_ms.iter().find(|(name, _)| *name == stage).map_or(0.0, |(_, ms)| *ms);
        times.push(of("lights") + of("upload"));
        if i > 2 {
            assert!(report.uploaded_bytes <= 4096 && visited(&report) == 0, "{} bytes", report.uploaded_bytes);
        }
    }
    let whole = times.drain(..3).fold(0.0, f32::max);
    times.sort_by(f32::total_cmp);
    let median = times[times.len() / 2];
    println!("{lights} lights, of which one flickers: {median:.3} ms of the CPU; the whole table: {whole:.3} ms");
    assert!(median < 0.1 * whole, "{median} ms, and {whole} ms for the whole table");
}
