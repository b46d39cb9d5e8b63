//! The shaders compose, agree with Rust about layouts and numbers, and keep to the order of rooms.

mod composition;
mod layout;
mod room_order;
mod shared_numbers;
