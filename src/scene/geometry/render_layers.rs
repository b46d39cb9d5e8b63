//! Who sees what: `RenderLayers` brought down to a bit for every set of layers that a `Restir` camera has.  So any layer will do, a ray
//! asks one bit, and a scene in which all cameras see all things asks none.

use bevy::{camera::visibility::RenderLayers, ecs::prelude::*, log::warn, render::Extract};

use crate::settings::Restir;

/// Sets of layers that are told apart: as many as the masks of ray-tracing hardware have bits.
pub(crate) const MAX_LAYER_SETS: usize = 8;
/// The bits of all of them.
pub(crate) const ALL_CAMERAS: u32 = (1 << MAX_LAYER_SETS) - 1;

/// The sets of layers that cameras have.
#[derive(Resource, Debug, Default)]
pub(crate) struct LayerSets {
    sets: Vec<RenderLayers>,
    told: bool,
}

impl LayerSets {
    /// Takes the cameras' layers.  A set that stays keeps its bit, but for those before it that go.
    fn update<'a>(&mut self, cameras: impl Iterator<Item = &'a RenderLayers>) {
        let mut wanted: Vec<RenderLayers> = Vec::new();
        for layers in cameras {
            if !wanted.contains(layers) {
                wanted.push(layers.clone());
            }
        }
        self.sets.retain(|set| wanted.contains(set));
        wanted.retain(|set| !self.sets.contains(set));
        self.sets.append(&mut wanted);
        if self.sets.len() > MAX_LAYER_SETS && !core::mem::replace(&mut self.told, true) {
            warn!(
                "restir: cameras have {} different sets of render layers; from the {}th on they see what any other sees",
                self.sets.len(),
                MAX_LAYER_SETS + 1
            );
        }
        self.sets.truncate(MAX_LAYER_SETS);
    }

    /// The bit of a camera; one whose set has none sees what anyone does.
    pub(crate) fn bit_of(&self, camera: Option<&RenderLayers>) -> u32 {
        let layers = camera.unwrap_or_default();
        self.sets.iter().position(|set| set == layers).map_or(ALL_CAMERAS, |bit| 1 << bit)
    }

    /// The bits of those who see a thing of these layers.
    pub(crate) fn camera_mask(&self, thing: Option<&RenderLayers>) -> u32 {
        let layers = thing.unwrap_or_default();
        let bits = self.sets.iter().enumerate().filter(|(_, set)| set.intersects(layers));
        let bits = bits.fold(0u32, |bits, (bit, _)| bits | 1 << bit);
        // What all see does not change as cameras come and go.
        if bits.count_ones() as usize == self.sets.len() { ALL_CAMERAS } else { bits }
    }
}

/// Before anything asks for a bit.
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
    fn a_thing_is_seen_by_those_whose_layers_it_shares() {
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
    fn without_cameras_all_is_kept_and_beyond_eight_sets_all_is_seen() {
        assert_eq!(sets(&[]).camera_mask(Some(&RenderLayers::layer(5))), ALL_CAMERAS);
        let many: Vec<_> = (0..12).map(RenderLayers::layer).collect();
        let sets = sets(&many);
        assert_eq!(sets.bit_of(Some(&many[11])), ALL_CAMERAS);
        assert_eq!(sets.bit_of(Some(&many[7])), 1 << 7);
    }

    #[test]
    fn sets_that_stay_keep_their_bits() {
        let mut sets = sets(&[RenderLayers::layer(3), RenderLayers::layer(1)]);
        let bit = sets.bit_of(Some(&RenderLayers::layer(3)));
        sets.update([RenderLayers::layer(2), RenderLayers::layer(3)].iter());
        assert_eq!(sets.bit_of(Some(&RenderLayers::layer(3))), bit);
    }
}
