//! Command lines: how values are parsed, and the names of the crate's choices.

use crate::fields;
use bevy::{
    camera::Exposure,
    math::UVec2,
    reflect::{FromReflect, Typed, enums::Enum},
};
use bevy_restir::Restir;
use clap::{
    Arg, Command, Parser,
    builder::{PossibleValuesParser, TypedValueParser},
};
use std::{path::PathBuf, process::ExitCode, str::FromStr};

/// Parses the command line. If it requests help or is wrong, the error is the exit code of the program.
pub fn parse<T: Parser>() -> Result<T, ExitCode> {
    // Otherwise a missing subcommand gives the help instead of an error.
    let command = with_negative_numbers(T::command()).arg_required_else_help(false);
    match command.try_get_matches().and_then(|mut matches| T::from_arg_matches_mut(&mut matches)) {
        Ok(arguments) => Ok(arguments),
        Err(error) if !error.use_stderr() => {
            // The user asked for the help or the version.
            let _ = error.print();
            Err(ExitCode::SUCCESS)
        }
        Err(error) => {
            eprintln!("{}", one_line(&error.to_string()));
            Err(ExitCode::from(2))
        }
    }
}

/// Takes -1 after an option as its value, so that an error names the option.
fn with_negative_numbers(command: Command) -> Command {
    let takes_value = |arg: &Arg| !arg.is_positional() && arg.get_action().takes_values();
    command
        .mut_args(|arg| if takes_value(&arg) { arg.allow_negative_numbers(true) } else { arg })
        .mut_subcommands(with_negative_numbers)
}

/// The first paragraph of clap's message and its tips in one line, without the usage.
fn one_line(message: &str) -> String {
    let lines = || message.lines().map(str::trim);
    let error = lines().take_while(|line| !line.is_empty());
    let tips = lines().filter(|line| line.starts_with("tip: "));
    let tips = tips.map(|tip| format!("({tip})")).collect::<Vec<_>>();
    error.map(String::from).chain(tips).collect::<Vec<_>>().join(" ")
}

/// Parses `WIDTHxHEIGHT` of a picture.
pub fn size(text: &str) -> Result<UVec2, String> {
    size_within(text, 1, 16384)
}

/// Parses `WIDTHxHEIGHT` of a window.
pub fn window_size(text: &str) -> Result<UVec2, String> {
    size_within(text, 64, 8192)
}

fn size_within(text: &str, least: u32, most: u32) -> Result<UVec2, String> {
    text.split_once('x')
        .and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)))
        .filter(|size| size.min_element() >= least && size.max_element() <= most)
        .ok_or_else(|| format!("expected WIDTHxHEIGHT, each from {least} to {most}"))
}

/// Parses the name of a file with one of these endings.
pub fn file(text: &str, endings: &[&str]) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_wanted = path.extension().is_some_and(|ending| endings.iter().any(|wanted| ending == *wanted));
    is_wanted.then_some(path).ok_or_else(|| format!("expected a name that ends in .{}", endings.join(" or .")))
}

/// Parses the name of a .png file.
pub fn png_file(text: &str) -> Result<PathBuf, String> {
    file(text, &["png"])
}

/// Parses a number above 0.
pub fn positive<T: FromStr + Copy + Into<f64>>(text: &str) -> Result<T, String> {
    let is_positive = |x: f64| x > 0.0 && x.is_finite();
    text.parse().ok().filter(|x: &T| is_positive((*x).into())).ok_or("expected a number above 0".into())
}

/// Parses a value of [`Restir::resolution_scale`].
pub fn resolution_scale(text: &str) -> Result<f32, String> {
    let range = Restir::LEAST_RESOLUTION_SCALE..=1.0;
    let number = text.parse().ok().filter(|scale| range.contains(scale));
    number.ok_or_else(|| format!("expected a number from {} to {}", range.start(), range.end()))
}

/// How the exposure of a picture is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExposureChoice {
    /// An exposure value at ISO 100.
    Ev100(f32),
    /// From the picture's own luminance, see [`crate::exposure::ev100_for`].
    Auto,
}

impl ExposureChoice {
    /// The camera's exposure where the user gave a number.
    pub fn fixed(self) -> Option<Exposure> {
        match self {
            Self::Ev100(ev100) => Some(Exposure { ev100 }),
            Self::Auto => None,
        }
    }
}

/// Parses an exposure value or `auto`.
pub fn exposure(text: &str) -> Result<ExposureChoice, String> {
    if text == "auto" {
        return Ok(ExposureChoice::Auto);
    }
    // Beyond these limits a picture of 32-bit floats overflows or is black.
    let number = text.parse().ok().filter(|x: &f32| x.is_finite() && x.abs() <= 60.0);
    number.map(ExposureChoice::Ev100).ok_or("expected a number from -60 to 60, or auto".into())
}

/// Parses a value of an enum without data, such as `Technique`: the name of the variant in lower case.
pub fn choice<E: FromReflect + Typed + Enum + Clone + Sync>() -> impl TypedValueParser<Value = E> {
    let named = || fields::values::<E>().into_iter().map(|value| (value.variant_name().to_lowercase(), value));
    let names: Vec<String> = named().map(|(name, _)| name).collect();
    PossibleValuesParser::new(names).try_map(move |text| {
        let value = named().find(|(name, _)| *name == text);
        value.map(|(_, value)| value).ok_or("no variant has this name")
    })
}
