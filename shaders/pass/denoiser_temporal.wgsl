// Averages the light of a pixel over frames: the mean of the last frame is taken from where its surface was.  The result, with an estimate of
// its variance, goes to the filter.

#import bevy_restir::common::constants::{LEAST_DIVISOR, LEAST_MAGNITUDE}
#import bevy_restir::denoiser::guide::{Guide, guide_depth, guide_unpack, plane_weight}
#import bevy_restir::denoiser::optical_image::image_guide
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
// Optical images, and where the last frame showed them; one empty texel where the scene has nothing smooth.
@group(2) @binding(7) var images: texture_2d<u32>;
@group(2) @binding(8) var last_images: texture_2d<u32>;
@group(2) @binding(9) var last_places: texture_2d<f32>;

@compute @workgroup_size(8, 8)
fn denoiser_temporal(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let own = guide_unpack(textureLoad(guides, pixel, 0));
    if own.depth == 0.0 {
        store_unfiltered(pixel, DIFFUSE);
        store_unfiltered(pixel, SPECULAR);
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    let before = previous_pixel_shape(ids, pixel);
    // Computed here, so that no shape takes registers during the loops below.
    var reflection_frames = 0.0;
    if !own.shows_image {
        reflection_frames = specular_frames(own.roughness, pixel_shape(ids, pixel, false), before);
    }
    let last = last_place(own, before.position, false);
    let around = neighborhoods(pixel, own, last);
    average(pixel, DIFFUSE, last, around[DIFFUSE], f32(settings.history));
    if own.shows_image {
        let image = image_guide(textureLoad(images, pixel, 0));
        let last_of_image = last_place(image, textureLoad(last_places, pixel, 0).xyz, true);
        average(pixel, SPECULAR, last_of_image, neighborhoods(pixel, image, last_of_image)[SPECULAR], f32(settings.history));
    } else {
        average(pixel, SPECULAR, last, around[SPECULAR], reflection_frames);
    }
}

// Light that is not filtered.
fn store_unfiltered(pixel: vec2<u32>, kind: u32) {
    textureStore(means, pixel, kind, mean_pack(no_mean()));
    textureStore(filtered, pixel, kind, textureLoad(signals, pixel, kind, 0));
}

// Where the last frame showed a surface or an optical image.
struct LastPlace {
    surface: Guide,            // as it was
    is_image: bool,
    is_seen: bool,             // within the image, or at most a pixel outside
    at: vec2<f32>,             // pixels, from the center of the first one
    weights: vec4<f32>,        // bilinear weights of the four pixels around; 0 where they showed another surface
}

// Least cosine between the normals of similar surfaces.
const LEAST_COSINE: f32 = 0.9;
// Tests of the last frame are looser than weights: its pixels have other positions on the surface.
const LEAST_PLANE_WEIGHT: f32 = 0.05;

// `position`: in the last frame.
fn last_place(own: Guide, position: vec3<f32>, is_image: bool) -> LastPlace {
    var surface = own;
    surface.depth = guide_depth(view.previous, position, true);
    // As in reuse, both jitters are ignored.
    let at = clamp(project(view.previous, position) - view.jitter - 0.5, vec2<f32>(-2.0), vec2<f32>(view.size) + 1.0);
    let is_seen = settings.has_history != 0u && all(at > vec2<f32>(-1.0)) && all(at < vec2<f32>(view.size));
    var place = LastPlace(surface, is_image, is_seen, at, vec4<f32>(0.0));
    let f = fract(at);
    for (var i = 0u; i < 4u; i++) {
        let offset = vec2<u32>(i & 1u, i >> 1u);
        let sides = select(1.0 - f, f, offset == vec2<u32>(1u));
        place.weights[i] = select(0.0, sides.x * sides.y, showed_surface(place, corner_of(at, i)));
    }
    return place;
}

fn corner_of(at: vec2<f32>, i: u32) -> vec2<i32> {
    return vec2<i32>(floor(at)) + vec2<i32>(vec2<u32>(i & 1u, i >> 1u));
}

// Whether a pixel of the last frame showed the surface.
fn showed_surface(place: LastPlace, pixel: vec2<i32>) -> bool {
    if !place.is_seen || any(pixel < vec2<i32>(0)) || any(pixel >= vec2<i32>(view.size)) {
        return false;
    }
    let offset = vec2<f32>(pixel) - place.at;
    if place.is_image {
        return is_similar(place.surface, image_guide(textureLoad(last_images, pixel, 0)), offset);
    }
    return is_similar(place.surface, guide_unpack(textureLoad(last_guides, pixel, 0)), offset);
}

fn is_similar(own: Guide, other: Guide, offset: vec2<f32>) -> bool {
    return other.depth > 0.0 && other.shows_image == own.shows_image && dot(other.n, own.n) > LEAST_COSINE
        && plane_weight(own, other.depth, offset) > LEAST_PLANE_WEIGHT;
}

// Frames in which the direction of reflection may change by half the width of the specular lobe: a reflection then still shows the same.
fn specular_frames(roughness: f32, now: Shape, before: Shape) -> f32 {
    let change = distance(reflected_view(now, eye_of(now.position, false)), reflected_view(before, eye_of(before.position, true)));
    return clamp(0.5 * roughness / max(change, 1.0e-6), 1.0, f32(settings.history));
}

fn reflected_view(at: Shape, eye: vec3<f32>) -> vec3<f32> {
    return reflect(normalize(at.position - eye), at.n);
}

// Least sum of the bilinear weights of a last mean.  Below it, the only pixels that show the surface are almost a pixel away.
const LEAST_SHARE_OF_LAST: f32 = 0.01;

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
    if !(weights > LEAST_SHARE_OF_LAST) {
        return no_mean();
    }
    return add_mean(no_mean(), sum, 1.0 / weights);
}

// Sums over the luminance of the pixels around, as far as they show a similar surface.  Where a pixel has no last mean, the light of this
// frame takes its place in `means`.
struct Neighborhood {
    count: f32,
    light: vec2<f32>,          // of this frame, and its square
    means: vec2<f32>,          // of the last means, and their squares
    brightest: vec3<f32>,      // the three greatest of the means
    compared: f32,             // number of pixels with a last mean
    change: f32,               // from the last means to this frame
    noise: f32,                // variance between frames
    quads: f32,                // number of quads: 2 x 2 pixels that all show the surface
    grain: f32,                // sum of `grain_of` over the quads
    coarsest: f32,             // greatest grain of a quad
}

// Quads on each side of the neighborhood.
const QUADS: u32 = 3u;

fn neighborhoods(pixel: vec2<u32>, own: Guide, place: LastPlace) -> array<Neighborhood, 2> {
    let empty = Neighborhood(0.0, vec2<f32>(0.0), vec2<f32>(0.0), vec3<f32>(0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    var diffuse = empty;
    var specular = empty;
    let last_pixel = vec2<i32>(round(place.at));
    for (var i = 0u; i < QUADS * QUADS; i++) {
        let corner = 2 * vec2<i32>(vec2<u32>(i % QUADS, i / QUADS)) - i32(QUADS);
        var shows = vec4<bool>(false);
        var showed = vec4<bool>(false);
        for (var j = 0u; j < 4u; j++) {
            let offset = corner + vec2<i32>(vec2<u32>(j & 1u, j >> 1u));
            shows[j] = shows_surface(own, place.is_image, vec2<i32>(pixel) + offset, offset);
            showed[j] = shows[j] && showed_surface(place, last_pixel + offset);
        }
        // The specular light of a mirror is compared at its optical image, and its diffuse light at its surface.
        if !place.is_image {
            diffuse = with_quad(diffuse, vec2<i32>(pixel) + corner, shows, last_pixel + corner, showed, DIFFUSE);
        }
        if place.is_image || !own.shows_image {
            specular = with_quad(specular, vec2<i32>(pixel) + corner, shows, last_pixel + corner, showed, SPECULAR);
        }
    }
    return array<Neighborhood, 2>(diffuse, specular);
}

fn shows_surface(own: Guide, is_image: bool, pixel: vec2<i32>, offset: vec2<i32>) -> bool {
    if any(pixel < vec2<i32>(0)) || any(pixel >= vec2<i32>(view.size)) {
        return false;
    }
    if is_image {
        return is_similar(own, image_guide(textureLoad(images, pixel, 0)), vec2<f32>(offset));
    }
    return is_similar(own, guide_unpack(textureLoad(guides, pixel, 0)), vec2<f32>(offset));
}

fn with_quad(sum: Neighborhood, corner: vec2<i32>, shows: vec4<bool>, last_corner: vec2<i32>, showed: vec4<bool>, kind: u32) -> Neighborhood {
    var result = sum;
    var quad = vec4<f32>(0.0);
    var is_whole = true;
    for (var j = 0u; j < 4u; j++) {
        let offset = vec2<i32>(vec2<u32>(j & 1u, j >> 1u));
        var light = vec4<f32>(-1.0);
        if shows[j] {
            light = textureLoad(signals, corner + offset, kind, 0);
        }
        if light.a < 0.0 {
            is_whole = false;
            continue;
        }
        let l = bounded_luminance(light.rgb);
        var m = l;
        if showed[j] {
            let last = mean_unpack(textureLoad(last_means, last_corner + offset, kind, 0));
            if last.frames > 0.0 {
                m = bounded_luminance(last.color);
                result.change += l - m;
                result.noise += variance_of(last);
                result.compared += 1.0;
            }
        }
        result.count += 1.0;
        result.light += vec2<f32>(l, l * l);
        result.means += vec2<f32>(m, m * m);
        result.brightest = with_brightest(result.brightest, m);
        quad[j] = m;
    }
    if is_whole {
        let grain = grain_of(quad);
        result.quads += 1.0;
        result.grain += grain;
        result.coarsest = max(result.coarsest, grain);
    }
    return result;
}

fn with_brightest(brightest: vec3<f32>, l: f32) -> vec3<f32> {
    let second = min(l, brightest.x);
    return vec3<f32>(max(l, brightest.x), max(second, brightest.y), max(min(second, brightest.y), brightest.z));
}

// Noise of four pixels relative to their mean: the diagonal Haar coefficient.  It is 0 for a gradient, and for an edge along the pixels.
fn grain_of(quad: vec4<f32>) -> f32 {
    return 2.0 * abs(quad.x - quad.y - quad.z + quad.w) / max(dot(quad, vec4<f32>(1.0)), LEAST_MAGNITUDE);
}

// Relative change of the light that no history is shortened for.
const LEAST_CHANGE: f32 = 0.01;
// Frames of a mean where the change of the light is as large as the noise of a frame.  By experiment: fewer follow changes better and are
// noisier at rest.
const FRAMES_OF_NOISE: f32 = 1.0;

// Greatest number of frames of a mean where the light changes: over n frames, noise falls to 1/n of its variance, and the lag is about the
// change, so that both are equal where n is the variance over the squared change.
fn frames_for_change(around: Neighborhood) -> f32 {
    let least = LEAST_CHANGE * around.light.x / around.count;
    let compared = max(around.compared, 1.0);
    let change = max(abs(around.change) / compared - least, 0.0);
    return FRAMES_OF_NOISE * (around.noise / compared + least * least) / max(change * change, LEAST_DIVISOR);
}

// Frames that count as one in the variance of a mean, because reuse gives them the same samples.
const CORRELATED_FRAMES: f32 = 2.0;
// Standard deviation of normally distributed noise, relative to the mean of its absolute value.
const DEVIATION_OF_MEAN: f32 = 1.2533;
// Standard deviations from the pixels around at which a pixel is an outlier: all of its difference is noise.
const OUTLIER_DEVIATIONS: f32 = 3.0;
// The same, relative to the luminance.
const OUTLIER_SHARE: f32 = 0.05;
// Least number of other pixels that an outlier is compared with.
const FEWEST_AROUND: f32 = 3.0;
// Frames after which the variance over frames is trusted.
const FEW_FRAMES: f32 = 8.0;

// The variance of a mean: the greater one of two estimates, over frames and over pixels.  Reuse makes both too small, because frames and the
// pixels around each other share samples.
fn variance_of_mean(mean: Mean, around: Neighborhood) -> f32 {
    let light = around.light / around.count;
    let trust = clamp((mean.frames - 1.0) / FEW_FRAMES, 0.0, 1.0);
    let of_frames = mix(max(light.y - light.x * light.x, variance_of(mean)), variance_of(mean), trust);
    // Without the coarsest quad, which may have an outlier.
    let grain = DEVIATION_OF_MEAN * max(around.grain - around.coarsest, 0.0) / max(around.quads - 1.0, 1.0);
    let deviation = max(grain * bounded_luminance(mean.color), abs(outlying(mean, around)));
    return max(of_frames * min(CORRELATED_FRAMES / mean.frames, 1.0), deviation * deviation);
}

// The difference of an outlier from the pixels around, without the brightest of them; 0: the pixel is no outlier.
fn outlying(mean: Mean, around: Neighborhood) -> f32 {
    // Without the three pixels of `brightest`.
    let count = around.count - 3.0;
    if count < FEWEST_AROUND {
        return 0.0;
    }
    let usual = max(around.means.x - dot(around.brightest, vec3<f32>(1.0)), 0.0) / count;
    let variance = max((around.means.y - dot(around.brightest, around.brightest)) / count - usual * usual, 0.0);
    let difference = bounded_luminance(mean.color) - usual;
    return select(0.0, difference, abs(difference) > OUTLIER_DEVIATIONS * sqrt(variance) + OUTLIER_SHARE * usual);
}

fn average(pixel: vec2<u32>, kind: u32, place: LastPlace, around: Neighborhood, most_frames: f32) {
    let light = textureLoad(signals, pixel, kind, 0);
    if light.a < 0.0 {
        store_unfiltered(pixel, kind);
        return;
    }
    let last = last_mean(place, kind);
    let frames = max(min(min(last.frames + 1.0, most_frames), frames_for_change(around)), 1.0);
    let l = bounded_luminance(light.rgb);
    let share = 1.0 / frames;
    let mean = Mean(mix(last.color, light.rgb, share), mix(last.second_moment, l * l, share), frames);
    textureStore(means, pixel, kind, mean_pack(mean));
    textureStore(filtered, pixel, kind, vec4<f32>(mean.color, variance_of_mean(mean, around)));
}
