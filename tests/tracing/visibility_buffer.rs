//! The rasterized visibility buffer equals the hits of primary rays, and culls by the material's `cull_mode`.

use crate::support::app::*;
use bevy::{
    mesh::PlaneMeshBuilder,
    prelude::*,
    render::{camera::TemporalJitter, render_resource::Face},
};
use bevy_restir::{DebugView, Jitter, Restir, Technique};

/// The share of pixels away from silhouettes that may hold another triangle than the ray's.  Rasterizers snap corners to 1/256 pixel, so
/// a pixel center that close to an edge may fall to the neighbor.  These meshes have about one pixel of edge per pixel.
const TRIANGLE_SHARE: f64 = 0.015;

/// A checkerboard of holes.
fn holes() -> Image {
    texture(4, 4, |x, y| [255, 255, 255, if (x + y) % 2 == 0 { 255 } else { 0 }])
}

/// Spheres, tori and planes with every kind of transform.  Nothing is culled, since the primary rays of the tracer are not.
fn crowd(rig: &mut Rig) {
    let open = |albedo| StandardMaterial { cull_mode: None, double_sided: true, ..lambert(albedo) };
    rig.spawn(Sphere::new(0.6).mesh().uv(18, 12), open(0.5), Transform::from_xyz(-1.0, 0.7, 0.0));
    // Mirrored, and sheared by a rotation under a non-uniform scale.
    let mirrored = Transform::from_xyz(1.0, 0.6, 0.3)
        .with_scale(Vec3::new(-1.3, 0.5, 0.8))
        .with_rotation(Quat::from_euler(EulerRot::XYZ, 0.4, 1.1, -0.7));
    rig.spawn(Torus::new(0.3, 0.8).mesh().minor_resolution(10).major_resolution(20), open(0.6), mirrored);
    let parent = rig.spawn_bundle((
        Transform::from_xyz(-0.8, -0.8, -0.5).with_scale(Vec3::new(0.4, 1.7, 0.9)),
        Visibility::default(),
    ));
    let child = rig.spawn(
        Cuboid::from_length(0.7),
        open(0.7),
        Transform::from_rotation(Quat::from_euler(EulerRot::XYZ, 0.5, 0.6, 0.7)),
    );
    rig.app.world_mut().entity_mut(parent).add_child(child);
    let image = rig.add::<Image>(holes());
    let masked = StandardMaterial { base_color_texture: Some(image), alpha_mode: AlphaMode::Mask(0.5), ..open(0.9) };
    let turned = Transform::from_xyz(0.6, -0.5, 1.2).with_rotation(Quat::from_rotation_y(0.5));
    rig.spawn(square(1.4), masked, turned);
    // A backdrop that lies partly behind the camera.
    rig.spawn(
        PlaneMeshBuilder::from_length(40.0).subdivisions(6),
        open(0.4),
        Transform::from_xyz(0.0, -1.5, 0.0).with_rotation(Quat::from_rotation_z(0.1)),
    );
}

/// At 65 km, floats are 8 mm apart.  Cubes with exact corners and a camera with an exact position are seen as exactly as at the origin.
#[test]
fn the_visibility_buffer_equals_the_hits_of_primary_rays_far_from_the_origin() {
    let different = |far: Vec3| {
        let mut rig = Rig::new(96, 96)?;
        for i in 0..27 {
            let at = Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) - 1.0;
            rig.spawn(Cuboid::from_length(0.5), lambert(0.5), Transform::from_translation(far + at));
        }
        *rig.get_mut::<Transform>(rig.camera) =
            Transform::from_translation(far + Vec3::new(1.5, 2.25, 4.0)).looking_at(far, Vec3::Y);
        let drawn = rig.debug(DebugView::Instances);
        let traced = rig.debug(DebugView::TracedInstances);
        Some(drawn.iter().filter(|(at, color)| *color != traced.at(at.x, at.y)).count())
    };
    let Some(near) = different(Vec3::ZERO) else { return };
    let far = different(Vec3::new(65536.0, -65536.0, 65536.0)).expect("the device is there");
    eprintln!("{near} pixels differ at the origin, {far} far from it");
    assert!(near < 40 && far < near + 20, "{near} pixels differ at the origin, {far} far from it");
}

#[test]
fn the_visibility_buffer_equals_the_hits_of_primary_rays() {
    for (width, height) in [(96, 64), (61, 47), (1, 1)] {
        let Some(mut rig) = Rig::new(width, height) else { return };
        crowd(&mut rig);
        for jitter in [Jitter::Never, Jitter::Always] {
            rig.set(|restir| restir.jitter = jitter);
            let drawn = rig.debug(DebugView::Instances);
            let traced = rig.debug(DebugView::TracedInstances);
            let (mut compared, mut seen) = (Vec::new(), Vec::new());
            for (at, color) in drawn.iter() {
                if drawn.is_flat_around(at) && traced.is_flat_around(at) {
                    assert_eq!(color, traced.at(at.x, at.y), "instance at {at}, {width} x {height}, jitter {jitter:?}");
                    compared.push(at);
                    if !seen.contains(&color) {
                        seen.push(color);
                    }
                }
            }
            if width > 1 {
                assert!(compared.len() * 2 > drawn.pixels.len(), "only {} pixels compared", compared.len());
                assert!(seen.len() >= 6, "five instances and the background, not {}", seen.len());
            }
            let drawn = rig.debug(DebugView::Triangles);
            let traced = rig.debug(DebugView::TracedTriangles);
            let other = compared.iter().filter(|at| drawn.at(at.x, at.y) != traced.at(at.x, at.y)).count();
            assert!(
                other as f64 <= TRIANGLE_SHARE * compared.len() as f64,
                "{other} of {} pixels hold another triangle, {width} x {height}, jitter {jitter:?}",
                compared.len()
            );
        }
        rig.assert_sound();
    }
}

/// Instances outside of the image are not drawn.
#[test]
fn instances_are_drawn_as_soon_as_they_are_in_the_image() {
    let Some(mut rig) = Rig::new(48, 48) else { return };
    *rig.get_mut::<Transform>(rig.camera) = Transform::default();
    // With so many triangles, a draw call is split at a few hidden instances.
    let mesh = rig.add::<Mesh>(Sphere::new(0.4).mesh().uv(48, 32));
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    // On a sphere around the camera.
    let directions = (0..90).map(|i| {
        let (y, turn) = (1.0 - (i as f32 + 0.5) / 45.0, 2.4 * i as f32);
        Vec3::new((1.0 - y * y).sqrt() * turn.cos(), y, (1.0 - y * y).sqrt() * turn.sin())
    });
    let balls: Vec<Entity> = directions
        .map(|way| {
            let place = Transform::from_translation(4.0 * way).looking_at(Vec3::ZERO, Vec3::Y);
            rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), place))
        })
        .collect();
    let check = |rig: &mut Rig, what: &str| {
        let (drawn, traced) = (rig.debug(DebugView::Instances), rig.debug(DebugView::TracedInstances));
        let is_flat = |at: UVec2| drawn.is_flat_around(at) && traced.is_flat_around(at);
        let differs = |(at, color): &(UVec2, Vec3)| is_flat(*at) && *color != traced.at(at.x, at.y);
        assert_eq!(drawn.iter().filter(differs).count(), 0, "{what}");
        drawn.iter().filter(|(at, color)| is_flat(*at) && *color != Vec3::ZERO).count()
    };
    for step in 0..8 {
        let turn = Quat::from_euler(EulerRot::YXZ, 0.9 * step as f32, 0.4 * (step % 3) as f32, 0.3 * step as f32);
        rig.get_mut::<Transform>(rig.camera).rotation = turn;
        assert!(check(&mut rig, &format!("camera at {turn}")) > 100);
    }
    // The camera rests, and a large ball moves from behind it into the image.
    let ahead = rig.get_mut::<Transform>(rig.camera).forward();
    for distance in [-3.0, 2.0, -3.0] {
        *rig.get_mut::<Transform>(balls[0]) =
            Transform::from_translation(distance * ahead).with_scale(Vec3::splat(2.0));
        let seen = check(&mut rig, &format!("a ball at {distance} m"));
        assert_eq!(seen > 1000, distance > 0.0, "{seen} pixels show balls");
    }
    rig.assert_sound();
}

#[test]
fn an_edge_on_pixel_borders_belongs_to_one_side() {
    // A quad over exactly the middle half of the image: its edges run along pixel borders, so no pixel center is near one.
    let Some(mut rig) = Rig::new(32, 32) else { return };
    rig.insert(rig.camera, orthographic(32.0, 32.0));
    rig.spawn(square(16.0), lambert(0.5), Transform::default());
    let drawn = rig.debug(DebugView::Albedo);
    let traced = rig.debug(DebugView::TracedInstances);
    for (at, color) in drawn.iter() {
        let inside = at.cmpge(UVec2::splat(8)).all() && at.cmplt(UVec2::splat(24)).all();
        assert_eq!(color.x > 0.0, inside, "at {at}");
        assert_eq!(traced.at(at.x, at.y) != Vec3::ZERO, inside, "traced, at {at}");
    }
}

/// Whether squares that face the camera and that face away are visible: each plain, mirrored, and mirrored twice.
#[test]
fn cull_mode_hides_its_face_from_camera_rays_only() {
    let Some(mut rig) = Rig::new(60, 20) else { return };
    rig.insert(rig.camera, orthographic(6.0, 2.0));
    let away = Quat::from_rotation_y(core::f32::consts::PI);
    let scales = [Vec3::ONE, Vec3::new(-1.0, 1.0, 1.0), Vec3::new(-1.0, 2.0, -0.5)];
    let material = rig.add::<StandardMaterial>(lambert(0.5));
    let mesh = rig.add::<Mesh>(square(0.8));
    for (i, scale) in scales.into_iter().enumerate() {
        for (row, rotation) in [Quat::IDENTITY, away].into_iter().enumerate() {
            let place = Vec3::new(2.0 * i as f32 - 2.0 + row as f32 - 0.5, 0.0, 0.0);
            let transform = Transform::from_translation(place).with_rotation(rotation).with_scale(scale);
            rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), transform));
        }
    }
    // The normal of a square is (0, 0, 1) times the inverse transpose: a negative scale of z flips it, one of x does not.
    let faces_camera = [true, false, true, false, false, true];
    for cull in [None, Some(Face::Back), Some(Face::Front)] {
        rig.edit(&material, |m| m.cull_mode = cull);
        let drawn = rig.debug(DebugView::Albedo);
        let traced = rig.debug(DebugView::TracedInstances);
        for (i, front) in faces_camera.into_iter().enumerate() {
            let expected = match cull {
                Some(Face::Back) => front,
                Some(Face::Front) => !front,
                None => true,
            };
            let x = 10 * i as u32 + 5;
            assert_eq!(drawn.at(x, 10).x > 0.0, expected, "square {i} under {cull:?}");
            assert!(
                traced.at(x, 10) != Vec3::ZERO,
                "other rays than the camera's hit both sides: square {i}, {cull:?}"
            );
        }
    }
    // `double_sided` is about shading and does not change culling.
    rig.edit(&material, |m| (m.cull_mode, m.double_sided) = (Some(Face::Back), true));
    let drawn = rig.debug(DebugView::Albedo);
    assert!(drawn.at(5, 10).x > 0.0 && drawn.at(15, 10).x == 0.0);
}

#[test]
fn holes_of_an_alpha_mask_show_the_surface_behind_them() {
    let Some(mut rig) = Rig::new(32, 32) else { return };
    rig.insert(rig.camera, orthographic(4.0, 4.0));
    let image = rig.add::<Image>(holes());
    let masked = StandardMaterial { base_color_texture: Some(image), alpha_mode: AlphaMode::Mask(0.5), ..lambert(1.0) };
    rig.spawn(square(4.0), masked, Transform::default());
    rig.spawn(square(4.0), lambert(0.25), Transform::from_xyz(0.0, 0.0, -1.0));
    let drawn = rig.debug(DebugView::Albedo);
    for (at, color) in drawn.iter() {
        let solid = (at.x / 8 + at.y / 8) % 2 == 0;
        assert!((color.x - if solid { 1.0 } else { 0.25 }).abs() < 1e-5, "{color} at {at}");
    }
}

#[test]
fn normals_under_non_uniform_scale_are_perpendicular_to_the_surface() {
    let Some(mut rig) = Rig::new(48, 48) else { return };
    rig.insert(rig.camera, orthographic(4.0, 4.0));
    let turned = Transform::from_rotation(Quat::from_euler(EulerRot::XYZ, 0.5, -0.4, 0.3));
    let parent = rig.spawn_bundle((turned.with_scale(Vec3::new(0.7, 1.1, -1.0)), Visibility::default()));
    let scaled = Transform::from_scale(Vec3::new(1.6, 0.5, 1.0)).with_rotation(Quat::from_rotation_z(0.6));
    let ball = rig.spawn(Sphere::new(1.0).mesh().uv(128, 96), lambert(0.5), scaled);
    rig.app.world_mut().entity_mut(parent).add_child(ball);
    let (depth, normals) = (rig.debug(DebugView::Depth), rig.debug(DebugView::Normals));
    let object = rig.app.world().get::<GlobalTransform>(ball).expect("it has one").affine();
    let (mut seen, mut power) = (0, 0);
    for (at, shown) in normals.iter().filter(|(at, _)| (4.0..6.0).contains(&depth.at(at.x, at.y).x)) {
        let across = (at.as_vec2() + 0.5) / 12.0 - 2.0;
        let on_ball = object.inverse().transform_point3(Vec3::new(across.x, -across.y, 5.0 - depth.at(at.x, at.y).x));
        let expected = (object.matrix3.inverse().transpose() * on_ball).normalize();
        // At the outline, facets are seen edge-on.
        if expected.z < 0.2 {
            continue;
        }
        let got = 2.0 * shown - 1.0;
        seen += 1;
        assert!(got.dot(expected) > 0.999, "{got}, not {expected}, at {at}");
        power += ((object.matrix3 * on_ball).normalize().dot(expected) < 0.95) as u32;
    }
    assert!(seen > 100 && power > seen / 4, "{seen} pixels, {power} of which can fail");
}

#[test]
fn debug_views_ignore_exposure() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, 1.0));
    rig.insert(rig.camera, (orthographic(1.0, 1.0), bevy::core_pipeline::tonemapping::Tonemapping::None));
    let target = rig.target.clone();
    let mut shown = Vec::new();
    for exposure in [unit_exposure(), default(), bevy::camera::Exposure { ev100: -3.0 }] {
        rig.insert(rig.camera, exposure);
        assert!((rig.debug(DebugView::Depth).center().x - 4.0).abs() < 0.2, "meters");
        assert!((rig.debug(DebugView::Albedo).center().x - 0.5).abs() < 1e-5);
        rig.set(|restir| restir.debug_view = DebugView::Albedo);
        shown.push(rig.drawn(&target)[0]);
    }
    // 0.5, sRGB-encoded.
    assert!(shown.iter().all(|p| p[0].abs_diff(188) <= 1), "{shown:?}");
}

/// Whether primary rays of successive frames meet other points.
fn moves(rig: &mut Rig, technique: Technique, jitter: Jitter, accumulate: bool) -> bool {
    rig.set(|r| *r = Restir { technique, jitter, accumulate, debug_view: DebugView::Depth, ..plain() });
    let first = rig.picture(1);
    (0..3).any(|_| rig.next().pixels != first.pixels)
}

#[test]
fn only_frames_that_are_averaged_are_jittered_by_default() {
    let Some(mut rig) = Rig::new(32, 32) else { return };
    crowd(&mut rig);
    for technique in [Technique::Reference, Technique::Di, Technique::Pt] {
        for accumulate in [false, true] {
            let averages = accumulate || technique == Technique::Reference;
            assert_eq!(moves(&mut rig, technique, Jitter::Auto, accumulate), averages, "{technique:?}, {accumulate}");
            assert!(moves(&mut rig, technique, Jitter::Always, accumulate), "{technique:?}, {accumulate}");
            assert!(!moves(&mut rig, technique, Jitter::Never, accumulate), "{technique:?}, {accumulate}");
        }
    }
    // Bevy's temporal antialiasing leaves the component behind when it is removed.
    rig.insert(rig.camera, TemporalJitter::default());
    assert!(moves(&mut rig, Technique::Reference, Jitter::Auto, false), "with a jitter that nothing sets");
}

#[test]
fn the_jitter_of_temporal_antialiasing_replaces_ours_where_it_is_zero_too() {
    let Some(mut rig) = Rig::new(32, 32) else { return };
    crowd(&mut rig);
    rig.set(|r| *r = Restir { jitter: Jitter::Always, debug_view: DebugView::Depth, ..plain() });
    rig.picture(1);
    let mut depth_with = |offset: Vec2| {
        rig.insert(rig.camera, TemporalJitter { offset });
        rig.next().pixels
    };
    depth_with(Vec2::splat(0.25));
    let center = depth_with(Vec2::ZERO);
    depth_with(Vec2::splat(-0.25));
    assert_eq!(depth_with(Vec2::ZERO), center);
}
