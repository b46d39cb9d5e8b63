//! Arrays that shaders read as textures, because WebGPU guarantees only eight storage buffers per stage.  Elements lie side by side in
//! rows of equal length.

use bevy::{
    log::warn,
    render::{
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
    },
};
use bytemuck::Pod;
use std::marker::PhantomData;

use super::allocation;

/// Elements of a row, equal to `ELEMENTS_PER_ROW` in `shaders/scene/bindings.wgsl`.
pub const ELEMENTS_PER_ROW: u32 = 1024;

/// Result of [`DataTexture::reserve`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reserved {
    /// The elements fit the texture as it is.
    Kept,
    /// The texture was replaced, so that its contents are lost.
    Replaced,
    /// The device has no memory for the elements.  The old texture stays.
    Failed,
}

/// An array of `T` in a texture; each element takes `texels` adjacent texels.
pub(crate) struct DataTexture<T> {
    label: &'static str,
    format: TextureFormat,
    texels: u32,
    texture: Option<Texture>,
    view: Option<TextureView>,
    /// A warning has said that the device has no memory for more elements.
    warned: bool,
    element: PhantomData<T>,
}

impl<T: Pod> DataTexture<T> {
    /// An empty array whose elements take `texels` texels of this format.
    pub(crate) fn new(label: &'static str, format: TextureFormat, texels: u32) -> Self {
        Self { label, format, texels, texture: None, view: None, warned: false, element: PhantomData }
    }

    /// The number of elements that a texture of this device can hold.
    pub(crate) fn limit(device: &RenderDevice) -> u32 {
        ELEMENTS_PER_ROW * device.limits().max_texture_dimension_2d
    }

    /// Makes room for `count` elements.
    #[must_use]
    pub(crate) fn reserve(&mut self, count: u32, device: &RenderDevice) -> Reserved {
        let rows = count.div_ceil(ELEMENTS_PER_ROW).max(1);
        if self.texture.as_ref().is_some_and(|t| t.height() >= rows) {
            return Reserved::Kept;
        }
        match allocation::attempt(device, self.label, || self.create(rows, device)) {
            Ok(texture) => {
                self.view = Some(texture.create_view(&TextureViewDescriptor::default()));
                self.texture = Some(texture);
                Reserved::Replaced
            }
            Err(error) => {
                if !core::mem::replace(&mut self.warned, true) {
                    warn!("restir: no memory for a texture of {count} elements ({}): {error}", self.label);
                }
                Reserved::Failed
            }
        }
    }

    fn create(&self, rows: u32, device: &RenderDevice) -> Texture {
        device.create_texture(&TextureDescriptor {
            label: Some(self.label),
            size: Extent3d {
                width: ELEMENTS_PER_ROW * self.texels,
                height: rows.next_power_of_two().min(device.limits().max_texture_dimension_2d),
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format: self.format,
            usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
            view_formats: &[],
        })
    }

    /// Uploads `data` to the elements from `first` on, which must be reserved.  Returns the number of bytes sent.
    pub(crate) fn write(&self, first: u32, data: &[T], queue: &RenderQueue) -> u64 {
        let Some(texture) = &self.texture else { return 0 };
        let (mut at, mut rest) = (first, data);
        while !rest.is_empty() && at / ELEMENTS_PER_ROW < texture.height() {
            // Each copy covers part of one row, or as many whole rows as possible.
            let column = at % ELEMENTS_PER_ROW;
            let whole = if column == 0 { rest.len() as u32 / ELEMENTS_PER_ROW } else { 0 };
            let (width, rows) = if whole > 0 {
                (ELEMENTS_PER_ROW, whole)
            } else {
                ((ELEMENTS_PER_ROW - column).min(rest.len() as u32), 1)
            };
            let (part, after) = rest.split_at((width * rows) as usize);
            queue.write_texture(
                TexelCopyTextureInfo {
                    origin: Origin3d { x: column * self.texels, y: at / ELEMENTS_PER_ROW, z: 0 },
                    ..texture.as_image_copy()
                },
                bytemuck::cast_slice(part),
                TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(width * size_of::<T>() as u32),
                    rows_per_image: None,
                },
                Extent3d { width: width * self.texels, height: rows, depth_or_array_layers: 1 },
            );
            at += part.len() as u32;
            rest = after;
        }
        size_of_val(data) as u64
    }

    /// Frees the texture.
    pub(crate) fn clear(&mut self) {
        (self.texture, self.view) = (None, None);
    }

    /// The view to bind; `None` before the first [`Self::reserve`].
    pub(crate) fn view(&self) -> Option<&TextureView> {
        self.view.as_ref()
    }

    /// Name and size in bytes, for the report.
    pub(crate) fn memory(&self) -> (&'static str, u64) {
        let bytes = |t: &Texture| t.height() as u64 * ELEMENTS_PER_ROW as u64 * size_of::<T>() as u64;
        (self.label, self.texture.as_ref().map_or(0, bytes))
    }
}
