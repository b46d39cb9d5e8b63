//! A wrong edit of a shader, which the tests must find (`tests/mutants`).  The environment names it for a whole process.

use bevy_restir::testing::shader_library::ShaderEdit;
use std::sync::OnceLock;

/// The edit of this process: empty, or one.
pub fn edits() -> &'static [ShaderEdit] {
    static EDIT: OnceLock<Option<ShaderEdit>> = OnceLock::new();
    // It lives as long as the process.
    let read = |name: &str| std::env::var(name).ok().map(|text| &*text.leak());
    let from_environment =
        || Some(ShaderEdit { module: read("MUTANT_FILE")?, from: read("MUTANT_OLD")?, to: read("MUTANT_NEW")? });
    EDIT.get_or_init(from_environment).as_slice()
}
