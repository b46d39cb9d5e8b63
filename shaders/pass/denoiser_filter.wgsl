// An iteration of the edge-avoiding à-trous filter (Dammertz et al. 2010), with weights by variance (SVGF, Schied et al. 2017): averages the
// light of pixels that show similar surfaces and differ by no more than noise.  Each iteration doubles the distance of the pixels.

#import bevy_restir::common::constants::LEAST_MAGNITUDE
#import bevy_restir::common::math::{exponential_decay, luminance}
#import bevy_restir::denoiser::guide::{Guide, guide_unpack, plane_weight}
#import bevy_restir::denoiser::optical_image::image_guide
#import bevy_restir::denoiser::types::{DIFFUSE, DenoiserSettings, SPECULAR}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::{DISTANCE_FOR_HEIGHT, is_orthographic}

@group(2) @binding(0) var<uniform> settings: DenoiserSettings;
// Light without albedo, and its variance; alpha < 0: the surface has no such light.
@group(2) @binding(1) var signals: texture_2d_array<f32>;
@group(2) @binding(2) var guides: texture_2d<u32>;
@group(2) @binding(3) var filtered: texture_storage_2d_array<rgba32float, write>;
// Optical images; one empty texel where the scene has nothing smooth.
@group(2) @binding(4) var images: texture_2d<u32>;

// Weighted sums of a signal.
struct Sum {
    color: vec3<f32>,
    variance: f32,             // with squared weights
    weight: f32,
}

// Exponent of the cosine between normals, for diffuse light.
const NORMAL_POWER: f32 = 64.0;
// Difference of luminance at which weights fall to 1/e, in standard deviations of the difference.
const DEVIATIONS: f32 = 1.0;
// Weights of specular light below this one do not count; the pixel itself has 1.
const LEAST_WEIGHT: f32 = 1.0e-9;
// Least tolerance, relative to the luminance.
const LEAST_TOLERANCE: f32 = 0.01;

@compute @workgroup_size(8, 8)
fn denoiser_filter(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let own = guide_unpack(textureLoad(guides, pixel, 0));
    let diffuse = textureLoad(signals, pixel, DIFFUSE, 0);
    let specular = textureLoad(signals, pixel, SPECULAR, 0);
    var sums = array<Sum, 2>(sum_of(diffuse), sum_of(specular));
    if own.depth > 0.0 {
        var image = own;
        if own.shows_image {
            image = image_guide(textureLoad(images, pixel, 0));
        }
        let radius = specular_radius(image.roughness);
        for (var y = -2; y <= 2; y++) {
            for (var x = -2; x <= 2; x++) {
                let offset = vec2<i32>(x, y) * i32(settings.step);
                let other_pixel = vec2<i32>(pixel) + offset;
                if (x == 0 && y == 0) || any(other_pixel < vec2<i32>(0)) || any(other_pixel >= vec2<i32>(view.size)) {
                    continue;
                }
                let other = guide_unpack(textureLoad(guides, other_pixel, 0));
                if other.depth == 0.0 || other.shows_image != own.shows_image {
                    continue;
                }
                let in_kernel = kernel(x) * kernel(y);
                let shape = in_kernel * similarity(own, other, offset);
                var of_image = shape;
                if own.shows_image {
                    of_image = in_kernel * similarity(image, image_guide(textureLoad(images, other_pixel, 0)), offset);
                }
                let distance_in_radii = length(vec2<f32>(offset)) / radius;
                let narrow = of_image * exponential_decay(distance_in_radii * distance_in_radii);
                if diffuse.a >= 0.0 && shape > 0.0 {
                    sums[DIFFUSE] = with_pixel(sums[DIFFUSE], diffuse, textureLoad(signals, other_pixel, DIFFUSE, 0), shape);
                }
                if specular.a >= 0.0 && narrow > LEAST_WEIGHT {
                    sums[SPECULAR] = with_pixel(sums[SPECULAR], specular, textureLoad(signals, other_pixel, SPECULAR, 0), narrow);
                }
            }
        }
    }
    store(pixel, DIFFUSE, diffuse, sums[DIFFUSE]);
    store(pixel, SPECULAR, specular, sums[SPECULAR]);
}

// Weight of the surface of another pixel.
fn similarity(own: Guide, other: Guide, offset: vec2<i32>) -> f32 {
    let cosine = max(dot(own.n, other.n), 0.0);
    return plane_weight(own, other.depth, vec2<f32>(offset)) * pow(cosine, NORMAL_POWER);
}

// The B3 spline, relative to its center.
fn kernel(i: i32) -> f32 {
    return array<f32, 3>(1.0, 2.0 / 3.0, 1.0 / 6.0)[abs(i)];
}

// Radius within which specular light of a surface is similar, pixels: the width of the lobe, for reflections of objects that are as far
// behind the surface as the camera is in front of it.
fn specular_radius(roughness: f32) -> f32 {
    let half_height = select(abs(view.current.view_from_clip[1].y), 0.5 / DISTANCE_FOR_HEIGHT, is_orthographic());
    return max(0.25 * roughness * f32(view.size.y) / half_height, 0.1);
}

fn sum_of(center: vec4<f32>) -> Sum {
    return Sum(center.rgb, max(center.a, 0.0), 1.0);
}

// Adds another pixel.  The tolerance has the variances of both pixels: by that of the center alone, the neighbors of a bright pixel would leave
// it out, and the picture would be darker.
fn with_pixel(sum: Sum, center: vec4<f32>, light: vec4<f32>, shape: f32) -> Sum {
    if light.a < 0.0 {
        return sum;
    }
    let l = luminance(light.rgb);
    let own = luminance(center.rgb);
    let tolerance = DEVIATIONS * sqrt(max(center.a, 0.0) + light.a) + LEAST_TOLERANCE * max(own, l) + LEAST_MAGNITUDE;
    let weight = shape * exponential_decay(abs(l - own) / tolerance);
    return Sum(sum.color + weight * light.rgb, sum.variance + weight * weight * light.a, sum.weight + weight);
}

fn store(pixel: vec2<u32>, kind: u32, center: vec4<f32>, sum: Sum) {
    let mean = vec4<f32>(sum.color / sum.weight, sum.variance / (sum.weight * sum.weight));
    textureStore(filtered, pixel, kind, select(mean, center, center.a < 0.0));
}
