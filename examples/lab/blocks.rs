//! Means over the square blocks of a picture.

/// Side of a block in pixels, where the user does not choose it.
pub const SIDE: usize = 8;

/// A block; those at the right and at the bottom of a picture may be incomplete.
pub struct Block {
    /// Mean over its pixels.
    pub mean: f64,
    /// Number of its pixels.
    pub pixels: f64,
}

/// The blocks of a picture, in rows from the top. `values`: one for each pixel.
pub fn of(values: impl ExactSizeIterator<Item = f64>, width: usize, side: usize) -> Vec<Block> {
    let across = width.div_ceil(side);
    let mut sums = vec![(0.0, 0.0); across * (values.len() / width).div_ceil(side)];
    for (i, value) in values.enumerate() {
        let sum = &mut sums[i / width / side * across + i % width / side];
        *sum = (sum.0 + value, sum.1 + 1.0);
    }
    sums.into_iter().map(|(sum, pixels)| Block { mean: sum / pixels, pixels }).collect()
}
