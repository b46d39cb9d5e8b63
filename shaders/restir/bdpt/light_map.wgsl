// The light map: lists of the splats that land in each pixel.  It begins with the head of each pixel's list: an entry's index plus 1, or 0.
// Then come the entries, SPLATS_OF_A_PATH for each light sub-path, of SPLAT_WORDS words.
//
// Lists have the order of execution.  Sums and choices must not depend on it, so that the same seed gives the same picture.
#define_import_path bevy_restir::restir::bdpt::light_map

#import bevy_restir::common::constants::{FAR, ONE_MINUS_EPSILON}
#import bevy_restir::restir::stored_path::{pack_radiance, unpack_radiance}
#import bevy_restir::view::bindings::view

// Entries of one light sub-path.  A sub-path with more visible vertices resamples the last ones into one.
const SPLATS_OF_A_PATH: u32 = 3u;
const SPLAT_WORDS: u32 = 5u;
// Greatest number of entries of a list that are read, so that no invocation takes seconds.  More entries are ignored, and reported as an
// overflow.
const MAX_ENTRIES: u32 = 1u << 20u;

// Bits of a link to the next entry: there are at most 3 * 2^24.  The others hold the number of scattering events less 1.
const LINK_BITS: u32 = 26u;
const LINK_MASK: u32 = (1u << LINK_BITS) - 1u;

struct MapEntry {
    next: u32,                 // the next entry's index plus 1, or 0
    events: u32,               // scattering events of the sub-path up to the vertex, 1 to 64
    value: vec3<f32>,          // radiance
    multiplicity: f32,         // radiance over that of the vertex alone: above 1 if the entry also represents other vertices
    diffuse: u32,              // `Splat::diffuse` of the vertex
    reconnects: bool,          // `Splat::reconnects` of the vertex; stored as the sign of `multiplicity`
}

fn entry_pack(e: MapEntry) -> array<u32, SPLAT_WORDS> {
    let value = pack_radiance(e.value);
    let multiplicity = select(e.multiplicity, -e.multiplicity, e.reconnects);
    return array<u32, SPLAT_WORDS>(
        e.next | ((e.events - 1u) << LINK_BITS), value.x, value.y, bitcast<u32>(multiplicity), e.diffuse,
    );
}

fn entry_unpack(words: array<u32, SPLAT_WORDS>) -> MapEntry {
    let value = unpack_radiance(vec2<u32>(words[1], words[2]));
    let multiplicity = bitcast<f32>(words[3]);
    return MapEntry(words[0] & LINK_MASK, (words[0] >> LINK_BITS) + 1u, value, abs(multiplicity), words[4], multiplicity < 0.0);
}

// First word of the entry that a link names.
fn word_of(link: u32) -> u32 {
    return view.size.x * view.size.y + SPLAT_WORDS * (link - 1u);
}

// A sum of colors as fixed-point numbers of 64 bits.
struct ExactSum {
    low: vec3<u32>,
    high: vec3<u32>,
    scale: f32,
}

// `largest`: of the components that are added.
fn exact_sum(largest: f32) -> ExactSum {
    // A power of two that takes the largest value to at least 2^30.
    let exponent = bitcast<u32>(largest) >> 23u;
    return ExactSum(vec3<u32>(0u), vec3<u32>(0u), bitcast<f32>(clamp(284u - exponent, 1u, 254u) << 23u));
}

fn exact_add(s: ptr<function, ExactSum>, value: vec3<f32>) {
    let v = vec3<u32>(value * (*s).scale);
    (*s).low += v;
    (*s).high += select(vec3<u32>(0u), vec3<u32>(1u), (*s).low < v);
}

fn exact_total(s: ExactSum) -> vec3<f32> {
    return (vec3<f32>(s.high) * 0x1p32 + vec3<f32>(s.low)) / s.scale;
}

// A random choice in proportion to weights: each input gets an exponentially distributed time with its weight as the rate, and the least time
// wins.
struct Race {
    winner: u32,
    time: f32,
}

// A race without inputs; 0 is no winner.
fn new_race() -> Race {
    return Race(0u, FAR);
}

// `bits`: random ones of this input.  The weight is positive.
fn race_add(race: ptr<function, Race>, index: u32, weight: f32, bits: u32) {
    let time = exponential_time(bits) / weight;
    if time < (*race).time || (time == (*race).time && index < (*race).winner) {
        (*race).winner = index;
        (*race).time = time;
    }
}

// -log(1 - u) for a random number u.  Among many inputs the least time is short: u has 24 bits at every size, and short times have a series,
// because log of a number near 1 has an absolute error of 2^-21.
fn exponential_time(bits: u32) -> f32 {
    let u = min((f32(bits) + 0.5) * 0x1p-32, ONE_MINUS_EPSILON);
    return select(-log(1.0 - u), u * (1.0 + u * (0.5 + u / 3.0)), u < 0x1p-7);
}
