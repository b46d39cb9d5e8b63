//! Times of two scenes side by side.

use bevy_restir::Restir;
use bevy_restir_support::progress::Progress;

use super::Bench;

impl Bench {
    /// Milliseconds of a frame of this scene and of another one, in pairs of frames that follow one another, so that other programs slow down
    /// both of a pair.
    pub fn pairs(&mut self, other: &mut Self, settings: &Restir, progress: &Progress) -> Result<Vec<[f64; 2]>, String> {
        for bench in [&mut *self, &mut *other] {
            bench.set(settings)?;
            bench.restart(0);
            for _ in 0..bench.counts.warmup {
                bench.timed(settings, progress)?;
            }
        }
        let frames = self.counts.frames;
        let pair = |i: u32| {
            // Each is the first one in every second pair.
            if i.is_multiple_of(2) {
                let own = self.timed(settings, progress)?;
                return Ok([own, other.timed(settings, progress)?]);
            }
            let theirs = other.timed(settings, progress)?;
            Ok([self.timed(settings, progress)?, theirs])
        };
        (0..frames).map(pair).collect()
    }

    /// Milliseconds of all passes of the next frame.
    fn timed(&mut self, settings: &Restir, progress: &Progress) -> Result<f64, String> {
        self.times.clear();
        self.step(progress)?;
        self.times.sample(self.app.world(), settings);
        Ok(self.times.frame())
    }
}
