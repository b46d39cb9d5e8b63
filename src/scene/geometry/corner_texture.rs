//! Attributes of triangle corners that few meshes have, in a texture that exists only while a scene needs it.

use bevy::{
    asset::AssetId,
    log::warn,
    mesh::Mesh,
    platform::collections::HashSet,
    render::{
        render_resource::{TextureFormat, TextureView},
        renderer::{RenderDevice, RenderQueue},
    },
};
use bytemuck::Pod;

use crate::scene::storage::data_texture::{DataTexture, Reserved};

/// An attribute of all corners of all triangles in the shared buffers: three texels for each triangle.
pub(crate) struct CornerTexture<T> {
    label: &'static str,
    /// The value that shaders read if the triangles do not fit the device.
    otherwise: &'static str,
    texture: DataTexture<[T; 3]>,
    /// Versions of the meshes and bodies whose values are in the texture.
    versions: HashSet<u64>,
    /// The inputs of the last update: the newest version and the number of triangles.
    state: Option<(u64, u32)>,
    /// A warning has named it.
    warned: bool,
}

impl<T: Pod> CornerTexture<T> {
    pub(crate) fn new(label: &'static str, otherwise: &'static str, format: TextureFormat) -> Self {
        let texture = DataTexture::new(label, format, 3);
        Self { label, otherwise, texture, versions: HashSet::default(), state: None, warned: false }
    }

    /// Uploads the values that are missing if the scene needs the attribute; else frees their memory.  `newest`: the newest version and the
    /// number of triangles.  `sources`: version, first triangle and values of each mesh and body, empty where it lacks the attribute.
    /// Returns the number of bytes sent.
    pub(crate) fn update<'a>(
        &mut self,
        needed: bool,
        newest: (u64, u32),
        sources: impl Iterator<Item = (u64, u32, &'a [[T; 3]])>,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> u64
    where
        T: 'a,
    {
        let (_, count) = newest;
        if !needed || count > DataTexture::<[T; 3]>::limit(device) {
            if needed {
                self.warn_of_size(count);
            }
            self.state = None;
            self.texture.clear();
            self.versions.clear();
            return 0;
        }
        if self.state.replace(newest) == Some(newest) {
            return 0;
        }
        match self.texture.reserve(count, device) {
            Reserved::Kept => {}
            Reserved::Replaced => self.versions.clear(),
            // The next frame tries again: memory may have become free.
            Reserved::Failed => {
                self.state = None;
                return 0;
            }
        }
        let mut bytes = 0;
        for (version, first, values) in sources.filter(|(.., values)| !values.is_empty()) {
            if self.versions.insert(version) {
                bytes += self.texture.write(first, values, queue);
            }
        }
        bytes
    }

    /// Warns once.
    fn warn_of_size(&mut self, count: u32) {
        if !core::mem::replace(&mut self.warned, true) {
            warn!(
                "restir: the {} of {count} triangles do not fit this device; {} is used instead",
                self.label, self.otherwise
            );
        }
    }

    /// Forgets that the values of a mesh or a body are in the texture.
    pub(crate) fn forget(&mut self, version: u64) {
        self.versions.remove(&version);
    }

    pub(crate) fn view(&self) -> Option<&TextureView> {
        self.texture.view()
    }

    /// Name and size in bytes, for the report.
    pub(crate) fn memory(&self) -> (&'static str, u64) {
        self.texture.memory()
    }

    /// Number of meshes and bodies whose values are in the texture.
    #[cfg(feature = "testing")]
    pub(crate) fn len(&self) -> usize {
        self.versions.len()
    }
}

/// A body: version, first triangle and mesh.
pub(crate) type BodySource = (u64, u32, AssetId<Mesh>);
