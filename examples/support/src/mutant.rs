//! A wrong edit of a shader, which the tests must find (`tests/mutants`).  The environment names it for a whole process.

use std::sync::OnceLock;

struct Mutant {
    file: String,
    old: String,
    new: String,
}

fn mutant() -> Option<&'static Mutant> {
    static MUTANT: OnceLock<Option<Mutant>> = OnceLock::new();
    let read = |name: &str| std::env::var(name).ok();
    let from_environment =
        || Some(Mutant { file: read("MUTANT_FILE")?, old: read("MUTANT_OLD")?, new: read("MUTANT_NEW")? });
    MUTANT.get_or_init(from_environment).as_ref()
}

/// The text of the shader `path` (below `shaders/`) with the edit; `None` if the edit is not in this shader, or there is none.
pub fn mutated(path: &str, text: &str) -> Option<String> {
    let mutant = mutant().filter(|mutant| mutant.file == path)?;
    Some(text.replace(&mutant.old, &mutant.new))
}
