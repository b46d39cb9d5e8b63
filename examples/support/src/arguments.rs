//! Command lines: how values are parsed, and the names of the crate's choices.

use bevy::{camera::Exposure, math::UVec2};
use bevy_restir::{Preset, RayBackend, Technique};
use clap::{Parser, ValueEnum};
use std::process::ExitCode;

/// Parses the command line. Where it asks for help or is wrong, the error is the exit code of the program.
pub fn parse<T: Parser>() -> Result<T, ExitCode> {
    match T::try_parse() {
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

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum TechniqueName {
    Reference,
    Di,
    Gi,
    Pt,
    Bdpt,
}

impl From<TechniqueName> for Technique {
    fn from(name: TechniqueName) -> Self {
        match name {
            TechniqueName::Reference => Self::Reference,
            TechniqueName::Di => Self::Di,
            TechniqueName::Gi => Self::Gi,
            TechniqueName::Pt => Self::Pt,
            TechniqueName::Bdpt => Self::Bdpt,
        }
    }
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum PresetName {
    Performance,
    Balanced,
    Quality,
    Unbiased,
}

impl From<PresetName> for Preset {
    fn from(name: PresetName) -> Self {
        match name {
            PresetName::Performance => Self::Performance,
            PresetName::Balanced => Self::Balanced,
            PresetName::Quality => Self::Quality,
            PresetName::Unbiased => Self::Unbiased,
        }
    }
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    Auto,
    Software,
    Hardware,
}

impl From<Backend> for RayBackend {
    fn from(backend: Backend) -> Self {
        match backend {
            Backend::Auto => Self::Auto,
            Backend::Software => Self::Software,
            Backend::Hardware => Self::Hardware,
        }
    }
}
