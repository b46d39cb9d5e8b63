//! The scene that the GPU sees is the scene that the ECS holds.

mod bad_input;
mod bindless_textures;
mod changing_meshes;
mod edits;
mod environment_cubemaps;
mod geometry;
mod light_counts;
mod live_images;
mod many_instances;
mod material_edge_cases;
mod material_lobes;
mod mirror;
mod texture_levels;
mod textures;
