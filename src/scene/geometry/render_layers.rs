//! Maps the `RenderLayers` of cameras to bits, so that a ray tests one bit per instance.
//!
//! Each distinct set of layers of the `Restir` cameras gets a bit, and each instance and light a mask of the cameras that see it.  A scene
//! in which all cameras see everything needs no test.

use bevy::{camera::visibility::RenderLayers, ecs::prelude::*, log::warn, render::Extract};

use crate::settings::Restir;

/// Maximum number of distinct sets of layers: the instance masks of ray-tracing hardware have eight bits.
pub(crate) const MAX_LAYER_SETS: usize = 8;
/// The mask of all sets.
pub(crate) const ALL_CAMERAS: u32 = (1 << MAX_LAYER_SETS) - 1;

/// The distinct sets of layers of the `Restir` cameras, by bit.
#[derive(Resource, Debug, Default)]
pub(crate) struct LayerSets {
    sets: Vec<RenderLayers>,
    warned: bool,
    /// Counts changes of the sets.
    pub revision: u64,
}

impl LayerSets {
    /// Updates the sets from the layers of all cameras.  A set keeps its bit until a set with a lower bit is removed.
    fn update<'a>(&mut self, cameras: impl Iterator<Item = &'a RenderLayers>) {
        let mut new: Vec<RenderLayers> = Vec::new();
        for layers in cameras {
            if !new.contains(layers) {
                new.push(layers.clone());
            }
        }
        let last = self.sets.clone();
        self.sets.retain(|set| new.contains(set));
        new.retain(|set| !self.sets.contains(set));
        self.sets.append(&mut new);
        if self.sets.len() > MAX_LAYER_SETS && !core::mem::replace(&mut self.warned, true) {
            warn!(
                "restir: cameras have {} different sets of render layers, but only {MAX_LAYER_SETS} are supported; the other \
                 cameras see every object that some camera sees",
                self.sets.len()
            );
        }
        self.sets.truncate(MAX_LAYER_SETS);
        self.revision += u64::from(self.sets != last);
    }

    /// The bit of a camera.  A camera whose set has no bit gets all bits, so it sees all that any camera sees.
    pub(crate) fn bit_of(&self, camera: Option<&RenderLayers>) -> u32 {
        let layers = camera.unwrap_or_default();
        self.sets.iter().position(|set| set == layers).map_or(ALL_CAMERAS, |bit| 1 << bit)
    }

    /// The bits of the cameras that see an instance or a light with these layers.
    pub(crate) fn camera_mask(&self, layers: Option<&RenderLayers>) -> u32 {
        let layers = layers.unwrap_or_default();
        let bits = self.sets.iter().enumerate().filter(|(_, set)| set.intersects(layers));
        let bits = bits.fold(0u32, |bits, (bit, _)| bits | 1 << bit);
        // If all cameras see it, the mask must not change when cameras are added or removed, for a change would reset histories.
        if bits.count_ones() as usize == self.sets.len() { ALL_CAMERAS } else { bits }
    }
}

/// Updates [`LayerSets`].  Runs before the systems that read the bits.
pub(crate) fn extract_layers(
    mut sets: ResMut<LayerSets>,
    cameras: Extract<Query<Option<&RenderLayers>, With<Restir>>>,
) {
    sets.update(cameras.iter().map(Option::unwrap_or_default));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sets(cameras: &[RenderLayers]) -> LayerSets {
        let mut sets = LayerSets::default();
        sets.update(cameras.iter());
        sets
    }

    #[test]
    fn cameras_see_entities_that_share_a_layer_with_them() {
        let layers = [RenderLayers::layer(0), RenderLayers::from_layers(&[1, 70]), RenderLayers::layer(0)];
        let sets = sets(&layers);
        let [first, second, third] = layers.each_ref().map(|l| sets.bit_of(Some(l)));
        assert!(first == third && first != second && first.count_ones() == 1 && second.count_ones() == 1);
        assert_eq!(sets.camera_mask(None), first, "no component is layer 0");
        assert_eq!(sets.camera_mask(Some(&RenderLayers::from_layers(&[70]))), second);
        assert_eq!(sets.camera_mask(Some(&RenderLayers::layer(2))), 0);
        assert_eq!(sets.camera_mask(Some(&RenderLayers::from_layers(&[0, 1]))), ALL_CAMERAS);
        assert_eq!(sets.bit_of(None), first);
    }

    #[test]
    fn entities_are_kept_without_cameras_and_extra_cameras_see_everything() {
        assert_eq!(sets(&[]).camera_mask(Some(&RenderLayers::layer(5))), ALL_CAMERAS);
        let many: Vec<_> = (0..12).map(RenderLayers::layer).collect();
        let sets = sets(&many);
        assert_eq!(sets.bit_of(Some(&many[11])), ALL_CAMERAS);
        assert_eq!(sets.bit_of(Some(&many[7])), 1 << 7);
    }

    #[test]
    fn a_set_keeps_its_bit_when_another_is_added() {
        let mut sets = sets(&[RenderLayers::layer(3), RenderLayers::layer(1)]);
        let bit = sets.bit_of(Some(&RenderLayers::layer(3)));
        sets.update([RenderLayers::layer(2), RenderLayers::layer(3)].iter());
        assert_eq!(sets.bit_of(Some(&RenderLayers::layer(3))), bit);
    }
}
