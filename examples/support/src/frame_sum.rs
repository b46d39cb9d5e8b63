//! The mean of captured frames.

use bevy_restir::CapturedRadiance;

/// A sum of captured frames.
#[derive(Default)]
pub struct FrameSum {
    pixels: Vec<[f64; 3]>,
    frames: u32,
    last: CapturedRadiance,
}

impl FrameSum {
    /// Adds the radiance of a frame: the mean of its samples.  The reference accumulates while nothing moves, so that its captures hold
    /// the samples of earlier frames, too; then only the samples count that the frame has added.
    pub fn add(&mut self, frame: CapturedRadiance) {
        self.pixels.resize(frame.pixels.len(), [0.0; 3]);
        let goes_on = self.last.samples() > 0 && frame.samples() > self.last.samples();
        for (i, (sum, pixel)) in self.pixels.iter_mut().zip(&frame.pixels).enumerate() {
            let before = self.last.pixels.get(i).filter(|_| goes_on).copied().unwrap_or_default();
            let samples = f64::from((pixel[3] - before[3]).max(1.0));
            for (channel, sum) in sum.iter_mut().enumerate() {
                *sum += (f64::from(pixel[channel]) - f64::from(before[channel])) / samples;
            }
        }
        self.frames += 1;
        self.last = frame;
    }

    /// The mean of the frames.
    pub fn mean(&self) -> Vec<[f64; 3]> {
        let frames = f64::from(self.frames.max(1));
        self.pixels.iter().map(|pixel| pixel.map(|c| c / frames)).collect()
    }
}
