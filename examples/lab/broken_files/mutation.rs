//! Ways to break a glTF file.

use bevy_restir_support::scenes::Random;
use serde_json::{Value, json};

use super::{glb::Glb, images};

/// Stands for a number that JSON has no name for, until the text is written.
const RAW: &str = "\u{1}raw ";

/// Numbers at the edges of what a file may contain.  With one of the last two the text is not usable JSON.
const NUMBERS: [&str; 26] = [
    "0",
    "-0.0",
    "1",
    "-1",
    "2",
    "3",
    "7",
    "255",
    "65535",
    "65536",
    "2147483647",
    "2147483648",
    "4294967295",
    "4294967296",
    "9007199254740993",
    "18446744073709551615",
    "18446744073709551616",
    "0.5",
    "1e-40",
    "1e-320",
    "1e20",
    "3e38",
    "1e39",
    "1e308",
    "1e999",
    "NaN",
];

/// Bit patterns of floats that are written over data.
const FLOATS: [f32; 8] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 1e20, 1e-40, -1.0, 0.0];

/// A broken copy of a file, and how it was broken.
pub fn mutant(sound: &Glb, random: &mut Random) -> (String, Vec<u8>) {
    let mut glb = sound.clone();
    let mut changes = Vec::new();
    for _ in 0..1 + random.below(3) / 2 {
        let kind = random.below(11);
        changes.push(match kind {
            0 => floats(&mut glb, random),
            1..=3 => anywhere(&mut glb.json, random),
            4 => images::replace(&mut glb, random),
            _ => structure(&mut glb.json, random),
        });
    }
    let text = raw_numbers(&glb.json.to_string());
    let mut file = glb.with_text(&text);
    if random.below(10) == 0 {
        changes.push(bytes(&mut file, text.len(), random));
    }
    (changes.join("; "), file)
}

/// Replaces the stand-ins of numbers.
fn raw_numbers(text: &str) -> String {
    let mark = serde_json::to_string(RAW).unwrap_or_default();
    let mark = mark.trim_end_matches('"');
    let mut parts = text.split(mark);
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (number, rest) = part.split_once('"').unwrap_or((part, ""));
        out += number;
        out += rest;
    }
    out
}

fn number(random: &mut Random) -> Value {
    // Few copies get a number that makes the whole text invalid JSON.
    let count = if random.below(20) == 0 { NUMBERS.len() } else { NUMBERS.len() - 2 };
    Value::String(format!("{RAW}{}", NUMBERS[random.below(count)]))
}

fn shown(value: &Value) -> String {
    let text = value.to_string().replace("\\u0001raw ", "");
    text.chars().take(40).collect()
}

/// Writes floats over the data.
fn floats(glb: &mut Glb, random: &mut Random) -> String {
    let count = glb.bytes.len() / 4;
    if count == 0 {
        return "no data".into();
    }
    let float = FLOATS[random.below(FLOATS.len())];
    let (first, length) = (random.below(count), 1 + random.below(20));
    for at in first..(first + length).min(count) {
        glb.bytes[4 * at..4 * at + 4].copy_from_slice(&float.to_le_bytes());
    }
    format!("{length} floats from {first} on are {float}")
}

/// Changes bytes of the whole file, or cuts it off.
fn bytes(file: &mut Vec<u8>, text: usize, random: &mut Random) -> String {
    match random.below(4) {
        0 => {
            file.truncate(random.below(file.len()));
            format!("cut off after {} bytes", file.len())
        }
        1 => {
            let at = 4 * random.below(5);
            file[at..at + 4].copy_from_slice(&random.bits().to_le_bytes());
            format!("another word {at} of the header")
        }
        part => {
            let (start, end) = if part == 2 { (20, 20 + text) } else { (20 + text, file.len()) };
            let count = 1 + random.below(8);
            for _ in 0..count {
                let at = (start + random.below((end - start).max(1))).min(file.len() - 1);
                file[at] ^= 1 << random.below(8);
            }
            format!("{count} bits flip between {start} and {end}")
        }
    }
}

/// Paths of all values.
fn paths(value: &Value, path: &str, all: &mut Vec<String>) {
    let mut visit = |key: &str, value: &Value| {
        let path = format!("{path}/{key}");
        all.push(path.clone());
        paths(value, &path, all);
    };
    match value {
        Value::Object(fields) => fields.iter().for_each(|(key, value)| visit(key, value)),
        Value::Array(values) => values.iter().enumerate().for_each(|(i, value)| visit(&i.to_string(), value)),
        _ => {}
    }
}

/// Changes a value anywhere, as its type allows.
fn anywhere(json: &mut Value, random: &mut Random) -> String {
    let mut all = Vec::new();
    paths(json, "", &mut all);
    if all.is_empty() {
        return "nothing is left".into();
    }
    let path = all.swap_remove(random.below(all.len()));
    let Some((parent, key)) = path.rsplit_once('/') else { return String::new() };
    if random.below(4) == 0 {
        match json.pointer_mut(parent) {
            Some(Value::Object(fields)) => _ = fields.remove(key),
            Some(Value::Array(values)) => _ = key.parse().map(|i: usize| values.remove(i)),
            _ => {}
        }
        return format!("{path} is missing");
    }
    let Some(value) = json.pointer_mut(&path) else { return String::new() };
    *value = match (&*value, random.below(5)) {
        (Value::Array(_), 0) => json!([]),
        (Value::Array(values), 1) => Value::Array(values.iter().chain(values).cloned().collect()),
        (_, 0) => Value::Null,
        (_, 1) => json!("text"),
        (Value::Object(_), 2) => json!([0, 1]),
        (Value::String(_), 2..) => json!("\u{0}/../\u{fffd}"),
        _ => number(random),
    };
    format!("{path} is {}", shown(value))
}

/// A member of one of the file's lists.  A missing list is created.
fn member<'a>(json: &'a mut Value, list: &str, random: &mut Random) -> Option<&'a mut Value> {
    if !json.get(list).is_some_and(Value::is_array) {
        json.as_object_mut()?.insert(list.into(), json!([{}]));
    }
    let members = json.get_mut(list)?.as_array_mut()?;
    if members.is_empty() {
        members.push(json!({}));
    }
    let at = random.below(members.len());
    members[at].is_object().then(|| &mut members[at])
}

/// Changes that break rules of the format.
fn structure(json: &mut Value, random: &mut Random) -> String {
    const RULES: [(&str, &[&str]); 10] = [
        ("accessors", &["count", "byteOffset", "componentType", "bufferView", "type", "sparse", "normalized", "max"]),
        ("bufferViews", &["buffer", "byteOffset", "byteLength", "byteStride"]),
        (
            "nodes",
            &["children", "mesh", "skin", "camera", "matrix", "rotation", "scale", "translation", "weights", "light"],
        ),
        ("images", &["bufferView", "mimeType", "uri"]),
        ("textures", &["source", "sampler"]),
        ("skins", &["joints", "inverseBindMatrices", "skeleton"]),
        ("cameras", &["type", "perspective", "orthographic"]),
        (
            "materials",
            &[
                "pbrMetallicRoughness",
                "normalTexture",
                "emissiveFactor",
                "alphaCutoff",
                "alphaMode",
                "extensions",
                "extras",
            ],
        ),
        ("meshes", &["primitives", "weights"]),
        ("animations", &["channels", "samplers"]),
    ];
    if random.below(5) == 0 {
        return whole(json, random);
    }
    let (list, fields) = RULES[random.below(RULES.len())];
    let field = fields[random.below(fields.len())];
    match field {
        "light" => {
            if let Some(node) = member(json, list, random) {
                node["extensions"] = json!({"KHR_lights_punctual": {"light": random.below(4)}});
            }
            return "a light at another node".into();
        }
        "primitives" => return primitive(json, random),
        _ => {}
    }
    let value = wrong(field, random);
    let change = format!("{list}: {field} is {}", shown(&value));
    match member(json, list, random) {
        Some(member) => {
            member[field] = value;
            change
        }
        None => "nothing to break".into(),
    }
}

/// A value that a field may hold in a broken file.
fn wrong(field: &str, random: &mut Random) -> Value {
    match field {
        "type" => [json!("MAT4"), json!("SCALAR"), json!("VEC5"), json!("orthographic")][random.below(4)].clone(),
        "componentType" => json!([5120, 5121, 5122, 5123, 5125, 5126, 5124][random.below(7)]),
        "sparse" => json!({"count": number(random), "indices": {"bufferView": random.below(4), "componentType": 5125},
            "values": {"bufferView": random.below(4)}}),
        "normalized" => json!(true),
        "children" | "joints" => Value::Array((0..random.below(4)).map(|_| json!(random.below(6))).collect()),
        "matrix" | "weights" | "max" | "rotation" | "scale" | "translation" | "emissiveFactor" => {
            let count = match field {
                "matrix" => 16,
                "rotation" => 4,
                "weights" => random.below(40),
                _ => 3,
            };
            Value::Array((0..count).map(|_| if random.below(3) == 0 { number(random) } else { json!(0) }).collect())
        }
        "mimeType" => json!(["image/png", "image/jpeg", "image/ktx2", "text/plain"][random.below(4)]),
        "uri" => json!(["missing.png", "data:image/png;base64,AAAA", "data:,", "/", "..", ""][random.below(6)]),
        "perspective" => {
            json!({"yfov": number(random), "znear": number(random), "zfar": number(random), "aspectRatio": number(random)})
        }
        "orthographic" => {
            json!({"xmag": number(random), "ymag": number(random), "znear": number(random), "zfar": number(random)})
        }
        "pbrMetallicRoughness" => {
            json!({"baseColorFactor": [number(random), 1, 1, number(random)], "roughnessFactor": number(random),
            "metallicFactor": number(random), "baseColorTexture": {"index": random.below(3), "texCoord": random.below(4)}})
        }
        "normalTexture" => json!({"index": random.below(3), "scale": number(random), "texCoord": number(random)}),
        "alphaMode" => json!(["MASK", "BLEND", "OPAQUE", "NONE"][random.below(4)]),
        "extras" => {
            json!({"subsurface": {"mean_free_path": [number(random), number(random), 1], "weight": number(random)}})
        }
        "extensions" => extension(random),
        "channels" => json!([{"sampler": random.below(3), "target": {"node": random.below(9), "path": "rotation"}}]),
        "samplers" => json!([{"input": random.below(9), "output": random.below(9), "interpolation": "CUBICSPLINE"}]),
        _ => number(random),
    }
}

fn extension(random: &mut Random) -> Value {
    let mut n = || number(random);
    json!({
        "KHR_materials_emissive_strength": {"emissiveStrength": n()}, "KHR_materials_ior": {"ior": n()},
        "KHR_materials_transmission": {"transmissionFactor": n()},
        "KHR_materials_volume": {"thicknessFactor": n(), "attenuationDistance": n(), "attenuationColor": [n(), 1, 1]},
        "KHR_materials_clearcoat": {"clearcoatFactor": n(), "clearcoatRoughnessFactor": n()},
        "KHR_materials_anisotropy": {"anisotropyStrength": n(), "anisotropyRotation": n()},
        "KHR_materials_specular": {"specularFactor": n(), "specularColorFactor": [n(), 1, 1]}
    })
}

/// Changes a part of a mesh.
fn primitive(json: &mut Value, random: &mut Random) -> String {
    const ATTRIBUTES: [&str; 9] =
        ["POSITION", "NORMAL", "TANGENT", "TEXCOORD_0", "TEXCOORD_1", "COLOR_0", "JOINTS_0", "WEIGHTS_0", "TEXCOORD_9"];
    let accessors = json["accessors"].as_array().map_or(1, |accessors| accessors.len() + 1);
    let attribute = ATTRIBUTES[random.below(ATTRIBUTES.len())];
    let (choice, accessor, mode) = (random.below(6), random.below(accessors), random.below(9));
    let part = member(json, "meshes", random).and_then(|mesh| mesh["primitives"].get_mut(0)?.as_object_mut());
    let Some(part) = part else { return "no part of a mesh".into() };
    match choice {
        0 => _ = part.insert("mode".into(), json!(mode)),
        1 => _ = part.insert("indices".into(), json!(accessor)),
        2 => _ = part.insert("material".into(), json!(accessor)),
        3 => _ = part.insert("targets".into(), json!([{attribute: accessor}, {}])),
        _ => {
            if let Some(attributes) = part.get_mut("attributes").and_then(Value::as_object_mut) {
                match choice {
                    4 => _ = attributes.remove(attribute),
                    _ => _ = attributes.insert(attribute.into(), json!(accessor)),
                }
            }
        }
    }
    format!("part of a mesh: choice {choice}, {attribute}, accessor {accessor}, mode {mode}")
}

/// Changes of the file as a whole.
fn whole(json: &mut Value, random: &mut Random) -> String {
    let lists: Vec<String> = json.as_object().map(|fields| fields.keys().cloned().collect()).unwrap_or_default();
    match random.below(6) {
        0 => json["extensionsRequired"] = json!(["EXT_unknown"]),
        1 => json["scene"] = number(random),
        2 => {
            json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
            {"type": (["point", "spot", "directional", "area"][random.below(4)]), "intensity": number(random),
             "range": number(random), "color": [number(random), 1, 1],
             "spot": {"innerConeAngle": number(random), "outerConeAngle": number(random)}}]}})
        }
        3 => {
            for node in json["nodes"].as_array_mut().into_iter().flatten().filter(|node| node.is_object()) {
                node["name"] = json!("same");
            }
        }
        4 => json["buffers"] = json!([{"byteLength": number(random), "uri": "missing.bin"}]),
        _ => {
            let Some(list) = lists.get(random.below(lists.len().max(1))) else { return "nothing is left".into() };
            _ = json.as_object_mut().map(|fields| fields.remove(list));
            return format!("{list} is missing");
        }
    }
    "a change of the whole file".into()
}
