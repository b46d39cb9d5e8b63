//! Meshes and their instances: triangulation, shared buffers, bodies that bend, which cameras see what, and the draw calls of the visibility
//! pass.

mod background;
pub(crate) mod bodies;
pub(crate) mod corner_texture;
pub(crate) mod draw_list;
pub(crate) mod gpu_tlas;
pub(crate) mod instance_record;
mod instance_trees;
pub(crate) mod instances;
pub(crate) mod joined_trees;
pub(crate) mod mesh_build;
pub(crate) mod meshes;
pub(crate) mod render_layers;
pub mod rig;
pub mod top_level;
pub(crate) mod totals;
pub mod triangulate;
pub(crate) mod visibility_range;
pub mod world_tree;

#[cfg(feature = "testing")]
pub use meshes::corner_copies::{hold_corner_copies, limit_corner_copies};
