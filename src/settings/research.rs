//! Settings for measurements, which apps leave alone.

use bevy::reflect::{Reflect, std_traits::ReflectDefault};

use super::validate::{Problem, Ranges};

/// Order of reservoirs in memory (Lanz 2025, 4.5.3).  It changes the speed, never the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum ReservoirLayout {
    /// Row by row.
    #[default]
    Rows,
    /// Column by column.
    Columns,
    /// Tiles of 2 x 2 pixels, row by row in each.
    Tiles2,
    /// Tiles of 4 x 4 pixels.
    Tiles4,
    /// Tiles of 8 x 8 pixels, the size of a workgroup.
    Tiles8,
    /// Tiles of 40 x 40 pixels.
    Tiles40,
}

impl ReservoirLayout {
    /// Width of a tile in pixels; 0: rows, `u32::MAX`: columns.
    pub(crate) fn tile(self) -> u32 {
        match self {
            Self::Rows => 0,
            Self::Columns => u32::MAX,
            Self::Tiles2 => 2,
            Self::Tiles4 => 4,
            Self::Tiles8 => 8,
            Self::Tiles40 => 40,
        }
    }
}

/// Variants that papers compare and apps need not choose.  Not part of the prelude.
#[derive(Clone, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
#[reflect(Default)]
pub struct Research {
    /// Order of reservoirs in memory.  It changes the speed, and the image only by other noise where light paths of `Bdpt` move.  Default:
    /// [`ReservoirLayout::Rows`].
    pub reservoir_layout: ReservoirLayout,
    /// Width in pixels of the square tiles whose pixels share a light subset (Wyman and Panteleev 2021, 5).  Larger tiles read memory more
    /// coherently; their noise is more correlated.  No bias.  1 to 16; default 8.
    pub light_tile_size: u32,
    /// Selects the light candidates of ReSTIR DI by arriving light, without the BSDF (Wyman and Panteleev 2021, 9 and 3.3): faster
    /// candidates, more noise on glossy surfaces.  No bias.  Default: off.
    pub target_without_bsdf: bool,
    /// Ends dark paths at random, from their third scattering event on, in [`Technique::Pt`](super::Technique::Pt) and the paths of `Gi` and
    /// `Bdpt` (Lin et al. 2026, supplement, 6).  Without it all paths go on to [`Restir::bounces`](super::Restir::bounces): a little less
    /// noise for many more rays.  No bias.  Default: on.
    pub russian_roulette: bool,
    /// Where pixels are paired ([`Reuse::paired`](super::Reuse::paired)), shifts that replay paths run in a pass of their own, over a queue
    /// of their pixels, so that threads without a replay do not wait for those with one (replay compaction, Lin et al. 2026, supplement,
    /// Table 1).  It changes the speed, never the image.  Memory: 8 bytes a pixel.  Default: on.
    pub replay_compaction: bool,
    /// Greatest number of rays of one dispatch, and of all passes in one submission to the GPU, by an upper estimate from the settings: a pass
    /// with more rays runs over bands of the picture, and a frame with more has several submissions.  Without a limit, a driver may reset a
    /// GPU that is busy for seconds.  Smaller values are safer on slow devices, and cost CPU time for each submission and a little GPU time at
    /// the end of each band.  It never changes the image.  A row of workgroups, 8 pixels high, is always one dispatch.  0, the default, leaves
    /// the choice to the device: 2^29 on a graphics card (one submission for a frame of the default settings with 1920 x 1080 pixels, two with
    /// four times as many), 2^26 on a GPU without memory of its own (four or more), and no limit on a CPU.
    pub rays_per_dispatch: u32,
}

impl Default for Research {
    fn default() -> Self {
        Self {
            reservoir_layout: ReservoirLayout::default(),
            light_tile_size: 8,
            target_without_bsdf: false,
            russian_roulette: true,
            replay_compaction: true,
            rays_per_dispatch: 0,
        }
    }
}

impl Research {
    /// Brings every field into its range.
    pub(super) fn clamp(&mut self, report: &mut dyn FnMut(Problem)) {
        let mut ranges = Ranges { path: "research.", report };
        ranges.count("light_tile_size", &mut self.light_tile_size, 1, 16);
    }
}
