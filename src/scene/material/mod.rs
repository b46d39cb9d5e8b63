//! Materials: packs `StandardMaterial`s, their texture slots and `Subsurface` components for shaders, and computes the table for energy
//! compensation.

pub mod directional_albedo;
pub(crate) mod materials;
mod pack;
pub(crate) mod subsurface;
pub(crate) mod texture_slots;
