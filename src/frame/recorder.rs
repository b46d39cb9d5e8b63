//! Records the commands of a frame: among Bevy's commands, or, if they may trace many rays, in submissions of their own.

use bevy::{
    ecs::prelude::*,
    render::{
        diagnostic::DiagnosticsRecorder,
        render_resource::{CommandEncoder, CommandEncoderDescriptor},
        renderer::{PendingCommandBuffers, RenderContext, RenderDevice, RenderQueue},
    },
};

/// Records the commands of a frame.
pub(super) struct Recorder<'a, 'w, 's> {
    context: &'a mut RenderContext<'w, 's>,
    device: &'a RenderDevice,
    queue: &'a RenderQueue,
    /// Rays of a submission; `None`: the frame has no submissions of its own.
    limit: Option<u64>,
    /// Commands that are not submitted yet, and their rays.
    encoder: Option<CommandEncoder>,
    rays: u64,
}

impl<'a, 'w, 's> Recorder<'a, 'w, 's> {
    /// Begins a frame that may trace `rays`, at most `limit` of them in a submission.
    pub(super) fn begin(
        context: &'a mut RenderContext<'w, 's>,
        (device, queue): (&'a RenderDevice, &'a RenderQueue),
        pending: &mut PendingCommandBuffers,
        rays: u64,
        limit: u64,
    ) -> Self {
        let limit = (rays > limit).then_some(limit);
        if limit.is_some() {
            // Images that Bevy has drawn before come first, because materials may show them.
            queue.submit(pending.take());
        }
        Self { context, device, queue, limit, encoder: None, rays: 0 }
    }

    pub(super) fn encoder(&mut self) -> &mut CommandEncoder {
        if self.limit.is_none() {
            return self.context.command_encoder();
        }
        let descriptor = CommandEncoderDescriptor { label: Some("restir") };
        self.encoder.get_or_insert_with(|| self.device.create_command_encoder(&descriptor))
    }

    pub(super) fn diagnostics(&self) -> Option<Res<'w, DiagnosticsRecorder>> {
        self.context.diagnostic_recorder()
    }

    /// Begins another submission if the next pass, which may trace `rays`, exceeds the limit of this one.
    pub(super) fn make_room(&mut self, rays: u64) {
        if self.limit.is_some_and(|limit| self.rays + rays > limit) {
            self.submit();
        }
        self.rays += rays;
    }

    /// Submits the commands so far.
    pub(super) fn submit(&mut self) {
        if let Some(encoder) = self.encoder.take() {
            self.queue.submit([encoder.finish()]);
        }
        self.rays = 0;
    }

    /// Leaves the remaining commands to Bevy, in the order of its own.
    pub(super) fn finish(self) {
        if let Some(encoder) = self.encoder {
            self.context.add_command_buffer(encoder.finish());
        }
    }
}
