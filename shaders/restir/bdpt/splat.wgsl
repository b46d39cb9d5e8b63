// Technique t = 1: the camera sees a vertex of a light sub-path (Hedstrom et al. 2025, 5 and 7.1).  Its light lands anywhere in a pixel.  A splat
// is a function of random numbers: it can be replayed with the same numbers, in the scene of this frame or of the last one.
#define_import_path bevy_restir::restir::bdpt::splat

#import bevy_restir::bsdf::bsdf::bsdf_pdf
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_LIGHT_CONTRIBUTION, guarded_3}
#import bevy_restir::common::math::luminance
#import bevy_restir::common::ray::Ray
#import bevy_restir::path::bidirectional_mis::mis_splat_weight
#import bevy_restir::path::light_path::{LightWalk, scattered_value}
#import bevy_restir::path::nee::nee_candidate_count
#import bevy_restir::restir::bdpt::last_edge::{can_reconnect, LastEdge}
#import bevy_restir::restir::bdpt::techniques::splat_share
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::connection::light_sub_path::replayed_sub_path
#import bevy_restir::scene::offset::offset_end
#import bevy_restir::scene::surface::{Surface, surface_at}
#import bevy_restir::trace::drawn_sides::is_drawn
#import bevy_restir::trace::trace::trace_drawn
#import bevy_restir::view::camera::{camera_density, camera_of, camera_point, CameraPoint, pixel_cone}
#import bevy_restir::view::light_part::{bsdf_diffuse_share, pack_share}
#import bevy_restir::view::pixel::{pixel_at, pixel_index}
#import bevy_restir::view::types::Camera

struct Splat {
    pixel: u32,                // index, or NONE
    value: vec3<f32>,
    diffuse: u32,              // share that the surface scatters diffusely, packed; without SPLIT_LIGHT 0
    reconnects: bool,          // its last edge can be reconnected (`restir/bdpt/last_edge.wgsl`), so that it belongs to that domain
}

fn no_splat() -> Splat {
    return Splat(NONE, vec3<f32>(0.0), 0u, false);
}

// The splat of the newest vertex, now or (`previous`) in the last frame; its pixel is NONE if the camera does not see the vertex.
fn splat_of(w: LightWalk, alpha_seed: u32, previous: bool) -> Splat {
    if settings.splats == 0u {
        return no_splat();
    }
    let camera = camera_of(previous);
    let point = camera_point(camera, w.surface.position);
    let wo = -point.ray.direction;
    if !point.inside || !is_drawn(w.hit.instance, w.hit.triangle, wo, previous) {
        return no_splat();
    }
    let depth = distance(point.ray.origin, w.surface.position);
    let s = seen_surface(w, camera, point, previous);
    let cosine = abs(dot(s.bsdf.n_geo, wo));
    let density = camera_density(camera, wo, depth);
    var state = w.state;
    if w.events == 1u {
        // At this vertex, NEE draws several light candidates (`nee_density`).
        state.last *= f32(nee_candidate_count(settings.candidates, 1u));
    }
    let pdf_reverse = bsdf_pdf(s.bsdf, wo, w.towards_light);
    let weight = mis_splat_weight(density, f32(settings.splats), cosine, state, pdf_reverse);
    let scale = splat_share(weight) * cosine * density / f32(settings.splats);
    let value = guarded_3(w.throughput * scattered_value(s, wo, w.towards_light) * scale, GUARD_LIGHT_CONTRIBUTION);
    if !(luminance(value) > 0.0) {
        return no_splat();
    }
    let diffuse = bitcast<u32>(pack_share(bsdf_diffuse_share(s.bsdf, wo, w.towards_light)));
    if !is_visible_to_camera(point, offset_end(s.position, s.bsdf.n_geo, wo, s.offset, depth), alpha_seed, previous) {
        return no_splat();
    }
    let pixel = pixel_at(point.at);
    return Splat(pixel_index(pixel), value, diffuse, reconnects_at(w, s, pdf_reverse, previous));
}

// Whether the edge to the newest vertex can be reconnected.  `s`: the surface there, as the camera sees it.  `pdf_reverse`: with which a path
// from the camera would take the edge.
fn reconnects_at(w: LightWalk, s: Surface, pdf_reverse: f32, previous: bool) -> bool {
    if !w.is_clear || !(w.pdf > 0.0) {
        return false;
    }
    let before = s.position + w.hit.t * w.towards_light;
    return can_reconnect(s, LastEdge(before, w.normal_before, w.pdf, pdf_reverse), previous);
}

// The splat of a vertex of a replayed sub-path, unless its last edge can be reconnected: then it belongs to another domain.
fn replayed_splat(path: u32, frame: u32, light: u32, events: u32, previous: bool) -> Splat {
    let p = replayed_sub_path(path, frame, light, events, previous);
    if p.walk.events != events {
        return no_splat();
    }
    let splat = splat_of(p.walk, p.alpha_seed, previous);
    if splat.reconnects {
        return no_splat();
    }
    return splat;
}

// The surface of the newest vertex as a path from the camera would evaluate it.
fn seen_surface(w: LightWalk, camera: Camera, point: CameraPoint, previous: bool) -> Surface {
    let cone = pixel_cone(camera, point.ray, distance(point.ray.origin, w.surface.position));
    return surface_at(w.hit.instance, w.hit.triangle, w.hit.barycentrics, -point.ray.direction, cone, previous);
}

// Whether the camera sees a point.  Its rays begin at the near plane.
fn is_visible_to_camera(point: CameraPoint, end: vec3<f32>, alpha_seed: u32, previous: bool) -> bool {
    return !trace_drawn(Ray(point.near, 0.0, end - point.near, 1.0), alpha_seed, previous);
}
