//! Settings as text on the command line: assignments to fields of `Restir`, separated by spaces.

use bevy_restir::Restir;
use bevy_restir_support::fields;

/// Fields that every command sets by itself.
const OWN: [&str; 4] = ["debug_view", "accumulate", "reset", "seed"];

/// Checks the text when the command line is parsed, so that nothing is measured before an error.
pub fn parse(text: &str) -> Result<String, String> {
    parse_without(text, &[])
}

/// Checks the text as [`parse`] does.  These fields belong to the command, too.
pub fn parse_without(text: &str, own: &[&str]) -> Result<String, String> {
    of(&Restir::default(), text)?;
    let mut paths = text.split_whitespace().map(fields::path_of);
    match paths.find(|path| OWN.contains(path) || own.contains(path)) {
        Some(path) => Err(format!("the command sets {path} by itself")),
        None => Ok(text.into()),
    }
}

/// The settings with these assignments.
pub fn of(plain: &Restir, text: &str) -> Result<Restir, String> {
    let mut settings = plain.clone();
    fields::set_in_range(&mut settings, text.split_whitespace())?;
    Ok(settings)
}
