//! The pictures of the techniques.  Modules in this folder hold for all techniques; subfolders are for one technique each.

mod area_lights;
mod debug_views;
mod di;
mod extremes;
mod gi;
mod pt;
mod reference;
mod resampling;
mod sss;
