// Probes: lines through a body that find where light enters it (King et al. 2013, "BSSRDF Importance Sampling").  A probe is drawn from
// nine techniques: three axes (the normal and two tangents) times the profiles of three channels.  Its density is the marginal over those
// techniques that can reach the point, which corrects the published one (Werner et al. 2024): a technique whose sphere ends before the
// point does not count.
#define_import_path bevy_restir::subsurface::probe

#import bevy_restir::common::constants::TWO_PI
#import bevy_restir::common::math::{max_component, precise_atan2}
#import bevy_restir::common::ray::Ray
#import bevy_restir::scene::bindings::scene
#import bevy_restir::subsurface::profile::{profile_inverse, profile_pdf, profile_sample, REACH}

// A probe: its axis, the channel whose profile it samples, and its random numbers.
struct Probe {
    axis: u32,                 // 0: along the normal; 1, 2: along the tangents
    channel: u32,
    u_radius: f32,
    u_angle: f32,
}

// The part of the probe's line inside the sphere that the technique reaches.
struct ProbeRay {
    ray: Ray,
    valid: bool,
}

fn axis_probability(axis: u32) -> f32 {
    return select(0.25, 0.5, axis == 0u);
}

// Number of channels that scatter, at least 1.
fn channel_count(radius: vec3<f32>) -> f32 {
    return max(dot(vec3<f32>(1.0), select(vec3<f32>(0.0), vec3<f32>(1.0), radius > vec3<f32>(0.0))), 1.0);
}

// Probability of each channel: equal for all that scatter.
fn channel_probability(radius: vec3<f32>) -> f32 {
    return 1.0 / channel_count(radius);
}

// Greatest distance over which light scatters, m.
fn reach_of(radius: vec3<f32>) -> f32 {
    return REACH * max_component(radius);
}

// Right-handed frame (t, b, n) about a smooth normal.  It is continuous except where the normal points almost straight down, so that neighbors
// can share the angle of a probe.
fn probe_frame(n: vec3<f32>) -> mat3x3<f32> {
    let s = select(-1.0, 1.0, n.y > -0.9);
    let a = -1.0 / (s + n.y);
    let b = n.z * n.x * a;
    return mat3x3<f32>(
        vec3<f32>(s * b, -s * n.z, 1.0 + s * n.z * n.z * a),
        vec3<f32>(s + n.x * n.x * a, -n.x, b),
        n,
    );
}

// Draws a technique: u.x chooses axis and channel.
fn draw_probe(radius: vec3<f32>, u: vec3<f32>) -> Probe {
    // Quarters of u.x: two for the normal, and one for each tangent.
    let quarters = 4.0 * u.x;
    let axis = u32(max(floor(quarters) - 1.0, 0.0));
    let rest = select(fract(quarters), 0.5 * quarters, axis == 0u);
    // Not 1 / `channel_probability`: where division is not exact, that may be below 3, and the last channel would never be drawn.
    let count = channel_count(radius);
    // The index among the channels that scatter.
    let index = u32(min(floor(rest * count), count - 1.0));
    var channel = 0u;
    var passed = 0u;
    for (var c = 0u; c < 3u; c += 1u) {
        if radius[c] > 0.0 {
            if passed == index {
                channel = c;
            }
            passed += 1u;
        }
    }
    return Probe(axis, channel, u.y, u.z);
}

// Columns: the plane of a probe's disk, then its axis.
fn disk_frame(frame: mat3x3<f32>, axis: u32) -> mat3x3<f32> {
    if axis == 0u {
        return frame;
    }
    if axis == 1u {
        return mat3x3<f32>(frame[1], frame[2], frame[0]);
    }
    return mat3x3<f32>(frame[2], frame[0], frame[1]);
}

// The line of a probe about a point; invalid if its radius is out of reach.
fn probe_ray(probe: Probe, position: vec3<f32>, frame: mat3x3<f32>, radius: vec3<f32>) -> ProbeRay {
    let d = radius[probe.channel];
    let x = profile_sample(probe.u_radius);
    let disk = disk_frame(frame, probe.axis);
    let phi = TWO_PI * probe.u_angle;
    let center = position + (x * d) * (cos(phi) * disk[0] + sin(phi) * disk[1]);
    // No body ends farther away than the diameter of the scene, in this frame or the last.  A longer line would only cost the precision of f32.
    let diameter = 2.0 * max(scene.radius, scene.previous_radius);
    let half_length = min(d * sqrt(max(REACH * REACH - x * x, 0.0)), diameter);
    let ray = Ray(center + half_length * disk[2], 0.0, -disk[2], 2.0 * half_length);
    return ProbeRay(ray, x < REACH && half_length > 0.0);
}

// Density of finding a point, per area: the marginal over all techniques.  `offset`: from the point where light leaves; `n_geo`: geometric
// normal where it enters.
fn probe_pdf(offset: vec3<f32>, n_geo: vec3<f32>, frame: mat3x3<f32>, radius: vec3<f32>) -> f32 {
    let local = offset * frame;
    let squares = local * local;
    // Distances from the three axes, in the order of the axes.
    let distances = sqrt(vec3<f32>(squares.x + squares.y, squares.y + squares.z, squares.z + squares.x));
    let along = abs(n_geo * frame);
    let cosines = vec3<f32>(along.z, along.x, along.y);
    let r = length(offset);
    var sum = 0.0;
    for (var channel = 0u; channel < 3u; channel += 1u) {
        let d = radius[channel];
        if !reaches(d, r) {
            continue;
        }
        let densities = vec3<f32>(profile_pdf(distances.x / d), profile_pdf(distances.y / d), profile_pdf(distances.z / d));
        sum += sum_of_axes(densities * cosines) / (d * d);
    }
    return sum * channel_probability(radius);
}

// A probe that finds a given point (probabilistic inversion, Werner et al. 2024).  The technique is drawn in proportion to its density at the
// point, and gets the random numbers that lead there.
fn inverse_probe(offset: vec3<f32>, n_geo: vec3<f32>, frame: mat3x3<f32>, radius: vec3<f32>, u: f32) -> Probe {
    var probe = Probe(0u, 0u, 0.0, 0.0);
    let total = probe_pdf(offset, n_geo, frame, radius) / channel_probability(radius);
    let r = length(offset);
    var sum = 0.0;
    for (var technique = 0u; technique < 9u; technique += 1u) {
        let axis = technique % 3u;
        let d = radius[technique / 3u];
        if !reaches(d, r) {
            continue;
        }
        let disk = disk_frame(frame, axis);
        let across = vec2<f32>(dot(offset, disk[0]), dot(offset, disk[1]));
        let x = length(across) / d;
        let p = axis_probability(axis) * profile_pdf(x) * abs(dot(n_geo, disk[2])) / (d * d);
        // Where rounding keeps `sum` below the threshold, the last technique with a density is taken.
        if p > 0.0 && sum <= u * total {
            let angle = precise_atan2(across.y, across.x) / TWO_PI;
            probe = Probe(axis, technique / 3u, profile_inverse(x), angle - floor(angle));
        }
        sum += p;
    }
    return probe;
}

// Whether the techniques of a channel can find a point.  PLANT_*: errors that tests plant.
#ifdef PLANT_NO_REACH
fn reaches(d: f32, r: f32) -> bool {
    return d > 0.0;
}
#else
fn reaches(d: f32, r: f32) -> bool {
    return d > 0.0 && r <= REACH * d;
}
#endif

#ifdef PLANT_ONE_AXIS
fn sum_of_axes(densities: vec3<f32>) -> f32 {
    return densities.x;
}
#else
fn sum_of_axes(densities: vec3<f32>) -> f32 {
    return dot(vec3<f32>(axis_probability(0u), axis_probability(1u), axis_probability(2u)), densities);
}
#endif
