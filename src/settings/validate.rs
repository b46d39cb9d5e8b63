//! Brings settings into their ranges.

use core::fmt;

use super::{BiasCorrection, DebugView, Technique, VisibilityReuse};

/// A setting that was out of range, or that does not have its usual effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Problem {
    /// The field `path` + `name` had a value outside of its range (lowest and highest value); another value is used.
    OutOfRange { path: &'static str, name: &'static str, value: Number, used: Number, range: [Number; 2] },
    /// The debug view has nothing to show with the technique and its settings.
    NothingToShow(DebugView, Technique),
    /// The bias correction traces no rays with this visibility, so that it is biased.
    NoMisRays(BiasCorrection, VisibilityReuse),
}

impl Problem {
    /// The field, without its value: two numbers out of range are one problem.
    pub(crate) fn field(&self) -> [&'static str; 2] {
        match *self {
            Self::OutOfRange { path, name, .. } => [path, name],
            Self::NothingToShow(..) => ["", "debug_view"],
            Self::NoMisRays(..) => ["direct.", "bias_correction"],
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { path, name, value, used, range: [low, high] } => {
                write!(f, "{path}{name} = {value} is out of range ({low} to {high}); {used} is used")
            }
            Self::NothingToShow(view, technique) => {
                write!(
                    f,
                    "debug_view = {view:?} has nothing to show with technique {technique:?} and its settings; the \
                     documentation of DebugView names what it needs"
                )
            }
            Self::NoMisRays(correction, visibility) => {
                write!(
                    f,
                    "direct.bias_correction = {correction:?} traces no rays with direct.visibility = {visibility:?}, \
                     and is biased; direct.visibility = {:?} is unbiased",
                    VisibilityReuse::Resampled
                )
            }
        }
    }
}

/// The value of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Number {
    Count(u32),
    Real(f32),
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(n) => n.fmt(f),
            Self::Real(x) if x.abs() >= 1e7 => write!(f, "{x:e}"),
            Self::Real(x) => x.fmt(f),
        }
    }
}

/// Clamps fields and reports each field that it changes.
pub(super) struct Ranges<'a> {
    /// Path of the struct whose fields are clamped, with a dot at its end.
    pub path: &'static str,
    pub report: &'a mut dyn FnMut(Problem),
}

impl Ranges<'_> {
    pub(super) fn count(&mut self, name: &'static str, value: &mut u32, low: u32, high: u32) {
        let clamped = (*value).clamp(low, high);
        if clamped != *value {
            self.out_of_range(name, [*value, clamped, low, high].map(Number::Count));
            *value = clamped;
        }
    }

    /// NaN becomes the lowest value.
    pub(super) fn number(&mut self, name: &'static str, value: &mut f32, low: f32, high: f32) {
        self.number_or(name, value, low, high, low);
    }

    /// Like [`Ranges::number`], with another value in place of NaN.
    pub(super) fn number_or(&mut self, name: &'static str, value: &mut f32, low: f32, high: f32, nan: f32) {
        let clamped = if value.is_nan() { nan } else { value.clamp(low, high) };
        if clamped != *value {
            self.out_of_range(name, [*value, clamped, low, high].map(Number::Real));
            *value = clamped;
        }
    }

    fn out_of_range(&mut self, name: &'static str, [value, used, low, high]: [Number; 4]) {
        (self.report)(Problem::OutOfRange { path: self.path, name, value, used, range: [low, high] });
    }
}
