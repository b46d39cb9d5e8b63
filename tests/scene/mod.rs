//! The scene on the GPU equals the scene in the ECS.

mod bad_input;
mod bad_values;
mod bindless_textures;
mod bodies;
mod changes;
mod changing_meshes;
mod corner_copies;
mod corners;
mod edits;
mod environment_cubemaps;
mod geometry;
mod huge_scenes;
mod light_counts;
mod live_images;
mod many_instances;
mod material_edge_cases;
mod material_lobes;
mod mirror;
mod moving_instances;
mod resting_instances;
mod seen_objects;
mod sizes_and_toggles;
mod subsurface;
mod texture_levels;
mod texture_sampling;
mod texture_slots;
