//! The scenes, the technique and the settings that `frames`, `features`, `motion` and `budget` measure.

use bevy_restir::{Preset, Restir, Technique};
use bevy_restir_support::arguments;
use std::path::PathBuf;

/// Scenes, and the technique and the settings that render them.
#[derive(clap::Args, Debug)]
pub struct Subject {
    /// glTF files.
    #[arg(required = true)]
    pub scenes: Vec<PathBuf>,
    /// Settings to start from.
    #[arg(long, default_value = "balanced", value_parser = arguments::choice::<Preset>())]
    pub preset: Preset,
    /// The technique to measure.
    #[arg(long, default_value = "pt", value_parser = arguments::choice::<Technique>())]
    pub technique: Technique,
}

impl Subject {
    pub fn settings(&self) -> Restir {
        Restir { technique: self.technique, ..Restir::preset(self.preset) }
    }
}
