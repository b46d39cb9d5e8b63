//! Sums over all live instances, kept up to date as instances come and go.

use super::instance_record::LiveInstance;
use super::render_layers::{ALL_CAMERAS, MAX_LAYER_SETS};
use crate::scene::features::SceneFeatures;

/// Sums over the live instances.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Totals {
    pub instances: u64,
    pub triangles: u64,
    /// Number of instances that need each feature, by the feature's bit.
    features: [u32; u64::BITS as usize],
    /// Number of instances that only cameras see, or that only other rays hit.
    camera_dependent: u32,
    /// For each camera bit, the number of instances that rays of another camera hit and those of this one do not.
    hidden: [u32; MAX_LAYER_SETS],
}

impl Default for Totals {
    fn default() -> Self {
        let features = [0; u64::BITS as usize];
        Self { instances: 0, triangles: 0, features, camera_dependent: 0, hidden: [0; MAX_LAYER_SETS] }
    }
}

impl Totals {
    pub(crate) fn add(&mut self, live: &LiveInstance) {
        self.count(live, |sum, n| sum + n);
    }

    pub(crate) fn subtract(&mut self, live: &LiveInstance) {
        self.count(live, |sum, n| sum - n);
    }

    fn count(&mut self, live: &LiveInstance, change: fn(u64, u64) -> u64) {
        self.instances = change(self.instances, 1);
        self.triangles = change(self.triangles, live.triangles.into());
        let count = |sum: &mut u32| *sum = change(u64::from(*sum), 1) as u32;
        bits(live.features.bits()).for_each(|bit| count(&mut self.features[bit]));
        if (live.ray_mask == 0) != (live.camera_mask == 0) {
            count(&mut self.camera_dependent);
        }
        // Instances with `NotShadowCaster` are in no tree, so no ray tests their masks.
        if live.ray_mask != 0 {
            bits(u64::from(ALL_CAMERAS & !live.ray_mask)).for_each(|bit| count(&mut self.hidden[bit]));
        }
    }

    /// Features that some instance needs.
    pub(crate) fn features(&self) -> SceneFeatures {
        SceneFeatures::from_bits_truncate(mask(&self.features))
    }

    /// Whether there is an instance that only cameras see, or that only other rays hit.
    pub(crate) fn has_camera_dependent_objects(&self) -> bool {
        self.camera_dependent > 0
    }

    /// Bits of the cameras whose rays do not hit some instance that rays of another camera hit.
    pub(crate) fn hidden_from(&self) -> u32 {
        mask(&self.hidden) as u32
    }
}

/// Positions of the set bits.
fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let bit = mask.trailing_zeros();
        (bit < u64::BITS).then(|| {
            mask &= mask - 1;
            bit as usize
        })
    })
}

/// The bits whose counts are not 0.
fn mask(counts: &[u32]) -> u64 {
    counts.iter().enumerate().fold(0, |mask, (bit, count)| mask | u64::from(*count > 0) << bit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::{asset::AssetId, ecs::entity::Entity};

    #[test]
    fn an_instance_that_leaves_is_no_longer_counted() {
        let live = |features, camera_mask, ray_mask| LiveInstance {
            entity: Entity::PLACEHOLDER.into(),
            mesh: AssetId::default(),
            material: 0,
            camera_mask,
            ray_mask,
            triangles: 7,
            features,
            emits: false,
            bounds: ([0.0; 3], [1.0; 3]),
        };
        let [a, b] = [SceneFeatures::ALPHA, SceneFeatures::ALPHA | SceneFeatures::LIGHT_SHAPES];
        let all = [live(a, ALL_CAMERAS, ALL_CAMERAS), live(b, 0, 1), live(a, 2, 0)];
        let mut totals = Totals::default();
        all.iter().for_each(|live| totals.add(live));
        assert_eq!((totals.instances, totals.triangles), (3, 21));
        let sums = |totals: &Totals| (totals.features(), totals.has_camera_dependent_objects(), totals.hidden_from());
        assert_eq!(sums(&totals), (b, true, ALL_CAMERAS & !1));
        totals.subtract(&all[1]);
        assert_eq!(sums(&totals), (a, true, 0));
        totals.subtract(&all[2]);
        assert!(!totals.has_camera_dependent_objects());
        totals.subtract(&all[0]);
        assert_eq!(totals, Totals::default());
    }
}
