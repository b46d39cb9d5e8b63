// Textures: one array of pages in 8-bit RGBA with their levels of detail, each texture a rectangle of a page that halves from level to
// level; and, where the device has arrays of textures, images as they are.  Both are read a texel at a time: wrap modes and weights are
// computed here, so that every adapter filters alike and no sampler binding is needed.
#define_import_path bevy_restir::scene::texture

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::texel::{decode_texel, ENCODING_LINEAR, ENCODING_SHARED_EXPONENT, ENCODING_SRGB}
#import bevy_restir::scene::bindings::atlas
#ifdef BOUND_TEXTURES
#import bevy_restir::common::math::{is_finite, is_finite_3}
#import bevy_restir::scene::bindings::bound_textures
#endif

// Flags of a slot, from bit 16 of its x: two bits of wrap mode an axis, the filter, how texels are kept, the coordinates.
const TEXTURE_CLAMP_U: u32 = 0x10000u;
const TEXTURE_MIRROR_U: u32 = 0x20000u;
const TEXTURE_CLAMP_V: u32 = 0x40000u;
const TEXTURE_MIRROR_V: u32 = 0x80000u;
const TEXTURE_NEAREST: u32 = 0x100000u;
const TEXTURE_SRGB: u32 = 0x200000u;
const TEXTURE_SHARED_EXPONENT: u32 = 0x400000u;
const TEXTURE_SECOND_UV: u32 = 0x800000u;
// Then the number of levels, 5 bits.
const TEXTURE_LEVELS_SHIFT: u32 = 24u;
// The image holds two components: the third of a normal is theirs to give.
const TEXTURE_TWO_COMPONENTS: u32 = 0x20000000u;
// Bound as it is: the low 16 bits are its place in `bound_textures`, no longer a page.  The highest bit: in no other slot but NONE.
const TEXTURE_BOUND: u32 = 0x80000000u;

// Samples along the longer side of an area: one that is longer still is blurred across.
const MAX_TAPS: f32 = 4.0;

// A point in texture coordinates and the ellipse round it that is seen: two diameters of it, each along the tangents at the other's ends.
// Diameters of 0 are the point itself.
struct TextureArea {
    uv: vec2<f32>,
    axis_a: vec2<f32>,
    axis_b: vec2<f32>,
}

#ifdef BOUND_TEXTURES
fn has_texture(slot: vec4<u32>) -> bool {
    return slot.x != NONE;
}
#else
// While the pipelines that read bound textures are being compiled there are none.
fn has_texture(slot: vec4<u32>) -> bool {
    return slot.x < TEXTURE_BOUND;
}
#endif

fn wrap(i: i32, size: i32, clamped: bool, mirrored: bool) -> i32 {
    if clamped {
        return clamp(i, 0, size - 1);
    }
    let period = select(size, 2 * size, mirrored);
    let m = ((i % period) + period) % period;
    return select(m, 2 * size - 1 - m, m >= size);
}

fn level_size(slot: vec4<u32>, level: u32) -> vec2<i32> {
    return vec2<i32>(max((vec2<u32>(slot.z, slot.z >> 16u) & vec2<u32>(0xffffu)) >> vec2<u32>(level), vec2<u32>(1u)));
}

fn texel(slot: vec4<u32>, level: u32, size: vec2<i32>, x: i32, y: i32) -> vec4<f32> {
    let at = vec2<i32>(
        wrap(x, size.x, (slot.x & TEXTURE_CLAMP_U) != 0u, (slot.x & TEXTURE_MIRROR_U) != 0u),
        wrap(y, size.y, (slot.x & TEXTURE_CLAMP_V) != 0u, (slot.x & TEXTURE_MIRROR_V) != 0u),
    );
    return stored_texel(slot, level, at);
}

fn atlas_texel(slot: vec4<u32>, level: u32, at: vec2<i32>) -> vec4<f32> {
    let corner = (vec2<u32>(slot.y, slot.y >> 16u) & vec2<u32>(0xffffu)) >> vec2<u32>(level);
    let is_shared = (slot.x & TEXTURE_SHARED_EXPONENT) != 0u;
    let is_srgb = (slot.x & TEXTURE_SRGB) != 0u;
    let encoding = select(select(ENCODING_LINEAR, ENCODING_SRGB, is_srgb), ENCODING_SHARED_EXPONENT, is_shared);
    return decode_texel(textureLoad(atlas, vec2<i32>(corner) + at, i32(slot.x & 0xffffu), i32(level)), encoding);
}

#ifdef BOUND_TEXTURES
fn stored_texel(slot: vec4<u32>, level: u32, at: vec2<i32>) -> vec4<f32> {
    if (slot.x & TEXTURE_BOUND) == 0u {
        return atlas_texel(slot, level, at);
    }
    // Its format decodes it.  What the atlas could not hold is no color here either: floats that are none, and what is below 0.
    let c = textureLoad(bound_textures[slot.x & 0xffffu], at, i32(level));
    let color = select(vec3<f32>(0.0), clamp(c.rgb, vec3<f32>(0.0), vec3<f32>(1.0e30)), is_finite_3(c.rgb));
    return vec4<f32>(color, select(1.0, clamp(c.a, 0.0, 1.0), is_finite(c.a)));
}
#else
fn stored_texel(slot: vec4<u32>, level: u32, at: vec2<i32>) -> vec4<f32> {
    return atlas_texel(slot, level, at);
}
#endif

// Bilinear within a level, linear values.  Nearest is a look at the texels themselves: where they are averaged there are none.
fn sample_level(slot: vec4<u32>, level: u32, uv: vec2<f32>) -> vec4<f32> {
    let size = level_size(slot, level);
    // Far coordinates lose their fraction anyway; the clamp keeps the conversion to i32 defined, non-finite ones included.
    let at = clamp(uv * vec2<f32>(size), vec2<f32>(-1.0e9), vec2<f32>(1.0e9));
    let nearest = (slot.x & TEXTURE_NEAREST) != 0u && level == 0u;
    let low = floor(select(at - 0.5, at, nearest));
    let f = select(at - 0.5 - low, vec2<f32>(0.0), nearest);
    let x = i32(low.x);
    let y = i32(low.y);
    return mix(
        mix(texel(slot, level, size, x, y), texel(slot, level, size, x + 1, y), f.x),
        mix(texel(slot, level, size, x, y + 1), texel(slot, level, size, x + 1, y + 1), f.x),
        f.y,
    );
}

// The texture as it is at a point.
fn sample_texture(slot: vec4<u32>, uv: vec2<f32>) -> vec4<f32> {
    return sample_level(slot, 0u, uv);
}

// The axes of the ellipse of two such diameters, in texels: the direction of the longer one, its length, that of the shorter one.  They are
// the eigenvectors of the sum of the diameters' squares, whichever the two are: neighbors with other triangles agree.
fn axes_of(a: vec2<f32>, b: vec2<f32>) -> vec4<f32> {
    let square = a * a + b * b;
    let mixed = a.x * a.y + b.x * b.y;
    let half = 0.5 * (square.x - square.y);
    let radius = sqrt(half * half + mixed * mixed);
    let long = sqrt(0.5 * (square.x + square.y) + radius);
    let direction = select(vec2<f32>(mixed, radius - half), vec2<f32>(radius + half, mixed), half >= 0.0);
    let length_squared = dot(direction, direction);
    let unit = select(vec2<f32>(1.0, 0.0), direction * inverseSqrt(max(length_squared, 1.0e-30)), length_squared > 1.0e-30);
    return vec4<f32>(unit, long, abs(a.x * b.y - a.y * b.x) / max(long, 1.0e-30));
}

// The mean over an area: taps along its longer axis, of the two levels whose texels are as wide as it is across.
fn sample_area(slot: vec4<u32>, area: TextureArea) -> vec4<f32> {
    let size = vec2<f32>(level_size(slot, 0u));
    let axes = axes_of(
        clamp(area.axis_a * size, vec2<f32>(-1.0e8), vec2<f32>(1.0e8)),
        clamp(area.axis_b * size, vec2<f32>(-1.0e8), vec2<f32>(1.0e8)),
    );
    let along = axes.xy * axes.z / size;
    let across = max(max(axes.w, axes.z / MAX_TAPS), 1.0);
    let last = f32(max((slot.x >> TEXTURE_LEVELS_SHIFT) & 31u, 1u) - 1u);
    let level = select(0.0, clamp(log2(across), 0.0, last), across > 1.0);
    let low = floor(level);
    let taps = u32(clamp(ceil(axes.z / across - 0.01), 1.0, MAX_TAPS));
    let levels = select(1u, 2u, level > low);

    var sum = vec4<f32>(0.0);
    for (var i = 0u; i < taps * levels; i++) {
        let above = i % levels;
        let at = (f32(i / levels) + 0.5) / f32(taps) - 0.5;
        let share = select(1.0 - (level - low), level - low, above == 1u);
        sum += share / f32(taps) * sample_level(slot, u32(low) + above, area.uv + at * along);
    }
    return sum;
}
