//! Bind groups that last as long as the resources of a view.

use bevy::{
    platform::collections::HashMap,
    render::render_resource::{
        BindGroup, BindingResource, Buffer, BufferBinding, BufferId, BufferSize, TextureView, TextureViewId,
    },
};
use std::sync::{Mutex, PoisonError};

/// A resource as a pass binds it.
#[derive(Clone, Copy)]
pub(crate) enum Bound<'a> {
    Buffer(&'a Buffer),
    /// Offset and size.
    Part(&'a Buffer, u64, BufferSize),
    View(&'a TextureView),
}

/// Identity of a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum BoundId {
    Buffer(BufferId, u64),
    View(TextureViewId),
}

impl<'a> Bound<'a> {
    fn id(&self) -> BoundId {
        match self {
            Self::Buffer(buffer) => BoundId::Buffer(buffer.id(), 0),
            Self::Part(buffer, offset, _) => BoundId::Buffer(buffer.id(), *offset),
            Self::View(view) => BoundId::View(view.id()),
        }
    }

    pub(crate) fn resource(self) -> BindingResource<'a> {
        match self {
            Self::Buffer(buffer) => buffer.as_entire_binding(),
            Self::Part(buffer, offset, size) => {
                BindingResource::Buffer(BufferBinding { buffer, offset, size: Some(size) })
            }
            Self::View(view) => BindingResource::TextureView(view),
        }
    }
}

/// The bind groups of a view's passes, by pass and resources.  Buffers that take turns give a pass several groups.
#[derive(Default)]
pub(crate) struct BindGroups(Mutex<HashMap<(&'static str, Vec<BoundId>), BindGroup>>);

impl BindGroups {
    /// The group of a pass with these resources.
    pub(crate) fn get(&self, pass: &'static str, bound: &[Bound], create: impl FnOnce() -> BindGroup) -> BindGroup {
        let mut groups = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        groups.entry((pass, bound.iter().map(Bound::id).collect())).or_insert_with(create).clone()
    }

    /// Drops all groups, which keep their resources alive.
    pub(super) fn clear(&mut self) {
        self.0.get_mut().unwrap_or_else(PoisonError::into_inner).clear();
    }
}
