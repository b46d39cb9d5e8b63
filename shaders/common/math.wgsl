// Vectors, floats, and encodings of directions.
#define_import_path bevy_restir::common::math

#import bevy_restir::common::constants::{PI, TWO_PI}

// Rec. 709 luminance of a linear color.
fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3<f32>(0.2126, 0.7152, 0.0722));
}

fn max_component(v: vec3<f32>) -> f32 {
    return max(v.x, max(v.y, v.z));
}

// Tests the bits, because the fast math of a driver may remove comparisons with NaN.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn is_finite_3(v: vec3<f32>) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

// i modulo n, in [0, n).  Vulkan does not define the operator `%` for negative numbers, and NVIDIA's driver computes other values than
// Mesa's.
fn wrapped_index(i: i32, n: i32) -> i32 {
    let backward = i < 0;
    let remainder = i32(u32(select(i, -1 - i, backward)) % u32(n));
    return select(remainder, n - 1 - remainder, backward);
}

// a / b for positive a and b.  The reciprocal of a number above 2^126 is below the smallest normal number, so that GPUs may compute 0.
fn quotient(a: f32, b: f32) -> f32 {
    let scale = select(1.0, 0x1p-8, b > 0x1p100);
    return (a * scale) / (b * scale);
}

// e^-x for x of at least 0.  Drivers return NaN for huge exponents; e^-200 is 0 in f32.
fn exponential_decay(x: f32) -> f32 {
    return exp(-min(x, 200.0));
}

fn exponential_decay_3(v: vec3<f32>) -> vec3<f32> {
    return exp(-min(v, vec3<f32>(200.0)));
}

// A texel of an environment image.  Infinity is the sun of a half-precision file, whose greatest number it becomes; NaN and negative
// values become 0.
fn clean_radiance(c: vec3<f32>) -> vec3<f32> {
    let is_infinite = bitcast<vec3<u32>>(c) == vec3<u32>(0x7f800000u);
    let finite = select(vec3<f32>(0.0), c, vec3<bool>(is_finite(c.x), is_finite(c.y), is_finite(c.z)));
    return select(clamp(finite, vec3<f32>(0.0), vec3<f32>(1.0e30)), vec3<f32>(65504.0), is_infinite);
}

// Right-handed frame (t, b, n) of a unit vector `n`; continuous except at n.z = 0 (Duff et al. 2017).
fn orthonormal_basis(n: vec3<f32>) -> mat3x3<f32> {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat3x3<f32>(
        vec3<f32>(1.0 + s * n.x * n.x * a, s * b, -s * n.x),
        vec3<f32>(b, s + n.y * n.y * a, -n.y),
        n,
    );
}

// Unit vector of two snorm16 on an octahedron (Cigolle et al. 2014), and the reverse; the error is below 1e-4 rad.
fn octahedral_decode(word: u32) -> vec3<f32> {
    let e = unpack2x16snorm(word);
    var v = vec3<f32>(e, 1.0 - abs(e.x) - abs(e.y));
    let t = max(-v.z, 0.0);
    v.x += select(t, -t, v.x >= 0.0);
    v.y += select(t, -t, v.y >= 0.0);
    return normalize(v);
}

fn octahedral_encode(n: vec3<f32>) -> u32 {
    let p = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    let folded = (vec2<f32>(1.0) - abs(p.yx)) * select(vec2<f32>(-1.0), vec2<f32>(1.0), p >= vec2<f32>(0.0));
    return pack2x16snorm(select(folded, p, n.z >= 0.0));
}

// Rounds a direction as `octahedral_encode` does.
fn quantized_direction(d: vec3<f32>) -> vec3<f32> {
    return octahedral_decode(octahedral_encode(d));
}

// Angle of (x, y) from the x axis, in (-π, π], with an error of about 3e-7.  WGSL allows atan2 an error of 4096 ulp: with it, a sampled
// direction could be looked up in the wrong cell of the map.  The polynomial is our own minimax fit up to tan(π/8).
fn precise_atan2(y: f32, x: f32) -> f32 {
    let big = max(abs(x), abs(y));
    if !(big > 0.0) {
        return 0.0;
    }
    let ratio = min(abs(x), abs(y)) / big;
    // Above tan(π/8), the angle is π/4 plus that of a smaller ratio.
    let upper = ratio > 0.41421356;
    let t = select(ratio, (ratio - 1.0) / (ratio + 1.0), upper);
    let s = t * t;
    let p = -0.33333316 + s * (0.19998489 + s * (-0.14243849 + s * (0.10596001 - 0.06083453 * s)));
    var a = t + t * s * p + select(0.0, 0.78539816, upper);
    a = select(a, 1.57079633 - a, abs(y) > abs(x));
    a = select(a, 3.14159265 - a, x < 0.0);
    return select(a, -a, y < 0.0);
}

// Sine of an angle in [-π/2, π/2], with an error of about 1e-7 (its Taylor polynomial).  WGSL allows sin an error of 2^-11, which is a third of
// the height of a cell of the map.
fn precise_sine(x: f32) -> f32 {
    let s = x * x;
    let p = -0.16666667 + s * (0.0083333333 + s * (-0.00019841270 + s * (0.0000027557319 - 0.000000025052108 * s)));
    return x + x * s * p;
}

// Sine and cosine of an angle in [-π, π], with an error below 1e-6.
fn precise_sine_cosine(x: f32) -> vec2<f32> {
    let half_sine = precise_sine(0.5 * x);
    let half_cosine = precise_sine(0.5 * (PI - abs(x)));
    return vec2<f32>(2.0 * half_sine * half_cosine, 1.0 - 2.0 * half_sine * half_sine);
}

// Point of an equirectangular map in a direction: u = 0.5 + atan2(d.x, -d.z)/2π, v = acos(d.y)/π.
fn equirectangular_uv(d: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(
        0.5 + precise_atan2(d.x, -d.z) / TWO_PI,
        // Like acos(d.y), but exact near the poles.
        precise_atan2(length(d.xz), d.y) / PI,
    );
}
