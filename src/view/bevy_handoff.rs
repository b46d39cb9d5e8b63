//! Hands a camera from Bevy's renderer to ours once our first frame of it is ready.  Meshes that our scene contains are removed from Bevy's
//! lists of visible meshes from then on, so that they are never drawn twice.  Where Bevy lights no mesh at all, it draws no shadow maps.

use bevy::{
    app::SubApp,
    camera::{
        Camera, Camera3d,
        visibility::{NoCpuCulling, RenderLayers, VisibilityClass, VisibleEntities},
    },
    ecs::prelude::*,
    mesh::Mesh3d,
    pbr::{
        ExtractedDirectionalLight, ExtractedPointLight, MeshMaterial3d, RenderGpuCulledEntities, StandardMaterial,
        collect_gpu_culled_meshes,
    },
    platform::collections::{HashMap, HashSet},
    render::{
        ExtractSchedule, MainWorld, Render, RenderSystems,
        camera::extract_cameras,
        sync_world::{MainEntity, RenderEntity},
        view::{RenderVisibleEntities, RenderVisibleEntitiesClass},
    },
};
use core::any::TypeId;

use super::ViewPool;
use crate::cpu_times::{CpuTimes, Stage};
use crate::settings::{Restir, RestirIgnore, RestirMaterial};

/// Objects that we draw.
type Mirrored = (With<Mesh3d>, With<MeshMaterial3d<StandardMaterial>>, Without<RestirMaterial>, Without<RestirIgnore>);

/// All other meshes.
type Others = (With<Mesh3d>, Or<(Without<MeshMaterial3d<StandardMaterial>>, With<RestirMaterial>, With<RestirIgnore>)>);

/// Renderer that lit the last frame of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LitBy {
    Bevy,
    Us,
}

/// Views in which mirrored meshes are hidden from Bevy.
#[derive(Resource, Debug, Default)]
pub(crate) struct HiddenFromBevy {
    /// Meshes are hidden from a camera's first frame on: Bevy does not light it while our pipelines are compiled.
    at_once: bool,
    /// The plugin is off, because the device lacks something.
    is_off: bool,
    lit_by: HashMap<Entity, LitBy>,
    views: HashSet<Entity>,
    /// Views of the last frame.
    last_views: HashSet<Entity>,
    /// Mirrored meshes that are culled on the GPU.  The main world's lists do not contain them.
    culled_on_gpu: HashSet<MainEntity>,
    /// The main world's lists of visible meshes, until Bevy has extracted the shorter ones in their places.
    taken: Vec<(Entity, Vec<Entity>)>,
    /// No active camera shows a mesh that Bevy lights.
    bevy_lights_nothing: bool,
}

/// Adds the systems that hide mirrored meshes from Bevy.  `at_once`: from a camera's first frame on.
pub(crate) fn build(render_app: &mut SubApp, at_once: bool) {
    render_app
        .insert_resource(HiddenFromBevy { at_once, ..Default::default() })
        .add_systems(
            ExtractSchedule,
            (hide_mirrored_meshes.before(extract_cameras), restore_lists.after(extract_cameras)),
        )
        .add_systems(
            Render,
            (
                hide_meshes_culled_on_gpu.after(collect_gpu_culled_meshes).in_set(RenderSystems::PrepareMeshes),
                skip_shadow_maps.after(RenderSystems::ExtractCommands).before(RenderSystems::CreateViews),
            ),
        );
}

/// Treats all cameras as new ones, because their GPU resources were lost with the device.  `is_on`: the new device meets all requirements.
pub(crate) fn forget_cameras(world: &mut World, is_on: bool) {
    if let Some(mut hidden) = world.get_resource_mut::<HiddenFromBevy>() {
        hidden.lit_by.clear();
        hidden.is_off = !is_on;
    }
}

/// Whether we render a camera's mirrored meshes.  `rendered`: whether we rendered its last frame; `None` if it had no view or no image to draw
/// into, for example because its window was minimized or resized.
fn is_ours(rendered: Option<bool>, lit_by: Option<LitBy>, at_once: bool) -> bool {
    match (rendered, lit_by) {
        (Some(true), _) | (None, Some(LitBy::Us)) => true,
        (_, Some(LitBy::Bevy)) => false,
        _ => at_once,
    }
}

impl HiddenFromBevy {
    /// Whether Bevy draws the mirrored meshes of a view in this frame.
    pub(crate) fn bevy_draws(&self, view: Entity) -> bool {
        !self.views.contains(&view)
    }

    /// Decides whether we render a camera's mirrored meshes in this frame, and remembers the decision.
    fn decide(&mut self, view: Entity, is_active: bool, has_restir: bool, rendered: Option<bool>) -> bool {
        let ours = has_restir && !self.is_off && is_ours(rendered, self.lit_by.get(&view).copied(), self.at_once);
        if is_active {
            self.lit_by.insert(view, if ours { LitBy::Us } else { LitBy::Bevy });
        }
        if ours {
            self.views.insert(view);
        }
        ours
    }
}

/// Queries of the main world.
pub(crate) struct Queries {
    cameras: QueryState<(Entity, RenderEntity, &'static Camera, Has<Restir>, Has<Camera3d>)>,
    mirrored: QueryState<(), Mirrored>,
    others: QueryState<(), Others>,
    without_mesh: QueryState<&'static VisibilityClass, Without<Mesh3d>>,
    culled_on_gpu: QueryState<Entity, (Mirrored, With<NoCpuCulling>)>,
}

impl FromWorld for Queries {
    fn from_world(world: &mut World) -> Self {
        let mut main_world = world.resource_mut::<MainWorld>();
        Self {
            cameras: main_world.query(),
            mirrored: main_world.query_filtered(),
            others: main_world.query_filtered(),
            without_mesh: main_world.query_filtered(),
            culled_on_gpu: main_world.query_filtered(),
        }
    }
}

/// Removes mirrored meshes from the main world's lists before Bevy extracts them.
fn hide_mirrored_meshes(
    mut main_world: ResMut<MainWorld>,
    pool: Res<ViewPool>,
    mut hidden: ResMut<HiddenFromBevy>,
    mut queries: Local<Queries>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::Handoff);
    let Queries { cameras, mirrored, others, without_mesh, culled_on_gpu } = &mut *queries;
    let hidden = &mut *hidden;
    core::mem::swap(&mut hidden.views, &mut hidden.last_views);
    hidden.views.clear();
    let mut seen = HashSet::new();
    let mut ours = Vec::new();
    let mut all_are_ours = true;
    for (camera, view, settings, has_restir, is_3d) in cameras.iter(&main_world) {
        seen.insert(view);
        let rendered = pool.views.get(&view).filter(|state| state.has_target).map(|state| state.rendered);
        if pool.without_memory.contains(&view) {
            hidden.lit_by.insert(view, LitBy::Bevy);
        }
        if hidden.decide(view, settings.is_active, has_restir, rendered) {
            ours.push(camera);
        } else {
            all_are_ours &= !(is_3d && settings.is_active);
        }
    }
    hidden.bevy_lights_nothing = false;
    hidden.lit_by.retain(|view, _| seen.contains(view));
    hidden.culled_on_gpu.clear();
    if ours.is_empty() {
        return;
    }
    let mesh = TypeId::of::<Mesh3d>();
    // Apps may list other things among the meshes.
    let only_mirrored =
        others.iter(&main_world).next().is_none() && without_mesh.iter(&main_world).all(|class| !class.contains(&mesh));
    hidden.bevy_lights_nothing = all_are_ours && only_mirrored;
    for camera in ours {
        let lists = main_world.get_mut::<VisibleEntities>(camera);
        let Some(all) = lists.map(|mut lists| core::mem::take(lists.get_mut(TypeId::of::<Mesh3d>()))) else {
            continue;
        };
        if !only_mirrored {
            let is_other = |entity: &&Entity| mirrored.get(&main_world, **entity).is_err();
            let others_seen: Vec<Entity> = all.iter().filter(is_other).copied().collect();
            if let Some(mut lists) = main_world.get_mut::<VisibleEntities>(camera) {
                *lists.get_mut(TypeId::of::<Mesh3d>()) = others_seen;
            }
        }
        hidden.taken.push((camera, all));
    }
    hidden.culled_on_gpu.extend(culled_on_gpu.iter(&main_world).map(MainEntity::from));
}

/// Restores the main world's lists, because apps may ask which objects are visible.
fn restore_lists(mut main_world: ResMut<MainWorld>, mut hidden: ResMut<HiddenFromBevy>) {
    for (camera, list) in hidden.taken.drain(..) {
        if let Some(mut lists) = main_world.get_mut::<VisibleEntities>(camera) {
            *lists.get_mut(TypeId::of::<Mesh3d>()) = list;
        }
    }
}

/// Hides the meshes that only the render world lists.  Bevy updates these lists by additions and removals alone, so meshes must be added back
/// when they are no longer hidden.
fn hide_meshes_culled_on_gpu(
    hidden: Res<HiddenFromBevy>,
    culled: Option<Res<RenderGpuCulledEntities>>,
    mut views: Query<(Option<&RenderLayers>, &mut RenderVisibleEntities)>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::Handoff);
    let Some(culled) = culled.filter(|culled| !culled.entities.is_empty()) else { return };
    for &view in hidden.views.union(&hidden.last_views) {
        let Ok((layers, mut lists)) = views.get_mut(view) else { continue };
        let is_hidden = hidden.views.contains(&view);
        let list = lists.classes.entry(TypeId::of::<Mesh3d>()).or_default();
        for (&entity, own_layers) in &culled.entities {
            let on_layer = layers.is_none_or(|layers| layers.intersects(own_layers));
            set_visible(list, entity, on_layer && !(is_hidden && hidden.culled_on_gpu.contains(&entity)));
        }
        list.sort_added_entities();
    }
}

/// Keeps Bevy from drawing shadow maps that no mesh would read.  Volumetric fog reads those of volumetric lights.  Nothing
/// resets the flags, because Bevy extracts visible lights with shadow maps again in each frame.
fn skip_shadow_maps(
    hidden: Res<HiddenFromBevy>,
    mut points: Query<&mut ExtractedPointLight>,
    mut suns: Query<&mut ExtractedDirectionalLight>,
) {
    if !hidden.bevy_lights_nothing {
        return;
    }
    for mut light in &mut points {
        light.shadow_maps_enabled &= light.volumetric;
    }
    for mut light in &mut suns {
        light.shadow_maps_enabled &= light.volumetric;
    }
}

/// Adds a mesh to a list or removes it.
fn set_visible(list: &mut RenderVisibleEntitiesClass, entity: MainEntity, visible: bool) {
    // Meshes have no entity in the render world.
    let pair = (Entity::PLACEHOLDER, entity);
    match (list.entities_gpu_culling.contains_key(&entity), visible) {
        (true, false) => {
            list.entities_gpu_culling.remove(&entity);
            list.added_entities.retain(|added| added.1 != entity);
            list.removed_entities.push(pair);
        }
        (false, true) => {
            list.entities_gpu_culling.insert(entity, pair.0);
            list.add_entity(pair);
        }
        (true, true) | (false, false) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bevy_lights_a_camera_until_our_first_frame() {
        let view = Entity::from_raw_u32(1).expect("a valid index");
        for at_once in [false, true] {
            let mut hidden = HiddenFromBevy { at_once, ..Default::default() };
            let mut ours = |restir, rendered| hidden.decide(view, true, restir, rendered);
            assert_eq!([ours(true, None), ours(true, Some(false))], [at_once; 2], "a new camera");
            assert!(ours(true, Some(true)), "our first frame is ready");
            assert!(ours(true, None), "its window was minimized");
            assert_eq!(ours(true, Some(false)), at_once, "its target has a new format");
            assert!(ours(true, Some(true)));
            assert!(!ours(false, None), "`Restir` was removed");
            assert!(!ours(true, None) && !ours(true, Some(false)), "`Restir` is back, and Bevy continues");
            assert!(ours(true, Some(true)), "until our frame is ready");
        }
    }

    #[test]
    fn an_inactive_camera_counts_as_a_new_one() {
        let view = Entity::from_raw_u32(1).expect("a valid index");
        let mut hidden = HiddenFromBevy { at_once: true, ..Default::default() };
        assert!(!hidden.decide(view, false, false, None));
        assert!(hidden.decide(view, true, true, None));
    }
}
