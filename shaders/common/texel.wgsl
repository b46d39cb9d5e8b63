// Encodings of colors with eight bits per channel: linear, sRGB, or mantissas with a shared exponent in the alpha channel.
#define_import_path bevy_restir::common::texel

#import bevy_restir::common::constants::LEAST_STORED_COLOR
#import bevy_restir::common::math::is_finite_3

// A test holds them equal to `Encoding` in src/scene/texture/atlas.rs.
const ENCODING_LINEAR: u32 = 0u;
const ENCODING_SRGB: u32 = 1u;
const ENCODING_SHARED_EXPONENT: u32 = 2u;

fn srgb_to_linear(c: vec3<f32>) -> vec3<f32> {
    let curve = pow((c + 0.055) / 1.055, vec3<f32>(2.4));
    return select(curve, c / 12.92, c <= vec3<f32>(0.04045));
}

fn linear_to_srgb(c: vec3<f32>) -> vec3<f32> {
    let curve = 1.055 * pow(max(c, vec3<f32>(0.0)), vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curve, c * 12.92, c <= vec3<f32>(0.0031308));
}

// The exponent has a bias of 128.
fn shared_exponent_to_linear(c: vec4<f32>) -> vec3<f32> {
    return c.rgb * exp2(c.a * 255.0 - 128.0);
}

fn linear_to_shared_exponent(color: vec3<f32>) -> vec4<f32> {
    let c = clamp(color, vec3<f32>(0.0), vec3<f32>(1.0e30));
    let largest = max(max(c.r, c.g), c.b);
    if !is_finite_3(color) || !(largest > LEAST_STORED_COLOR) {
        return vec4<f32>(0.0);
    }
    let exponent = floor(log2(largest)) + 1.0;
    return vec4<f32>(c * exp2(-exponent), (exponent + 128.0) / 255.0);
}

fn decode_texel(c: vec4<f32>, encoding: u32) -> vec4<f32> {
    if encoding == ENCODING_SRGB {
        return vec4<f32>(srgb_to_linear(c.rgb), c.a);
    }
    if encoding == ENCODING_SHARED_EXPONENT {
        return vec4<f32>(shared_exponent_to_linear(c), 1.0);
    }
    return c;
}

fn encode_texel(c: vec4<f32>, encoding: u32) -> vec4<f32> {
    if encoding == ENCODING_SRGB {
        return vec4<f32>(linear_to_srgb(c.rgb), c.a);
    }
    if encoding == ENCODING_SHARED_EXPONENT {
        return linear_to_shared_exponent(c.rgb);
    }
    return c;
}
