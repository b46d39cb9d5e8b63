//! Which assets that are not here are still to come.

use bevy::{
    asset::{AssetServer, LoadState, UntypedAssetId},
    platform::collections::HashMap,
};

/// Frames in which what is loaded gets here.  The main world runs ahead of the render world, which may so hear of a load before it is
/// given what was loaded.
const FRAMES: u32 = 3;

/// Loaded assets that are not here, and since which frame.
#[derive(Default)]
pub(crate) struct AssetWait {
    frame: u32,
    loaded: HashMap<UntypedAssetId, u32>,
}

impl AssetWait {
    pub(crate) fn begin_frame(&mut self) {
        self.frame = self.frame.wrapping_add(1);
    }

    /// Whether an asset that is not here is still to come.  One that failed to load, or that nobody loads, is not.
    pub(crate) fn is_pending(&mut self, id: impl Into<UntypedAssetId>, assets: &AssetServer) -> bool {
        let id = id.into();
        self.comes(id, &assets.load_state(id))
    }

    fn comes(&mut self, id: UntypedAssetId, state: &LoadState) -> bool {
        if state.is_loaded() {
            let since = *self.loaded.entry(id).or_insert(self.frame);
            return self.frame.wrapping_sub(since) < FRAMES;
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
    fn what_is_loaded_is_waited_for_a_little_and_what_is_not_is_not() {
        let mut wait = AssetWait::default();
        let id = AssetId::<Image>::default().untyped();
        let mut of_frames = |state: LoadState| {
            [(); 5].map(|()| {
                wait.begin_frame();
                // However often it is asked for.
                let [a, b] = [(); 2].map(|()| wait.comes(id, &state));
                assert_eq!(a, b);
                a
            })
        };
        assert_eq!(of_frames(LoadState::Loading), [true; 5]);
        assert_eq!(of_frames(LoadState::Loaded), [true, true, true, false, false]);
        assert_eq!(of_frames(LoadState::NotLoaded), [false; 5]);
        assert_eq!(of_frames(LoadState::Loaded), [true, true, true, false, false], "it was loaded again");
    }
}
