//! Materials: packs `StandardMaterial`s and their texture slots for shaders, and computes the table for energy compensation.

pub mod directional_albedo;
pub(crate) mod materials;
pub(crate) mod texture_slots;
