//! Extracts the poses of skinned and morphed meshes.

use bevy::{
    asset::Assets,
    ecs::{prelude::*, system::SystemParam},
    math::Affine3A,
    mesh::{
        morph::{MeshMorphWeights, MorphWeights},
        skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    },
    transform::components::GlobalTransform,
};

use crate::scene::geometry::rig::Pose;

/// The data that poses depend on, apart from the components of an instance.
#[derive(SystemParam)]
pub(crate) struct PoseSources<'w, 's> {
    inverse_bindposes: Option<Res<'w, Assets<SkinnedMeshInverseBindposes>>>,
    joints: Query<'w, 's, &'static GlobalTransform>,
    weights: Query<'w, 's, &'static MorphWeights>,
}

impl PoseSources<'_, '_> {
    /// The pose of an instance; `None` if nothing bends it.
    pub(super) fn pose(&self, skin: Option<&SkinnedMesh>, morph: Option<&MeshMorphWeights>) -> Option<Box<Pose>> {
        if skin.is_none() && morph.is_none() {
            return None;
        }
        let weights = morph.map(|morph| match morph {
            MeshMorphWeights::Value { weights } => weights.clone(),
            MeshMorphWeights::Reference(entity) => {
                self.weights.get(*entity).map_or(Vec::new(), |weights| weights.weights().to_vec())
            }
        });
        let joints = skin.and_then(|skin| self.joints(skin)).unwrap_or_default();
        Some(Box::new(Pose::new(joints, weights.unwrap_or_default())))
    }

    /// For each joint the transform from the mesh at rest to the world; `None` while the skin is not loaded.  A joint that does not exist
    /// counts as one without a transform.
    fn joints(&self, skin: &SkinnedMesh) -> Option<Vec<Affine3A>> {
        let bindposes = self.inverse_bindposes.as_ref()?.get(&skin.inverse_bindposes)?;
        let joints = skin.joints.iter().zip(bindposes.iter()).map(|(&joint, bindpose)| {
            let world_from_joint = self.joints.get(joint).map_or(Affine3A::IDENTITY, GlobalTransform::affine);
            world_from_joint * Affine3A::from_mat4(*bindpose)
        });
        Some(joints.collect())
    }
}
