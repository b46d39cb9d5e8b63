//! Exposure that fits the brightness of a picture.

use bevy::{camera::Exposure, math::UVec2};

/// Pixels a side of a block: single pixels of a noisy picture say little about its brightness.
const BLOCK: usize = 8;
/// Middle gray, which the logarithmic mean of the luminance becomes.
const MIDDLE_GRAY: f32 = 0.18;

/// Exposure 1: a picture shows radiance as it is.
pub fn unit_exposure() -> Exposure {
    // exposure = 1/(1.2 · 2^ev100).
    Exposure { ev100: (1.0f32 / 1.2).log2() }
}

/// The luminance of a picture, measured over blocks of 8 x 8 pixels.
#[derive(Clone, Copy, Debug)]
pub struct Brightness {
    /// Share of the blocks that are not black.
    pub lit: f32,
    /// Logarithmic mean over those blocks, cd/m²; `None` where the whole picture is black.
    pub luminance: Option<f32>,
}

/// Measures a picture of linear Rec. 709 radiance, rows from the top.
pub fn measure(size: UVec2, pixels: impl IntoIterator<Item = [f32; 3]>) -> Brightness {
    let (width, height) = (size.x as usize, size.y as usize);
    let luminance: Vec<f32> = pixels.into_iter().map(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b).collect();
    let (mut logarithms, mut blocks) = (Vec::new(), 0.0);
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            let rows = top..(top + BLOCK).min(height);
            let columns = left..(left + BLOCK).min(width);
            let block = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
            let (sum, count) = block.fold((0.0, 0.0), |(sum, count), i| (sum + luminance[i], count + 1.0));
            blocks += 1.0;
            if sum > 0.0 && sum < f32::MAX {
                logarithms.push((sum / count).log2());
            }
        }
    }
    let count = logarithms.len() as f32;
    let mean = || (logarithms.iter().sum::<f32>() / count).exp2();
    Brightness { lit: count / f32::max(blocks, 1.0), luminance: (count > 0.0).then(mean) }
}

/// The exposure value at which a luminance is shown as middle gray: EV100 = log2(luminance / (1.2 · 0.18)).
pub fn ev100_for(luminance: f32) -> f32 {
    (luminance / (1.2 * MIDDLE_GRAY)).log2().clamp(-40.0, 60.0)
}
