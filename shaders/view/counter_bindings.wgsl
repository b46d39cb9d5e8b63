// Group 2 of the passes that add to the counters of the view.
#define_import_path bevy_restir::view::counter_bindings

struct Counters {
    // Of this frame.
    rays: atomic<u32>,
    non_finite_pixels: atomic<u32>,
    overflow_flags: atomic<u32>,
    light_vertices: atomic<u32>,
    splats: atomic<u32>,
    // Of the whole run: for each bit of a guard, the sum over frames of the pixels that raised it.
    guards: array<atomic<u32>, 32>,
}

// The binding is the same in all of these passes (`COUNTERS_BINDING` in src/frame/resource.rs).
@group(2) @binding(15) var<storage, read_write> counters: Counters;
