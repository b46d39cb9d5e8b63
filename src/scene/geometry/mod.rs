//! Meshes and their instances: triangulation, shared buffers, which cameras see what, and the draw calls of the visibility pass.

pub(crate) mod draw_list;
pub(crate) mod gpu_tlas;
pub(crate) mod instances;
pub(crate) mod meshes;
pub(crate) mod render_layers;
pub mod triangulate;
pub(crate) mod visibility_range;
