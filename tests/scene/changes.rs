//! The mirror visits the elements that change and no others.  Every app of the tests compares it with the main world in each frame
//! (`check_mirror`), so that an edit that goes unnoticed fails there.

use crate::support::app::*;
use bevy::{
    camera::visibility::{RenderLayers, VisibilityRange},
    ecs::entity_disabling::Disabled,
    light::{NotShadowCaster, SunDisk},
    mesh::morph::MeshMorphWeights,
    prelude::*,
};
use bevy_restir::{RestirIgnore, RestirMaterial, Subsurface};
use bevy_restir_support::skinned;

/// A row of squares before the camera, under a lamp and a light.
fn row(rig: &mut Rig, count: usize) -> Vec<Entity> {
    rig.spawn(square(1.0), lamp(1.0, 1.0, 1.0), Transform::from_xyz(2.0, 0.0, 1.0));
    rig.spawn_bundle((PointLight::default(), Transform::from_xyz(1.0, 2.0, 2.0)));
    let image = rig.add::<Image>(texture(2, 2, |x, _| [100 * x as u8, 50, 100, 255]));
    let look = StandardMaterial { base_color_texture: Some(image), ..lambert(0.5) };
    let (mesh, material) = (rig.add::<Mesh>(square(0.1)), rig.add::<StandardMaterial>(look));
    (0..count)
        .map(|i| {
            let place = Transform::from_xyz(0.01 * i as f32 - 1.0, 0.0, -1.0);
            rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), place))
        })
        .collect()
}

/// The numbers of elements that the last frame looked at, by kind.
fn visited(rig: &Rig) -> Vec<(&'static str, u64)> {
    rig.report().visited.into_iter().filter(|(_, count)| *count > 0).collect()
}

#[test]
fn a_still_frame_visits_nothing_and_a_move_visits_the_moved_object() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    let squares = row(&mut rig, 200);
    rig.until_ready();
    rig.frames(3);
    assert_eq!((visited(&rig), rig.report().uploaded_bytes), (vec![], 0));
    rig.get_mut::<Transform>(squares[70]).translation.y = 0.5;
    rig.frame();
    assert_eq!(visited(&rig), [("extracted_instances", 1), ("instances", 1)]);
    rig.frame();
    assert_eq!(visited(&rig), [("instances", 1)], "the last frame's transform follows");
    rig.frame();
    assert_eq!(visited(&rig), []);
    // An image that no material uses changes.
    let image = rig.add::<Image>(texture(2, 2, |_, _| [0; 4]));
    rig.frames(2);
    rig.edit(&image, |image| *image = texture(4, 4, |_, _| [255; 4]));
    rig.frame();
    assert_eq!(visited(&rig), [], "an image of something else");
    // A frame with a changed light looks at the two lamps, and one with a changed camera at nothing.
    let lights = rig.app.world_mut().query_filtered::<Entity, With<PointLight>>().iter(rig.app.world()).next();
    rig.get_mut::<PointLight>(lights.expect("there is a light")).intensity *= 2.0;
    rig.frame();
    assert_eq!(visited(&rig), [("emitters", 2)]);
    rig.get_mut::<Transform>(rig.camera).translation.z += 0.1;
    rig.frame();
    assert_eq!(visited(&rig), []);
}

/// An edit of the first square, or of the camera, and the number of instances after it.
type Edit = (&'static str, fn(&mut World, Entity, Entity), u64);

fn with<B: Bundle>(world: &mut World, entity: Entity, bundle: B) {
    world.entity_mut(entity).insert(bundle);
}

fn without<B: Bundle>(world: &mut World, entity: Entity) {
    world.entity_mut(entity).remove::<B>();
}

/// Pairs of an edit and its reverse.  There are four instances.
const EDITS: &[Edit] = &[
    ("NotShadowCaster", |world, square, _| with(world, square, NotShadowCaster), 4),
    ("no NotShadowCaster", |world, square, _| without::<NotShadowCaster>(world, square), 4),
    ("Visibility", |world, square, _| with(world, square, Visibility::Hidden), 3),
    ("no Visibility", |world, square, _| with(world, square, Visibility::Inherited), 4),
    ("RenderLayers", |world, square, _| with(world, square, RenderLayers::layer(5)), 3),
    ("no RenderLayers", |world, square, _| without::<RenderLayers>(world, square), 4),
    ("RenderLayers of the camera", |world, _, camera| with(world, camera, RenderLayers::layer(5)), 0),
    ("no RenderLayers of the camera", |world, _, camera| without::<RenderLayers>(world, camera), 4),
    ("RestirIgnore", |world, square, _| with(world, square, RestirIgnore), 3),
    ("no RestirIgnore", |world, square, _| without::<RestirIgnore>(world, square), 4),
    ("Disabled", |world, square, _| with(world, square, Disabled), 3),
    ("another one Disabled in the same frame", exchange_disabled, 3),
    ("no Disabled", enable_last, 4),
    ("RestirMaterial", stand_in, 4),
    ("no RestirMaterial", |world, square, _| without::<RestirMaterial>(world, square), 4),
    ("RestirMaterial again", stand_in, 4),
    ("no MeshMaterial3d", |world, square, _| without::<MeshMaterial3d<StandardMaterial>>(world, square), 4),
    ("neither", |world, square, _| without::<RestirMaterial>(world, square), 3),
    ("MeshMaterial3d", any_material, 4),
    ("Subsurface", translucent, 4),
    ("no Subsurface", |world, square, _| without::<Subsurface>(world, square), 4),
    ("a skin", skin, 4),
    ("no skin", |world, square, _| without::<bevy::mesh::skinning::SkinnedMesh>(world, square), 4),
    ("MeshMorphWeights", |world, square, _| with(world, square, MeshMorphWeights::Value { weights: vec![0.5] }), 4),
    ("no MeshMorphWeights", |world, square, _| without::<MeshMorphWeights>(world, square), 4),
    ("a VisibilityRange", |world, square, _| with(world, square, VisibilityRange::abrupt(50.0, 100.0)), 3),
    ("the camera far away", |world, _, camera| with(world, camera, Transform::from_xyz(0.0, 0.0, 60.0)), 4),
    ("the camera near", |world, _, camera| with(world, camera, Transform::from_xyz(0.0, 0.0, 5.0)), 3),
    ("no VisibilityRange", |world, square, _| without::<VisibilityRange>(world, square), 4),
    ("no InheritedVisibility", |world, square, _| without::<InheritedVisibility>(world, square), 3),
    ("InheritedVisibility", |world, square, _| with(world, square, InheritedVisibility::VISIBLE), 4),
    ("no Mesh3d, and another one in the same frame", another_mesh, 4),
    ("despawned, and one spawned in the same frame", respawn, 4),
    ("despawned", |world, _, _| despawn_last(world), 3),
];

fn stand_in(world: &mut World, square: Entity, _: Entity) {
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(Color::WHITE);
    with(world, square, RestirMaterial(material));
}

fn any_material(world: &mut World, square: Entity, _: Entity) {
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(Color::WHITE);
    with(world, square, MeshMaterial3d(material));
}

fn translucent(world: &mut World, square: Entity, _: Entity) {
    with(world, square, Subsurface { mean_free_path: Vec3::splat(0.1), ..default() });
}

fn skin(world: &mut World, square: Entity, _: Entity) {
    let skin = skinned::skin(world);
    with(world, square, skin);
}

fn another_mesh(world: &mut World, square: Entity, _: Entity) {
    without::<Mesh3d>(world, square);
    let mesh = world.resource_mut::<Assets<Mesh>>().add(Cuboid::from_length(0.1));
    with(world, square, Mesh3d(mesh));
}

#[derive(Component)]
struct Last;

fn respawn(world: &mut World, _: Entity, _: Entity) {
    let (mesh, material) = {
        let mut looks = world.query::<(&Mesh3d, &MeshMaterial3d<StandardMaterial>)>();
        let (mesh, material) = looks.iter(world).next().expect("there is a mesh");
        (mesh.clone(), material.clone())
    };
    despawn_last(world);
    world.spawn((Last, mesh, material, Transform::from_xyz(0.5, 0.5, -1.0)));
}

fn exchange_disabled(world: &mut World, square: Entity, _: Entity) {
    let last = world.query_filtered::<Entity, With<Last>>().single(world).expect("one square is the last");
    with(world, last, Disabled);
    without::<Disabled>(world, square);
}

fn enable_last(world: &mut World, _: Entity, _: Entity) {
    let last = world.query_filtered::<Entity, (With<Last>, With<Disabled>)>().single(world).expect("it is disabled");
    without::<Disabled>(world, last);
}

fn despawn_last(world: &mut World) {
    let last = world.query_filtered::<Entity, With<Last>>().single(world).expect("one square is the last");
    world.despawn(last);
}

#[test]
fn every_edit_is_noticed() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    let squares = row(&mut rig, 3);
    rig.insert(squares[2], Last);
    rig.until_ready();
    assert_eq!(rig.report().instances, 4);
    let camera = rig.camera;
    for (name, edit, instances) in EDITS {
        edit(rig.app.world_mut(), squares[0], camera);
        // A new mesh takes some frames.
        rig.until_ready();
        rig.frame();
        assert_eq!(rig.report().instances, *instances, "{name}");
    }
    rig.frames(2);
    assert_eq!(visited(&rig), []);
    rig.assert_sound();
}

#[test]
fn every_edit_of_lights_is_noticed() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    let sun = rig.spawn_bundle((DirectionalLight::default(), SunDisk::EARTH, Transform::default()));
    let point = rig.spawn_bundle((PointLight::default(), RenderLayers::layer(3), Transform::from_xyz(0.0, 0.0, 2.0)));
    // Bevy computes the visibility only of entities that were enabled at first.
    let spare = rig.spawn_bundle((SpotLight::default(), Transform::from_xyz(0.0, 1.0, 2.0)));
    rig.until_ready();
    rig.insert(spare, Disabled);
    let mut lights_after = |edit: &dyn Fn(&mut World)| {
        edit(rig.app.world_mut());
        rig.until_ready();
        rig.frame();
        rig.report().lights
    };
    assert_eq!(lights_after(&|_| ()), 1);
    assert_eq!(lights_after(&|world| without::<SunDisk>(world, sun)), 1);
    assert_eq!(lights_after(&|world| without::<RenderLayers>(world, point)), 2);
    assert_eq!(lights_after(&|world| with(world, point, Visibility::Hidden)), 1);
    assert_eq!(lights_after(&|world| with(world, point, Visibility::Inherited)), 2);
    assert_eq!(lights_after(&|world| without::<PointLight>(world, point)), 1);
    assert_eq!(lights_after(&|world| with(world, point, SpotLight::default())), 2);
    let exchange = |world: &mut World| {
        with(world, point, Disabled);
        without::<Disabled>(world, spare);
    };
    assert_eq!(lights_after(&exchange), 2);
    assert_eq!(lights_after(&|world| _ = world.despawn(spare)), 1);
    assert_eq!(lights_after(&|world| without::<Disabled>(world, point)), 2);
    assert_eq!(lights_after(&|world| _ = world.despawn(point)), 1);
}

#[test]
fn a_late_extraction_misses_nothing() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    let squares = row(&mut rig, 5);
    rig.until_ready();
    // The main world forgets removals after two of its frames.
    rig.app.world_mut().despawn(squares[1]);
    rig.get_mut::<Transform>(squares[2]).translation.y = 0.5;
    for _ in 0..4 {
        rig.app.main_mut().run_default_schedule();
        rig.app.world_mut().clear_trackers();
    }
    rig.frames(2);
    assert_eq!(rig.report().instances, 5);
    rig.assert_sound();
}
