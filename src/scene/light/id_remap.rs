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

/// Lights of one owner: `first..first + count` in the table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Group {
    pub owner: Owner,
    pub first: u32,
    pub count: u32,
}

/// Ids of the lights of each frame in the other frame; `NONE` for lights that the other frame does not have.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct LightRemap {
    /// By this frame's ids.
    pub previous_from_current: Vec<u32>,
    /// By the last frame's ids.
    pub current_from_previous: Vec<u32>,
}

impl LightRemap {
    /// Lights correspond if their owners are equal and own equally many lights.
    pub(super) fn new(old: &[Group], old_count: u32, new: &[Group], new_count: u32) -> Self {
        let by_owner: HashMap<Owner, &Group> = old.iter().map(|g| (g.owner, g)).collect();
        let mut map = Self {
            previous_from_current: vec![NONE; new_count as usize],
            current_from_previous: vec![NONE; old_count as usize],
        };
        for group in new {
            let Some(before) = by_owner.get(&group.owner).filter(|b| b.count == group.count) else {
                continue;
            };
            let first_before = if is_planted(Fault::LightNotRemapped) { group.first } else { before.first };
            for i in 0..group.count {
                map.previous_from_current[(group.first + i) as usize] = first_before + i;
                map.current_from_previous[(before.first + i) as usize] = group.first + i;
            }
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
    fn remapping_a_light_there_and_back_is_the_identity() {
        let old = [group(1, 0, 1), group(2, 1, 5), group(3, 6, 2)];
        let new = [group(3, 0, 2), group(4, 2, 7), group(2, 9, 5), group(1, 14, 3)];
        let map = LightRemap::new(&old, 8, &new, 17);
        for (current, &previous) in map.previous_from_current.iter().enumerate() {
            if previous != NONE {
                assert_eq!(map.current_from_previous[previous as usize], current as u32);
            }
        }
        assert_eq!(map.current_from_previous[6], 0, "light 6 is the first of entity 3");
        assert_eq!(map.current_from_previous[0], NONE, "the number of lights of entity 1 has changed");
        assert_eq!(map.previous_from_current[2], NONE, "entity 4 is new");
        let mut sphere = group(2, 1, 5);
        sphere.owner.kind = LIGHT_SPHERE;
        let map = LightRemap::new(&old, 8, &[sphere], 6);
        assert_eq!(map.previous_from_current, [NONE; 6], "the kind of entity 2 has changed");
    }
}
