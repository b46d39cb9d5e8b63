// The mean of a pixel's light over frames, in memory.
#define_import_path bevy_restir::denoiser::mean

#import bevy_restir::common::constants::{HALF_BOUND, LEAST_DIVISOR}
#import bevy_restir::common::math::luminance

struct Mean {
    color: vec3<f32>,
    second_moment: f32,        // mean of the squared luminance of single frames
    frames: f32,               // number of frames; 0: there is no mean
}

fn no_mean() -> Mean {
    return Mean(vec3<f32>(0.0), 0.0, 0.0);
}

// The second moment is stored as the variance relative to the square of the mean.
fn mean_pack(m: Mean) -> vec4<u32> {
    let relative = min(variance_of(m) / max(squared_luminance(m), LEAST_DIVISOR), HALF_BOUND);
    return vec4<u32>(bitcast<vec3<u32>>(m.color), pack2x16float(vec2<f32>(relative, m.frames)));
}

fn mean_unpack(p: vec4<u32>) -> Mean {
    let rest = unpack2x16float(p.w);
    var m = Mean(bitcast<vec3<f32>>(p.xyz), 0.0, rest.y);
    m.second_moment = (1.0 + rest.x) * squared_luminance(m);
    return m;
}

fn squared_luminance(m: Mean) -> f32 {
    let l = bounded_luminance(m.color);
    return l * l;
}

// Its square, times the greatest relative variance, is finite.
fn bounded_luminance(color: vec3<f32>) -> f32 {
    return min(luminance(color), 1.0e15);
}

// Variance of the luminance of single frames.
fn variance_of(m: Mean) -> f32 {
    return max(m.second_moment - squared_luminance(m), 0.0);
}

// The weighted sum of a mean and another one, whose weights must add up to 1 in the end.
fn add_mean(sum: Mean, m: Mean, weight: f32) -> Mean {
    return Mean(sum.color + weight * m.color, sum.second_moment + weight * m.second_moment, sum.frames + weight * m.frames);
}
