//! Our cameras together with the rest of Bevy's rendering: the prepass textures that other passes read, and what Bevy draws over and
//! under our picture.

use crate::support::{
    app::*,
    bodies::*,
    gpu::{Bound, Gpu},
};
use bevy::{
    camera::{
        Hdr, ImageRenderTarget, MainPassResolutionOverride, RenderTarget, Viewport,
        visibility::{NoCpuCulling, VisibleEntities},
    },
    core_pipeline::{
        prepass::{DeferredPrepass, DepthPrepass, MotionVectorPrepass, ViewPrepassTextures},
        tonemapping::Tonemapping,
    },
    material::OpaqueRendererMethod,
    pbr::{ExtendedMaterial, Material, MaterialExtension, MaterialPlugin},
    prelude::*,
    reflect::TypePath,
    render::{
        Render, RenderApp, RenderSystems,
        camera::{ExtractedCamera, TemporalJitter},
        render_resource::AsBindGroup,
        renderer::{RenderDevice, RenderQueue},
    },
};
use bevy_restir::{Restir, RestirIgnore, RestirMaterial};
use std::any::TypeId;

/// (motion, depth) of every pixel, as other passes of Bevy read them after the frame.
fn prepass(rig: &mut Rig) -> Vec<[f32; 4]> {
    let world = rig.app.sub_app_mut(RenderApp).world_mut();
    let (device, queue) = (world.resource::<RenderDevice>(), world.resource::<RenderQueue>());
    let gpu = Gpu::new(device.wgpu_device().clone(), (****queue).clone(), String::new(), false);
    let mut views = world.query::<&ViewPrepassTextures>();
    let textures = views.single(world).expect("the camera has prepass textures");
    let size = textures.size;
    let (motion, depth) = (
        textures.motion_vectors_view().expect("the camera has this prepass"),
        textures.depth_view().expect("the camera has this prepass"),
    );
    let kernel = gpu.kernel("prepass", include_str!("../support/kernels/prepass.wgsl"), &[]);
    let texels = gpu.zeroed::<[f32; 4]>((size.width * size.height) as usize);
    kernel.run(
        [size.width.div_ceil(8), size.height.div_ceil(8), 1],
        &[(0, 0, Bound::Texture(motion)), (0, 1, Bound::Texture(depth)), (0, 2, Bound::Buffer(&texels))],
    );
    gpu.read(&texels)
}

/// Renders the cameras at a lower resolution, as an upscaler asks for.
fn draw_smaller(app: &mut App, size: UVec2) {
    let shrink = move |mut commands: Commands, cameras: Query<Entity, With<ExtractedCamera>>| {
        cameras.iter().for_each(|camera| _ = commands.entity(camera).insert(MainPassResolutionOverride(size)));
    };
    app.sub_app_mut(RenderApp).add_systems(Render, shrink.in_set(RenderSystems::PrepareViews));
}

/// The settings of a camera.
#[derive(Clone)]
struct Looks {
    projection: Projection,
    jitter: Vec2,
    viewport: Option<Viewport>,
    smaller: Option<UVec2>,
    deferred: bool,
}

/// A scene in which everything moves: renders two frames and returns the prepass.
fn moving(restir: bool, looks: &Looks) -> Option<Vec<[f32; 4]>> {
    let mut rig = Rig::beside(|app| looks.smaller.into_iter().for_each(|size| draw_smaller(app, size)), 48, 32)?;
    let open = |albedo| StandardMaterial { cull_mode: None, ..lambert(albedo) };
    rig.spawn(square(30.0), open(0.5), Transform::from_xyz(0.0, 0.0, -3.0));
    let ball = rig.spawn(Sphere::new(0.7).mesh().uv(18, 12), open(0.5), Transform::from_xyz(-0.8, 0.3, 0.0));
    let board = rig.spawn(square(1.2), open(0.5), Transform::from_xyz(1.0, -0.4, 0.5));
    let bending = spawn_skinned(&mut rig, "body", tube(), open(0.5));
    let camera = rig.camera;
    let jitter = TemporalJitter { offset: looks.jitter };
    rig.insert(camera, (DepthPrepass, MotionVectorPrepass, jitter, looks.projection.clone()));
    if looks.deferred {
        rig.insert(camera, DeferredPrepass);
    }
    rig.get_mut::<Camera>(camera).viewport = looks.viewport.clone();
    if restir {
        rig.until_ready();
    } else {
        rig.app.world_mut().entity_mut(camera).remove::<Restir>();
        rig.insert(camera, Msaa::Off);
        rig.frames(6);
    }
    for i in 0..2 {
        rig.insert(ball, Transform::from_xyz(-0.8 + 0.2 * i as f32, 0.3, 0.0));
        let foot = Transform::from_xyz(0.1, -1.3, 0.8).with_scale(Vec3::new(1.3, 1.0, 0.8));
        set_joints(&mut rig, bending, &swaying(foot, 0.5 + 0.3 * i as f32, 1.0));
        let turn = Quat::from_rotation_z(0.2 * i as f32);
        rig.insert(board, Transform::from_xyz(1.0, -0.4, 0.5 - 0.3 * i as f32).with_rotation(turn));
        rig.insert(
            camera,
            Transform::from_xyz(0.1 * i as f32, 0.0, 5.0).with_rotation(Quat::from_rotation_y(0.02 * i as f32)),
        );
        rig.frame();
    }
    Some(prepass(&mut rig))
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn depth_and_motion_vectors_equal_those_of_bevys_own_prepass() {
    let right = Viewport { physical_position: UVec2::new(20, 4), physical_size: UVec2::new(28, 28), ..default() };
    let perspective = Projection::Perspective(PerspectiveProjection::default());
    let plain = Looks { projection: perspective, jitter: Vec2::ZERO, viewport: None, smaller: None, deferred: false };
    // The jitter of Bevy's temporal anti-aliasing.
    let jitter = Vec2::new(0.3, -0.2);
    for (name, looks) in [
        ("perspective", plain.clone()),
        ("jittered", Looks { jitter, ..plain.clone() }),
        ("orthographic", Looks { projection: orthographic(6.0, 4.0), ..plain.clone() }),
        ("in a viewport", Looks { viewport: Some(right), ..plain.clone() }),
        ("with a deferred prepass", Looks { deferred: true, ..plain.clone() }),
        // The resolution of Bevy's DLSS.
        ("at a lower resolution for an upscaler", Looks { jitter, smaller: Some(UVec2::new(36, 24)), ..plain }),
    ] {
        let Some(ours) = moving(true, &looks) else { return };
        let bevys = moving(false, &looks).expect("there is an adapter");
        let (mut other, mut moved) = (0, 0);
        for (a, b) in ours.iter().zip(&bevys) {
            // Motion is stored in half floats with a precision of a thousandth.
            let near = |a: f32, b: f32| (a - b).abs() <= 2e-3 * b.abs() + 2e-5;
            other += !(near(a[0], b[0]) && near(a[1], b[1]) && near(a[2], b[2])) as usize;
            moved += (b[0].abs() > 0.002) as usize;
        }
        println!("{name}: {other} of {} pixels differ, {moved} move", ours.len());
        assert!(moved * 4 > ours.len(), "{name}: only {moved} pixels move");
        // At corners of triangles, rounding may choose the neighboring pixel.
        assert!(other * 200 <= ours.len(), "{name}: {other} of {} pixels differ", ours.len());
    }
}

/// A material that we do not support: Bevy draws it with its default shader, in pink.
#[derive(Asset, TypePath, AsBindGroup, Clone, Default)]
struct Foreign {
    mode: u32,
}

impl Material for Foreign {
    fn alpha_mode(&self) -> AlphaMode {
        if self.mode == 0 { AlphaMode::Opaque } else { AlphaMode::Blend }
    }
}

/// A material that we do not support, because it extends `StandardMaterial`.
#[derive(Asset, TypePath, AsBindGroup, Clone, Default)]
struct Extension {}

impl MaterialExtension for Extension {}

type Extended = ExtendedMaterial<StandardMaterial, Extension>;

#[test]
fn meshes_that_bevy_draws_are_depth_sorted_with_ours() {
    let Some(mut rig) = Rig::beside(
        |app| {
            app.add_plugins((MaterialPlugin::<Foreign>::default(), MaterialPlugin::<Extended>::default()));
        },
        32,
        32,
    ) else {
        return;
    };
    rig.insert(rig.camera, (orthographic(4.0, 4.0), Tonemapping::None));
    // Our meshes fill the picture at z = 0 on the left and z = 2 on the right; Bevy's mesh stands at z = 1 in a band across the middle.
    rig.spawn(square(4.0), lamp(0.0, 1.0, 0.0), Transform::from_xyz(-2.0, 0.0, 0.0));
    rig.spawn(square(4.0), lamp(0.0, 1.0, 0.0), Transform::from_xyz(2.0, 0.0, 2.0));
    let mesh = rig.add::<Mesh>(Rectangle::new(4.0, 1.0));
    let target = rig.target.clone();
    let pink = StandardMaterial { unlit: true, ..Color::linear_rgb(1.0, 0.0, 1.0).into() };
    for (mode, kind) in [(0, "opaque"), (1, "transparent"), (0, "with a stand-in"), (0, "ignored"), (0, "deferred")] {
        let place = Transform::from_xyz(0.0, 0.0, 1.0);
        let theirs = rig.spawn_bundle((Mesh3d(mesh.clone()), place));
        if kind == "ignored" {
            let pink = rig.add::<StandardMaterial>(pink.clone());
            rig.insert(theirs, (MeshMaterial3d(pink), RestirIgnore));
        } else if kind == "deferred" {
            let base = StandardMaterial { opaque_render_method: OpaqueRendererMethod::Deferred, ..pink.clone() };
            let material = rig.add::<Extended>(Extended { base, extension: Extension {} });
            rig.insert(theirs, MeshMaterial3d(material));
        } else {
            let material = rig.add::<Foreign>(Foreign { mode });
            rig.insert(theirs, MeshMaterial3d(material));
        }
        if kind == "with a stand-in" {
            let blue = rig.add::<StandardMaterial>(lamp(0.0, 0.0, 1.0));
            rig.insert(theirs, RestirMaterial(blue));
        }
        for prepass in ["without a prepass", "with a prepass", "with a deferred prepass"] {
            // Bevy panics where a deferred material has another prepass.
            if kind == "deferred" && prepass != "with a deferred prepass" {
                continue;
            }
            match prepass {
                "with a prepass" => rig.insert(rig.camera, (DepthPrepass, MotionVectorPrepass)),
                "with a deferred prepass" => rig.insert(rig.camera, DeferredPrepass),
                _ => {}
            }
            rig.until_ready();
            rig.frames(8);
            let drawn = rig.drawn(&target);
            let at = |x: usize, y: usize| drawn[32 * y + x];
            let what = format!("{kind}, {prepass}");
            assert_eq!(at(8, 4)[..3], [0, 255, 0], "{what}: only our mesh");
            assert_eq!(at(8, 16)[..3], [255, 0, 255], "{what}: Bevy's mesh in front of ours");
            assert_eq!(at(24, 16)[..3], [0, 255, 0], "{what}: Bevy's mesh behind ours");
        }
        let mut camera = rig.app.world_mut().entity_mut(rig.camera);
        camera.remove::<(DepthPrepass, MotionVectorPrepass, DeferredPrepass)>();
        rig.app.world_mut().despawn(theirs);
    }
}

#[test]
fn gizmos_are_drawn_over_our_picture_and_hidden_behind_our_meshes() {
    fn line(mut gizmos: Gizmos) {
        gizmos.line(Vec3::new(-3.0, 0.0, 1.0), Vec3::new(3.0, 0.0, 1.0), Color::linear_rgb(1.0, 0.0, 0.0));
    }
    let Some(mut rig) = Rig::beside(|app| _ = app.add_systems(Update, line), 32, 32) else { return };
    rig.insert(rig.camera, (orthographic(4.0, 4.0), Tonemapping::None));
    rig.spawn(square(4.0), lamp(0.0, 1.0, 0.0), Transform::from_xyz(-2.0, 0.0, 0.0));
    rig.spawn(square(4.0), lamp(0.0, 1.0, 0.0), Transform::from_xyz(2.0, 0.0, 2.0));
    rig.until_ready();
    rig.frames(8);
    let target = rig.target.clone();
    let drawn = rig.drawn(&target);
    let rows = |x: usize, color: [u8; 3]| (0..32).filter(|y| drawn[32 * y + x][..3] == color).collect::<Vec<_>>();
    assert_eq!(rows(8, [255, 0, 0]), [15, 16], "the line is two pixels wide");
    assert_eq!(rows(8, [0, 255, 0]).len(), 30, "our mesh behind the line");
    assert_eq!(rows(24, [0, 255, 0]).len(), 32, "our mesh in front of the line");
}

#[test]
fn interface_and_sprites_are_drawn_over_our_picture() {
    let Some(mut rig) = Rig::new(32, 32) else { return };
    rig.insert(rig.camera, (orthographic(4.0, 4.0), Tonemapping::None));
    rig.spawn(square(4.0), lamp(0.0, 1.0, 0.0), Transform::default());
    let target = rig.target.clone();
    // The interface of the same camera covers the upper left quarter.
    rig.spawn_bundle((
        Node { width: Val::Percent(50.0), height: Val::Percent(50.0), ..default() },
        BackgroundColor(Color::linear_rgb(1.0, 0.0, 0.0)),
        bevy::ui::UiTargetCamera(rig.camera),
    ));
    rig.until_ready();
    rig.frames(8);
    let drawn = rig.drawn(&target);
    assert_eq!(
        [drawn[32 * 8 + 8], drawn[32 * 8 + 24]],
        [[255, 0, 0, 255], [0, 255, 0, 255]],
        "the interface and our picture"
    );
    // A later 2D camera, with the same texture format, draws a sprite in the lower right quarter.
    rig.spawn_bundle((
        Camera2d,
        Hdr,
        Camera { order: 1, clear_color: ClearColorConfig::None, ..default() },
        RenderTarget::Image(ImageRenderTarget::from(target.clone())),
        Tonemapping::None,
        Msaa::Off,
    ));
    rig.spawn_bundle((
        bevy::sprite::Sprite::from_color(Color::linear_rgb(0.0, 0.0, 1.0), Vec2::splat(16.0)),
        Transform::from_xyz(8.0, -8.0, 0.0),
    ));
    rig.until_ready();
    rig.frames(8);
    let drawn = rig.drawn(&target);
    let at = |x: usize, y: usize| drawn[32 * y + x];
    assert_eq!(at(8, 8)[..3], [255, 0, 0], "the interface");
    assert_eq!(at(24, 8)[..3], [0, 255, 0], "ours");
    assert_eq!(at(24, 24)[..3], [0, 0, 255], "the sprite");
}

#[test]
fn tonemapping_and_exposure_apply_to_our_picture() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.insert(rig.camera, orthographic(1.0, 1.0));
    rig.spawn(square(4.0), lamp(2.0, 2.0, 2.0), Transform::default());
    let target = rig.target.clone();
    let shown = |rig: &mut Rig| {
        rig.until_ready();
        rig.drawn(&target)[9][0]
    };
    // Reinhard maps 2 to 2/3, in 8-bit sRGB 213.  Two stops less leave a quarter, 0.5, which maps to 1/3: 156.
    rig.insert(rig.camera, (Tonemapping::Reinhard, unit_exposure()));
    assert!(shown(&mut rig).abs_diff(213) <= 1);
    let darker = bevy::camera::Exposure { ev100: unit_exposure().ev100 + 2.0 };
    rig.insert(rig.camera, darker);
    assert!(shown(&mut rig).abs_diff(156) <= 1, "two stops darker");
    rig.insert(rig.camera, (Tonemapping::None, unit_exposure()));
    assert_eq!(shown(&mut rig), 255, "none");
}

#[test]
fn gpu_culled_meshes_are_hidden_from_bevys_passes_of_our_cameras_only() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    // Ambient light is Bevy's only: pictures of Bevy are bright, and our own are black.
    rig.app.insert_resource(bevy::light::GlobalAmbientLight { brightness: 1e4, ..default() });
    let other = rig.add::<Image>(target_image(UVec2::new(16, 16)));
    let image = RenderTarget::Image(ImageRenderTarget::from(other.clone()));
    rig.spawn_bundle((
        Camera3d::default(),
        Camera { order: 1, ..default() },
        image,
        Transform::from_xyz(0.0, 0.0, 5.0),
        unit_exposure(),
    ));
    let (mesh, material) = (rig.add::<Mesh>(square(2.0)), rig.add::<StandardMaterial>(lambert(1.0)));
    rig.frame();
    let square = (Mesh3d(mesh), MeshMaterial3d(material), Transform::default());
    let entity = rig.spawn_bundle((square.clone(), NoCpuCulling));
    rig.until_ready();
    let ours = rig.target.clone();
    let center = |rig: &mut Rig, target: &Handle<Image>| rig.drawn(target)[8 * 16 + 8][0];
    assert!(center(&mut rig, &other) > 100, "a camera without `Restir`");
    assert!(center(&mut rig, &ours) < 10, "a camera with `Restir`");
    // Bevy's lists of GPU-culled meshes hold changes only.
    rig.app.world_mut().entity_mut(rig.camera).remove::<Restir>();
    rig.frames(3);
    assert!(center(&mut rig, &ours) > 100, "after `Restir` was removed");
    rig.insert(rig.camera, plain());
    rig.until_ready();
    rig.frames(2);
    assert!(center(&mut rig, &ours) < 10, "after `Restir` was added again");
    rig.app.world_mut().despawn(entity);
    rig.frames(3);
    assert!(center(&mut rig, &other) < 10, "the mesh was removed");
    rig.spawn_bundle((square, NoCpuCulling));
    rig.until_ready();
    assert!(center(&mut rig, &ours) < 10 && center(&mut rig, &other) > 100, "another mesh");
}

/// Apps ask Bevy's lists which objects a camera sees.
#[test]
fn the_lists_of_visible_objects_stay_as_bevy_made_them() {
    let Some(mut rig) = Rig::new(16, 12) else { return };
    let object = rig.spawn(square(1.0), lambert(0.5), Transform::default());
    rig.until_ready();
    rig.frame();
    let lists = rig.app.world().get::<VisibleEntities>(rig.camera).expect("a camera has lists");
    assert_eq!(lists.get(TypeId::of::<Mesh3d>()), [object]);
}
