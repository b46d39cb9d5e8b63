// MIS weights of bidirectional path tracing by the balance heuristic, accumulated along both sub-paths (Georgiev et al. 2012; Hedstrom et
// al. 2025, 6.1, Eqs. 30-35, 40 and 41).  `MisState` holds their d^p and d^VC.  Eq. 40 is printed with a wrong index: the factor of d^VC is
// p_(s-2), as in Eq. 34.
//
// A path of k + 1 vertices x0 (the camera) to xk (on a light) can be found by every technique (s, t) with s + t = k + 1: its last s vertices
// come from a light sub-path, its first t from a camera sub-path.  Technique (k, 1) has `splats` samples in an image, and the others have
// one in a pixel.  All densities of directions are in solid angle, `*_forward` in the direction of the sub-path and `*_reverse` against it.
// Russian roulette is not part of them: the weights of all techniques sum to one with any densities.  All terms have the unit m², so that
// f32 holds them in scenes of any size.
#define_import_path bevy_restir::path::bidirectional_mis

// Ratios of the densities of other techniques to that of this sub-path.  On a ray they lack the factors of the vertex where it arrives.
struct MisState {
    last: f32,                 // of the technique that joins the sub-paths at the last edge
    earlier: f32,              // sum over the techniques that join them earlier, divided by the density of the reverse direction here
}

// The camera ray before it arrives at x1.  `camera_density`: samples of a pixel for each unit of area perpendicular to the ray, at x1.
fn mis_camera_start(splats: f32, camera_density: f32) -> MisState {
    return MisState(splats / camera_density, 0.0);
}

// The ray of a light sub-path before it arrives at y1.  All densities already hold at y1, so that `mis_arrive` gets the distance 1.
// `nee_density`, `light_density`: with which next-event estimation and light sub-paths sample the light's point, in solid angle about y1;
// of a delta light only their ratio matters.  `emission_density`: of the light's rays at y1, for each unit of perpendicular area.
fn mis_light_start(nee_density: f32, light_density: f32, emission_density: f32, is_delta: bool) -> MisState {
    return MisState(nee_density / (light_density * emission_density), select(1.0 / (light_density * emission_density), 0.0, is_delta));
}

// Arrival at a vertex.  `distance2`: 1 where the ray's state already holds for the vertex.
fn mis_arrive(s: MisState, distance2: f32, cos_in: f32) -> MisState {
    return MisState(s.last * distance2 / cos_in, s.earlier / cos_in);
}

// Scattering at a vertex that can be connected: Eqs. 31 and 32, together with `mis_arrive` at the next vertex.
fn mis_scatter(s: MisState, cos_out: f32, pdf_forward: f32, pdf_reverse: f32) -> MisState {
    return MisState(1.0 / pdf_forward, cos_out / pdf_forward * joined(s, pdf_forward, pdf_reverse));
}

// Scattering by a delta lobe, which no technique connects.  Weights assume that it has the same probability in both directions.
fn mis_scatter_delta(s: MisState, cos_out: f32) -> MisState {
    return MisState(0.0, cos_out * s.earlier);
}

// Sum over all techniques that join the sub-paths at the last edge or at an earlier one.
fn mis_sum(s: MisState, pdf_reverse: f32) -> f32 {
    return s.last + s.earlier * pdf_reverse;
}

// PLANT_*: errors that only tests define, and must find.
#ifdef PLANT_MIS_ORDER
// The state after scattering is used in place of the one before.
fn joined(s: MisState, pdf_forward: f32, pdf_reverse: f32) -> f32 {
    return mis_sum(MisState(1.0 / pdf_forward, s.earlier), pdf_reverse);
}
#else
fn joined(s: MisState, pdf_forward: f32, pdf_reverse: f32) -> f32 {
    return mis_sum(s, pdf_reverse);
}
#endif

// `path/technique_weights.wgsl` has the weights of s = 0 and s = 1 (Eqs. 36-39).

// The light vertex of a connection.
struct LightEnd {
    state: MisState,
    cosine: f32,               // of the connection with the geometric normal
    pdf_forward: f32,          // towards the camera's vertex
    pdf_reverse: f32,          // back along the sub-path, with light that comes from the other end
}

// Techniques s, t >= 2 (Eqs. 33-35), as far as the light sub-path decides: the sum of the techniques that join the sub-paths nearer to the
// light, over the density of the direction at the camera's vertex; and the factor of the sum of those that join them nearer to the camera.
// Both are relative to this technique, which counts as `connections` (`TechniqueCounts`).
fn mis_connection_ratios(light: LightEnd, camera_cosine: f32, distance2: f32, connections: f32) -> vec2<f32> {
    let nearer_to_light = light.cosine * mis_sum(light.state, light.pdf_reverse);
    return vec2<f32>(nearer_to_light, light.pdf_forward * camera_cosine) / (distance2 * connections);
}

// Technique t = 1: a vertex of a light sub-path that the camera sees.  `camera_density` and `splats` as in `mis_camera_start`.
fn mis_splat_weight(camera_density: f32, splats: f32, cos_in: f32, light: MisState, pdf_reverse: f32) -> f32 {
    return 1.0 / (1.0 + camera_density * cos_in / splats * mis_sum(light, pdf_reverse));
}
