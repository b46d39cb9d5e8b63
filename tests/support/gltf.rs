//! Writes a small glTF file: an emissive square that faces the camera, optionally with an animation or a texture.

/// The content of the file.
pub struct Scene {
    pub camera: bool,
    pub emissive: [f32; 3],
    /// Moves 10 m to the right within half a second; the animation lasts ten seconds.
    pub animated: bool,
    /// The file of the base color texture.
    pub texture: Option<String>,
    /// Changes the binary buffer: positions, texture coordinates, indices, times, translations.
    pub edit_bytes: fn(&mut [u8]),
    /// Changes the file.
    pub edit_json: fn(&mut serde_json::Value),
}

impl Default for Scene {
    fn default() -> Self {
        // KHR_materials_emissive_strength 4 · (0.25, 0.5, 0.75).
        Self {
            camera: true,
            emissive: [0.25, 0.5, 0.75],
            animated: false,
            texture: None,
            edit_bytes: |_| (),
            edit_json: |_| (),
        }
    }
}

/// Standard base 64 encoding.
fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let word = (0..3).fold(0u32, |word, i| word << 8 | u32::from(*chunk.get(i).unwrap_or(&0)));
        for i in 0..4 {
            let digit = ALPHABET[(word >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= chunk.len() { digit as char } else { '=' });
        }
    }
    text
}

impl Scene {
    /// The text of the file.
    pub fn json(&self) -> String {
        // 48 bytes of positions, 32 of texture coordinates, 12 of indices, 12 of times, 36 of translations.
        let positions: [f32; 12] = [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 1.0, 1.0, 0.0, -1.0, 1.0, 0.0];
        let uvs: [f32; 8] = [0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0];
        let indices: [u16; 6] = [0, 1, 2, 0, 2, 3];
        let times: [f32; 3] = [0.0, 0.5, 10.0];
        let places: [f32; 9] = [0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 10.0, 0.0, 0.0];
        let mut bytes = bytemuck::cast_slice::<f32, u8>(&positions).to_vec();
        bytes.extend_from_slice(bytemuck::cast_slice(&uvs));
        bytes.extend_from_slice(bytemuck::cast_slice(&indices));
        bytes.extend_from_slice(bytemuck::cast_slice(&times));
        bytes.extend_from_slice(bytemuck::cast_slice(&places));
        (self.edit_bytes)(&mut bytes);
        let mut pbr = serde_json::json!({"baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicFactor": 0.0});
        let mut file = serde_json::json!({
            "asset": {"version": "2.0"},
            "extensionsUsed": ["KHR_materials_emissive_strength"],
            "scene": 0,
            "scenes": [{"nodes": if self.camera { vec![0, 1] } else { vec![0] }}],
            "nodes": [{"mesh": 0, "name": "square"}, {"camera": 0, "translation": [0.0, 0.0, 5.0], "name": "eye"}],
            "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
            "buffers": [{
                "byteLength": bytes.len(),
                "uri": format!("data:application/octet-stream;base64,{}", base64(&bytes)),
            }],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": 48},
                {"buffer": 0, "byteOffset": 48, "byteLength": 32},
                {"buffer": 0, "byteOffset": 80, "byteLength": 12},
                {"buffer": 0, "byteOffset": 92, "byteLength": 12},
                {"buffer": 0, "byteOffset": 104, "byteLength": 36},
            ],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1, 0]},
                {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
                {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
                {"bufferView": 3, "componentType": 5126, "count": 3, "type": "SCALAR", "min": [0], "max": [10]},
                {"bufferView": 4, "componentType": 5126, "count": 3, "type": "VEC3"},
            ],
        });
        if let Some(texture) = &self.texture {
            pbr["baseColorTexture"] = serde_json::json!({"index": 0});
            file["textures"] = serde_json::json!([{"source": 0}]);
            file["images"] = serde_json::json!([{"uri": texture}]);
        }
        file["materials"] = serde_json::json!([{
            "pbrMetallicRoughness": pbr,
            "emissiveFactor": self.emissive,
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}},
        }]);
        if self.animated {
            file["animations"] = serde_json::json!([{
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
                "samplers": [{"input": 3, "output": 4, "interpolation": "LINEAR"}],
            }]);
        }
        (self.edit_json)(&mut file);
        file.to_string()
    }
}
