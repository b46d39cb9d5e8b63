//! The CPU cost of ten thousand instances: printed, and compared with earlier measurements with room for slower machines.

use crate::support::app::*;
use bevy::{
    prelude::*,
    render::{render_resource::PollType, renderer::RenderDevice},
};
use bevy_restir::testing::check_mirror;
use std::time::Instant;

const COUNT: usize = 10_000;

/// Boxes that take turns in using this number of meshes.
fn crowd(meshes: usize, visible: bool) -> Option<(Rig, Vec<Entity>)> {
    let mut rig = Rig::new(16, 16)?;
    // The comparison costs more than the rest.
    check_mirror(&mut rig.app, false);
    rig.spawn_bundle((DirectionalLight::default(), Transform::default()));
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    let meshes: Vec<_> = (0..meshes).map(|i| rig.add::<Mesh>(Cuboid::from_length(0.2 + 0.001 * i as f32))).collect();
    let entities = (0..COUNT)
        .map(|i| {
            let place = Vec3::new((i % 100) as f32, (i / 100) as f32, 0.0) * 0.4 - Vec3::new(20.0, 20.0, 30.0);
            let entity = rig.spawn_bundle((
                Mesh3d(meshes[i % meshes.len()].clone()),
                MeshMaterial3d(material.clone()),
                Transform::from_translation(place),
            ));
            if !visible {
                rig.insert(entity, Visibility::Hidden);
            }
            entity
        })
        .collect();
    rig.until_ready();
    rig.frames(3);
    Some((rig, entities))
}

/// The median time in milliseconds until a frame is submitted, with an idle GPU.
fn frame_ms(rig: &mut Rig, mut change: impl FnMut(&mut Rig, usize)) -> f64 {
    let mut times: Vec<f64> = (0..15)
        .map(|i| {
            change(rig, i);
            let start = Instant::now();
            rig.app.update();
            let took = start.elapsed().as_secs_f64() * 1e3;
            let polled = rig.app.world().resource::<RenderDevice>().poll(PollType::wait_indefinitely());
            assert!(polled.is_ok());
            took
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

#[test]
#[ignore = "a measurement of ten seconds that needs an idle machine"]
fn full_length_ten_thousand_instances_cost_little() {
    let Some((mut hidden, _)) = crowd(1, false) else { return };
    let nothing = frame_ms(&mut hidden, |_, _| ());
    for meshes in [1, 100] {
        let (mut rig, entities) = crowd(meshes, true).expect("there is an adapter");
        assert_eq!(rig.report().instances, COUNT as u64);
        let still = frame_ms(&mut rig, |_, _| ());
        assert_eq!(rig.report().uploaded_bytes, 0);
        let moving = frame_ms(&mut rig, |rig, i| {
            for &entity in &entities {
                rig.get_mut::<Transform>(entity).translation.z = -30.0 + 0.01 * i as f32;
            }
        });
        let bytes = rig.report().uploaded_bytes;
        println!(
            "{COUNT} boxes of {meshes} meshes: {still:.2} ms a frame at rest, {moving:.2} ms and {bytes} bytes moving; hidden {nothing:.2} ms"
        );
        assert!(still < 60.0 && moving < 200.0, "{still} ms, {moving} ms");
    }
}
