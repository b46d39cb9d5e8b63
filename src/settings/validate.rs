//! Brings settings into their ranges.

/// Clamps fields and collects a warning for each field that it changes.
pub(super) struct Ranges<'a> {
    /// Path of the struct whose fields are clamped, with a dot at its end.
    pub path: &'static str,
    pub warnings: &'a mut Vec<String>,
}

impl Ranges<'_> {
    pub(super) fn count(&mut self, name: &str, value: &mut u32, low: u32, high: u32) {
        let clamped = (*value).clamp(low, high);
        if clamped != *value {
            self.warnings.push(format!("{}{name} = {value} is out of range, {clamped} is used", self.path));
            *value = clamped;
        }
    }

    /// NaN becomes the lowest value.
    pub(super) fn number(&mut self, name: &str, value: &mut f32, low: f32, high: f32) {
        let clamped = if value.is_nan() { low } else { value.clamp(low, high) };
        if clamped != *value {
            self.warnings.push(format!("{}{name} = {value} is out of range, {clamped} is used", self.path));
            *value = clamped;
        }
    }
}
