//! Images in a glTF file that are broken, or are not what the file states.

use bevy_restir_support::scenes::Random;
use serde_json::{Value, json};
use std::io::Cursor;

use super::glb::{Glb, png};

/// Bytes of a PNG file before the type of its first chunk, which is the header: the signature and the chunk's length.
const HEADER: usize = 12;
/// Bytes of the type and the content of that chunk: width, height, and five bytes of the format.
const HEADER_LENGTH: usize = 4 + 13;

/// Replaces an image of the file.  A file without images gets one for all of its materials.
pub fn replace(glb: &mut Glb, random: &mut Random) -> String {
    let half = |image: Vec<u8>| image[..image.len() / 2].to_vec();
    let (name, image, mime) = match random.below(9) {
        0 => ("a PNG image without width", png_of_size(0, 2), "image/png"),
        1 => ("a PNG image without height", png_of_size(2, 0), "image/png"),
        2 => ("a PNG image that no memory holds", png_of_size(i32::MAX as u32, i32::MAX as u32), "image/png"),
        3 => ("half of a PNG image", half(png()), "image/png"),
        4 => ("half of a JPEG image", half(jpeg()), "image/jpeg"),
        5 => ("a JPEG image that is stated as PNG", jpeg(), "image/png"),
        6 => ("a PNG image that is stated as JPEG", png(), "image/jpeg"),
        7 => ("a PNG image that is stated as KTX2", png(), "image/ktx2"),
        _ => ("an image without bytes", Vec::new(), "image/png"),
    };
    match add(glb, &image).and_then(|view| show(glb, json!({"bufferView": view, "mimeType": mime}), random)) {
        Some(()) => name.into(),
        None => format!("no place for {name}"),
    }
}

/// Adds data with a view of their own, and returns the number of the view.
fn add(glb: &mut Glb, data: &[u8]) -> Option<usize> {
    let start = glb.bytes.len().next_multiple_of(4);
    let buffer = glb.json.pointer_mut("/buffers/0")?.as_object_mut()?;
    // Only the first buffer can lie in the file itself.
    if buffer.contains_key("uri") {
        return None;
    }
    buffer.insert("byteLength".into(), json!(start + data.len()));
    let views = glb.json.get_mut("bufferViews")?.as_array_mut()?;
    views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": data.len()}));
    let view = views.len() - 1;
    glb.bytes.resize(start, 0);
    glb.bytes.extend(data);
    Some(view)
}

/// Replaces an image of the file.  A file without images gets one, which all of its materials show.
fn show(glb: &mut Glb, image: Value, random: &mut Random) -> Option<()> {
    if let Some(images) = glb.json.get_mut("images").and_then(Value::as_array_mut)
        && !images.is_empty()
    {
        let at = random.below(images.len());
        images[at] = image;
        return Some(());
    }
    let file = glb.json.as_object_mut()?;
    file.insert("images".into(), json!([image]));
    file.insert("textures".into(), json!([{"source": 0}]));
    let materials = file.get_mut("materials")?.as_array_mut()?;
    for material in materials.iter_mut().filter_map(Value::as_object_mut) {
        material.insert("pbrMetallicRoughness".into(), json!({"baseColorTexture": {"index": 0}}));
    }
    Some(())
}

/// A PNG image whose header is valid and states this size; its texels are those of a small image.
fn png_of_size(width: u32, height: u32) -> Vec<u8> {
    let mut file = png();
    file[HEADER + 4..HEADER + 8].copy_from_slice(&width.to_be_bytes());
    file[HEADER + 8..HEADER + 12].copy_from_slice(&height.to_be_bytes());
    let end = HEADER + HEADER_LENGTH;
    let sum = crc32(&file[HEADER..end]);
    file[end..end + 4].copy_from_slice(&sum.to_be_bytes());
    file
}

/// The checksum of a chunk of a PNG file.
fn crc32(bytes: &[u8]) -> u32 {
    let bit = |sum: u32| (sum >> 1) ^ if sum & 1 == 1 { 0xedb8_8320 } else { 0 };
    !bytes.iter().fold(u32::MAX, |sum, byte| (0..8).fold(sum ^ u32::from(*byte), |sum, _| bit(sum)))
}

/// A JPEG image of 8 x 8 texels.
fn jpeg() -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let image = image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([200, 30 * x as u8, 30 * y as u8]));
    // Writing to memory cannot fail.
    let _ = image.write_to(&mut file, image::ImageFormat::Jpeg);
    file.into_inner()
}
