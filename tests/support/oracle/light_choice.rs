//! The choice of a light from a table of two levels, in f64 and in integers of 64 bits.

use super::pairs::pcg4d;
use bevy_restir::testing::light::alias_table::AliasEntry;

/// A bin of the table: a single light, or a mesh with a table over its triangles.
pub struct Bin {
    pub entry: AliasEntry,
    pub triangles: Vec<AliasEntry>,
}

/// The bin and the triangle that 2 x 24 random bits choose beside an environment of this probability; `None`: the environment.
pub fn choose(bins: &[Bin], bits: [u32; 2], environment: f64) -> Option<(usize, usize)> {
    let y = f64::from(bits[1]) / f64::from(1 << 24);
    if y < environment {
        return None;
    }
    let [a, b, c, d] = pcg4d([bits[0], bits[1], 0, 0]);
    // One number of 64 bits: the place in the table, with a fine digit between the steps of its first 32 bits.
    let place = (u64::from(bits[0] << 8 | a >> 24) << 32 | u64::from(c)) as u128 * bins.len() as u128;
    let (bin, place) = ((place >> 64) as usize, (place >> 32) as u32);
    let coin = (y - environment + f64::from(b) / 2f64.powi(56)) / (1.0 - environment);
    let bin = keep(&bins[bin].entry, bin, coin);
    let triangles = &bins[bin].triangles;
    if triangles.is_empty() {
        return Some((bin, 0));
    }
    let triangle = ((u64::from(place) * triangles.len() as u64) >> 32) as usize;
    let coin = (f64::from(d) + f64::from(a & 0x00ff_ffff) / f64::from(1 << 24)) / 2f64.powi(32);
    Some((bin, keep(&triangles[triangle], triangle, coin)))
}

fn keep(entry: &AliasEntry, index: usize, coin: f64) -> usize {
    if coin < f64::from(entry.probability) { index } else { entry.alias as usize }
}
