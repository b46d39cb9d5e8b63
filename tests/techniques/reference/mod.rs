//! The reference path tracer.

mod closed_forms;
mod mitsuba;
mod subsurface;
