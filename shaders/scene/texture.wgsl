// Texture sampling.  Most textures are rectangles in the pages of an atlas, 8-bit RGBA with mip levels; where the device supports arrays of
// textures, images may be bound directly.  Wrapping and filtering are computed here from single texels, so that all adapters give the same
// result and no sampler is bound.
#define_import_path bevy_restir::scene::texture

#import bevy_restir::common::constants::{LEAST_MAGNITUDE, NONE}
#import bevy_restir::common::math::wrapped_index
#import bevy_restir::common::texel::{decode_texel, ENCODING_LINEAR, ENCODING_SHARED_EXPONENT, ENCODING_SRGB}
#import bevy_restir::scene::bindings::atlas
#ifdef BOUND_TEXTURES
#import bevy_restir::common::math::{is_finite, is_finite_3}
#import bevy_restir::scene::bindings::bound_textures
#endif

// Flags of a texture slot, from bit 16 of its x: wrap mode of each axis, filter, encoding, and the set of texture coordinates.
const TEXTURE_CLAMP_U: u32 = 0x10000u;
const TEXTURE_MIRROR_U: u32 = 0x20000u;
const TEXTURE_CLAMP_V: u32 = 0x40000u;
const TEXTURE_MIRROR_V: u32 = 0x80000u;
const TEXTURE_NEAREST: u32 = 0x100000u;
const TEXTURE_SRGB: u32 = 0x200000u;
const TEXTURE_SHARED_EXPONENT: u32 = 0x400000u;
const TEXTURE_SECOND_UV: u32 = 0x800000u;
// Number of mip levels, 5 bits.
const TEXTURE_LEVELS_SHIFT: u32 = 24u;
// The normal map has two components, from which the third is computed.
const TEXTURE_TWO_COMPONENTS: u32 = 0x20000000u;
// The image is bound directly: the low 16 bits are its index in `bound_textures` instead of a page.  Of other slots only NONE has this bit.
const TEXTURE_BOUND: u32 = 0x80000000u;

// Greatest number of samples along the long axis of a footprint.  A longer footprint is widened across.
const MAX_SAMPLES: f32 = 4.0;

// A footprint: a point in texture coordinates, and two conjugate diameters of an ellipse around it.  With diameters of 0 it is the point.
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
// Pipelines without bound textures, which render until those with them are compiled, ignore such slots.
fn has_texture(slot: vec4<u32>) -> bool {
    return slot.x < TEXTURE_BOUND;
}
#endif

fn wrap(i: i32, size: i32, clamped: bool, mirrored: bool) -> i32 {
    if clamped {
        return clamp(i, 0, size - 1);
    }
    let m = wrapped_index(i, select(size, 2 * size, mirrored));
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
    // The format decodes texels.  Negative and non-finite values are dropped, as they are in the atlas.
    let c = textureLoad(bound_textures[slot.x & 0xffffu], at, i32(level));
    let color = select(vec3<f32>(0.0), clamp(c.rgb, vec3<f32>(0.0), vec3<f32>(1.0e30)), is_finite_3(c.rgb));
    return vec4<f32>(color, select(1.0, clamp(c.a, 0.0, 1.0), is_finite(c.a)));
}
#else
fn stored_texel(slot: vec4<u32>, level: u32, at: vec2<i32>) -> vec4<f32> {
    return atlas_texel(slot, level, at);
}
#endif

// Bilinear filtering of linear values within a level.  Nearest filtering applies to level 0 only: coarser levels are averages.
fn sample_level(slot: vec4<u32>, level: u32, uv: vec2<f32>) -> vec4<f32> {
    let size = level_size(slot, level);
    // The clamp keeps the conversion to i32 defined, also for non-finite coordinates.
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

// The texture at a point, without a footprint.
fn sample_texture(slot: vec4<u32>, uv: vec2<f32>) -> vec4<f32> {
    return sample_level(slot, 0u, uv);
}

// Axes of the ellipse with two conjugate diameters, in texels: direction of the long axis, its length, length of the short axis.  They are
// eigenvectors of the sum of the outer products of the diameters, and do not depend on the pair: adjacent triangles agree.
fn ellipse_axes(a: vec2<f32>, b: vec2<f32>) -> vec4<f32> {
    let square = a * a + b * b;
    let mixed = a.x * a.y + b.x * b.y;
    let half = 0.5 * (square.x - square.y);
    let radius = sqrt(half * half + mixed * mixed);
    let long = sqrt(0.5 * (square.x + square.y) + radius);
    let direction = select(vec2<f32>(mixed, radius - half), vec2<f32>(radius + half, mixed), half >= 0.0);
    let length_squared = dot(direction, direction);
    let unit = select(vec2<f32>(1.0, 0.0), direction * inverseSqrt(max(length_squared, LEAST_MAGNITUDE)), length_squared > LEAST_MAGNITUDE);
    return vec4<f32>(unit, long, abs(a.x * b.y - a.y * b.x) / max(long, LEAST_MAGNITUDE));
}

// Mean over a footprint: samples along the long axis, each from the two mip levels around the length of the short axis.
fn sample_area(slot: vec4<u32>, area: TextureArea) -> vec4<f32> {
    let size = vec2<f32>(level_size(slot, 0u));
    let axes = ellipse_axes(
        clamp(area.axis_a * size, vec2<f32>(-1.0e8), vec2<f32>(1.0e8)),
        clamp(area.axis_b * size, vec2<f32>(-1.0e8), vec2<f32>(1.0e8)),
    );
    let along = axes.xy * axes.z / size;
    let across = max(max(axes.w, axes.z / MAX_SAMPLES), 1.0);
    let last = f32(max((slot.x >> TEXTURE_LEVELS_SHIFT) & 31u, 1u) - 1u);
    let level = select(0.0, clamp(log2(across), 0.0, last), across > 1.0);
    let low = floor(level);
    // A footprint that is too long for some number of samples by less than 1 % takes no further sample.
    let samples = u32(clamp(ceil(axes.z / across - 0.01), 1.0, MAX_SAMPLES));
    let levels = select(1u, 2u, level > low);

    var sum = vec4<f32>(0.0);
    for (var i = 0u; i < samples * levels; i++) {
        let above = i % levels;
        let at = (f32(i / levels) + 0.5) / f32(samples) - 0.5;
        let share = select(1.0 - (level - low), level - low, above == 1u);
        sum += share / f32(samples) * sample_level(slot, u32(low) + above, area.uv + at * along);
    }
    return sum;
}
