// The environment: a color, times an equirectangular map or a cube.  It is importance-sampled by descending a mip chain of sums over
// equirectangular cells (McCool and Harwood 1997).  Within a cell of the finest level, the density is constant in solid angle, so that the
// poles need no special treatment.
#define_import_path bevy_restir::light::environment

#import bevy_restir::common::constants::{FOUR_PI, ONE_MINUS_EPSILON, PI, TWO_PI}
#import bevy_restir::common::math::{clean_radiance, equirectangular_uv, luminance, precise_sine, precise_sine_cosine, wrapped_index}
#import bevy_restir::light::cube::{cube_radiance, cube_side}
#import bevy_restir::view::bindings::{environment_importance, environment_map, view}

struct EnvironmentSample {
    direction: vec3<f32>,      // in the world
    pdf_solid_angle: f32,      // 0: no direction was sampled
}

// Rotates a direction from the world into the frame of the environment, now or (`previous`) in the last frame.
fn into_environment(direction: vec3<f32>, previous: bool) -> vec3<f32> {
    if previous {
        return view.previous_environment_rotation * direction;
    }
    return view.environment_rotation * direction;
}

// Rotates a direction back into the world: the inverse of a rotation is its transpose.
fn out_of_environment(direction: vec3<f32>, previous: bool) -> vec3<f32> {
    if previous {
        return direction * view.previous_environment_rotation;
    }
    return direction * view.environment_rotation;
}

#ifdef ENVIRONMENT
// Radiance from a direction in the world, now or (`previous`) in the last frame.
fn environment_radiance(direction: vec3<f32>, previous: bool) -> vec3<f32> {
    return color_of_environment(previous) * map_radiance(into_environment(direction, previous));
}

fn color_of_environment(previous: bool) -> vec3<f32> {
    return select(view.environment_color, view.previous_environment_color, previous);
}

// ∫ luminance dω, for the choice between the environment and the table of lights.
fn environment_flux() -> f32 {
    return luminance(view.environment_color) * map_flux();
}

fn environment_sample(u: vec2<f32>, previous: bool) -> EnvironmentSample {
    let s = map_sample(u);
    return EnvironmentSample(normalize(out_of_environment(s.direction, previous)), s.pdf_solid_angle);
}

fn environment_pdf(direction: vec3<f32>, previous: bool) -> f32 {
    return map_pdf(into_environment(direction, previous));
}
#else
fn environment_radiance(direction: vec3<f32>, previous: bool) -> vec3<f32> {
    return vec3<f32>(0.0);
}

fn environment_flux() -> f32 {
    return 0.0;
}

fn environment_sample(u: vec2<f32>, previous: bool) -> EnvironmentSample {
    return EnvironmentSample(vec3<f32>(0.0, 1.0, 0.0), 0.0);
}

fn environment_pdf(direction: vec3<f32>, previous: bool) -> f32 {
    return 0.0;
}
#endif

#ifdef ENVIRONMENT_MAP
fn map_flux() -> f32 {
    return importance(vec2<u32>(0u), textureNumLevels(environment_importance) - 1u);
}

fn map_sample(u: vec2<f32>) -> EnvironmentSample {
    // Descend from the 1x1 level; at each level, choose the row, then the column, and rescale u.
    let levels = textureNumLevels(environment_importance);
    let size = textureDimensions(environment_importance);
    var cell = vec2<u32>(0u);
    var rest = u;
    for (var k = 1u; k < levels; k++) {
        let level = levels - 1u - k;
        // A side of 1 cell is not divided further.
        let parent = max(size >> vec2<u32>(level + 1u), vec2<u32>(1u));
        let divided = vec2<u32>(max(size >> vec2<u32>(level), vec2<u32>(1u)) > parent);
        cell *= 1u + divided;
        let a = importance(cell, level);
        let b = f32(divided.x) * importance(cell + vec2<u32>(divided.x, 0u), level);
        let c = f32(divided.y) * importance(cell + vec2<u32>(0u, divided.y), level);
        let d = f32(divided.x * divided.y) * importance(cell + divided, level);
        let sum = a + b + c + d;
        if !(sum > 0.0) {
            return EnvironmentSample(vec3<f32>(0.0, 1.0, 0.0), 0.0);
        }
        let row = split(rest.y, (a + b) / sum);
        rest.y = row.y;
        let first = select(a, c, row.x > 0.0);
        let both = select(a + b, c + d, row.x > 0.0);
        let column = split(rest.x, first / both);
        rest.x = column.y;
        cell += vec2<u32>(u32(column.x), u32(row.x));
    }
    return EnvironmentSample(cell_direction(cell, size, rest), cell_pdf(cell, size));
}

// Chooses one of two parts: (0, rescaled u) with the probability `share`, otherwise (1, rescaled u).  The rescaled u is uniform in [0, 1).
fn split(u: f32, share: f32) -> vec2<f32> {
    if u < share {
        return vec2<f32>(0.0, min(u / share, ONE_MINUS_EPSILON));
    }
    return vec2<f32>(1.0, min((u - share) / (1.0 - share), ONE_MINUS_EPSILON));
}

// Samples a direction uniformly in the solid angle of a cell, in the frame of the map.
fn cell_direction(cell: vec2<u32>, size: vec2<u32>, u: vec2<f32>) -> vec3<f32> {
    let phi = TWO_PI * ((f32(cell.x) + u.x) / f32(size.x) - 0.5);
    let around = precise_sine_cosine(phi);
    let south = is_southern(cell.y, size);
    let edges = row_edges(cell.y, size);
    let s = mix(edges.x, edges.y, select(u.y, 1.0 - u.y, south));
    let sin_theta = 2.0 * sqrt(max(s * (1.0 - s), 0.0));
    let cos_theta = 1.0 - 2.0 * s;
    return vec3<f32>(sin_theta * around.x, select(cos_theta, -cos_theta, south), -sin_theta * around.y);
}

fn map_pdf(d: vec3<f32>) -> f32 {
    let size = textureDimensions(environment_importance);
    return cell_pdf(min(vec2<u32>(equirectangular_uv(d) * vec2<f32>(size)), size - 1u), size);
}

fn cell_pdf(cell: vec2<u32>, size: vec2<u32>) -> f32 {
    let total = map_flux();
    if !(total > 0.0) {
        return 0.0;
    }
    return importance(cell, 0u) / total / cell_solid_angle(cell.y, size);
}

fn importance(cell: vec2<u32>, level: u32) -> f32 {
    return textureLoad(environment_importance, cell, level).x;
}

#else
fn map_radiance(d: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(1.0);
}

fn map_flux() -> f32 {
    return FOUR_PI;
}

fn map_sample(u: vec2<f32>) -> EnvironmentSample {
    let z = 1.0 - 2.0 * u.x;
    let r = 2.0 * sqrt(u.x * (1.0 - u.x));
    let phi = TWO_PI * u.y;
    return EnvironmentSample(vec3<f32>(r * cos(phi), r * sin(phi), z), 1.0 / FOUR_PI);
}

fn map_pdf(d: vec3<f32>) -> f32 {
    return 1.0 / FOUR_PI;
}
#endif

// Whether the angles of a row are measured from the lower pole.
fn is_southern(y: u32, size: vec2<u32>) -> bool {
    return 2u * y >= size.y && size.y > 1u;
}

// The edges of a row as sin²(θ/2), where θ is measured from the nearer pole: linear in cosθ, and precise near this pole.
fn row_edges(y: u32, size: vec2<u32>) -> vec2<f32> {
    let row = f32(select(y, size.y - 1u - y, is_southern(y, size)));
    let angles = vec2<f32>(row, row + 1.0) * (0.5 * PI / f32(size.y));
    let sines = vec2<f32>(precise_sine(angles.x), precise_sine(angles.y));
    return sines * sines;
}

// Solid angle of a cell of row y: 2π/width times the difference of cosθ.  Sampling has the same edges, so that the density is that of the
// directions even where the edges are rounded.
fn cell_solid_angle(y: u32, size: vec2<u32>) -> f32 {
    let edges = row_edges(y, size);
    return TWO_PI / f32(size.x) * 2.0 * (edges.y - edges.x);
}

#ifdef ENVIRONMENT_MAP
#ifdef ENVIRONMENT_CUBE
fn map_radiance(d: vec3<f32>) -> vec3<f32> {
    return cube_radiance(d);
}

// Value of a cell in level 0 of `environment_importance`: solid angle · mean luminance over a grid of directions, which includes the
// border of the cell.  The grid is as fine as the smallest texels, in the corners of faces, so that no texel is missed.
fn environment_cell_importance(cell: vec2<u32>, size: vec2<u32>) -> f32 {
    let n = u32(clamp(ceil(CELL_TEXELS * f32(cube_side()) / f32(size.x)), 2.0, CELL_SAMPLES_MAX));
    var sum = 0.0;
    for (var y = 0u; y <= n; y++) {
        for (var x = 0u; x <= n; x++) {
            sum += luminance(cube_radiance(cell_direction(cell, size, vec2<f32>(vec2<u32>(x, y)) / f32(n))));
        }
    }
    return sum / f32((n + 1u) * (n + 1u)) * cell_solid_angle(cell.y, size);
}

// 2π over the angle of a texel in a corner, which is 2/3 of 1/side.  The grid is limited for cubes of more than 13,900 texels a side, or
// 3,476 if the GPU can write them: it may miss texels, which only BSDF sampling finds.
const CELL_TEXELS: f32 = 9.425;
const CELL_SAMPLES_MAX: f32 = 32.0;
#else
// Bilinear filtering; u wraps around, v is clamped at the poles.
fn map_radiance(d: vec3<f32>) -> vec3<f32> {
    let size = vec2<i32>(textureDimensions(environment_map));
    let at = equirectangular_uv(d) * vec2<f32>(size) - 0.5;
    let low = floor(at);
    let f = at - low;
    let x = vec2<i32>(i32(low.x), i32(low.x) + 1);
    let y = vec2<i32>(i32(low.y), i32(low.y) + 1);
    return mix(
        mix(map_texel(x.x, y.x, size), map_texel(x.y, y.x, size), f.x),
        mix(map_texel(x.x, y.y, size), map_texel(x.y, y.y, size), f.x),
        f.y,
    );
}

fn map_texel(x: i32, y: i32, size: vec2<i32>) -> vec3<f32> {
    let at = vec2<i32>(wrapped_index(x, size.x), clamp(y, 0, size.y - 1));
    return clean_radiance(textureLoad(environment_map, at, 0, 0).rgb);
}

// Value of a cell in level 0 of `environment_importance`: solid angle · mean luminance of the bilinear map over the cell.  The mean is
// exact, so that it is 0 only where the map is 0.  `size` is that of level 0; each further level has the 2x2 sums of the one before.
fn environment_cell_importance(cell: vec2<u32>, size: vec2<u32>) -> f32 {
    let map = vec2<i32>(textureDimensions(environment_map));
    let low = vec2<f32>(cell) / vec2<f32>(size) * vec2<f32>(map);
    let high = vec2<f32>(cell + 1u) / vec2<f32>(size) * vec2<f32>(map);
    let first = vec2<i32>(floor(low - 0.5));
    let last = vec2<i32>(floor(high + 0.5));
    var sum = 0.0;
    for (var y = first.y; y <= last.y; y++) {
        var row = 0.0;
        for (var x = first.x; x <= last.x; x++) {
            row += tent_integral(low.x, high.x, x) * luminance(map_texel(x, y, map));
        }
        sum += tent_integral(low.y, high.y, y) * row;
    }
    let mean = sum / ((high.x - low.x) * (high.y - low.y));
    return mean * cell_solid_angle(cell.y, size);
}

// ∫ from a to b of the tent function of width 2 around the center of texel i.
fn tent_integral(a: f32, b: f32, i: i32) -> f32 {
    let center = f32(i) + 0.5;
    return tent_antiderivative(b - center) - tent_antiderivative(a - center);
}

fn tent_antiderivative(t: f32) -> f32 {
    let x = clamp(t, -1.0, 1.0);
    return x - 0.5 * x * abs(x);
}
#endif
#endif
