//! Parts that the programs with a window share: the window, the panel of settings with its keys, the look of the picture, programs with
//! one scene; and the parts of the viewer.

pub mod demo;
pub mod look;
pub mod panel;
pub mod viewer;
pub mod window;
