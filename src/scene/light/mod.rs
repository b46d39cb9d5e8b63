//! Lights.  Analytic lights and the triangles of emissive meshes share one table.  An alias table selects an analytic light or a mesh by
//! balanced power, and an alias table of each mesh selects one of its triangles.

pub mod alias_table;
mod analytic;
#[cfg(feature = "testing")]
mod check;
mod emissive_mesh;
mod emitter;
mod id_remap;
pub(crate) mod lights;
mod records;
mod shape_tree;
mod table;

/// Luminance of a linear Rec. 709 color.
fn luminance(c: [f32; 3]) -> f64 {
    0.2126 * c[0] as f64 + 0.7152 * c[1] as f64 + 0.0722 * c[2] as f64
}

/// Whether numbers are equal.  NaN equals NaN here, so that a rejected light does not count as changed in every frame.
fn equal_or_nan<const N: usize>(a: [f32; N], b: [f32; N]) -> bool {
    a.iter().zip(&b).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}
