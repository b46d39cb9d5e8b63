//! Rows of the table, and a sentence for each feature.

use bevy_restir::SceneFeatures;

use super::{COUNTS, LOADS, Measured, Removal, change::Figure};
use crate::table::{Row, Table, Unit, digits};

impl Measured {
    /// Adds a section with the scene and its features.  `names_always`: a note names the definitions that no row takes out of the shaders.
    pub fn add_to(&self, table: &mut Table, scene: &str, names_always: bool) {
        let none = Figure { value: f64::NAN, error: f64::NAN };
        add_row(table, scene, "all features", [self.time, none, none], self.size.loads);
        let mut always = self.size.features;
        for removal in &self.removals {
            let figures = [removal.time, removal.change.light, removal.change.pixels];
            let lost = core::array::from_fn(|i| self.size.loads[i] - removal.rest.loads[i]);
            add_row(table, scene, &format!("{} ({})", removal.feature.name, removal.place), figures, lost);
            table.notes.push(format!("- {scene}: {}", removal.sentence(self)));
            always &= removal.rest.features;
        }
        if names_always && !always.is_empty() {
            table.notes.push(format!("- {scene}: no row takes {} out of the shaders.", named(always)));
        }
    }
}

impl Removal {
    /// What the scene loses, in a sentence.
    fn sentence(&self, whole: &Measured) -> String {
        let Self { time, change, .. } = self;
        let time = match time.is_noise() {
            true => format!("the time of a frame changes by less than the noise of {} ms", digits(time.noise())),
            false => format!(
                "a frame takes {} ms {} ({} %)",
                shown(*time),
                if time.value > 0.0 { "less" } else { "more" },
                digits(time.percent_of(whole.time.value).value.abs())
            ),
        };
        let light = match change.light {
            light if light.is_noise() => {
                format!("the mean light changes by less than the noise of {} %", digits(light.noise()))
            }
            light => {
                format!("the mean light {} by {} %", if light.value > 0.0 { "rises" } else { "falls" }, shown(light))
            }
        };
        let pixels = match change.pixels {
            pixels if pixels.is_noise() => {
                format!("pixels change by less than the noise of {} %", digits(pixels.noise()))
            }
            pixels => format!("pixels change by {} % of the mean", shown(pixels)),
        };
        let picture = if change.is_nothing() {
            "and the picture stays the same".into()
        } else {
            format!("{light}, and {pixels}")
        };
        let definitions = whole.size.features.difference(self.rest.features);
        let shaders = match definitions.is_empty() {
            true => String::new(),
            false => format!("; the shaders lose {}", named(definitions)),
        };
        format!("without {} ({}), {time}, {picture}{shaders}.", self.feature.name, self.place)
    }
}

/// Adds a figure to each column.
fn add_row(table: &mut Table, scene: &str, label: &str, figures: [Figure; 3], loads: [f64; LOADS.len()]) {
    let values = figures.into_iter().flat_map(|figure| [figure.value, figure.error]).chain(loads);
    for ((name, rows), value) in table.columns.iter_mut().zip(values) {
        let unit = if COUNTS.contains(&name.as_str()) { Unit::Count } else { Unit::Plain };
        rows.push(Row::new(scene.to_owned(), label, &[("", unit, value)]));
    }
}

/// An amount and its standard error, with two digits of the error.
fn shown(Figure { value, error }: Figure) -> String {
    if error == 0.0 {
        return digits(value.abs());
    }
    let decimals = (1 - error.log10().floor() as i32).clamp(0, 6) as usize;
    format!("{:.decimals$} ± {error:.decimals$}", value.abs())
}

/// Shader definitions as code.
fn named(features: SceneFeatures) -> String {
    features.names().into_iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}
