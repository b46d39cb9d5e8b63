// MIS weights of the techniques that find a path from the camera: next-event estimation (NEE), and rays that hit a light.  They compete with
// each other and, where light sub-paths are traced (LIGHT_PATHS), with the techniques of light sub-paths (`path/bidirectional_mis.wgsl`).
//
// A weight is the reciprocal of a sum of ratios of densities, one for each competing technique.  A shift changes the part of a path before
// its reconnection vertex.  The sum depends on that part only through 1/p and S/p: p is the density of the direction after the reconnection
// vertex, and S is the sum over the techniques that join the sub-paths before it.  The sum has the form a + b/p + c S/p, where a, b and c
// do not change in a shift.  A vec3 of this module holds such coefficients, in the order (1, 1/p, S/p), and a reservoir stores b/a and c/a.
// (Hedstrom et al. 2025, 6.2 and 6.3, store 84 bytes for this; their section 8 gives reservoirs of 160 and 244 bytes.)
#define_import_path bevy_restir::path::technique_weights

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_LIGHT_SAMPLE, guarded_or_infinite}
#import bevy_restir::light::emission::emission_density
#import bevy_restir::light::select::light_pmf
#import bevy_restir::light::types::{LightSample, no_light_sample}
#import bevy_restir::light::triangle::triangle_light_pdf_solid_angle
#import bevy_restir::path::bidirectional_mis::{mis_arrive, mis_camera_start}
#import bevy_restir::path::light_path::{arrival_cosine, reverse_pdf}
#import bevy_restir::path::nee::{expected_nee_candidates, nee_candidate_count}
#import bevy_restir::path::walk::{Step, Vertex}
#import bevy_restir::scene::surface::Surface

// Factors by which MIS weights multiply the densities of light sub-paths.  A camera path is resampled and stands for `reuse_gain` samples,
// so that light sub-paths count less where camera paths find the light well, and more where they hardly find it.  The weights sum to 1 with
// any factors that depend on the whole path only.  0: no light sub-paths are traced.
struct LightShares {
    nee: f32,                  // where NEE can find the path: 1/`reuse_gain`
    caustic: f32,              // where light arrives at a delta lobe, so that only hits and light sub-paths find it: `reuse_gain`
}

// Numbers of samples of the techniques.
struct TechniqueCounts {
    nee_candidates: u32,       // light candidates at the first vertex
    splats: f32,               // light sub-paths whose vertices the camera sees
    connections: f32,          // of a vertex of a camera sub-path (`restir/connection/count.wgsl`); 0: there are none
    shares: LightShares,
}

// The newest vertex of a camera sub-path, or the ray that leaves it.
struct CameraState {
    last: vec3<f32>,           // coefficients of `MisState::last`
    earlier: vec3<f32>,        // and of `MisState::earlier`
    basis: vec3<f32>,          // (1, 1/p, S/p); (1, 0, 0) before the reconnection vertex
}

// MIS weight: the reciprocal of the sum with these coefficients (`mis_sum_of_*`).
fn weight_of(coefficients: vec3<f32>, s: CameraState) -> f32 {
    return 1.0 / dot(coefficients, s.basis);
}

// MIS weight of a path that stores its coefficients: those of 1/p and S/p, divided by that of 1.  The stored radiance is divided by the
// coefficient of 1, too.
fn stored_weight(coefficients: vec2<f32>, s: CameraState) -> f32 {
    return 1.0 / (1.0 + dot(coefficients, s.basis.yz));
}

// The state of the ray that leaves the reconnection vertex in a direction of this density.  `sum`: S.
fn behind_reconnection(cos_out: f32, pdf: f32, sum: f32) -> CameraState {
    return CameraState(vec3<f32>(0.0, 1.0, 0.0), vec3<f32>(0.0, 0.0, cos_out), vec3<f32>(1.0, 1.0, sum) / vec3<f32>(1.0, pdf, pdf));
}

// The state of a point where light enters a translucent object.  Light sub-paths end there, so that no technique joins the sub-paths at an
// earlier edge.
fn below_surface(s: CameraState) -> CameraState {
    return CameraState(vec3<f32>(0.0), vec3<f32>(0.0), s.basis);
}

// k v, where 0 stays 0: k may be infinite.
fn scaled(k: f32, v: vec3<f32>) -> vec3<f32> {
    return select(k * v, vec3<f32>(0.0), v == vec3<f32>(0.0));
}

// The light sample that NEE would have taken where a ray hits an emissive surface; `light` is NONE for one that is not in the table of lights.
fn emitter_sample(n: Surface, wi: vec3<f32>, instance: u32, triangle: u32, from_point: vec3<f32>, previous: bool) -> LightSample {
    var l = no_light_sample();
    l.delta = 0u;
    l.light = n.light;
    l.wi = wi;
    l.normal = n.bsdf.n_geo;
    l.distance = distance(n.position, from_point);
    if n.light != NONE {
        l.pdf_solid_angle = triangle_light_pdf_solid_angle(instance, triangle, from_point, n.position, previous);
    }
    return l;
}

// Coefficients of the sum for a ray that hits the light sample `l`.  The ray left the vertex of this index by a delta lobe (`by_delta`) or
// by another one.
fn mis_sum_of_hit(s: CameraState, l: LightSample, by_delta: bool, index: u32, counts: TechniqueCounts) -> vec3<f32> {
    if l.light == NONE {
        return vec3<f32>(1.0, 0.0, 0.0);
    }
    let nee = guarded_or_infinite(nee_density(l, index, counts), GUARD_LIGHT_SAMPLE);
    let share = select(counts.shares.nee, counts.shares.caustic, by_delta);
    return unless_alone(vec3<f32>(1.0, 0.0, 0.0) + scaled(nee, s.last) + emitted_density(l, share) * s.earlier);
}

// Coefficients of the sum for NEE of the light sample `l` at the vertex `v` of this index, where the BSDF samples the direction with
// density `pdf`.
fn mis_sum_of_nee(s: CameraState, v: Vertex, l: LightSample, pdf: f32, index: u32, counts: TechniqueCounts) -> vec3<f32> {
    let nee = nee_density(l, index, counts);
    if !(nee > 0.0) {
        return vec3<f32>(1.0, 0.0, 0.0);
    }
    let hit = select(pdf / nee, 0.0, l.delta != 0u);
    return unless_alone(vec3<f32>(1.0 + hit, 0.0, 0.0) + found_by_light_paths(s, v, l, nee, counts));
}

// Coefficients of the sum for a connection of the vertex `v` in a direction that its BSDF samples with density `pdf`.  `ratios`:
// `mis_connection_ratios`.
fn mis_sum_of_connection(s: CameraState, v: Vertex, wi: vec3<f32>, pdf: f32, ratios: vec2<f32>) -> vec3<f32> {
    let nearer_to_camera = s.last + s.earlier * reverse_pdf(v.surface, wi, v.wo);
    return unless_alone(vec3<f32>(1.0 + pdf * ratios.x, 0.0, 0.0) + ratios.y * nearer_to_camera);
}

// TEST_ALONE: tests use techniques without their weights.
#ifdef TEST_ALONE
fn unless_alone(coefficients: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(1.0, 0.0, 0.0);
}
#else
fn unless_alone(coefficients: vec3<f32>) -> vec3<f32> {
    return coefficients;
}
#endif

#ifdef LIGHT_PATHS
// The state at the first vertex.  `camera_density`: of the camera's rays there (`mis_camera_start`).
fn camera_state(v: Vertex, camera_density: f32, counts: TechniqueCounts) -> CameraState {
    let s = mis_arrive(mis_camera_start(counts.splats, camera_density), 1.0, arrival_cosine(v.surface, v.wo));
    return CameraState(vec3<f32>(s.last, 0.0, 0.0), vec3<f32>(s.earlier, 0.0, 0.0), vec3<f32>(1.0, 0.0, 0.0));
}

// The state of the ray that leaves the vertex `v`.
fn state_of_ray(s: CameraState, v: Vertex, step: Step, is_reconnection: bool) -> CameraState {
    let cos_out = abs(dot(v.surface.bsdf.n_geo, step.wi));
    if step.delta {
        return CameraState(vec3<f32>(0.0), cos_out * s.earlier, s.basis);
    }
    let sum = s.last + s.earlier * reverse_pdf(v.surface, step.wi, v.wo);
    if is_reconnection {
        return behind_reconnection(cos_out, step.pdf, sum.x);
    }
    return CameraState(vec3<f32>(1.0 / step.pdf, 0.0, 0.0), cos_out / step.pdf * sum, s.basis);
}

// The state where the ray arrives at the surface `n`, from the position `from_point`.
fn state_at(s: CameraState, n: Surface, wi: vec3<f32>, from_point: vec3<f32>, counts: TechniqueCounts) -> CameraState {
    let d = n.position - from_point;
    let cos_in = arrival_cosine(n, wi);
    return CameraState(s.last * (counts.connections * dot(d, d) / cos_in), s.earlier / cos_in, s.basis);
}

// A light sub-path knows the index of the vertex that NEE starts from only if the camera sees that vertex, so that weights assume one light
// candidate at all later vertices.
fn nee_density(l: LightSample, index: u32, counts: TechniqueCounts) -> f32 {
    let candidates = select(1.0, f32(nee_candidate_count(counts.nee_candidates, 1u)), index == 1u);
    return candidates * light_pmf(l.light) * l.pdf_solid_angle * l.pdf_scale;
}

// Density with which light sub-paths emit the ray of a light sample, times their share.
fn emitted_density(l: LightSample, share: f32) -> f32 {
    return share * light_pmf(l.light) * l.pdf_solid_angle * emission_density(l);
}

fn found_by_light_paths(s: CameraState, v: Vertex, l: LightSample, nee: f32, counts: TechniqueCounts) -> vec3<f32> {
    let cosine = abs(dot(v.surface.bsdf.n_geo, l.wi));
    return emitted_density(l, counts.shares.nee) / nee * cosine * (s.last + s.earlier * reverse_pdf(v.surface, l.wi, v.wo));
}
#else
fn camera_state(v: Vertex, camera_density: f32, counts: TechniqueCounts) -> CameraState {
    return CameraState(vec3<f32>(0.0), vec3<f32>(0.0), vec3<f32>(1.0, 0.0, 0.0));
}

fn state_of_ray(s: CameraState, v: Vertex, step: Step, is_reconnection: bool) -> CameraState {
    if is_reconnection && !step.delta {
        return behind_reconnection(0.0, step.pdf, 0.0);
    }
    return CameraState(vec3<f32>(select(1.0 / step.pdf, 0.0, step.delta), 0.0, 0.0), vec3<f32>(0.0), s.basis);
}

fn state_at(s: CameraState, n: Surface, wi: vec3<f32>, from_point: vec3<f32>, counts: TechniqueCounts) -> CameraState {
    return s;
}

fn nee_density(l: LightSample, index: u32, counts: TechniqueCounts) -> f32 {
    return expected_nee_candidates(l.light, counts.nee_candidates, index) * l.pdf_solid_angle * l.pdf_scale;
}

fn emitted_density(l: LightSample, share: f32) -> f32 {
    return 0.0;
}

fn found_by_light_paths(s: CameraState, v: Vertex, l: LightSample, nee: f32, counts: TechniqueCounts) -> vec3<f32> {
    return vec3<f32>(0.0);
}
#endif
