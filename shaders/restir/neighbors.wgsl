// The search for neighbors whose samples a pixel reuses.  Only geometry and random numbers decide: a choice by the samples themselves would
// add bias.
#define_import_path bevy_restir::restir::neighbors

#import bevy_restir::common::constants::{NONE, TWO_PI}
#import bevy_restir::common::rng::{Rng, rng_2}
#import bevy_restir::restir::bindings::{previous_visibility, settings}
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::types::{RESAMPLE_BILINEAR, RESAMPLE_DUAL_MOTION, RESAMPLE_FROM_PREVIOUS, RESAMPLE_HEURISTICS, RESAMPLE_SAME_MATERIAL}
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::surface::Shape
#import bevy_restir::scene::triangle::{instance_exists, world_triangle}
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{barycentrics_on_ray, eye_of, previous_primary_ray, project}
#import bevy_restir::view::pixel::{is_in_picture, pixel_at}
#import bevy_restir::view::primary::{pixel_shape, previous_pixel_shape}

// (instance, triangle) of a neighbor, in the frame that neighbors are taken from.
fn neighbor_ids(pixel: vec2<u32>) -> vec2<u32> {
    if has(RESAMPLE_FROM_PREVIOUS) {
        return textureLoad(previous_visibility, pixel, 0).xy;
    }
    return textureLoad(visibility, pixel, 0).xy;
}

// Where a pixel takes neighbors: its surface and the position of that in the image, both in the frame that neighbors are taken from.
struct ReuseCenter {
    shape: Shape,
    position: vec2<f32>,       // pixels
    pixel: vec2<f32>,          // center of the pixel, in this frame
    radius: f32,               // of the disk that its neighbors are in, pixels
}

fn reuse_center(ids: vec2<u32>, pixel: vec2<u32>, radius: f32) -> ReuseCenter {
    let at = vec2<f32>(pixel) + 0.5;
    if ids.x == NONE {
        return no_center(at);
    }
    if has(RESAMPLE_FROM_PREVIOUS) {
        let shape = previous_pixel_shape(ids, pixel);
        // The surface was found with the jitter of this frame, and those of the last frame with its own.  For the nearest pixel, both
        // jitters are ignored: otherwise all samples of a still picture would move by one pixel, in one direction, whenever the jitter
        // changes by more than half a pixel.  A bilinear choice uses both, because it moves samples in all directions with the same
        // probability.
        let jitter = select(view.jitter, view.previous_jitter, has(RESAMPLE_BILINEAR));
        return ReuseCenter(shape, project(view.previous, shape.position) - jitter, at, radius);
    }
    return ReuseCenter(pixel_shape(ids, pixel, false), at, at, radius);
}

// The center of a pixel without a surface.  It lies outside of the image, so that no neighbor is found.
fn no_center(pixel: vec2<f32>) -> ReuseCenter {
    var center: ReuseCenter;
    center.position = vec2<f32>(-1.0e9);
    center.pixel = pixel;
    return center;
}

// A neighbor; NONE where none is found.  `is_temporal`: the pixel that showed the surface in the last frame.
fn find_neighbor(center: ReuseCenter, is_temporal: bool, rng: ptr<function, Rng>) -> vec2<u32> {
    let attempts = select(settings.neighbor_attempts, settings.temporal_attempts, is_temporal);
    // One loop, so that the test for similarity is in the program once.
    let last = select(attempts, attempts + 1u, is_temporal && has(RESAMPLE_DUAL_MOTION));
    for (var t = 0u; t < last; t++) {
        var at: vec2<f32>;
        if t == attempts {
            at = position_beside_occluder(center);
        } else {
            at = center.position + neighbor_offset(center, is_temporal, t, rng_2(rng));
        }
        let pixel = similar_pixel(center.shape, at);
        if pixel.x != NONE {
            return pixel;
        }
    }
    return vec2<u32>(NONE);
}

// The pixel at a position, in the frame that neighbors are taken from; NONE if its surface is not similar.
fn similar_pixel(own: Shape, at: vec2<f32>) -> vec2<u32> {
    if !is_in_picture(at) {
        return vec2<u32>(NONE);
    }
    let pixel = pixel_at(at);
    let ids = neighbor_ids(pixel);
    if ids.x == NONE || (has(RESAMPLE_HEURISTICS) && !is_similar(own, ids, pixel)) {
        return vec2<u32>(NONE);
    }
    return pixel;
}

// Where to look for a surface that an object hid in the last frame (dual motion vectors, Zeng et al. 2021; Lin et al. 2026, supplement, 7):
// the offset from the object to the surface in this frame is added to the object's position in the last frame.  The background there is
// often similar to the surface.
fn position_beside_occluder(center: ReuseCenter) -> vec2<f32> {
    if !is_in_picture(center.position) {
        return vec2<f32>(-1.0);
    }
    let pixel = pixel_at(center.position);
    let ids = neighbor_ids(pixel);
    if ids.x == NONE || !instance_exists(ids.x, false) {
        return vec2<f32>(-1.0);
    }
    let barycentrics = barycentrics_on_ray(world_triangle(ids.x, ids.y, true), previous_primary_ray(pixel));
    let occluder = surface_point(ids.x, ids.y, barycentrics, false);
    return center.position + center.pixel - project(view.current, occluder);
}

// Along edges and at the border of the image, the jitter of the camera moves the nearest pixel to another surface.  The pixels next to it
// then show the same surface.
const TEMPORAL_RADIUS: f32 = 1.5;
// Centers of pixels within TEMPORAL_RADIUS are at most this far away.  A neighbor farther away was found beside an occluder.
const SAME_SURFACE_RADIUS: f32 = TEMPORAL_RADIUS + 0.71;

// Offset of an attempt, pixels: uniform in a disk.  The first temporal attempt is the nearest pixel, or one of the four around, chosen by
// bilinear weights.
fn neighbor_offset(center: ReuseCenter, is_temporal: bool, attempt: u32, u: vec2<f32>) -> vec2<f32> {
    if is_temporal && attempt == 0u {
        return select(vec2<f32>(0.0), u - 0.5, has(RESAMPLE_BILINEAR));
    }
    if is_temporal {
        return ring_offset(u, 0.0, TEMPORAL_RADIUS);
    }
    return ring_offset(u, min(OWN_RADIUS, center.radius), center.radius);
}

// Half the diagonal of a pixel.  Beyond this distance from its center lie other pixels only: its own sample would add nothing.
const OWN_RADIUS: f32 = 0.7072;

// Uniform between two circles.
fn ring_offset(u: vec2<f32>, inner: f32, outer: f32) -> vec2<f32> {
    return sqrt(mix(inner * inner, outer * outer, u.x)) * vec2<f32>(cos(TWO_PI * u.y), sin(TWO_PI * u.y));
}

// A position from 1 pixel to a quarter of the radius of neighbors (at least 2 pixels) away from a pixel.
fn position_around(pixel: vec2<u32>, rng: ptr<function, Rng>) -> vec2<f32> {
    return vec2<f32>(pixel) + 0.5 + ring_offset(rng_2(rng), 1.0, max(COMPARED_RADIUS * settings.radius, 2.0));
}

const COMPARED_RADIUS: f32 = 0.25;

// Whether a neighbor's surface is similar enough to share light (Wyman and Panteleev 2021, Eq. 24).
fn is_similar(own: Shape, ids: vec2<u32>, pixel: vec2<u32>) -> bool {
    let from_previous = has(RESAMPLE_FROM_PREVIOUS);
    return are_similar(own, pixel_shape(ids, pixel, from_previous), from_previous);
}

// `previous`: both in the last frame.
fn are_similar(own: Shape, other: Shape, previous: bool) -> bool {
    let view_distance = max(distance(own.position, eye_of(own.position, previous)), 1.0e-20);
    return dot(own.n, other.n) >= settings.normal_threshold
        && abs(dot(other.position - own.position, own.n_geo)) <= settings.depth_threshold * view_distance
        && (own.material == other.material || !has(RESAMPLE_SAME_MATERIAL));
}

// Whether a pixel with these (instance, triangle) has samples.
fn receives_light(ids: vec2<u32>) -> bool {
    return ids.x != NONE;
}
