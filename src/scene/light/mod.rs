//! Lights: what emits, the table that all lights share, and the alias table that chooses one by its power.

pub mod alias_table;
pub(crate) mod emissive;
pub(crate) mod lights;
