// Pixels of the picture that the view traces.
#define_import_path bevy_restir::view::pixel

#import bevy_restir::view::bindings::view

// Index of a pixel in buffers that hold one element for each pixel, row by row.
fn pixel_index(pixel: vec2<u32>) -> u32 {
    return pixel.y * view.size.x + pixel.x;
}

// Whether a point of the image (pixels, y down) lies in the picture.
fn is_in_picture(at: vec2<f32>) -> bool {
    return all(at >= vec2<f32>(0.0)) && all(at < vec2<f32>(view.size));
}

// The pixel at a point of the picture.
fn pixel_at(at: vec2<f32>) -> vec2<u32> {
    return min(vec2<u32>(at), view.size - 1u);
}
