//! The scene as rays see it: triangles out of Bevy's meshes, and the trees over them.

pub mod blas;
pub mod geometry;
pub mod tlas;
