//! Tooltips: the doc comments of settings and their variants, by the name of their type.
//!
//! Bevy's feature `reflect_documentation` would supply them, too; it compiles the documentation of all Bevy types into the program.

use bevy::ecs::resource::Resource;
use std::collections::HashMap;

/// The sources that declare the settings, joined by `build.rs`.
const SOURCES: &str = include_str!(concat!(env!("OUT_DIR"), "/settings.rs"));

/// Doc comments by type and member, as plain text.
#[derive(Resource)]
pub struct Docs(HashMap<(String, String), String>);

impl Default for Docs {
    fn default() -> Self {
        let mut docs = HashMap::new();
        read(SOURCES, &mut docs);
        Self(docs)
    }
}

impl Docs {
    /// The documentation of a field or a variant; `ty` is the name of the type without its path.
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

/// Removes the marks of links and code.
fn plain(doc: &str) -> String {
    let mut text = String::new();
    let mut rest = doc;
    // [`name`](target) becomes [`name`].
    while let Some(start) = rest.find("](") {
        text.push_str(&rest[..start + 1]);
        rest = rest[start + 2..].split_once(')').map_or("", |(_, after)| after);
    }
    text.push_str(rest);
    text.replace(['[', ']', '`'], "")
}
