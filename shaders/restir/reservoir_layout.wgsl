// Layouts of the reservoirs in memory.
#define_import_path bevy_restir::restir::reservoir_layout

#import bevy_restir::restir::types::{LAYOUT_COLUMNS, LAYOUT_ROWS}

// Index of a pixel's reservoir.  `tiling`: LAYOUT_ROWS, LAYOUT_COLUMNS, or the side of square tiles with rows inside (Lanz 2025, 4.5.3).
fn reservoir_index(pixel: vec2<u32>, size: vec2<u32>, tiling: u32) -> u32 {
    if tiling == LAYOUT_ROWS {
        return pixel.y * size.x + pixel.x;
    }
    if tiling == LAYOUT_COLUMNS {
        return pixel.x * size.y + pixel.y;
    }
    let tile = pixel / tiling;
    let within = pixel % tiling;
    let across = (size.x + tiling - 1u) / tiling;
    return ((tile.y * across + tile.x) * tiling + within.y) * tiling + within.x;
}
