//! Rays and the visibility buffer find the right triangle.

mod offset;
mod probes;
mod ray_queries;
mod traversal;
mod visibility_buffer;
