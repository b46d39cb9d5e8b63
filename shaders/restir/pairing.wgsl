// Pairs of pixels for paired spatial reuse (Lin et al. 2026; Table 1 of its supplement has the cost): a random involution of the plane.
// The plane is cut into square tiles at a random place.  In each tile a random permutation numbers the pixels, and partners have numbers
// that differ by a random mask.  The mask alone makes every other pixel of the tile equally likely; the permutation makes the pairs of a
// tile unlike each other.
#define_import_path bevy_restir::restir::pairing

#import bevy_restir::common::rng::pcg4d

// The random numbers of an involution: the offset of the tiles, and a salt for the keys of their permutations.
struct PairKey {
    offset: vec2<u32>,
    salt: vec2<u32>,
}

// `stream`: with the user's seed.  Each slot of an iteration has an involution of its own.
fn pair_key(frame: u32, stream: u32, slot: u32) -> PairKey {
    let bits = pcg4d(vec4<u32>(slot, frame, stream, 0u));
    return PairKey(bits.xy, bits.zw);
}

// The partner of a pixel, which may lie outside of the image; left of it or above, its coordinates are huge.  Tiles have 2^`tile_bits`
// pixels a side, at least 2.
fn partner_of(pixel: vec2<u32>, tile_bits: u32, key: PairKey) -> vec2<u32> {
    let mask = (1u << tile_bits) - 1u;
    let offset = key.offset & vec2<u32>(mask);
    let shifted = pixel + offset;
    let tile_key = pcg4d(vec4<u32>(shifted >> vec2<u32>(tile_bits), key.salt));
    // Not 0: no pixel is its own partner.
    let difference = 1u + tile_key.w % ((1u << (2u * tile_bits)) - 1u);
    let number = permuted(shifted & vec2<u32>(mask), tile_bits, tile_key.xyz);
    let partner = unpermuted(number ^ vec2<u32>(difference & mask, difference >> tile_bits), tile_bits, tile_key.xyz);
    return (shifted & vec2<u32>(~mask)) + partner - offset;
}

// A Feistel cipher of the two coordinates, in three rounds.
fn permuted(place: vec2<u32>, bits: u32, round_keys: vec3<u32>) -> vec2<u32> {
    var keys = round_keys;
    var v = place;
    for (var i = 0u; i < 3u; i++) {
        v = vec2<u32>(v.y, v.x ^ scrambled(v.y, keys[i], bits));
    }
    return v;
}

// The inverse of `permuted`.
fn unpermuted(number: vec2<u32>, bits: u32, round_keys: vec3<u32>) -> vec2<u32> {
    var keys = round_keys;
    var v = number;
    for (var i = 0u; i < 3u; i++) {
        v = vec2<u32>(v.y ^ scrambled(v.x, keys[2u - i], bits), v.x);
    }
    return v;
}

// `bits` bits that depend on all bits of a number and its key.
fn scrambled(number: u32, key: u32, bits: u32) -> u32 {
    var h = (number ^ key) * 0x9e3779b1u;
    h = (h ^ (h >> 15u)) * 0x85ebca6bu;
    h = (h ^ (h >> 13u)) * 0xc2b2ae35u;
    return h >> (32u - bits);
}
