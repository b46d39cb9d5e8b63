// Layouts of the reservoirs in memory.
#define_import_path bevy_restir::restir::reservoir_layout

#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::types::{LAYOUT_COLUMNS, LAYOUT_ROWS}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::pixel::pixel_index

// Index of a pixel's reservoir.  The layout is LAYOUT_ROWS, LAYOUT_COLUMNS, or the side of square tiles with rows inside (Lanz 2025, 4.5.3).
fn reservoir_index(pixel: vec2<u32>) -> u32 {
    let tiling = settings.reservoir_layout;
    if tiling == LAYOUT_ROWS {
        return pixel_index(pixel);
    }
    if tiling == LAYOUT_COLUMNS {
        return pixel.x * view.size.y + pixel.y;
    }
    let tile = pixel / tiling;
    let within = pixel % tiling;
    let across = (view.size.x + tiling - 1u) / tiling;
    return ((tile.y * across + tile.x) * tiling + within.y) * tiling + within.x;
}
