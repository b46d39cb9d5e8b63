//! Extracts mesh instances: a list persists between frames, and each frame updates the instances that have changed.

use super::{ExtractedScene, poses::PoseSources, users::Users};
use crate::cpu_times::{CpuTimes, Stage};
use crate::scene::{
    geometry::render_layers::LayerSets, geometry::rig::Pose, geometry::visibility_range::VisibilityRanges,
};
use crate::settings::{RestirIgnore, RestirMaterial, Subsurface};
use bevy::{
    asset::AssetId,
    camera::{
        primitives::Aabb,
        visibility::{InheritedVisibility, RenderLayers, VisibilityRange},
    },
    ecs::{entity::EntityHash, entity_disabling::Disabled, prelude::*, query::ROQueryItem, system::SystemParam},
    light::NotShadowCaster,
    math::{Affine3A, Vec3A},
    mesh::{Mesh, Mesh3d, morph::MeshMorphWeights, skinning::SkinnedMesh},
    pbr::{MeshMaterial3d, StandardMaterial},
    platform::collections::{HashMap, HashSet},
    render::{
        Extract,
        sync_world::{MainEntity, MainEntityHashSet},
    },
    transform::components::GlobalTransform,
};

/// A mesh instance that at least one camera sees.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ExtractedInstance {
    pub entity: MainEntity,
    pub mesh: AssetId<Mesh>,
    pub material: AssetId<StandardMaterial>,
    pub world_from_object: Affine3A,
    /// Bits of the cameras that see it ([`LayerSets`]).
    pub camera_mask: u32,
    /// Rays other than the camera's can hit it.
    pub casts_shadows: bool,
    /// It stands in for an object that Bevy draws (`RestirMaterial`), so camera rays do not see it.
    pub is_stand_in: bool,
    /// `None` if it has neither a skin nor morph targets.
    pub pose: Option<Box<Pose>>,
    pub subsurface: Option<Subsurface>,
}

/// The state of an entity in the main world.
pub(crate) enum EntityState {
    /// It is gone, or it is no mesh with a material.
    NoMesh,
    /// The instance; `None` if no camera sees it.
    Mesh(Option<ExtractedInstance>),
}

/// The mesh instances of the main world, and which of them have changed.
///
/// Most frames look only at the entities that have changed; [`Self::touch_all`] looks at all of them.  Both give the same list.
#[derive(Debug, Default)]
pub(crate) struct InstanceList {
    /// All entities with a mesh and a material; `None` for those that no camera sees.
    all: HashMap<MainEntity, Option<ExtractedInstance>, EntityHash>,
    /// Instances that have appeared, disappeared or changed since the last [`Self::take_changed`]; some more than once.
    changed: Vec<MainEntity>,
    /// Those of which only the transform has changed, since the last [`Self::take_moved`].
    moved: Vec<MainEntity>,
    /// Instances whose material has been replaced by another one since the last [`Self::take_repainted`]; some more than once.
    repainted: Vec<MainEntity>,
    /// Meshes that instances have begun to show since the last [`Self::take_newly_shown`].
    newly_shown: HashSet<AssetId<Mesh>>,
    mesh_users: Users<AssetId<Mesh>>,
    material_users: Users<AssetId<StandardMaterial>>,
    /// Instances with a pose.
    posed: MainEntityHashSet,
    /// Entities that extractions have looked at since the last [`Self::take_visited`].
    visited: u64,
}

impl InstanceList {
    /// The instance of an entity, if a camera sees it.
    pub(crate) fn get(&self, entity: MainEntity) -> Option<&ExtractedInstance> {
        self.all.get(&entity)?.as_ref()
    }

    /// All instances, in no particular order.
    #[cfg(feature = "testing")]
    pub(crate) fn visible(&self) -> impl Iterator<Item = &ExtractedInstance> {
        self.all.values().flatten()
    }

    /// Removes duplicates from long lists of changes: an app whose rendering has stopped still extracts its scene, and nobody takes the
    /// changes.
    fn shorten(&mut self) {
        let limit = 4 * self.all.len() + 1024;
        for changes in [&mut self.changed, &mut self.moved, &mut self.repainted] {
            if changes.len() > limit {
                *changes = sorted(core::mem::take(changes));
            }
        }
    }

    /// Takes the entities whose instances have changed since the last call, without those that have only moved.
    pub(crate) fn take_changed(&mut self) -> Vec<MainEntity> {
        sorted(core::mem::take(&mut self.changed))
    }

    /// Takes the entities whose instances have moved since the last call; some more than once.
    pub(crate) fn take_moved(&mut self) -> Vec<MainEntity> {
        core::mem::take(&mut self.moved)
    }

    /// Takes the meshes that instances have begun to show since the last call.
    pub(crate) fn take_newly_shown(&mut self) -> HashSet<AssetId<Mesh>> {
        core::mem::take(&mut self.newly_shown)
    }

    /// Number of entities that extractions have looked at since the last call.
    pub(crate) fn take_visited(&mut self) -> u64 {
        core::mem::take(&mut self.visited)
    }

    /// Takes the entities whose instances have got another material since the last call.
    pub(crate) fn take_repainted(&mut self) -> Vec<MainEntity> {
        sorted(core::mem::take(&mut self.repainted))
    }

    /// Instances of a mesh, in no particular order.
    pub(crate) fn users_of_mesh(&self, mesh: AssetId<Mesh>) -> impl Iterator<Item = MainEntity> {
        self.mesh_users.of(mesh)
    }

    /// The materials of all instances, each with its instances.
    pub(crate) fn materials(&self) -> impl Iterator<Item = (AssetId<StandardMaterial>, &MainEntityHashSet)> {
        self.material_users.all()
    }

    /// Instances of a material, in no particular order.
    pub(crate) fn users_of_material(&self, material: AssetId<StandardMaterial>) -> impl Iterator<Item = MainEntity> {
        self.material_users.of(material)
    }

    /// Instances with a pose, in no particular order.
    pub(crate) fn posed(&self) -> &MainEntityHashSet {
        &self.posed
    }

    /// Takes over the transform of an entity, if a camera sees its instance.
    fn move_to(&mut self, entity: MainEntity, world_from_object: Affine3A) {
        if let Some(Some(instance)) = self.all.get_mut(&entity)
            && instance.world_from_object != world_from_object
        {
            instance.world_from_object = world_from_object;
            self.moved.push(entity);
            self.visited += 1;
        }
    }

    /// Takes over the state of an entity.
    pub(crate) fn set(&mut self, entity: MainEntity, state: EntityState) {
        let [before, after] = match state {
            EntityState::Mesh(new) => {
                let listed = self.all.entry(entity).or_default();
                if let (Some(old), Some(new)) = (&mut *listed, &new) {
                    let has_moved = old.world_from_object != new.world_from_object;
                    old.world_from_object = new.world_from_object;
                    if old == new {
                        if has_moved {
                            self.moved.push(entity);
                        }
                        return;
                    }
                } else if *listed == new {
                    return;
                }
                let after = Traits::of(new.as_ref());
                [Traits::of(core::mem::replace(listed, new).as_ref()), after]
            }
            EntityState::NoMesh => {
                let Some(old) = self.all.remove(&entity).flatten() else { return };
                [Traits::of(Some(&old)), Traits::default()]
            }
        };
        self.changed.push(entity);
        if before == after {
            return;
        }
        if before.material != after.material {
            self.repainted.push(entity);
        }
        if before.mesh != after.mesh {
            self.newly_shown.extend(after.mesh);
        }
        self.mesh_users.change(entity, before.mesh, after.mesh);
        self.material_users.change(entity, before.material, after.material);
        set_member(&mut self.posed, entity, after.is_posed);
    }
}

/// The properties by which the list finds instances.
#[derive(Default, PartialEq)]
struct Traits {
    mesh: Option<AssetId<Mesh>>,
    material: Option<AssetId<StandardMaterial>>,
    is_posed: bool,
}

impl Traits {
    fn of(instance: Option<&ExtractedInstance>) -> Self {
        Self {
            mesh: instance.map(|i| i.mesh),
            material: instance.map(|i| i.material),
            is_posed: instance.is_some_and(|i| i.pose.is_some()),
        }
    }
}

fn set_member(set: &mut MainEntityHashSet, entity: MainEntity, is_member: bool) {
    if is_member {
        set.insert(entity);
    } else if !set.is_empty() {
        set.remove(&entity);
    }
}

/// Entities in ascending order, each once.
pub(crate) fn sorted(mut entities: Vec<MainEntity>) -> Vec<MainEntity> {
    // Most lists consist of a few sorted parts, which this sort merges.
    entities.sort();
    entities.dedup();
    entities
}

type InstanceData<'a> = (
    Entity,
    &'a Mesh3d,
    AnyOf<(&'static MeshMaterial3d<StandardMaterial>, &'static RestirMaterial)>,
    &'a GlobalTransform,
    &'a InheritedVisibility,
    Option<&'a RenderLayers>,
    Has<NotShadowCaster>,
    Option<&'a SkinnedMesh>,
    Option<&'a MeshMorphWeights>,
    Option<&'a Subsurface>,
);

/// The mesh instances of the main world.
#[derive(SystemParam)]
pub(crate) struct Instances<'w, 's> {
    all: Query<'w, 's, InstanceData<'static>, Without<RestirIgnore>>,
    ranges: VisibilityRanges<'w, 's>,
    poses: PoseSources<'w, 's>,
}

impl Instances<'_, '_> {
    /// The instance of a row; `None` if no camera sees it.
    fn instance(
        &self,
        row: ROQueryItem<InstanceData<'static>>,
        sets: &LayerSets,
        viewpoint: Option<Vec3A>,
    ) -> Option<ExtractedInstance> {
        let (entity, mesh, materials, transform, visibility, layers, not_shadow_caster, skin, morph, subsurface) = row;
        let camera_mask = sets.camera_mask(layers);
        let (own, stand_in) = materials;
        let material = stand_in.map(|material| material.0.id()).or(own.map(|material| material.id()))?;
        let is_seen = visibility.get()
            && camera_mask != 0
            && !viewpoint.is_some_and(|viewpoint| self.ranges.is_culled(entity, viewpoint));
        is_seen.then(|| ExtractedInstance {
            entity: entity.into(),
            mesh: mesh.id(),
            material,
            world_from_object: transform.affine(),
            camera_mask,
            casts_shadows: !not_shadow_caster,
            is_stand_in: stand_in.is_some(),
            pose: self.poses.pose(skin, morph),
            subsurface: subsurface.copied(),
        })
    }
}

/// A component of the row has changed; not the transform alone, unless the level of detail depends on it.
type Touched = Or<(
    Changed<Mesh3d>,
    Changed<MeshMaterial3d<StandardMaterial>>,
    Changed<RestirMaterial>,
    (Changed<GlobalTransform>, With<VisibilityRange>),
    Changed<InheritedVisibility>,
    Changed<RenderLayers>,
    Changed<NotShadowCaster>,
    Changed<SkinnedMesh>,
    Changed<MeshMorphWeights>,
    Changed<Subsurface>,
)>;

/// The changes in the main world since the last frame.
#[derive(SystemParam)]
pub(crate) struct InstanceChanges<'w, 's> {
    rows: Query<'w, 's, InstanceData<'static>, (Without<RestirIgnore>, Touched)>,
    transforms: Query<'w, 's, (Entity, &'static GlobalTransform), (With<Mesh3d>, Changed<GlobalTransform>)>,
    ignored: Query<'w, 's, Entity, (With<Mesh3d>, Added<RestirIgnore>)>,
    /// Queries that do not name `Disabled` leave these entities out.
    disabled: Query<'w, 's, Entity, (With<Mesh3d>, Added<Disabled>)>,
    posed: Query<'w, 's, Entity, (With<Mesh3d>, Or<(With<SkinnedMesh>, With<MeshMorphWeights>)>)>,
    ranged: Query<'w, 's, Entity, (With<Mesh3d>, With<VisibilityRange>)>,
    new_ranges: Query<'w, 's, Entity, (With<Mesh3d>, With<VisibilityRange>, NewRange)>,
    removed: RemovedParts<'w, 's>,
}

type NewRange = Or<(Changed<VisibilityRange>, Changed<Aabb>)>;

/// Components whose removal changes an instance or ends it.  A despawned entity loses all of them.
#[derive(SystemParam)]
pub(crate) struct RemovedParts<'w, 's> {
    meshes: RemovedComponents<'w, 's, Mesh3d>,
    materials: RemovedComponents<'w, 's, MeshMaterial3d<StandardMaterial>>,
    stand_ins: RemovedComponents<'w, 's, RestirMaterial>,
    ignored: RemovedComponents<'w, 's, RestirIgnore>,
    disabled: RemovedComponents<'w, 's, Disabled>,
    layers: RemovedComponents<'w, 's, RenderLayers>,
    not_shadow_casters: RemovedComponents<'w, 's, NotShadowCaster>,
    skins: RemovedComponents<'w, 's, SkinnedMesh>,
    morphs: RemovedComponents<'w, 's, MeshMorphWeights>,
    subsurface: RemovedComponents<'w, 's, Subsurface>,
    ranges: RemovedComponents<'w, 's, VisibilityRange>,
    boxes: RemovedComponents<'w, 's, Aabb>,
}

impl RemovedParts<'_, '_> {
    /// The entities that have lost a part since the last call; some more than once.
    fn read(&mut self) -> impl Iterator<Item = Entity> {
        let Self { meshes, materials, stand_ins, ignored, layers, not_shadow_casters, skins, morphs, .. } = self;
        let shown = meshes.read().chain(materials.read()).chain(stand_ins.read());
        let shown = shown.chain(ignored.read()).chain(self.disabled.read());
        let looks = layers.read().chain(not_shadow_casters.read()).chain(skins.read()).chain(morphs.read());
        shown.chain(looks).chain(self.subsurface.read()).chain(self.ranges.read()).chain(self.boxes.read())
    }
}

impl InstanceChanges<'_, '_> {
    /// Entities to look at besides the rows that have changed.  A skin and a level of detail depend on other entities.
    fn others(&mut self, has_new_viewpoint: bool) -> Vec<MainEntity> {
        let ranged = has_new_viewpoint.then(|| self.ranged.iter()).into_iter().flatten();
        let others = self.ignored.iter().chain(&self.disabled).chain(&self.posed).chain(ranged).chain(&self.new_ranges);
        let others: Vec<_> = others.map(MainEntity::from).collect();
        sorted(others.into_iter().chain(self.removed.read().map(MainEntity::from)).collect())
    }
}

/// The inputs of the last extraction that all instances depend on.
#[derive(Default)]
pub(crate) struct LastExtraction {
    layers: u64,
    viewpoint: Option<Vec3A>,
}

/// Extracts the mesh instances that have changed.
pub(crate) fn extract_instances(
    mut scene: ResMut<ExtractedScene>,
    instances: Extract<Instances>,
    mut changes: Extract<InstanceChanges>,
    sets: Res<LayerSets>,
    mut last: Local<LastExtraction>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::ExtractInstances);
    let is_new = scene.is_new;
    let list = &mut scene.instances;
    let viewpoint = instances.ranges.viewpoint();
    let others = changes.others(viewpoint != last.viewpoint);
    let has_new_layers = sets.revision != last.layers;
    *last = LastExtraction { layers: sets.revision, viewpoint };
    if is_new || has_new_layers {
        list.touch_all(&instances, &sets, viewpoint);
        return;
    }
    for row in &changes.rows {
        list.visited += 1;
        list.set(row.0.into(), EntityState::Mesh(instances.instance(row, &sets, viewpoint)));
    }
    for (entity, transform) in &changes.transforms {
        list.move_to(entity.into(), transform.affine());
    }
    for entity in others {
        list.touch(entity, &instances, &sets, viewpoint);
    }
    list.shorten();
    // The main world keeps removals for two of its frames.  A late extraction misses some, and then the numbers differ.
    if list.all.len() != instances.all.iter().len() {
        list.touch_all(&instances, &sets, viewpoint);
    }
}

impl InstanceList {
    /// Looks at an entity.
    fn touch(&mut self, entity: MainEntity, instances: &Instances, sets: &LayerSets, viewpoint: Option<Vec3A>) {
        self.visited += 1;
        let state = match instances.all.get(*entity) {
            Ok(row) => EntityState::Mesh(instances.instance(row, sets, viewpoint)),
            Err(_) => EntityState::NoMesh,
        };
        self.set(entity, state);
    }

    /// Looks at every entity.
    fn touch_all(&mut self, instances: &Instances, sets: &LayerSets, viewpoint: Option<Vec3A>) {
        let known = self.all.keys().copied();
        for entity in sorted(known.chain(instances.all.iter().map(|row| row.0.into())).collect()) {
            self.touch(entity, instances, sets, viewpoint);
        }
    }
}

/// Compares instances and lights in each frame with those that are extracted from scratch.
#[cfg(feature = "testing")]
#[derive(Resource)]
pub(crate) struct CheckMirror;

/// Panics if an instance differs from what the main world has.
#[cfg(feature = "testing")]
pub(crate) fn check_instances(
    scene: Res<ExtractedScene>,
    instances: Extract<Instances>,
    sets: Res<LayerSets>,
    wanted: Option<Res<CheckMirror>>,
) {
    if wanted.is_none() {
        return;
    }
    let viewpoint = instances.ranges.viewpoint();
    let mut seen = 0;
    for row in &instances.all {
        let entity = MainEntity::from(row.0);
        let expected = instances.instance(row, &sets, viewpoint);
        seen += usize::from(expected.is_some());
        // NaN differs from itself, but not from its text.
        let [expected, listed] = [expected.as_ref(), scene.instances.get(entity)].map(|i| format!("{i:?}"));
        assert_eq!(listed, expected, "entity {}", *entity);
    }
    let list = &scene.instances;
    assert_eq!(list.all.values().flatten().count(), seen, "instances that no entity has");
    assert_eq!(list.mesh_users.all().map(|(_, users)| users.len()).sum::<usize>(), seen, "users of meshes");
    assert_eq!(list.material_users.all().map(|(_, users)| users.len()).sum::<usize>(), seen, "users of materials");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_that_nobody_takes_are_kept_once() {
        let mut list = InstanceList::default();
        let entity = MainEntity::from(Entity::PLACEHOLDER);
        for i in 0..10_000u16 {
            let instance = ExtractedInstance {
                entity,
                mesh: AssetId::default(),
                material: AssetId::default(),
                world_from_object: Affine3A::from_translation(bevy::math::Vec3::splat(i.into())),
                camera_mask: 1,
                casts_shadows: true,
                is_stand_in: false,
                pose: None,
                subsurface: None,
            };
            list.set(entity, EntityState::Mesh(Some(instance)));
            list.shorten();
            assert!(list.moved.len() <= 1028, "{}", list.moved.len());
        }
        assert_eq!((list.take_changed(), sorted(list.take_moved())), (vec![entity], vec![entity]));
    }
}
