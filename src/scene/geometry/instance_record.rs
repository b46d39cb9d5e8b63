//! The record of an instance on the GPU, as it is in the instance's first frame.

use bevy::{
    asset::{AssetId, AssetServer},
    math::Affine3A,
    mesh::Mesh,
    render::sync_world::MainEntity,
};

use crate::gpu_layout::*;
use crate::planted::{Fault, is_planted};
use crate::scene::{
    accel::blas::Bounds,
    accel::tlas,
    extract::instances::ExtractedInstance,
    features::SceneFeatures,
    geometry::bodies::{Body, BodyPool},
    geometry::meshes::{MeshEntry, MeshPool},
    geometry::render_layers::MAX_LAYER_SETS,
    material::{materials::MaterialPool, subsurface::SubsurfacePool},
};

/// An instance that at least one camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LiveInstance {
    pub entity: MainEntity,
    pub mesh: AssetId<Mesh>,
    pub material: u32,
    /// Bits of the cameras that see it directly: 0 for a `RestirMaterial`.
    pub camera_mask: u32,
    /// Bits of the cameras whose other rays can hit it: 0 for a `NotShadowCaster`.
    pub ray_mask: u32,
    pub triangles: u32,
    /// Features that shaders need for it.
    pub features: SceneFeatures,
    /// Its triangles are lights.
    pub emits: bool,
    /// World bounds.
    pub bounds: Bounds,
}

impl LiveInstance {
    /// Its bounds in the top level, if rays can hit it.
    pub(super) fn traced_bounds(&self) -> Option<Bounds> {
        (self.ray_mask != 0).then_some(self.bounds)
    }
}

/// The pools and limits that the records of instances depend on.
pub(crate) struct InstanceSources<'a> {
    pub meshes: &'a MeshPool,
    pub bodies: &'a BodyPool,
    pub materials: &'a mut MaterialPool,
    pub subsurface: &'a mut SubsurfacePool,
    pub assets: &'a AssetServer,
    /// Number of instances that the device can bind.
    pub limit: u32,
}

/// The record of a free slot.
pub(super) const EMPTY_SLOT: GpuInstance = GpuInstance {
    world_from_object: [[0.0; 4]; 3],
    object_from_world: [[0.0; 4]; 3],
    previous_world_from_object: [[0.0; 4]; 3],
    blas_root: NONE,
    first_triangle: 0,
    triangle_count: 0,
    material: 0,
    first_light: NONE,
    flags: 0,
    layers: 0,
    entity: 0,
};

/// The record of a slot that becomes free, which had this one.
pub(super) fn freed(record: &GpuInstance) -> GpuInstance {
    if is_planted(Fault::StaleSlot) { *record } else { EMPTY_SLOT }
}

/// The record without its transforms, its place in the table of lights, and whether the last frame had it.  The rest must not change:
/// temporal reuse has the transforms of both frames and maps light ids from one table to the other, but it has one material and one mesh
/// for a slot.
pub(super) fn without_placement(instance: &GpuInstance) -> GpuInstance {
    let zero = Rows::default();
    GpuInstance {
        world_from_object: zero,
        object_from_world: zero,
        previous_world_from_object: zero,
        first_light: NONE,
        flags: instance.flags & !(INSTANCE_APPEARED | INSTANCE_GONE),
        ..*instance
    }
}

/// The part of a record that follows from a transform, and the world bounds.
pub(super) struct Placement {
    pub world_from_object: Rows,
    pub object_from_world: Rows,
    pub is_mirrored: bool,
    pub bounds: Bounds,
}

impl Placement {
    /// The placement of an instance with these bounds in object space; `None` if its transform cannot be used.
    pub(super) fn new(transform: &Affine3A, bounds: &Bounds) -> Option<Self> {
        let world_from_object = tlas::rows(transform);
        Some(Self {
            object_from_world: tlas::inverse(&world_from_object)?,
            is_mirrored: transform.matrix3.determinant() < 0.0,
            bounds: tlas::world_bounds(&world_from_object, bounds)?,
            world_from_object,
        })
    }
}

fn flags_of(is_mirrored: bool, mesh: &MeshEntry, material: &GpuMaterial) -> u32 {
    let mut flags = 0;
    if is_mirrored {
        flags |= INSTANCE_MIRRORED;
    }
    if material.flags & (MATERIAL_ALPHA_MASK | MATERIAL_ALPHA_BLEND) != 0 {
        flags |= INSTANCE_ALPHA;
    }
    if !mesh.second_uvs.is_empty() {
        flags |= INSTANCE_SECOND_UV;
    }
    if !mesh.colors.is_empty() {
        flags |= INSTANCE_VERTEX_COLORS;
    }
    flags
}

/// Bits of the cameras that see an instance directly.
pub(super) fn seen_by(extracted: &ExtractedInstance) -> u32 {
    if extracted.is_stand_in { 0 } else { extracted.camera_mask }
}

/// Why an instance has no record.
pub(super) enum Absence {
    /// Its mesh is left out, or the device cannot bind its material.
    LeftOut,
    /// Its mesh or its material is missing.
    Asset,
    /// The shaders that pose bodies are not compiled yet.
    Shaders,
    /// Its transform cannot be used.
    Transform,
}

/// The mesh to show: that of the instance, or the one that it had `last` while its own is built.  A posed mesh has no substitute.
pub(super) fn shown_mesh(
    extracted: &ExtractedInstance,
    last: Option<&LiveInstance>,
    meshes: &MeshPool,
) -> AssetId<Mesh> {
    let waits = meshes.get(extracted.mesh).is_none() && meshes.is_building(extracted.mesh) && extracted.pose.is_none();
    let last = last.map(|live| live.mesh).filter(|last| waits && meshes.get(*last).is_some());
    last.unwrap_or(extracted.mesh)
}

/// The record of an instance in its first frame with this mesh, and its world bounds.
pub(super) fn new_record(
    extracted: &ExtractedInstance,
    mesh_id: AssetId<Mesh>,
    sources: &mut InstanceSources,
) -> Result<(GpuInstance, Bounds), Absence> {
    let InstanceSources { meshes, bodies, materials, .. } = sources;
    let (Some(mesh), Some(material)) = (meshes.get(mesh_id), materials.slot(extracted.material)) else {
        let is_left_out = meshes.is_left_out(mesh_id) || materials.is_left_out(extracted.material);
        return Err(if is_left_out { Absence::LeftOut } else { Absence::Asset });
    };
    let body = bodies.get(extracted.entity);
    if body.is_some() && !bodies.is_ready() {
        return Err(Absence::Shaders);
    }
    let (root, triangles, bounds) = match body {
        Some(body) => (body.root(), body.triangles(), body.bounds),
        None => (mesh.root(), mesh.triangles.clone(), mesh.bounds),
    };
    let placed = body.and_then(Body::place).unwrap_or(&extracted.world_from_object);
    let placement = Placement::new(placed, &bounds).ok_or(Absence::Transform)?;
    let Placement { world_from_object, object_from_world, is_mirrored, bounds } = placement;
    let mut flags = flags_of(is_mirrored, mesh, materials.get(material).ok_or(Absence::LeftOut)?);
    if body.is_some() {
        flags |= INSTANCE_DEFORMED;
    }
    let instance = GpuInstance {
        world_from_object,
        object_from_world,
        previous_world_from_object: world_from_object,
        blas_root: root,
        first_triangle: triangles.start,
        triangle_count: triangles.end - triangles.start,
        material,
        first_light: NONE,
        flags,
        layers: if extracted.casts_shadows { extracted.camera_mask } else { 0 } | seen_by(extracted) << MAX_LAYER_SETS,
        entity: extracted.entity.index_u32(),
    };
    Ok((instance, bounds))
}
