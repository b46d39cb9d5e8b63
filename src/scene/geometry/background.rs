//! Work in the background, whose results later frames use.

use bevy::tasks::{AsyncComputeTaskPool, Task, block_on, futures::check_ready};

/// Frames between the start of a build and the use of its result, where pictures must be repeatable.
pub(super) const BUILD_FRAMES: u64 = 8;

/// A build in the background.
pub(super) struct Background<T> {
    task: Task<T>,
    /// The frame in which the result is used, where pictures must be repeatable.
    due: u64,
}

impl<T: Send + 'static> Background<T> {
    /// Starts a build.
    pub(super) fn start(due: u64, build: impl FnOnce() -> T + Send + 'static) -> Self {
        Self { task: AsyncComputeTaskPool::get().spawn(async move { build() }), due }
    }

    /// The result, once it may be used; after that, it must not be called again.
    ///
    /// With `waits`, pictures are repeatable: the frame in which the result is due waits for it, so that its use does not depend on how long the
    /// build takes.  Otherwise no frame waits, because a build may take long: pipelines compile in the same threads.  On the web, a frame that
    /// waits would never end.
    pub(super) fn take(&mut self, frame: u64, waits: bool) -> Option<T> {
        match waits {
            true if frame < self.due => None,
            true => Some(block_on(&mut self.task)),
            false => check_ready(&mut self.task),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::tasks::TaskPoolBuilder;
    use std::sync::mpsc;

    #[test]
    fn frames_wait_for_a_build_only_where_pictures_must_be_repeatable() {
        for waits in [false, true] {
            let pool = TaskPoolBuilder::new().num_threads(1).build();
            let (finish, may_finish) = mpsc::channel::<()>();
            let task = pool.spawn(async move {
                _ = may_finish.recv();
                7
            });
            let mut build = Background { task, due: BUILD_FRAMES };
            assert_eq!(build.take(0, waits), None, "it is neither due nor built");
            if !waits {
                assert_eq!(build.take(BUILD_FRAMES, waits), None, "it is being built");
            }
            finish.send(()).expect("the task waits");
            let mut built = build.take(BUILD_FRAMES, waits);
            while !waits && built.is_none() {
                std::thread::yield_now();
                built = build.take(BUILD_FRAMES, waits);
            }
            assert_eq!(built, Some(7));
        }
    }
}
