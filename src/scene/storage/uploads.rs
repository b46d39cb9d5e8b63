//! The uploads of a frame.
//!
//! On native platforms wgpu makes a staging buffer for each `write_buffer` and does not reuse it, and each submission calls the driver and
//! looks for finished work.  Here, many small pieces of a buffer share a staging buffer, and all buffers share a submission.

use bevy::render::{
    render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoder, CommandEncoderDescriptor},
    renderer::{RenderDevice, RenderQueue},
};

/// The device, and copies that it runs in [`Self::submit`].
///
/// The copies run after all writes to the queue, even those that follow [`Self::scatter`].  Until they are submitted, their destination must
/// not grow, and nothing else may be written to the same places.
pub(crate) struct Uploads<'a> {
    pub device: &'a RenderDevice,
    pub queue: &'a RenderQueue,
    /// The copies; `None` if there are none.
    encoder: Option<CommandEncoder>,
}

impl<'a> Uploads<'a> {
    pub(crate) fn new(device: &'a RenderDevice, queue: &'a RenderQueue) -> Self {
        Self { device, queue, encoder: None }
    }

    /// Records copies of `parts` to a buffer.  `size`: bytes of all parts.  `parts`: the offset in the buffer and the bytes of each.
    pub(super) fn scatter<'b>(
        &mut self,
        label: &str,
        buffer: &Buffer,
        size: u64,
        parts: impl Iterator<Item = (u64, &'b [u8])>,
    ) {
        let (device, usage) = (self.device, BufferUsages::MAP_WRITE | BufferUsages::COPY_SRC);
        let descriptor = BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: true };
        let staged = device.create_buffer(&descriptor);
        let descriptor = CommandEncoderDescriptor { label: Some("restir uploads") };
        let encoder = self.encoder.get_or_insert_with(|| device.create_command_encoder(&descriptor));
        {
            let mut view = staged.slice(..).get_mapped_range_mut();
            let mut bytes = view.slice(..);
            let mut at = 0;
            for (offset, part) in parts {
                bytes.slice(at..at + part.len()).copy_from_slice(part);
                encoder.copy_buffer_to_buffer(&staged, at as u64, buffer, offset, part.len() as u64);
                at += part.len();
            }
        }
        staged.unmap();
    }

    /// Runs the copies.
    pub(crate) fn submit(self) {
        if let Some(encoder) = self.encoder {
            self.queue.submit([encoder.finish()]);
        }
    }
}
