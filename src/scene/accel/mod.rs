//! Acceleration structures: bottom and top levels for rays traced in compute shaders, and the device's own for ray queries.

pub mod blas;
pub mod ray_query;
pub mod tlas;
