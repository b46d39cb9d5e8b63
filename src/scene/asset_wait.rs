//! Tracks assets that have not reached the render world yet, so that `RestirReport::ready` waits for those that are still loading.

use bevy::{
    asset::{AssetServer, LoadState, UntypedAssetId},
    platform::collections::HashMap,
};

/// Frames that an asset may take to reach the render world, after it was loaded or an app has added it.  The asset server reports a load at
/// once, but extraction brings the asset later, and the main world runs ahead of the render world.
const MAX_DELAY: u32 = 3;

/// Assets that no loader is working on, and that have not reached the render world.
#[derive(Default)]
pub(crate) struct AssetWait {
    frame: u32,
    /// The frames in which each was first seen, and in which something last waited for it.
    waiting: HashMap<UntypedAssetId, (u32, u32)>,
}

impl AssetWait {
    /// Starts a frame.  Forgets assets that have arrived, for which nothing waits.
    pub(crate) fn begin_frame(&mut self) {
        let last = self.frame;
        self.frame = last.wrapping_add(1);
        self.waiting.retain(|_, (_, asked)| *asked == last);
    }

    /// Whether a missing asset may still arrive.  An asset that failed to load will not.
    pub(crate) fn is_pending(&mut self, id: impl Into<UntypedAssetId>, assets: &AssetServer) -> bool {
        let id = id.into();
        self.is_pending_in_state(id, &assets.load_state(id))
    }

    fn is_pending_in_state(&mut self, id: UntypedAssetId, state: &LoadState) -> bool {
        match state {
            // The server does not know an asset that an app has added itself.
            LoadState::Loaded | LoadState::NotLoaded => {
                let (since, asked) = self.waiting.entry(id).or_insert((self.frame, self.frame));
                *asked = self.frame;
                self.frame.wrapping_sub(*since) < MAX_DELAY
            }
            LoadState::Loading | LoadState::Failed(_) => {
                self.waiting.remove(&id);
                state.is_loading()
            }
        }
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
        let in_five_frames = |wait: &mut AssetWait, state: LoadState| {
            [(); 5].map(|()| {
                wait.begin_frame();
                // Repeated queries in a frame agree.
                let [a, b] = [(); 2].map(|()| wait.is_pending_in_state(id, &state));
                assert_eq!(a, b);
                a
            })
        };
        assert_eq!(in_five_frames(&mut wait, LoadState::Loading), [true; 5]);
        assert_eq!(in_five_frames(&mut wait, LoadState::Loaded), [true, true, true, false, false]);
        assert_eq!(in_five_frames(&mut wait, LoadState::Loading), [true; 5]);
        assert_eq!(
            in_five_frames(&mut wait, LoadState::Loaded),
            [true, true, true, false, false],
            "loaded a second time"
        );
        assert_eq!(in_five_frames(&mut wait, LoadState::NotLoaded), [false; 5], "no longer loaded");
        wait.begin_frame();
        wait.begin_frame();
        assert_eq!(
            in_five_frames(&mut wait, LoadState::NotLoaded),
            [true, true, true, false, false],
            "added by the app"
        );
        wait.begin_frame();
        wait.begin_frame();
        assert!(wait.waiting.is_empty(), "nothing waits for the asset");
    }
}
