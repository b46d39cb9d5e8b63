//! The uniforms of a view, its sub-pixel jitter, and whether its history still holds.

use bevy::{
    math::{Mat4, Vec3},
    render::{
        camera::{ExtractedCamera, TemporalJitter},
        renderer::RenderQueue,
        view::ExtractedView,
    },
};

use super::{RestirView, Shown, environment::EnvironmentPool, extract::ExtractedRestir};
use crate::{
    gpu_layout::*,
    scene::bindings::SceneBindings,
    settings::{DebugView, Restir},
};

/// Sub-pixel position of a frame, uniform in the pixel: the R2 sequence (Roberts 2018) in 32-bit fixed point, shifted by the seed.
pub(crate) fn jitter_of(frame: u32, seed: u32) -> [f32; 2] {
    let mix = |x: u32| {
        let x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
        let x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
        x ^ (x >> 16)
    };
    let shift = [mix(seed.wrapping_mul(2).wrapping_add(1)), mix(seed.wrapping_mul(2).wrapping_add(2))];
    let step = [3_242_174_889u32, 2_447_445_414];
    core::array::from_fn(|i| {
        let bits = shift[i].wrapping_add(frame.wrapping_mul(step[i]));
        // 24 bits, so that +0.5 is never reached.
        (bits >> 8) as f32 / (1u32 << 24) as f32 - 0.5
    })
}

impl RestirView {
    #[expect(clippy::too_many_arguments, reason = "one call site; each is a resource of the caller's system")]
    pub(super) fn update_uniforms(
        &mut self,
        restir: &ExtractedRestir,
        camera: &ExtractedCamera,
        view: &ExtractedView,
        bevy_jitter: Option<&TemporalJitter>,
        scene: &SceneBindings,
        environments: &EnvironmentPool,
        queue: &RenderQueue,
    ) {
        let world_from_view = view.world_from_view.to_matrix();
        let clip_from_view = view.clip_from_view;
        let current = GpuCamera {
            clip_from_world: (clip_from_view * world_from_view.inverse()).to_cols_array_2d(),
            world_from_view: world_from_view.to_cols_array_2d(),
            view_from_clip: clip_from_view.inverse().to_cols_array_2d(),
        };
        let exposure = if camera.exposure > 0.0 && camera.exposure.is_finite() { camera.exposure } else { 1.0 };
        let background = (restir.background / exposure).max(Vec3::ZERO).to_array();

        // What is shown decides whether frames may be summed.
        let shown = Shown {
            motion: scene.motion_revision,
            edits: scene.edit_revision,
            environment_revision: environments.revision(restir.environment.as_ref()),
            camera: current,
            size: self.size,
            // Gathering frames changes none of them, and what debug views are scaled by is no value of theirs.
            settings: Restir { reset: false, accumulate: false, debug_scale: 1.0, ..restir.settings.clone() },
            environment: restir.environment,
            layers: restir.layers,
            background,
            // Shaders know one kind of projection for this frame and the last.
            orthographic: is_orthographic(&clip_from_view),
            pipelines: self.key.unwrap_or_default(),
        };
        // A picture that is summed must stay the same; a history must only know what it sees: things and cameras may move, and no path
        // knows the backdrop.
        let progressive = self.key.is_none_or(|key| key.frame.domains().is_empty());
        let last = self.shown.as_ref().filter(|_| !restir.settings.reset);
        let same = last.is_some_and(|last| *last == shown);
        let known = last.is_some_and(|last| {
            Shown { motion: shown.motion, camera: shown.camera, background, ..last.clone() } == shown
        });
        let keep = if progressive { same } else { known };
        self.moved = last.is_some_and(|last| last.motion != shown.motion);
        self.frame = if keep { self.frame.saturating_add(1) } else { 0 };
        // What changes in the scene takes the history, not the luck: noise that stands still would be seen, and averaged by nobody.
        let goes_on = last.is_some_and(|last| last.settings == shown.settings && last.pipelines == shown.pipelines);
        self.sequence = if goes_on { self.sequence.wrapping_add(1) } else { 0 };
        let sums = progressive || restir.settings.accumulate;
        self.accumulated = if same && sums && self.summed { self.accumulated.saturating_add(1) } else { 0 };
        self.summed = sums;
        self.shown = Some(shown);

        let jitter = match bevy_jitter {
            Some(j) => (j.offset * self.size.as_vec2() / self.target_size.as_vec2()).to_array(),
            None if restir.settings.jitter => jitter_of(self.sequence, restir.settings.seed),
            None => [0.0; 2],
        };

        let rotation = restir.environment.map_or(bevy::math::Mat3::IDENTITY, |e| e.rotation);
        let mut flags = 0;
        if restir.environment.is_some_and(|e| e.is_backdrop()) {
            flags |= VIEW_ENVIRONMENT_IS_BACKDROP;
        }
        if restir.environment.is_none() && !restir.has_backdrop {
            flags |= VIEW_NO_BACKDROP;
        }
        if is_orthographic(&clip_from_view) {
            flags |= VIEW_ORTHOGRAPHIC;
        }
        let uniforms = GpuViewUniforms {
            current,
            previous: self.previous_camera.unwrap_or(current),
            environment_rotation: [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|c| c.extend(0.0).to_array()),
            environment_color: restir.environment.map_or([0.0; 3], |e| e.color.to_array()),
            exposure: match restir.settings.debug_view {
                DebugView::Off => exposure,
                _ => restir.settings.debug_scale,
            },
            background,
            debug_view: restir.settings.debug_view as u32,
            size: self.size.to_array(),
            jitter,
            previous_jitter: self.previous_jitter,
            frame: self.sequence,
            seed: restir.settings.seed,
            bounces: restir.settings.bounces,
            flags,
            origin: self.origin.to_array(),
            accumulated: self.accumulated,
            layers: restir.layers,
            target_size: self.target_size.to_array(),
        };
        queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&uniforms));
        self.previous_camera = Some(current);
        self.previous_jitter = jitter;
    }
}

fn is_orthographic(clip_from_view: &Mat4) -> bool {
    clip_from_view.w_axis.w == 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jitter_is_uniform_in_the_pixel() {
        let mut bins = [[0u32; 8]; 8];
        for frame in 0..6400 {
            let [x, y] = jitter_of(frame, 7);
            assert!((-0.5..0.5).contains(&x) && (-0.5..0.5).contains(&y));
            bins[((y + 0.5) * 8.0) as usize][((x + 0.5) * 8.0) as usize] += 1;
        }
        // A low-discrepancy sequence is far more even than chance: 100 a cell.
        assert!(bins.iter().flatten().all(|&n| (90..=110).contains(&n)), "{bins:?}");
    }

    #[test]
    fn seeds_shift_the_jitter() {
        assert_ne!(jitter_of(0, 0), jitter_of(0, 1));
    }
}
