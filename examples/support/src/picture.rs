//! Tonemapped pictures as files.

use bevy::{
    camera::RenderTarget,
    color::ColorToComponents,
    prelude::*,
    render::view::screenshot::{Screenshot, ScreenshotCaptured},
};
use std::path::Path;

use crate::{files::complete, headless::until, scene::View};

/// The picture that was requested, once it has come back.
#[derive(Resource, Default)]
struct Taken(Option<Image>);

/// Renders the next frame and reads the view target back, tonemapped by Bevy.
pub fn screenshot(app: &mut App) -> Result<Image, String> {
    request(app)?;
    take(app)
}

/// Requests the picture of the next frame.
pub fn request(app: &mut App) -> Result<(), String> {
    app.insert_resource(Taken::default());
    let camera = app.world().resource::<View>().camera;
    let target = app.world().get::<RenderTarget>(camera).cloned().ok_or("the camera is gone")?;
    app.world_mut()
        .spawn(Screenshot(target))
        .observe(|captured: On<ScreenshotCaptured>, mut taken: ResMut<Taken>| taken.0 = Some(captured.image.clone()));
    Ok(())
}

/// Renders frames until the picture that was requested has come back.
pub fn take(app: &mut App) -> Result<Image, String> {
    until(app, "no picture came back", |app| app.world().resource::<Taken>().0.is_some())?;
    app.world_mut().resource_mut::<Taken>().0.take().ok_or("no picture came back".into())
}

/// Reads a picture: its size, and its colors as linear light.
pub fn read_png(path: &Path) -> Result<(UVec2, Vec<[f32; 3]>), String> {
    let file = image::open(path).map_err(|e| format!("{}: {e}", path.display()))?.to_rgb8();
    let linear = |image::Rgb([r, g, b]): &image::Rgb<u8>| LinearRgba::from(Srgba::rgb_u8(*r, *g, *b));
    let colors = file.pixels().map(|pixel| linear(pixel).to_f32_array_no_alpha()).collect();
    Ok((UVec2::new(file.width(), file.height()), colors))
}

/// Writes a picture, complete or not at all.
pub fn write_png(path: &Path, image: Image) -> Result<(), String> {
    let dynamic = image.try_into_dynamic().map_err(|e| e.to_string())?;
    complete(path, |part| dynamic.to_rgb8().save_with_format(part, image::ImageFormat::Png).map_err(|e| e.to_string()))
}
