//! The pictures of the techniques.  Modules in this folder hold for all techniques; subfolders are for one technique each.

mod area_lights;
mod debug_views;
mod di;
mod extremes;
mod furnace;
mod gi;
mod guards;
mod presets;
mod pt;
mod reference;
mod resampling;
