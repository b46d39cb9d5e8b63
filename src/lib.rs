//! Lights an ordinary Bevy scene by ReSTIR (spatiotemporally resampled) path tracing, on GPUs with and without ray-tracing hardware.
//!
//! ```no_run
//! use bevy::prelude::*;
//! use bevy_restir::prelude::*;
//!
//! App::new()
//!     .add_plugins((DefaultPlugins, RestirPlugin::default()))
//!     .add_systems(Startup, setup)
//!     .run();
//!
//! fn setup(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>, mut materials: ResMut<Assets<StandardMaterial>>) {
//!     commands.spawn((Mesh3d(meshes.add(Sphere::default())), MeshMaterial3d(materials.add(Color::WHITE))));
//!     commands.spawn((PointLight::default(), Transform::from_xyz(2.0, 3.0, 2.0)));
//!     let eye = Transform::from_xyz(0.0, 1.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y);
//!     commands.spawn((Camera3d::default(), eye, Restir::default()));
//! }
//! ```
//!
//! [`Restir`] holds the settings of a camera, [`RestirEnvironment`] its environment.  Each field documents its effect, its cost and its
//! bias.  [`Restir::preset`] has settings by purpose.  If a picture is black, [`RestirStatus`] tells whether the plugin is on, and
//! [`RestirReport`] whether the scene is ready and how often histories restarted.
//!
//! Data flows one way: ECS → scene → view → frame → Bevy's view target.  `docs/architecture.md` describes the modules, and
//! `docs/sources.md` lists the works that are cited by author and year.  The folder `docs` is in the repository, not in the package.
//!
//! # Features
//!
//! - `material_textures`: textures of transmission, specular, clearcoat and anisotropy.  With it Bevy may quit on devices that bind only 16
//!   textures per stage; see `docs/limits.md`.
//! - `serde`: `Serialize` and `Deserialize` for all settings that hold no asset handles.
//! - `testing`: internals for the tests and measurements of this crate; no stability.

#![cfg_attr(not(feature = "testing"), warn(missing_docs))]
#![cfg_attr(feature = "testing", warn(unreachable_pub))]

mod budget;
mod cpu_times;
mod device;
mod frame;
#[cfg_attr(not(feature = "testing"), allow(dead_code, reason = "tests compare every constant of the shaders"))]
mod gpu_layout;
mod planted;
mod plugin;
mod report;
mod scene;
mod settings;
mod shader_library;
mod system_sets;
mod technique;
mod view;
mod warned;

pub use frame::{SPAN_PREFIX, pipelines::PipelineReport};
pub use plugin::{RestirPlugin, RestirStatus};
pub use report::{RestirReport, RestirStatistics};
pub use scene::SceneFeatures;
pub use settings::{
    Bdpt, BiasCorrection, DebugView, Denoiser, Direct, EmissiveLuminance, Jitter, LightTechniques, Mis, Paths, Preset,
    RayBackend, Reconnection, Research, ReservoirLayout, Restir, RestirBudget, RestirEnvironment, RestirExpected,
    RestirIgnore, RestirMaterial, Reuse, ReuseOrder, ShiftedMis, Subsurface, SubsurfaceSampling, SubsurfaceShift,
    SuffixRetrace, Technique, VisibilityReuse,
};
pub use system_sets::RestirSystems;
pub use technique::pass_names;
pub use view::capture::{CapturedRadiance, RadianceCapture};

/// Everything that an app needs.
pub mod prelude {
    pub use crate::{
        Bdpt, BiasCorrection, DebugView, Denoiser, Direct, EmissiveLuminance, Jitter, LightTechniques, Mis, Paths,
        Preset, RayBackend, Reconnection, Restir, RestirBudget, RestirEnvironment, RestirExpected, RestirIgnore,
        RestirMaterial, RestirPlugin, RestirStatistics, RestirStatus, Reuse, ReuseOrder, ShiftedMis, Subsurface,
        SubsurfaceSampling, SubsurfaceShift, SuffixRetrace, Technique, VisibilityReuse,
    };
}

/// Internals for the tests and measurements of this crate.
#[cfg(feature = "testing")]
#[allow(missing_docs, reason = "not part of the public interface")]
pub mod testing {
    pub use crate::{
        frame::pipelines::{
            features_read_by,
            testing::{SharedPipelines, plant_shader_defs, plant_shader_edits, replace_pass_shader, share_pipelines},
        },
        scene::{accel, check_mirror, geometry, lengths, light, material, storage},
        technique::shader_templates,
    };

    pub mod gpu_layout {
        pub use crate::gpu_layout::*;
    }

    pub mod guards {
        pub use crate::view::guards::*;
    }

    pub mod resolution {
        pub use crate::view::resolution::wanted_size;
    }

    pub mod planted {
        pub use crate::planted::{Fault, plant};
    }

    pub mod shader_library {
        pub use crate::shader_library::{MODULES, ShaderEdit, edited, instantiate, is_template};
    }

    /// Numbers that shaders share with Rust, beside those of `gpu_layout`.
    pub mod shared_numbers {
        pub use crate::{
            frame::resource::COUNTERS_BINDING,
            scene::{
                geometry::bodies::WORKGROUP as BODY_WORKGROUP,
                storage::data_texture::ELEMENTS_PER_ROW,
                texture::{
                    atlas::{Encoding, GpuCopy},
                    image_info::{
                        BINDLESS, CLAMP_U, CLAMP_V, LEVELS_SHIFT, MIRROR_U, MIRROR_V, NEAREST, SECOND_UV,
                        SHARED_EXPONENT, SRGB, TWO_COMPONENTS,
                    },
                },
            },
            technique::reuse_schedule::{FEW_INPUTS, MAX_ITERATIONS, MAX_PAIR_LAYERS},
            view::light_paths::MAX_LIGHT_PATHS,
        };

        /// Bytes of the header of the replay queue.
        pub const REPLAY_QUEUE_HEADER: u64 = crate::view::pairs::ReplayQueue::HEADER;
    }
}
