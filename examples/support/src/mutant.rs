//! A wrong edit of a shader, which the tests must find (`tests/mutants`).  The environment names it for a whole process.

use bevy_restir::testing::shader_library::ShaderEdit;
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
