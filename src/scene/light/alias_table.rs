//! The alias table selects an index in proportion to its weight in constant time (Vose 1991, "A linear algorithm for generating random
//! numbers with a given distribution").  For lights the weight is the power, balanced between distant lights and the others.
//! `shaders/light/select.wgsl` reads the table.

use crate::gpu_layout::GpuLight;

/// Least joint share of the distant lights, and of all others, where a scene has both.  The power of a distant light is its flux through a disk
/// of the scene's radius, so that it grows with the ground around a room, and says nothing about the light in the room.  With this share,
/// the error of a frame grows at most as if it had 20 % fewer light candidates.
const LEAST_SHARE: f64 = 0.2;

/// Largest probability of choosing the environment, if the table has distant lights only, or others only.  The smallest probability is
/// `PROBABILITY_MIN` of `shaders/light/select.wgsl`, which must stay below this and the next limit.
pub const ENVIRONMENT_LIMIT: f32 = 0.8;

/// Largest probability of choosing the environment, if the table has lights of both kinds: where a sun and a sky shine over a room, its lamps
/// have a joint probability of at least 0.1.
pub const ENVIRONMENT_LIMIT_BESIDE_SUNS_AND_LAMPS: f32 = 0.5;

/// Scales powers for the choice of a light, so that distant lights and all others each keep at least `LEAST_SHARE`.  Returns the largest
/// probability of choosing the environment instead of one of these lights.
pub fn balance_distant_lights(powers: &mut [f64], is_distant: impl Fn(usize) -> bool) -> f32 {
    let usable = |p: f64| if p.is_finite() && p > 0.0 { p } else { 0.0 };
    let max = powers.iter().copied().map(usable).fold(0.0, f64::max);
    // Sums of powers relative to the largest can neither overflow nor vanish.
    let mut sums = [0.0; 2];
    for (i, &power) in powers.iter().enumerate() {
        sums[usize::from(is_distant(i))] += usable(power) / max;
    }
    let [near, distant] = sums;
    if !(near > 0.0 && distant > 0.0) {
        return ENVIRONMENT_LIMIT;
    }
    let share = (distant / (near + distant)).clamp(LEAST_SHARE, 1.0 - LEAST_SHARE);
    let factors = [(1.0 - share) / near, share / distant];
    for (i, power) in powers.iter_mut().enumerate() {
        *power = usable(*power) / max * factors[usize::from(is_distant(i))];
    }
    ENVIRONMENT_LIMIT_BESIDE_SUNS_AND_LAMPS
}

/// One bin: its own index with `probability`, else `alias`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AliasEntry {
    /// Probability of keeping the bin's own index.
    pub probability: f32,
    /// Index that is selected otherwise.
    pub alias: u32,
    /// Probability that the whole table selects the bin's own index.
    pub pmf: f32,
}

impl From<&GpuLight> for AliasEntry {
    /// The entry that a record of the light table holds.
    fn from(light: &GpuLight) -> Self {
        Self { probability: light.alias_probability, alias: light.alias_index, pmf: light.pmf }
    }
}

/// Builds the table in O(n); `None` if no power is positive and finite.  Zero, negative, NaN and infinite powers get the pmf 0.
#[must_use]
pub fn alias_table(powers: &[f64]) -> Option<Vec<AliasEntry>> {
    // The sum of powers relative to the largest can neither overflow nor vanish.
    let max = powers.iter().copied().filter(|p| p.is_finite()).fold(0.0, f64::max);
    if max <= 0.0 {
        return None;
    }
    let usable = |p: f64| if p.is_finite() && p > 0.0 { p / max } else { 0.0 };
    let brightest = powers.iter().position(|&p| p == max)? as u32;
    let sum: f64 = powers.iter().map(|&p| usable(p)).sum();
    let mut share: Vec<f64> = powers.iter().map(|&p| usable(p) / sum * powers.len() as f64).collect();

    // Fill bins that hold less than 1 from those that hold more.
    let (mut small, mut large): (Vec<u32>, Vec<u32>) = (0..powers.len() as u32).partition(|&i| share[i as usize] < 1.0);
    let mut table = vec![AliasEntry::default(); powers.len()];
    while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
        small.pop();
        table[s as usize] = AliasEntry { probability: share[s as usize] as f32, alias: l, pmf: 0.0 };
        share[l as usize] -= 1.0 - share[s as usize];
        if share[l as usize] < 1.0 {
            large.pop();
            small.push(l);
        }
    }
    // Each remaining bin holds 1 up to rounding.  Rounding must not make an unusable light selectable.
    for i in small.into_iter().chain(large) {
        let probability = if usable(powers[i as usize]) > 0.0 { 1.0 } else { 0.0 };
        table[i as usize] = AliasEntry { probability, alias: brightest, pmf: 0.0 };
    }

    // The pmf of the rounded table, not of the powers: the GPU must divide by the probabilities that it really samples with.
    let mut pmf = vec![0.0f64; powers.len()];
    for (i, entry) in table.iter().enumerate() {
        pmf[i] += f64::from(entry.probability);
        pmf[entry.alias as usize] += 1.0 - f64::from(entry.probability);
    }
    for (entry, pmf) in table.iter_mut().zip(pmf) {
        entry.pmf = (pmf / powers.len() as f64) as f32;
    }
    Some(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distant_lights_and_others_share_the_choice() {
        let shares = |mut powers: Vec<f64>, distant: &[usize]| {
            let has_both = distant.len() == 1;
            let limit = balance_distant_lights(&mut powers, |i| distant.contains(&i));
            assert_eq!(limit, if has_both { ENVIRONMENT_LIMIT_BESIDE_SUNS_AND_LAMPS } else { ENVIRONMENT_LIMIT });
            let sum: f64 = powers.iter().filter(|p| p.is_finite()).sum();
            powers.into_iter().map(|p| p / sum).collect::<Vec<_>>()
        };
        let near = |a: Vec<f64>, b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(near(shares(vec![1e12, 3.0, 1.0], &[0]), &[0.8, 0.15, 0.05]), "a sun over a wide ground");
        assert!(near(shares(vec![1e-12, 3.0, 1.0], &[0]), &[0.2, 0.6, 0.2]), "a moon beside bright lamps");
        assert!(near(shares(vec![1.0, 3.0], &[0]), &[0.25, 0.75]), "by power alone");
        assert!(near(shares(vec![1.0, 3.0], &[]), &[0.25, 0.75]), "lamps alone");
        assert!(near(shares(vec![f64::NAN, 1e300, f64::INFINITY, -1.0, 1e300], &[1]), &[0.0, 0.5, 0.0, 0.0, 0.5]));
    }
}
