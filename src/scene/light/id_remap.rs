//! The lights of this frame and those of the last one.  Temporal reuse looks the light of a sample up in the other frame.

use bevy::{platform::collections::HashMap, render::sync_world::MainEntity};

/// Owner of lights: a Bevy light, or an emissive mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Owner {
    pub entity: MainEntity,
    /// `LIGHT_*`.  A light that changes its kind is a different light, because samples on it are parameterized differently.
    pub kind: u32,
}

/// The lights of one owner.  Each group has a bin of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Group {
    pub owner: Owner,
    pub count: u32,
}

/// For each new group, the old group with the same lights: that of the same owner, if it has as many lights.
pub(super) fn groups_before(old: &[Group], new: &[Group]) -> Vec<Option<usize>> {
    if old == new {
        return (0..new.len()).map(Some).collect();
    }
    let by_owner: HashMap<Owner, usize> = old.iter().enumerate().map(|(i, group)| (group.owner, i)).collect();
    new.iter().map(|group| by_owner.get(&group.owner).copied().filter(|i| old[*i].count == group.count)).collect()
}

/// For each of `old_count` old groups, the new group with the same lights.
pub(super) fn groups_after(before: &[Option<usize>], old_count: usize) -> Vec<Option<usize>> {
    let mut after = vec![None; old_count];
    for (new, old) in before.iter().enumerate() {
        if let Some(old) = *old {
            after[old] = Some(new);
        }
    }
    after
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu_layout::{LIGHT_SPHERE, LIGHT_TRIANGLE};
    use bevy::ecs::entity::Entity;

    fn group(entity: u32, count: u32) -> Group {
        let entity = Entity::from_raw_u32(entity).expect("a valid index").into();
        Group { owner: Owner { entity, kind: LIGHT_TRIANGLE }, count }
    }

    #[test]
    fn groups_of_both_frames_correspond_by_owner_and_count() {
        let old = [group(1, 1), group(2, 5), group(3, 2)];
        let new = [group(3, 2), group(4, 7), group(2, 5), group(1, 3)];
        let before = groups_before(&old, &new);
        assert_eq!(before, [Some(2), None, Some(1), None], "entity 4 is new, and entity 1 has other lights");
        assert_eq!(groups_after(&before, old.len()), [None, Some(2), Some(0)]);
        assert_eq!(groups_before(&old, &old), [Some(0), Some(1), Some(2)]);
        let mut sphere = group(2, 5);
        sphere.owner.kind = LIGHT_SPHERE;
        assert_eq!(groups_before(&old, &[sphere]), [None], "the kind of entity 2 has changed");
    }
}
