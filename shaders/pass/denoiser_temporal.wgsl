// Averages the light of a pixel over frames: the mean of the last frame is taken from where its surface was.  The result, with an estimate of
// its variance, goes to the filter.

#import bevy_restir::denoiser::guide::{Guide, guide_depth, guide_unpack, plane_weight}
#import bevy_restir::denoiser::mean::{add_mean, bounded_luminance, Mean, mean_pack, mean_unpack, no_mean, variance_of}
#import bevy_restir::denoiser::types::{DIFFUSE, DenoiserSettings, SPECULAR}
#import bevy_restir::scene::surface::Shape
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{eye_of, project}
#import bevy_restir::view::primary::{pixel_shape, previous_pixel_shape}

@group(2) @binding(0) var<uniform> settings: DenoiserSettings;
// Light without albedo; alpha < 0: the surface has no such light.
@group(2) @binding(1) var signals: texture_2d_array<f32>;
@group(2) @binding(2) var guides: texture_2d<u32>;
@group(2) @binding(3) var last_guides: texture_2d<u32>;
@group(2) @binding(4) var last_means: texture_2d_array<u32>;
@group(2) @binding(5) var means: texture_storage_2d_array<rgba32uint, write>;
// The means with their variance.
@group(2) @binding(6) var filtered: texture_storage_2d_array<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn denoiser_temporal(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let own = guide_unpack(textureLoad(guides, pixel, 0));
    if own.depth == 0.0 {
        pass_on(pixel, DIFFUSE);
        pass_on(pixel, SPECULAR);
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    let before = previous_pixel_shape(ids, pixel);
    let last = last_place(own, before);
    let now = pixel_shape(ids, pixel, false);
    let frames = vec2<f32>(f32(settings.history), specular_frames(own.roughness, now.position, before.position));
    average(pixel, own, DIFFUSE, last, frames.x);
    average(pixel, own, SPECULAR, last, frames.y);
}

// Light that is not filtered.
fn pass_on(pixel: vec2<u32>, kind: u32) {
    textureStore(means, pixel, kind, mean_pack(no_mean()));
    textureStore(filtered, pixel, kind, textureLoad(signals, pixel, kind, 0));
}

// Where the last frame showed a surface.
struct LastPlace {
    surface: Guide,            // as it was
    at: vec2<f32>,             // pixels, from the center of the first one
    weights: vec4<f32>,        // bilinear weights of the four pixels around; 0 where they showed another surface
}

// Least cosine between the normals of similar surfaces.
const LEAST_COSINE: f32 = 0.9;
// Tests of the last frame are looser than weights: its pixels have other positions on the surface.
const LEAST_PLANE_WEIGHT: f32 = 0.05;

fn last_place(own: Guide, before: Shape) -> LastPlace {
    var surface = own;
    surface.depth = guide_depth(view.previous, before.position, true);
    // As in reuse, both jitters are ignored.
    let at = clamp(project(view.previous, before.position) - view.jitter - 0.5, vec2<f32>(-2.0), vec2<f32>(view.size) + 1.0);
    var place = LastPlace(surface, at, vec4<f32>(0.0));
    if settings.has_history == 0u {
        return place;
    }
    let f = fract(at);
    for (var i = 0u; i < 4u; i++) {
        let offset = vec2<u32>(i & 1u, i >> 1u);
        let sides = select(1.0 - f, f, offset == vec2<u32>(1u));
        place.weights[i] = select(0.0, sides.x * sides.y, showed_surface(surface, at, corner_of(at, i)));
    }
    return place;
}

fn corner_of(at: vec2<f32>, i: u32) -> vec2<i32> {
    return vec2<i32>(floor(at)) + vec2<i32>(vec2<u32>(i & 1u, i >> 1u));
}

// Whether a pixel of the last frame showed a surface whose place was `at`.
fn showed_surface(surface: Guide, at: vec2<f32>, pixel: vec2<i32>) -> bool {
    if any(pixel < vec2<i32>(0)) || any(pixel >= vec2<i32>(view.size)) {
        return false;
    }
    return is_similar(surface, guide_unpack(textureLoad(last_guides, pixel, 0)), vec2<f32>(pixel) - at);
}

fn is_similar(own: Guide, other: Guide, offset: vec2<f32>) -> bool {
    return other.depth > 0.0 && dot(other.n, own.n) > LEAST_COSINE && plane_weight(own, other.depth, offset) > LEAST_PLANE_WEIGHT;
}

// Frames in which the direction of view may change by half the width of the specular lobe: a reflection then still shows the same.
fn specular_frames(roughness: f32, now: vec3<f32>, before: vec3<f32>) -> f32 {
    let change = distance(normalize(eye_of(now, false) - now), normalize(eye_of(before, true) - before));
    return clamp(0.5 * roughness / max(change, 1.0e-6), 1.0, f32(settings.history));
}

// The last mean at a pixel's surface.
fn last_mean(place: LastPlace, kind: u32) -> Mean {
    var sum = no_mean();
    var weights = 0.0;
    for (var i = 0u; i < 4u; i++) {
        if place.weights[i] > 0.0 {
            let mean = mean_unpack(textureLoad(last_means, corner_of(place.at, i), kind, 0));
            if mean.frames > 0.0 {
                sum = add_mean(sum, mean, place.weights[i]);
                weights += place.weights[i];
            }
        }
    }
    if !(weights > 0.01) {
        return no_mean();
    }
    return add_mean(no_mean(), sum, 1.0 / weights);
}

// Luminance around a pixel, on similar surfaces.
struct Neighborhood {
    mean: f32,
    variance: f32,             // between pixels
    change: f32,               // of the mean of the pixels, from the last means to this frame
    noise: f32,                // mean variance of a pixel between frames
}

// Pixels on each side.
const NEIGHBORHOOD: i32 = 3;

fn neighborhood(pixel: vec2<u32>, own: Guide, kind: u32, place: LastPlace) -> Neighborhood {
    var moments = vec2<f32>(0.0);
    var count = 0.0;
    var change = 0.0;
    var noise = 0.0;
    var compared = 0.0;
    let last_pixel = vec2<i32>(round(place.at));
    for (var y = -NEIGHBORHOOD; y <= NEIGHBORHOOD; y++) {
        for (var x = -NEIGHBORHOOD; x <= NEIGHBORHOOD; x++) {
            let offset = vec2<i32>(x, y);
            let other_pixel = vec2<i32>(pixel) + offset;
            if any(other_pixel < vec2<i32>(0)) || any(other_pixel >= vec2<i32>(view.size)) {
                continue;
            }
            let light = textureLoad(signals, other_pixel, kind, 0);
            if light.a < 0.0 || !is_similar(own, guide_unpack(textureLoad(guides, other_pixel, 0)), vec2<f32>(offset)) {
                continue;
            }
            let l = bounded_luminance(light.rgb);
            moments += vec2<f32>(l, l * l);
            count += 1.0;
            if settings.has_history != 0u && showed_surface(place.surface, place.at, last_pixel + offset) {
                let last = mean_unpack(textureLoad(last_means, last_pixel + offset, kind, 0));
                if last.frames > 0.0 {
                    change += l - bounded_luminance(last.color);
                    noise += variance_of(last);
                    compared += 1.0;
                }
            }
        }
    }
    moments /= max(count, 1.0);
    compared = max(compared, 1.0);
    return Neighborhood(moments.x, max(moments.y - moments.x * moments.x, 0.0), change / compared, noise / compared);
}

// Relative change of the light that no history is shortened for.
const LEAST_CHANGE: f32 = 0.01;
// Frames of a mean where the change of the light is as large as the noise of a frame.  By experiment: fewer follow changes better and are
// noisier at rest.
const FRAMES_OF_NOISE: f32 = 1.0;

// Greatest number of frames of a mean where the light changes: over n frames, noise falls to 1/n of its variance, and the lag is about the
// change, so that both are equal where n is the variance over the squared change.
fn frames_for_change(around: Neighborhood) -> f32 {
    let least = LEAST_CHANGE * around.mean;
    let change = max(abs(around.change) - least, 0.0);
    return FRAMES_OF_NOISE * (around.noise + least * least) / max(change * change, 1.0e-37);
}

// Frames after which the variance over frames is trusted.
const FEW_FRAMES: f32 = 8.0;
// Frames that count as one in the variance of a mean, because reuse gives them the same samples.
const CORRELATED_FRAMES: f32 = 2.0;

fn average(pixel: vec2<u32>, own: Guide, kind: u32, place: LastPlace, most_frames: f32) {
    let light = textureLoad(signals, pixel, kind, 0);
    if light.a < 0.0 {
        pass_on(pixel, kind);
        return;
    }
    let around = neighborhood(pixel, own, kind, place);
    let last = last_mean(place, kind);
    let frames = max(min(min(last.frames + 1.0, most_frames), frames_for_change(around)), 1.0);
    let l = bounded_luminance(light.rgb);
    let share = 1.0 / frames;
    let mean = Mean(mix(last.color, light.rgb, share), mix(last.second_moment, l * l, share), frames);
    textureStore(means, pixel, kind, mean_pack(mean));
    let trust = clamp((frames - 1.0) / FEW_FRAMES, 0.0, 1.0);
    let of_frames = mix(max(around.variance, variance_of(mean)), variance_of(mean), trust);
    textureStore(filtered, pixel, kind, vec4<f32>(mean.color, of_frames * min(CORRELATED_FRAMES / frames, 1.0)));
}
