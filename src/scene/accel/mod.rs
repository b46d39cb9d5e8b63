//! Acceleration structures: bottom-level and top-level trees for tracing in compute shaders, and the device's own for ray queries.

pub mod blas;
pub mod ray_query;
#[cfg(any(test, feature = "testing"))]
pub mod reached;
pub(crate) mod refit;
pub mod tlas;
pub(crate) mod wide_node;
