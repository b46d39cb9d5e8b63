// The diffusion profile R_d(r) = (e^(-r/d) + e^(-r/3d)) / (8π d r) (Burley 2015), which integrates to 1 over a plane.  Radii are in units of
// d here, and densities per area of d².  R_d diverges at 0; below RADIUS_MIN its value at RADIUS_MIN is used, both in the integrand
// and in the density of samples.
#define_import_path bevy_restir::subsurface::profile

#import bevy_restir::common::constants::PI

const RADIUS_MIN: f32 = 1.0e-3;
// Radius where the profile is cut off: it holds 99.9 % of the integral.
const REACH: f32 = 19.86;

// Integral of the profile up to RADIUS_MIN.
const CORE_EXACT: f32 = 4.998333e-4;
// Integral of the bounded profile, which is constant there, up to RADIUS_MIN.
const CORE: f32 = 2.4983335e-4;
// Integral of the bounded profile over the plane: 1 - CORE_EXACT + CORE.
const TOTAL: f32 = 0.99975;

fn profile(r: f32) -> f32 {
    let x = max(r, RADIUS_MIN);
    let e = exp(-x / 3.0);
    return (e * e * e + e) / (8.0 * PI * x);
}

// Density of a point at this radius, per area of d².
fn profile_pdf(r: f32) -> f32 {
    return profile(r) / TOTAL;
}

// Samples a radius by inverting the distribution of the bounded profile at `u`.  The tail beyond RADIUS_MIN is inverted in closed form
// (Golubev 2019).
fn profile_sample(u: f32) -> f32 {
    let mass = u * TOTAL;
    if mass < CORE {
        return RADIUS_MIN * sqrt(mass / CORE);
    }
    let v = max(TOTAL - mass, 1.0e-9);
    let g = 1.0 + 4.0 * v * (2.0 * v + sqrt(1.0 + 4.0 * v * v));
    let root = pow(g, 1.0 / 3.0);
    return 3.0 * log((1.0 + 1.0 / root + root) / (4.0 * v));
}

// Random number for which `profile_sample` gives a radius.
fn profile_inverse(r: f32) -> f32 {
    if r < RADIUS_MIN {
        return CORE * (r / RADIUS_MIN) * (r / RADIUS_MIN) / TOTAL;
    }
    let e = exp(-r / 3.0);
    return (1.0 - 0.25 * e * e * e - 0.75 * e - CORE_EXACT + CORE) / TOTAL;
}
