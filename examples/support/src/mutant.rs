//! A fault that must be found: a wrong edit of a shader (`tests/mutants`, `lab plants`), or a fault of the library (`lab plants`).  The
//! environment names it for a whole process.

use bevy_restir::testing::{
    planted::{self, Fault},
    shader_library::ShaderEdit,
};
use std::sync::OnceLock;

/// The edit of this process: empty, or one.
pub fn edits() -> &'static [ShaderEdit] {
    static EDIT: OnceLock<Option<ShaderEdit>> = OnceLock::new();
    // It lives as long as the process.
    let read = |name: &str| std::env::var(name).ok().map(|text| &*text.leak());
    let from_environment = || match ["MUTANT_FILE", "MUTANT_OLD", "MUTANT_NEW"].map(read) {
        [Some(module), Some(from), Some(to)] => Some(ShaderEdit { module, from, to }),
        [None, None, None] => None,
        // Half an edit would plant nothing, and a test would seem to miss the fault.
        _ => panic!("MUTANT_FILE, MUTANT_OLD and MUTANT_NEW belong together: all of them must be set, or none"),
    };
    EDIT.get_or_init(from_environment).as_slice()
}

/// The variable that names a fault of the library.
pub const FAULT: &str = "PLANTED_FAULT";

/// Plants the fault of the library that the environment names, if it names one.
pub fn plant_fault() {
    let Ok(name) = std::env::var(FAULT) else { return };
    match Fault::ALL.into_iter().find(|fault| format!("{fault:?}") == name) {
        Some(fault) => planted::plant(fault),
        // A process without the fault would seem to miss it.
        None => panic!("{FAULT} names no fault: {name}"),
    }
}
