//! Light ids of this frame and the last one: temporal reuse finds the light of a sample in the other frame by them.

use bevy::{platform::collections::HashMap, render::sync_world::MainEntity};

use crate::{
    gpu_layout::NONE,
    planted::{Fault, is_planted},
};

/// Owner of lights: a Bevy light, or an emissive mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Owner {
    pub entity: MainEntity,
    /// `LIGHT_*`.  A light that changes its kind is a different light, because samples on it are parameterized differently.
    pub kind: u32,
}

/// Lights of one owner: `first..first + count` in the table.  Each group has a bin of its own; bins and groups have the same order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Group {
    pub owner: Owner,
    pub first: u32,
    pub count: u32,
}

/// First lights of the groups of each frame in the other frame; `NONE` for groups that the other frame does not have.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct LightRemap {
    /// By the bins of this frame: the group of the last frame that corresponds.
    pub previous_groups: Vec<Option<usize>>,
    /// By the bins of this frame.
    pub previous_from_current: Vec<u32>,
    /// By the bins of the last frame.
    pub current_from_previous: Vec<u32>,
}

impl LightRemap {
    /// Groups correspond if their owners are equal and own equally many lights.
    pub(super) fn new(old: &[Group], new: &[Group]) -> Self {
        let by_owner: HashMap<Owner, usize> = old.iter().enumerate().map(|(i, g)| (g.owner, i)).collect();
        let counterpart = |group: &Group| by_owner.get(&group.owner).copied().filter(|i| old[*i].count == group.count);
        let previous_groups: Vec<_> = new.iter().map(counterpart).collect();
        let mut map = Self {
            previous_from_current: vec![NONE; new.len()],
            current_from_previous: vec![NONE; old.len()],
            previous_groups,
        };
        for (bin, (group, before)) in new.iter().zip(&map.previous_groups).enumerate() {
            let Some(before) = *before else { continue };
            let first_before = if is_planted(Fault::LightNotRemapped) { group.first } else { old[before].first };
            map.previous_from_current[bin] = first_before;
            map.current_from_previous[before] = group.first;
        }
        map
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu_layout::{LIGHT_SPHERE, LIGHT_TRIANGLE};
    use bevy::ecs::entity::Entity;

    fn group(entity: u32, first: u32, count: u32) -> Group {
        let entity = Entity::from_raw_u32(entity).expect("a valid index").into();
        Group { owner: Owner { entity, kind: LIGHT_TRIANGLE }, first, count }
    }

    #[test]
    fn remapping_a_group_there_and_back_is_the_identity() {
        let old = [group(1, 0, 1), group(2, 3, 5), group(3, 8, 2)];
        let new = [group(3, 4, 2), group(4, 6, 7), group(2, 13, 5), group(1, 3, 3)];
        let map = LightRemap::new(&old, &new);
        assert_eq!(
            map.previous_groups,
            [Some(2), None, Some(1), None],
            "entity 4 is new, and entity 1 has other lights"
        );
        assert_eq!(map.previous_from_current, [8, NONE, 3, NONE]);
        assert_eq!(map.current_from_previous, [NONE, 13, 4]);
        let mut sphere = group(2, 3, 5);
        sphere.owner.kind = LIGHT_SPHERE;
        let map = LightRemap::new(&old, &[sphere]);
        assert_eq!(map.previous_from_current, [NONE], "the kind of entity 2 has changed");
    }
}
