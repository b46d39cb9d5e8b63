//! Settings as text on the command line: assignments to fields of `Restir`, separated by spaces.

use bevy_restir::Restir;
use bevy_restir_support::fields;

/// Checks the text when the command line is parsed, so that nothing is measured before an error.
pub fn parse(text: &str) -> Result<String, String> {
    of(&Restir::default(), text).map(|_| text.into())
}

/// The settings with these assignments.
pub fn of(plain: &Restir, text: &str) -> Result<Restir, String> {
    let mut settings = plain.clone();
    fields::set_in_range(&mut settings, text.split_whitespace())?;
    Ok(settings)
}
