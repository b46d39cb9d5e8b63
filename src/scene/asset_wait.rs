//! Tracks assets that have not reached the render world yet, so that `RestirReport::ready` waits for those that are still loading.

use bevy::{
    asset::{AssetServer, LoadState, UntypedAssetId},
    platform::collections::HashMap,
};

/// Frames that a loaded asset may take to reach the render world.  The asset server reports a load at once, but extraction brings the asset
/// later, and the main world runs ahead of the render world.
const MAX_DELAY: u32 = 3;

/// Assets that are loaded but have not reached the render world.
#[derive(Default)]
pub(crate) struct AssetWait {
    frame: u32,
    /// The frames in which each was first seen as loaded, and in which something last waited for it.
    loaded: HashMap<UntypedAssetId, (u32, u32)>,
}

impl AssetWait {
    /// Starts a frame.  Forgets assets that have arrived, for which nothing waits.
    pub(crate) fn begin_frame(&mut self) {
        let last = self.frame;
        self.frame = last.wrapping_add(1);
        self.loaded.retain(|_, (_, asked)| *asked == last);
    }

    /// Whether a missing asset will still arrive.  An asset that failed to load, or that nothing loads, will not.
    pub(crate) fn is_pending(&mut self, id: impl Into<UntypedAssetId>, assets: &AssetServer) -> bool {
        let id = id.into();
        self.is_pending_in_state(id, &assets.load_state(id))
    }

    fn is_pending_in_state(&mut self, id: UntypedAssetId, state: &LoadState) -> bool {
        if state.is_loaded() {
            let (since, asked) = self.loaded.entry(id).or_insert((self.frame, self.frame));
            *asked = self.frame;
            return self.frame.wrapping_sub(*since) < MAX_DELAY;
        }
        self.loaded.remove(&id);
        state.is_loading()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::{asset::AssetId, image::Image};

    #[test]
    fn assets_are_pending_while_they_load_and_shortly_after() {
        let mut wait = AssetWait::default();
        let id = AssetId::<Image>::default().untyped();
        let mut in_five_frames = |state: LoadState| {
            [(); 5].map(|()| {
                wait.begin_frame();
                // Repeated queries in a frame agree.
                let [a, b] = [(); 2].map(|()| wait.is_pending_in_state(id, &state));
                assert_eq!(a, b);
                a
            })
        };
        assert_eq!(in_five_frames(LoadState::Loading), [true; 5]);
        assert_eq!(in_five_frames(LoadState::Loaded), [true, true, true, false, false]);
        assert_eq!(in_five_frames(LoadState::NotLoaded), [false; 5]);
        assert_eq!(in_five_frames(LoadState::Loaded), [true, true, true, false, false], "loaded a second time");
        wait.begin_frame();
        wait.begin_frame();
        assert!(wait.loaded.is_empty(), "nothing waits for the asset");
    }
}
