//! ReSTIR GI.

mod small_scenes;
