//! Partners of pixels in integers: a table of the permutation of a tile, instead of its inverse.

/// `pcg4d` of `shaders/common/rng.wgsl`.
pub fn pcg4d(seed: [u32; 4]) -> [u32; 4] {
    let mut v = seed.map(|s| s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mix = |v: &mut [u32; 4]| {
        for (to, a, b) in [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)] {
            v[to] = v[to].wrapping_add(v[a].wrapping_mul(v[b]));
        }
    };
    mix(&mut v);
    v = v.map(|x| x ^ x >> 16);
    mix(&mut v);
    v
}

/// The number of a place in its tile, and the place.
fn numbered(x: u32, y: u32, bits: u32, keys: [u32; 3]) -> [u32; 2] {
    let scramble = |number: u32, key: u32| {
        let h = (number ^ key).wrapping_mul(0x9e37_79b1);
        let h = (h ^ h >> 15).wrapping_mul(0x85eb_ca6b);
        (h ^ h >> 13).wrapping_mul(0xc2b2_ae35) >> (32 - bits)
    };
    keys.into_iter().fold([x, y], |[x, y], key| [y, x ^ scramble(y, key)])
}

/// The partner of a pixel in tiles of 2^`bits` pixels a side.
pub fn partner(pixel: [u32; 2], bits: u32, frame: u32, stream: u32, slot: u32) -> [i64; 2] {
    let side = 1i64 << bits;
    let [x, y, salt @ ..] = pcg4d([slot, frame, stream, 0]);
    let offset = [x, y].map(|o| i64::from(o) % side);
    let shifted = [0, 1].map(|i| i64::from(pixel[i]) + offset[i]);
    let tile = shifted.map(|s| s / side);
    let [keys @ .., mask] = pcg4d([tile[0] as u32, tile[1] as u32, salt[0], salt[1]]);
    let difference = 1 + u64::from(mask) % ((side * side) as u64 - 1);
    let [high, low] = [difference / side as u64, difference % side as u64].map(|d| d as u32);
    let [own_x, own_y] = shifted.map(|s| (s % side) as u32);
    let [a, b] = numbered(own_x, own_y, bits, keys);
    let places = (0..side as u32).flat_map(|y| (0..side as u32).map(move |x| (x, y)));
    let (x, y) = { places }
        .find(|&(x, y)| numbered(x, y, bits, keys) == [a ^ low, b ^ high])
        .expect("the cipher is a permutation");
    [tile[0] * side + i64::from(x) - offset[0], tile[1] * side + i64::from(y) - offset[1]]
}
