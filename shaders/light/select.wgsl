// Choice of a light by balanced power (`src/scene/light/alias_table.rs`): the environment, or a light of the table by the alias method
// (Vose 1991).  The table has two levels: a bin for each analytic light and each emissive mesh, and a table over the triangles of each mesh.
// A change of one emitter thus changes the bins and the records of its own triangles.
#define_import_path bevy_restir::light::select

#import bevy_restir::common::constants::{LIGHT_MESH, NONE, PI}
#import bevy_restir::common::guard::{GUARD_LIGHT_SAMPLE, guarded_or_infinite}
#import bevy_restir::common::math::is_finite
#import bevy_restir::common::rng::pcg4d
#import bevy_restir::light::environment::environment_flux
#import bevy_restir::light::remap::{current_light_of, is_bin}
#import bevy_restir::light::types::ENVIRONMENT_LIGHT
#import bevy_restir::scene::bindings::{lights, scene}
#import bevy_restir::view::render_layers::light_kind

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

    // 48 random bits are too few for all decisions below: those of dim lights would be biased.  A hash of them gives the others.
    let bits = vec2<u32>(u * 0x1p24);
    let more = pcg4d(vec4<u32>(bits, 0u, 0u));
    // The 24 bits of u.x alone would bias the choice in a long table by up to count/2^24.
    let word = (bits.x << 8u) | (more.x >> 24u);
    let bin = scene.first_bin + multiply_high(word, scene.light_bins);
    // The 24 bits of u.y alone would round the probability of a dim light up.
    let v = ((u.y - environment) + f32(more.y) * 0x1p-56) / (1.0 - environment);
    let keeps = v < lights[bin].alias_probability || lights[bin].alias_probability == 1.0;
    let chosen = select(scene.first_bin + lights[bin].alias_index, bin, keeps);
    // The place within the bin, which the choice of the bin leaves uniform.  Its steps are as wide as the number of bins.
    let place = word * scene.light_bins + multiply_high(more.z, scene.light_bins);
    let light = light_of_bin(chosen, place, vec2<u32>(more.w, more.x));
    return LightChoice(light, pmf_in_bin(light, chosen) * (1.0 - environment));
}

#ifdef LIGHT_TRIANGLES
// The light of a bin: a triangle, if the bin is that of a mesh.  `place`, `coin`: random bits.
fn light_of_bin(bin: u32, place: u32, coin: vec2<u32>) -> u32 {
    if light_kind(bin) != LIGHT_MESH {
        return bin;
    }
    let triangle = multiply_high(place, lights[bin].data.y);
    let light = lights[bin].data.x + triangle;
    let v = (f32(coin.x) + f32(coin.y & 0xffffffu) * 0x1p-24) * 0x1p-32;
    let keeps = v < lights[light].alias_probability || lights[light].alias_probability == 1.0;
    return lights[bin].data.x + select(lights[light].alias_index, triangle, keeps);
}

// Probability of a light in the table.
fn table_pmf(light: u32) -> f32 {
    if is_bin(light, false) {
        return lights[light].pmf;
    }
    let header = lights[light].link;
    return pmf_in_bin(light, scene.first_mesh_bin + lights[header].data.x);
}
#else
fn light_of_bin(bin: u32, place: u32, coin: vec2<u32>) -> u32 {
    return bin;
}

fn table_pmf(light: u32) -> f32 {
    return lights[light].pmf;
}
#endif

// Probability of a light in the table.  `bin`: the light itself, or the bin of its mesh.
fn pmf_in_bin(light: u32, bin: u32) -> f32 {
    return lights[light].pmf * select(lights[bin].pmf, 1.0, light == bin);
}

// Probability with which `light_select` chooses a light, which is given by its record of this frame or the last.  A light of the last frame
// has the probability that it has now: both frames weigh their sampling techniques alike.
fn light_pmf(record: u32) -> f32 {
    if record == ENVIRONMENT_LIGHT {
        return environment_pmf();
    }
    let light = current_light_of(record);
    if light >= scene.lights_end || !table_has_power() {
        return 0.0;
    }
    return table_pmf(light) * (1.0 - environment_pmf());
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
    return scene.lights_end > 0u && scene.light_power > 0.0;
}

// High word of a 64-bit product.
fn multiply_high(a: u32, b: u32) -> u32 {
    let al = a & 0xffffu;
    let ah = a >> 16u;
    let bl = b & 0xffffu;
    let bh = b >> 16u;
    let middle = ah * bl + ((al * bl) >> 16u);
    let low = al * bh + (middle & 0xffffu);
    return ah * bh + (middle >> 16u) + (low >> 16u);
}
