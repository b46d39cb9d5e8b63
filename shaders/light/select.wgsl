// Choice of a light by balanced power (`src/scene/light/alias_table.rs`): the environment, or a light of the table by the alias method
// (Vose 1991).
#define_import_path bevy_restir::light::select

#import bevy_restir::common::constants::{NONE, PI}
#import bevy_restir::common::guard::{GUARD_LIGHT_SAMPLE, guarded_or_infinite}
#import bevy_restir::common::math::is_finite
#import bevy_restir::light::environment::environment_flux
#import bevy_restir::light::remap::current_light_id
#import bevy_restir::light::types::ENVIRONMENT_LIGHT
#import bevy_restir::scene::bindings::{lights, scene}

// Least probability of the environment beside a table: power alone does not tell how much light reaches a point.  The largest one is
// `environment_limit`: one of the constants ENVIRONMENT_LIMIT... of `src/scene/light/alias_table.rs`, which are greater.  In the furnished
// room of the tests, limits of 0.05 and 0.95 have 8 % more error.
const PROBABILITY_MIN: f32 = 0.2;

struct LightChoice {
    light: u32,            // index in the table, ENVIRONMENT_LIGHT or NONE
    pmf: f32,              // 0: there is no light
}

fn light_select(u: vec2<f32>) -> LightChoice {
    let environment = environment_pmf();
    if u.y < environment {
        return LightChoice(ENVIRONMENT_LIGHT, environment);
    }
    if !table_has_power() {
        return LightChoice(NONE, 0.0);
    }

    // The 24 bits of u.x alone would bias the choice in a long table by up to count/2^24, so that the low 8 bits of u.y are added.
    let word = u32(u.x * 0x1p24) << 8u | (u32(u.y * 0x1p24) & 0xffu);
    let bin = min(multiply_high(word, scene.light_count), scene.light_count - 1u);
    // The 24 bits of u.y alone would round the probability of a dim light up, so that the place within the bin is added.
    let inside = f32(word * scene.light_count) * 0x1p-32;
    let v = ((u.y - environment) + inside * 0x1p-24) / (1.0 - environment);
    let light = select(lights[bin].alias_index, bin, v < lights[bin].alias_probability || lights[bin].alias_probability == 1.0);
    return LightChoice(light, light_pmf(light));
}

// Probability with which `light_select` chooses a light.  A light of the last frame, whose record stands behind this frame's table, has the
// probability that it has now: both frames weigh their sampling techniques alike.
fn light_pmf(record: u32) -> f32 {
    if record == ENVIRONMENT_LIGHT {
        return environment_pmf();
    }
    var light = record;
    if record >= scene.light_count && record < ENVIRONMENT_LIGHT {
        light = current_light_id(record - scene.previous_lights);
    }
    if light >= scene.light_count || !table_has_power() {
        return 0.0;
    }
    return lights[light].pmf * (1.0 - environment_pmf());
}

// Probability of the environment: its flux through a disk of the scene's radius, against the power of the table.
fn environment_pmf() -> f32 {
    let flux = guarded_or_infinite(environment_flux(), GUARD_LIGHT_SAMPLE);
    if !(flux > 0.0) {
        return 0.0;
    }
    if !table_has_power() {
        return 1.0;
    }
    // Overflow is legal here: it gives a ratio that is 0 or not finite, and both end at a limit of the probability.
    let ratio = scene.light_power / (flux * PI * scene.radius * scene.radius);
    if !is_finite(ratio) {
        return PROBABILITY_MIN;
    }
    return clamp(1.0 / (1.0 + ratio), PROBABILITY_MIN, scene.environment_limit);
}

fn table_has_power() -> bool {
    return scene.light_count > 0u && scene.light_power > 0.0;
}

// High word of a 64-bit product.
fn multiply_high(a: u32, b: u32) -> u32 {
    let al = a & 0xffffu;
    let ah = a >> 16u;
    let bl = b & 0xffffu;
    let bh = b >> 16u;
    let middle = ah * bl + (al * bl >> 16u);
    let low = al * bh + (middle & 0xffffu);
    return ah * bh + (middle >> 16u) + (low >> 16u);
}
