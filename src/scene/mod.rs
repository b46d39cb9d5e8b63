//! The ECS mirrored into GPU buffers.

pub mod alias;
