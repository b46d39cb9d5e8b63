//! The pictures of the techniques.  Modules in this folder hold for all techniques; subfolders are for one technique each.

mod area_lights;
pub mod bdpt;
mod bending;
pub mod confidence;
mod debug_views;
mod di;
mod disocclusion;
mod domain_views;
mod edited_scenes;
mod extremes;
mod far_lamps;
mod fireflies;
mod furnace;
mod gi;
mod guards;
mod light_parts;
mod mis_enumeration;
mod pairs;
mod presets;
pub mod previous_frame;
pub mod pt;
mod reference;
mod resampling;
mod settings;
mod skipped_work;
mod specialization;
mod sss;
