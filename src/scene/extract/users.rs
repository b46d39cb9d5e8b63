//! The instances that use each mesh or material.

use bevy::{
    platform::collections::HashMap,
    render::sync_world::{MainEntity, MainEntityHashSet},
};
use core::hash::Hash;

/// The instances that use each asset.
#[derive(Debug)]
pub(super) struct Users<K>(HashMap<K, MainEntityHashSet>);

impl<K> Default for Users<K> {
    fn default() -> Self {
        Self(HashMap::default())
    }
}

impl<K: Copy + Eq + Hash> Users<K> {
    pub(super) fn change(&mut self, entity: MainEntity, old: Option<K>, new: Option<K>) {
        if old == new {
            return;
        }
        if let Some(id) = old
            && let Some(users) = self.0.get_mut(&id)
        {
            users.remove(&entity);
            if users.is_empty() {
                self.0.remove(&id);
            }
        }
        if let Some(id) = new {
            self.0.entry(id).or_default().insert(entity);
        }
    }

    pub(super) fn of(&self, id: K) -> impl Iterator<Item = MainEntity> {
        self.0.get(&id).into_iter().flatten().copied()
    }

    /// All assets in use, each with its instances.
    pub(super) fn all(&self) -> impl Iterator<Item = (K, &MainEntityHashSet)> {
        self.0.iter().map(|(id, users)| (*id, users))
    }
}
