//! The plugin inside a Bevy app: cameras, effects, other passes, and frames over time.

mod accumulation;
mod cameras;
mod effects;
mod hot_reload;
mod interop;
mod light_units;
mod lost_devices;
mod motion_vectors;
mod parity;
mod pipelined;
mod switches;
mod webgpu_limits;
mod windows;
