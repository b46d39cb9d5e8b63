// Hits of a probe: a ray that finds every triangle of one instance between its ends, instead of the closest triangle of the scene.  Both
// back ends sort the hits by distance, so that the index of a hit has one meaning for both of them.
#define_import_path bevy_restir::trace::probe_hits

#import bevy_restir::common::constants::{NONE, OVERFLOW_PROBE}
#import bevy_restir::common::ray::trace_flags

// Greatest number of hits.  A probe with more hits counts as one without hits, in both directions of a shift, and reports OVERFLOW_PROBE.
const PROBE_HITS_MAX: u32 = 8u;

// Distance in a slot without a hit, beyond every ray.
const NO_HIT_DISTANCE: f32 = 3.4e38;

// `count` is PROBE_HITS_MAX + 1 if there are more hits than that.  The hits lie in vectors and not in arrays, because a device keeps an
// array in memory if its index is not a constant.
struct ProbeHits {
    count: u32,
    distances: vec4<f32>,           // of hits 0 to 3
    more_distances: vec4<f32>,      // of hits 4 to 7
    triangles: vec4<u32>,
    more_triangles: vec4<u32>,
}

fn no_probe_hits() -> ProbeHits {
    return ProbeHits(0u, vec4<f32>(NO_HIT_DISTANCE), vec4<f32>(NO_HIT_DISTANCE), vec4<u32>(NONE), vec4<u32>(NONE));
}

fn probe_distance(hits: ProbeHits, index: u32) -> f32 {
    return select(hits.distances, hits.more_distances, index >= 4u)[index & 3u];
}

fn probe_triangle(hits: ProbeHits, index: u32) -> u32 {
    return select(hits.triangles, hits.more_triangles, index >= 4u)[index & 3u];
}

// Inserts a hit in the order of (distance, triangle).  A device may report a triangle twice; it is inserted once.
fn with_probe_hit(before: ProbeHits, t: f32, triangle: u32) -> ProbeHits {
    var hits = before;
    if any(hits.triangles == vec4<u32>(triangle)) || any(hits.more_triangles == vec4<u32>(triangle)) {
        return hits;
    }
    if hits.count >= PROBE_HITS_MAX {
        hits.count = PROBE_HITS_MAX + 1u;
        return hits;
    }
    // The hits behind the new one move one slot further; it takes the first slot that becomes free.
    let moves = is_behind(before.distances, before.triangles, t, triangle);
    let more_moves = is_behind(before.more_distances, before.more_triangles, t, triangle);
    let earlier_moves = vec4<bool>(false, moves.xyz);
    let more_earlier_moves = vec4<bool>(moves.w, more_moves.xyz);
    let earlier_distances = vec4<f32>(t, before.distances.xyz);
    let more_earlier_distances = vec4<f32>(before.distances.w, before.more_distances.xyz);
    let earlier_triangles = vec4<u32>(triangle, before.triangles.xyz);
    let more_earlier_triangles = vec4<u32>(before.triangles.w, before.more_triangles.xyz);
    hits.distances = select(before.distances, select(vec4<f32>(t), earlier_distances, earlier_moves), moves);
    hits.more_distances = select(before.more_distances, select(vec4<f32>(t), more_earlier_distances, more_earlier_moves), more_moves);
    hits.triangles = select(before.triangles, select(vec4<u32>(triangle), earlier_triangles, earlier_moves), moves);
    hits.more_triangles = select(before.more_triangles, select(vec4<u32>(triangle), more_earlier_triangles, more_earlier_moves), more_moves);
    hits.count += 1u;
    return hits;
}

fn is_behind(distances: vec4<f32>, triangles: vec4<u32>, t: f32, triangle: u32) -> vec4<bool> {
    return (distances > vec4<f32>(t)) | ((distances == vec4<f32>(t)) & (triangles > vec4<u32>(triangle)));
}

fn has_too_many(hits: ProbeHits) -> bool {
    return hits.count > PROBE_HITS_MAX;
}

// Ends a probe that has too many hits or steps.
fn failed_probe() -> ProbeHits {
    trace_flags |= OVERFLOW_PROBE;
    return no_probe_hits();
}
