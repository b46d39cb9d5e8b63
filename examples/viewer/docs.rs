//! What the source says about the settings: doc comments of fields and variants, by the name of their type.

use std::collections::HashMap;

/// Where settings are declared.
const SOURCES: [&str; 3] = [
    include_str!("../../src/settings.rs"),
    include_str!("../../src/settings/direct.rs"),
    include_str!("../../src/settings/paths.rs"),
];

/// Doc comments by type and member, as plain text.
pub struct Docs(HashMap<(String, String), String>);

impl Default for Docs {
    fn default() -> Self {
        let mut docs = HashMap::new();
        for source in SOURCES {
            read(source, &mut docs);
        }
        Self(docs)
    }
}

impl Docs {
    /// What a field of a struct or a variant of an enum is; the type by its name without a path.
    pub fn of(&self, ty: &str, member: &str) -> Option<&str> {
        self.0.get(&(ty.into(), member.into())).map(String::as_str)
    }
}

fn read(source: &str, docs: &mut HashMap<(String, String), String>) {
    let (mut ty, mut doc) = (String::new(), String::new());
    for line in source.lines() {
        let code = line.trim();
        if let Some(text) = code.strip_prefix("///") {
            if !doc.is_empty() {
                doc.push(' ');
            }
            doc.push_str(text.trim());
            continue;
        }
        if code.starts_with("#[") {
            continue;
        }
        let name = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
        if let Some(rest) = code.strip_prefix("pub struct ").or(code.strip_prefix("pub enum ")) {
            ty = name(rest);
        } else if code == "}" {
            ty.clear();
        } else if !ty.is_empty() && !doc.is_empty() {
            let member = name(code.strip_prefix("pub ").unwrap_or(code));
            docs.insert((ty.clone(), member), plain(&doc));
        }
        doc.clear();
    }
}

/// Without the marks of links and code.
fn plain(doc: &str) -> String {
    let mut text = String::new();
    let mut rest = doc;
    // [`name`](target) and [`name`] are their name.
    while let Some(start) = rest.find("](") {
        text.push_str(&rest[..start + 1]);
        rest = rest[start + 2..].split_once(')').map_or("", |(_, after)| after);
    }
    text.push_str(rest);
    text.replace(['[', ']', '`'], "")
}
