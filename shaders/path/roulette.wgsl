// Russian roulette, for paths from the camera and from lights.
#define_import_path bevy_restir::path::roulette

#import bevy_restir::common::math::max_component

// The first scattering event after which a path may end by chance.
const ROULETTE_FROM: u32 = 3u;
// Greatest probability of going on, so that paths between bright surfaces end, too.
const MAX_SURVIVAL: f32 = 0.95;

// Probability with which a path goes on: the largest component of its throughput, times `scale`.  For a path from the camera, `scale`
// includes `eta_scale`, its squared relative indices of refraction: roulette must not take the scaling of radiance in glass for
// absorption.
fn survival_probability(throughput: vec3<f32>, scale: f32) -> f32 {
    return min(max_component(throughput) * scale, MAX_SURVIVAL);
}
