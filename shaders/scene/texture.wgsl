// Textures: one array of pages in 8-bit RGBA, each texture a rectangle of a page.  Wrap modes and bilinear weights are computed
// here, so that every adapter gives the same texel and no sampler binding is needed.
#define_import_path bevy_restir::scene::texture

#import bevy_restir::common::constants::NONE
#import bevy_restir::scene::bindings::atlas

// Flags of a slot, from bit 16 of its x: two bits of wrap mode an axis, then the filter.
const TEXTURE_CLAMP_U: u32 = 0x10000u;
const TEXTURE_MIRROR_U: u32 = 0x20000u;
const TEXTURE_CLAMP_V: u32 = 0x40000u;
const TEXTURE_MIRROR_V: u32 = 0x80000u;
const TEXTURE_NEAREST: u32 = 0x100000u;

fn has_texture(slot: vec4<u32>) -> bool {
    return slot.x != NONE;
}

fn wrap(i: i32, size: i32, clamped: bool, mirrored: bool) -> i32 {
    if clamped {
        return clamp(i, 0, size - 1);
    }
    let period = select(size, 2 * size, mirrored);
    let m = ((i % period) + period) % period;
    return select(m, 2 * size - 1 - m, m >= size);
}

fn texel(slot: vec4<u32>, x: i32, y: i32) -> vec4<f32> {
    let size = vec2<i32>(i32(slot.z & 0xffffu), i32(slot.z >> 16u));
    let corner = vec2<i32>(i32(slot.y & 0xffffu), i32(slot.y >> 16u));
    let at = vec2<i32>(
        wrap(x, size.x, (slot.x & TEXTURE_CLAMP_U) != 0u, (slot.x & TEXTURE_MIRROR_U) != 0u),
        wrap(y, size.y, (slot.x & TEXTURE_CLAMP_V) != 0u, (slot.x & TEXTURE_MIRROR_V) != 0u),
    );
    return textureLoad(atlas, corner + at, i32(slot.x & 0xffffu), 0);
}

fn srgb_to_linear(c: vec3<f32>) -> vec3<f32> {
    let curve = pow((c + 0.055) / 1.055, vec3<f32>(2.4));
    return select(curve, c / 12.92, c <= vec3<f32>(0.04045));
}

fn linear_texel(slot: vec4<u32>, x: i32, y: i32) -> vec4<f32> {
    let c = texel(slot, x, y);
    return vec4<f32>(srgb_to_linear(c.rgb), c.a);
}

struct Footprint {
    low: vec2<i32>,
    fraction: vec2<f32>,
}

fn footprint(slot: vec4<u32>, uv: vec2<f32>) -> Footprint {
    let size = vec2<f32>(f32(slot.z & 0xffffu), f32(slot.z >> 16u));
    // Far coordinates lose their fraction anyway; the clamp keeps the conversion to i32 defined, non-finite ones included.
    let at = clamp(uv * size, vec2<f32>(-1.0e9), vec2<f32>(1.0e9));
    if (slot.x & TEXTURE_NEAREST) != 0u {
        return Footprint(vec2<i32>(floor(at)), vec2<f32>(0.0));
    }
    let low = floor(at - 0.5);
    return Footprint(vec2<i32>(low), at - 0.5 - low);
}

// Bilinear, of the stored values: for data.
fn sample_data(slot: vec4<u32>, uv: vec2<f32>) -> vec4<f32> {
    let f = footprint(slot, uv);
    let x = f.low.x;
    let y = f.low.y;
    return mix(
        mix(texel(slot, x, y), texel(slot, x + 1, y), f.fraction.x),
        mix(texel(slot, x, y + 1), texel(slot, x + 1, y + 1), f.fraction.x),
        f.fraction.y,
    );
}

// Bilinear, of linear values of an sRGB texture: for colours.
fn sample_color(slot: vec4<u32>, uv: vec2<f32>) -> vec4<f32> {
    let f = footprint(slot, uv);
    let x = f.low.x;
    let y = f.low.y;
    return mix(
        mix(linear_texel(slot, x, y), linear_texel(slot, x + 1, y), f.fraction.x),
        mix(linear_texel(slot, x, y + 1), linear_texel(slot, x + 1, y + 1), f.fraction.x),
        f.fraction.y,
    );
}
