//! The two chunks of a binary glTF file, and a small file with a bit of everything.

use serde_json::{Value, json};

/// A binary glTF file.
#[derive(Clone, Debug)]
pub struct Glb {
    pub json: Value,
    pub bytes: Vec<u8>,
}

const JSON: u32 = 0x4e4f_534a;
const BIN: u32 = 0x004e_4942;

impl Glb {
    /// Reads a valid file.
    pub fn read(file: &[u8]) -> Result<Self, String> {
        let word = |at: usize| file.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
        let (mut at, mut chunks) = (12, Vec::new());
        while let Some(length) = word(at) {
            chunks.push(file.get(at + 8..at + 8 + length).ok_or("a chunk is cut off")?);
            at += 8 + length.next_multiple_of(4);
        }
        let json = chunks.first().ok_or("it is not a binary glTF file")?;
        let json = serde_json::from_slice(json).map_err(|error| error.to_string())?;
        Ok(Self { json, bytes: chunks.get(1).map(|bytes| bytes.to_vec()).unwrap_or_default() })
    }

    /// The file with this text in place of its JSON.
    pub fn with_text(&self, text: &str) -> Vec<u8> {
        let mut text = text.as_bytes().to_vec();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bytes = self.bytes.clone();
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        let length = 12 + 8 + text.len() + 8 + bytes.len();
        let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
        let mut file = b"glTF".to_vec();
        file.extend(words(&[2, length as u32, text.len() as u32, JSON]));
        file.extend(text);
        file.extend(words(&[bytes.len() as u32, BIN]));
        file.extend(bytes);
        file
    }
}

/// Appends data, each with a view of its own and, but for images, an accessor.
#[derive(Default)]
struct Writer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Writer {
    fn view(&mut self, data: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": data.len()}));
        self.bytes.extend(data);
        self.views.len() - 1
    }

    fn accessor(&mut self, data: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(data);
        let accessor = json!({"bufferView": view, "componentType": component, "type": kind, "count": count});
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats(&mut self, data: &[f32], kind: &str, count: usize) -> usize {
        self.accessor(bytemuck::cast_slice(data), 5126, kind, count)
    }
}

/// A square with a texture, a skin, morph targets and an animation, with a camera and lights of each kind.
pub fn rich() -> Glb {
    let mut data = Writer::default();
    let corners = [[-1.0f32, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    let positions = data.floats(corners.as_flattened(), "VEC3", 4);
    data.accessors[positions]["min"] = json!([-1, -1, 0]);
    data.accessors[positions]["max"] = json!([1, 1, 0]);
    let normals = data.floats([[0.0f32, 0.0, 1.0]; 4].as_flattened(), "VEC3", 4);
    let tangents = data.floats([[1.0f32, 0.0, 0.0, 1.0]; 4].as_flattened(), "VEC4", 4);
    let uvs = data.floats(&[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0], "VEC2", 4);
    let joints = data.accessor(&[0, 1, 0, 0].repeat(4), 5121, "VEC4", 4);
    let weights = data.floats([[0.5f32, 0.5, 0.0, 0.0]; 4].as_flattened(), "VEC4", 4);
    let indices = data.accessor(bytemuck::cast_slice(&[0u16, 1, 2, 0, 2, 3]), 5123, "SCALAR", 6);
    let target = data.floats([[0.0f32, 0.1, 0.2]; 4].as_flattened(), "VEC3", 4);
    let identity: [f32; 16] = core::array::from_fn(|i| if i % 5 == 0 { 1.0 } else { 0.0 });
    let inverse = data.floats([identity; 2].as_flattened(), "MAT4", 2);
    let times = data.floats(&[0.0, 1.0], "SCALAR", 2);
    let places = data.floats(&[0.0, 0.0, 0.0, 0.0, 0.2, 0.0], "VEC3", 2);
    let morphs = data.floats(&[0.0, 1.0], "SCALAR", 2);
    let image = data.view(&png());
    let attributes = json!({"POSITION": positions, "NORMAL": normals, "TANGENT": tangents, "TEXCOORD_0": uvs,
        "JOINTS_0": joints, "WEIGHTS_0": weights});
    let light = |kind: &str| json!({"type": kind, "color": [1, 1, 1], "intensity": 20, "range": 10});
    let mut spot = light("spot");
    spot["spot"] = json!({"innerConeAngle": 0.2, "outerConeAngle": 0.6});
    let lit = |light: u32| json!({"KHR_lights_punctual": {"light": light}});
    let mut material = json!({"name": "m", "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.7, 0.6, 1], "roughnessFactor": 0.5,
        "metallicFactor": 0.1, "baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}},
        "normalTexture": {"index": 0, "scale": 1}, "occlusionTexture": {"index": 0}, "emissiveTexture": {"index": 0},
        "emissiveFactor": [0.1, 0.1, 0.1], "alphaMode": "MASK", "alphaCutoff": 0.1, "doubleSided": true,
        "extras": {"subsurface": {"mean_free_path": [0.1, 0.05, 0.02], "weight": 0.5}}});
    material["extensions"] = json!({"KHR_materials_emissive_strength": {"emissiveStrength": 2},
        "KHR_materials_ior": {"ior": 1.4}, "KHR_materials_transmission": {"transmissionFactor": 0.3},
        "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationDistance": 1, "attenuationColor": [0.5, 0.8, 0.9]},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.1},
        "KHR_materials_anisotropy": {"anisotropyStrength": 0.5, "anisotropyRotation": 0.3},
        "KHR_materials_specular": {"specularFactor": 0.7}});
    let mut json = json!({
        "asset": {"version": "2.0"}, "scene": 0, "buffers": [{"byteLength": data.bytes.len()}],
        "extensionsUsed": ["KHR_lights_punctual", "KHR_texture_transform"],
        "bufferViews": data.views, "accessors": data.accessors, "materials": [material],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "zfar": 100}}],
        "images": [{"bufferView": image, "mimeType": "image/png"}], "samplers": [{"magFilter": 9729, "wrapS": 10497}],
        "textures": [{"source": 0, "sampler": 0}],
        "skins": [{"joints": [2, 3], "inverseBindMatrices": inverse, "skeleton": 2}],
        "scenes": [{"name": "s", "nodes": [0, 1, 2, 4, 5, 6]}]
    });
    json["extensions"] = json!({"KHR_lights_punctual": {"lights": [light("point"), spot, light("directional")]}});
    json["meshes"] = json!([{"name": "square", "weights": [0.2], "primitives": [
        {"attributes": attributes, "indices": indices, "material": 0, "targets": [{"POSITION": target}]}]}]);
    json["nodes"] = json!([
        {"name": "body", "mesh": 0, "skin": 0}, {"name": "camera", "camera": 0, "translation": [0, 0, 4]},
        {"name": "hip", "children": [3], "translation": [0, 0, 0]}, {"name": "knee", "rotation": [0, 0, 0, 1]},
        {"name": "point", "translation": [1, 2, 2], "extensions": lit(0)},
        {"name": "spot", "translation": [0, 0, 3], "extensions": lit(1)},
        {"name": "sun", "scale": [1, 1, 1], "extensions": lit(2)}]);
    json["animations"] = json!([{"samplers": [{"input": times, "output": places}, {"input": times, "output": morphs}],
        "channels": [{"sampler": 0, "target": {"node": 3, "path": "translation"}},
            {"sampler": 1, "target": {"node": 0, "path": "weights"}}]}]);
    Glb { json, bytes: data.bytes }
}

/// A PNG image of 2 x 2 texels.
pub fn png() -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_fn(2, 2, |x, y| image::Rgba([200, 100 * x as u8, 100 * y as u8, 255]));
    // Writing to memory cannot fail.
    let _ = image.write_to(&mut file, image::ImageFormat::Png);
    file.into_inner()
}
