//! Uniforms of a view (`shaders/view/bindings.wgsl`) and its sub-pixel jitter.

use bevy::{
    math::{Mat3, Mat4, Vec2, Vec4},
    render::{
        camera::{ExtractedCamera, TemporalJitter},
        renderer::{RenderDevice, RenderQueue},
        view::ExtractedView,
    },
};

use super::{
    RestirView,
    environment::EnvironmentPool,
    extract::{ExtractedEnvironment, ExtractedRestir},
    image_state::ImageState,
};
use crate::{
    gpu_layout::*,
    scene::{bindings::SceneBindings, extract::lights::MAX_LIGHT},
    settings::{DebugView, Restir},
};

/// Sub-pixel offset of a frame, uniform in the pixel: the R2 sequence (Roberts 2018) in 32-bit fixed point, shifted by the seed.
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
        // 24 bits convert to f32 exactly, so the offset never rounds up to +0.5.
        (bits >> 8) as f32 / (1u32 << 24) as f32 - 0.5
    })
}

/// The camera of a view.  Its transform may have a scale.
pub(super) fn camera_of(view: &ExtractedView) -> GpuCamera {
    let world_from_view = view.world_from_view.to_matrix();
    let view_from_clip = view.clip_from_view.inverse();
    let [x, y, z] = [world_from_view.x_axis, world_from_view.y_axis, world_from_view.z_axis].map(Vec4::truncate);
    let across = x.cross(y);
    let normal = across.normalize_or_zero();
    // The plane at z = -1 in view space is this far away.
    let distance = if is_orthographic(&view.clip_from_view) { 1.0 } else { z.dot(normal) };
    let in_view = (4.0 * view_from_clip.x_axis.x * view_from_clip.y_axis.y).abs();
    GpuCamera {
        clip_from_offset: (view.clip_from_view * Mat4::from_mat3(Mat3::from_mat4(world_from_view).inverse()))
            .to_cols_array_2d(),
        world_from_view: world_from_view.to_cols_array_2d(),
        view_from_clip: view_from_clip.to_cols_array_2d(),
        image_normal: normal.to_array(),
        image_area: in_view * across.length() / (distance * distance),
    }
}

/// Whether rays of a camera see back faces in place of front faces: inverted culling, a mirrored transform and a mirrored projection exchange
/// them.
fn sees_back_faces(view: &ExtractedView) -> bool {
    let [x, y] = [view.clip_from_view.x_axis, view.clip_from_view.y_axis];
    let is_mirrored = view.world_from_view.to_matrix().determinant() < 0.0;
    let mirrors = x.x * y.y - x.y * y.x < 0.0;
    view.invert_culling ^ is_mirrored ^ mirrors
}

/// Whether all numbers of a camera are finite.
pub(super) fn is_finite(camera: &GpuCamera) -> bool {
    let GpuCamera { clip_from_offset, world_from_view, view_from_clip, image_normal: _, image_area } = camera;
    let mut matrices = [clip_from_offset, world_from_view, view_from_clip].into_iter().flatten().flatten();
    matrices.all(|x| x.is_finite()) && *image_area > 0.0 && image_area.is_finite()
}

/// The firefly limit of this frame; 0: none.  Means of frames do not use it, because its bias would stay in the mean.  Debug views do not
/// use it, because the parts of the light must add up.
fn firefly_limit(settings: &Restir) -> f32 {
    let is_limited = !settings.accumulate && settings.debug_view == DebugView::Off;
    if is_limited { settings.firefly_limit } else { 0.0 }
}

/// Inputs of a view's uniforms from the rest of the frame.
pub(super) struct UniformInputs<'a> {
    pub restir: &'a ExtractedRestir,
    pub camera: &'a ExtractedCamera,
    pub view: &'a ExtractedView,
    /// The camera that `view` describes.
    pub current: GpuCamera,
    pub bevy_jitter: Option<&'a TemporalJitter>,
    pub scene: &'a SceneBindings,
    pub environments: &'a EnvironmentPool,
    /// Rays of a dispatch where the settings leave it to the device.
    pub rays_per_dispatch: u32,
}

impl UniformInputs<'_> {
    fn exposure(&self) -> f32 {
        let exposure = self.camera.exposure;
        if exposure > 0.0 && exposure.is_finite() { exposure } else { 1.0 }
    }

    /// Radiance of the clear color: the exposure turns it into the color again.
    fn background(&self) -> [f32; 3] {
        (self.restir.background / self.exposure()).to_array().map(|c| if c > 0.0 { c.min(MAX_LIGHT) } else { 0.0 })
    }

    fn sees_environment(&self) -> bool {
        self.restir.environment.is_some_and(|e| self.environments.is_seen(&e))
    }

    /// Whether pixels without a surface show what lies behind the image: the picture of an earlier camera, or that behind a window.
    fn shows_earlier(&self) -> bool {
        !self.sees_environment() && (!self.restir.has_backdrop || self.restir.background_alpha < 1.0)
    }

    fn is_orthographic(&self) -> bool {
        is_orthographic(&self.view.clip_from_view)
    }

    fn flags(&self) -> u32 {
        let mut flags = 0;
        if self.sees_environment() {
            flags |= VIEW_ENVIRONMENT_IS_BACKDROP;
        } else if !self.restir.has_backdrop {
            flags |= VIEW_NO_BACKDROP;
        }
        if self.is_orthographic() {
            flags |= VIEW_ORTHOGRAPHIC;
        }
        if sees_back_faces(self.view) {
            flags |= VIEW_SEES_BACK_FACES;
        }
        flags
    }
}

impl RestirView {
    /// Writes the uniforms of this frame, after advancing or restarting the frame counters in them.
    pub(super) fn update_uniforms(&mut self, inputs: &UniformInputs, device: &RenderDevice, queue: &RenderQueue) {
        let UniformInputs { restir, current, .. } = *inputs;
        self.advance(self.new_image_state(inputs), &restir.settings);
        let offset = self.next_jitter(inputs);
        let jitter = offset.unwrap_or_default();
        let is_jittered_mean = offset.is_some() && self.accumulated > 0;
        let environment = placement_of(restir.environment);
        // If the image has changed, the old environment is a light that is gone, and the new one is a light that was dark, because the old
        // image may be lost.
        let mut previous_environment = self.previous_environment.unwrap_or(environment);
        if !self.same_environment_image {
            previous_environment.color = [0.0; 3];
        }
        let uniforms = GpuViewUniforms {
            current,
            previous: self.previous_camera.unwrap_or(current),
            environment_rotation: environment.rotation,
            previous_environment_rotation: previous_environment.rotation,
            environment_color: environment.color,
            previous_environment_color: previous_environment.color,
            firefly_limit: firefly_limit(&restir.settings),
            exposure: if restir.settings.debug_view.shows_light() {
                inputs.exposure()
            } else {
                restir.settings.debug_scale
            },
            background: inputs.background(),
            debug_view: restir.settings.debug_view as u32,
            size: self.size.to_array(),
            jitter,
            previous_jitter: self.previous_jitter,
            frame: self.sequence,
            seed: restir.settings.seed,
            bounces: restir.settings.bounces,
            flags: inputs.flags() | if is_jittered_mean { VIEW_JITTERED_MEAN } else { 0 },
            origin: self.origin.to_array(),
            accumulated: self.accumulated,
            layers: restir.layers,
            target_size: self.target_size.to_array(),
            background_alpha: restir.background_alpha,
            band_rows: self.size.y,
            first_pixel: [0; 2],
        };
        queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&uniforms));
        self.update_bands(&uniforms, inputs.rays_per_dispatch, device, queue);
        self.previous_camera = Some(current);
        self.previous_environment = Some(environment);
        self.has_last_jitter = jitter == self.previous_jitter;
        self.previous_jitter = jitter;
    }

    fn new_image_state(&self, inputs: &UniformInputs) -> ImageState {
        let restir = inputs.restir;
        ImageState {
            motion_revision: inputs.scene.motion_revision,
            edit_revision: inputs.scene.edit_revision,
            environment_revision: inputs.environments.revision(restir.environment.as_ref()),
            camera: inputs.current,
            size: self.size,
            // `reset` and `accumulate` leave the light of an image as it is, and `debug_scale` applies to the accumulated result.  A budget
            // changes numbers of samples, which leave the light as it is, too, and the traced resolution, which `size` shows.
            settings: Restir { reset: false, accumulate: false, debug_scale: 1.0, ..restir.asked.clone() },
            environment: restir.environment,
            layers: restir.layers,
            // The backdrop depends on the exposure.  A camera that shows an environment instead keeps its mean when the exposure changes.
            background: if inputs.sees_environment() { [0.0; 3] } else { inputs.background() },
            shows_earlier: inputs.shows_earlier(),
            sees_back_faces: sees_back_faces(inputs.view),
            orthographic: inputs.is_orthographic(),
            pipelines: self.key.unwrap_or_default(),
        }
    }

    /// Sub-pixel offset of this frame: Bevy's, so that temporal antialiasing and upscalers know it, or else our own sequence.  `None` if frames
    /// are not jittered.
    fn next_jitter(&mut self, inputs: &UniformInputs) -> Option<[f32; 2]> {
        let settings = &inputs.restir.settings;
        let offset = inputs.bevy_jitter.map_or(Vec2::ZERO, |jitter| jitter.offset);
        let is_zero = offset == Vec2::ZERO;
        self.frames_without_bevy_jitter = if is_zero { self.frames_without_bevy_jitter.saturating_add(1) } else { 0 };
        // One offset 0 is part of Bevy's sequence.  Several in a row mean that temporal antialiasing was removed: its component stays.
        if self.frames_without_bevy_jitter <= 1 {
            return Some((offset * self.size.as_vec2() / self.target_size.as_vec2()).to_array());
        }
        settings.jitters(inputs.shows_earlier()).then(|| jitter_of(self.sequence, settings.seed))
    }
}

/// Rotation and color of an environment.
#[derive(Clone, Copy, Debug)]
pub(super) struct EnvironmentPlacement {
    /// Columns of the rotation from world to environment, padded.
    rotation: [[f32; 4]; 3],
    color: [f32; 3],
}

fn placement_of(environment: Option<ExtractedEnvironment>) -> EnvironmentPlacement {
    let rotation = environment.map_or(Mat3::IDENTITY, |e| e.rotation);
    EnvironmentPlacement {
        rotation: [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|c| c.extend(0.0).to_array()),
        color: environment.map_or([0.0; 3], |e| e.color.to_array()),
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
        // 100 per cell are expected.  A low-discrepancy sequence is far more even than independent random numbers.
        assert!(bins.iter().flatten().all(|&n| (90..=110).contains(&n)), "{bins:?}");
    }

    #[test]
    fn seeds_shift_the_jitter() {
        assert_ne!(jitter_of(0, 0), jitter_of(0, 1));
    }
}
