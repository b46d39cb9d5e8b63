// Hits of a probe: a ray that finds every triangle of one instance between its ends, instead of the closest triangle of the scene.  Both
// back ends sort the hits by distance, so that the index of a hit has one meaning for both of them.
#define_import_path bevy_restir::trace::probe_hits

#import bevy_restir::common::constants::OVERFLOW_PROBE
#import bevy_restir::common::ray::trace_flags

// Greatest number of hits.  A probe with more hits has none, in both directions of a shift, and OVERFLOW_PROBE is reported.
const PROBE_HITS_MAX: u32 = 8u;

// `count` is PROBE_HITS_MAX + 1 if there are more hits than that.
struct ProbeHits {
    count: u32,
    distances: array<f32, PROBE_HITS_MAX>,
    triangles: array<u32, PROBE_HITS_MAX>,
}

fn no_probe_hits() -> ProbeHits {
    return ProbeHits(0u, array<f32, PROBE_HITS_MAX>(), array<u32, PROBE_HITS_MAX>());
}

// Inserts a hit in the order of (distance, triangle).  A device may report a triangle twice; it is inserted once.
fn with_probe_hit(before: ProbeHits, t: f32, triangle: u32) -> ProbeHits {
    var hits = before;
    for (var i = 0u; i < min(hits.count, PROBE_HITS_MAX); i += 1u) {
        if hits.triangles[i] == triangle {
            return hits;
        }
    }
    if hits.count >= PROBE_HITS_MAX {
        hits.count = PROBE_HITS_MAX + 1u;
        return hits;
    }
    var at = hits.count;
    while at > 0u && (hits.distances[at - 1u] > t || (hits.distances[at - 1u] == t && hits.triangles[at - 1u] > triangle)) {
        hits.distances[at] = hits.distances[at - 1u];
        hits.triangles[at] = hits.triangles[at - 1u];
        at -= 1u;
    }
    hits.distances[at] = t;
    hits.triangles[at] = triangle;
    hits.count += 1u;
    return hits;
}

fn has_too_many(hits: ProbeHits) -> bool {
    return hits.count > PROBE_HITS_MAX;
}

// Ends a probe that has too many hits or steps.
fn failed_probe() -> ProbeHits {
    trace_flags |= OVERFLOW_PROBE;
    return no_probe_hits();
}
