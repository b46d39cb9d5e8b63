// The pixel to which debug views shift the sample of another pixel.
#define_import_path bevy_restir::view::debug_shift

#import bevy_restir::view::bindings::view

// Distance to the right, pixels.
const SHIFT_DISTANCE: u32 = 8u;

fn shift_destination(pixel: vec2<u32>) -> vec2<u32> {
    return vec2<u32>(min(pixel.x + SHIFT_DISTANCE, view.size.x - 1u), pixel.y);
}
