//! ReSTIR PT.

mod asset_scenes;
mod connection;
mod long_run;
mod matrix;
mod motion;
mod packing_and_jacobian;
pub mod reconnection_choice;
mod roulette;
mod shift_inverse;
mod shift_measure;
mod small_scenes;
