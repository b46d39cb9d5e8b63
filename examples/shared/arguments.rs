//! What the command lines share: how values are read, and the names of the crate's choices.
#![allow(dead_code, reason = "no program takes all of it")]

use bevy::math::UVec2;
use bevy_restir::{Preset, RayBackend, Technique};
use clap::ValueEnum;

/// Reads `WIDTHxHEIGHT` of a picture.
pub fn size(text: &str) -> Result<UVec2, String> {
    size_within(text, 1, 16384)
}

/// Reads `WIDTHxHEIGHT` of a window.
pub fn window_size(text: &str) -> Result<UVec2, String> {
    size_within(text, 64, 8192)
}

fn size_within(text: &str, least: u32, most: u32) -> Result<UVec2, String> {
    text.split_once('x')
        .and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)))
        .filter(|size| size.min_element() >= least && size.max_element() <= most)
        .ok_or_else(|| format!("expected WIDTHxHEIGHT, each from {least} to {most}"))
}

/// Reads an exposure value: one whose exposure a picture in f32 can bear.
pub fn ev100(text: &str) -> Result<f32, String> {
    text.parse()
        .ok()
        .filter(|x: &f32| x.is_finite() && x.abs() <= 60.0)
        .ok_or("expected a number from -60 to 60".into())
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum TechniqueName {
    Reference,
    Di,
    Gi,
    Pt,
}

impl From<TechniqueName> for Technique {
    fn from(name: TechniqueName) -> Self {
        match name {
            TechniqueName::Reference => Self::Reference,
            TechniqueName::Di => Self::Di,
            TechniqueName::Gi => Self::Gi,
            TechniqueName::Pt => Self::Pt,
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
