//! Builds the triangles and the tree of a mesh in a background task.

use bevy::{
    mesh::Mesh,
    tasks::{AsyncComputeTaskPool, Task},
};

use crate::scene::{
    accel::blas::{self, Blas},
    geometry::triangulate::{self, Dropped, GeometryError},
};

/// Result of a build: the tree, if there are triangles, and the triangles that are left out.
pub(super) type Built = (Result<Option<Blas>, BuildError>, Dropped);

/// Reasons why a mesh has no tree.
pub(super) enum BuildError {
    Geometry(GeometryError),
    /// The builder panicked, with this message.
    Panic(String),
}

/// Starts a build in the background.
pub(super) fn build(mesh: Mesh) -> Task<Built> {
    AsyncComputeTaskPool::get().spawn(async move {
        catching_panics(|| match triangulate::triangles_of(&mesh) {
            Ok(geometry) => (Ok(blas::build_blas(&geometry)), geometry.dropped),
            Err(error) => (Err(BuildError::Geometry(error)), Dropped::default()),
        })
    })
}

/// Runs a build.  After a panic in it the mesh is missing, and the app goes on.
fn catching_panics(build: impl FnOnce() -> Built) -> Built {
    // Nothing reads the state of a build that panicked.
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(build)).unwrap_or_else(|payload| {
        let text = payload.downcast_ref::<&str>().map(|text| text.to_string());
        let text = text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default();
        (Err(BuildError::Panic(text)), Dropped::default())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_that_panics_gives_an_error() {
        let text = |build: fn() -> Built| match catching_panics(build) {
            (Err(BuildError::Panic(text)), _) => text,
            _ => "no panic".into(),
        };
        assert_eq!(text(|| panic!("index {} out of range", 7)), "index 7 out of range");
        assert_eq!(text(|| panic!("no tree")), "no tree");
        assert_eq!(text(|| (Ok(None), Dropped::default())), "no panic");
    }
}
