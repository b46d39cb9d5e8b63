// Where a path goes on from a vertex: from the surface that it hit, or from a point where light enters the object below that surface.  The
// point of entry then replaces the vertex.
#define_import_path bevy_restir::path::scattering

#import bevy_restir::path::walk::Vertex
#ifdef SUBSURFACE
#import bevy_restir::path::random::path_probe_numbers
#import bevy_restir::subsurface::entry::{exit_factor, sample_entry, scatters_below, subsurface_probability}
#endif

struct ScatteringChoice {
    below: bool,
    probability: f32,          // of this choice; 0 if it is impossible
    carried: vec3<f32>,        // factors of the BSSRDF where the light leaves the body, over the probability
}

// The vertex from which a path goes on.
struct ScatteringVertex {
    vertex: Vertex,
    weight: vec3<f32>,         // light that leaves per light that enters, over the probabilities of choice and point
    below: bool,
    valid: bool,
}

// The vertex from which a path goes on by its own random numbers.
fn scattering_vertex(v: Vertex, seed: u32, index: u32) -> ScatteringVertex {
    let choice = drawn_choice(v, seed, index);
    if !choice.below {
        return ScatteringVertex(v, choice.carried, false, true);
    }
    var entry = entry_vertex(v, seed, index, false);
    entry.weight *= choice.carried;
    return entry;
}

#ifdef SUBSURFACE
// The choice that the path's own random numbers make at the vertex of this index.
fn drawn_choice(v: Vertex, seed: u32, index: u32) -> ScatteringChoice {
    return given_choice(v, path_probe_numbers(seed, index).choice < probability_below(v));
}

fn given_choice(v: Vertex, below: bool) -> ScatteringChoice {
    let p = probability_below(v);
    let chosen = select(1.0 - p, p, below);
    if !(chosen > 0.0) {
        return ScatteringChoice(below, 0.0, vec3<f32>(0.0));
    }
    if !below {
        return ScatteringChoice(false, chosen, vec3<f32>(1.0 / chosen));
    }
    return ScatteringChoice(true, p, exit_factor(v.surface, v.wo) / p);
}

fn probability_below(v: Vertex) -> f32 {
    if !scatters_below(v.surface, v.wo) {
        return 0.0;
    }
    return subsurface_probability(v.surface, v.wo);
}

// The point of entry that the probe of the path's own random numbers finds, without the weight of the choice.  It depends on the vertex, but
// not on where the path came from.
fn entry_vertex(v: Vertex, seed: u32, index: u32, previous: bool) -> ScatteringVertex {
    let numbers = path_probe_numbers(seed, index);
    let entry = sample_entry(v.surface, numbers.probe, numbers.alpha_seed, previous);
    return ScatteringVertex(Vertex(entry.surface, entry.surface.bsdf.n, v.medium, v.cone), entry.weight, true, entry.valid);
}
#else
fn drawn_choice(v: Vertex, seed: u32, index: u32) -> ScatteringChoice {
    return ScatteringChoice(false, 1.0, vec3<f32>(1.0));
}

fn given_choice(v: Vertex, below: bool) -> ScatteringChoice {
    return ScatteringChoice(false, 1.0, vec3<f32>(1.0));
}

fn entry_vertex(v: Vertex, seed: u32, index: u32, previous: bool) -> ScatteringVertex {
    return ScatteringVertex(v, vec3<f32>(0.0), true, false);
}
#endif
