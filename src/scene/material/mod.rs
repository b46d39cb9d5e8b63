//! Materials: `StandardMaterial` packed for shaders, its texture slots, and the table that energy compensation reads.

pub mod directional_albedo;
pub(crate) mod materials;
pub(crate) mod texture_slots;
