//! Rust and WGSL agree on the layout of every shared struct and on the value of every shared constant.

use crate::support::compose::{compose, composer};
use bevy_restir::testing::{
    gpu_layout::*,
    guards::GUARDS,
    shader_library::MODULES,
    shared_numbers::{COUNTERS_BINDING, GpuCopy},
};
use core::mem::{offset_of, size_of};
use naga::{Expression, Literal, ResourceBinding, TypeInner};

fn module(path: &str) -> naga::Module {
    let (_, text) = MODULES.iter().find(|(p, _)| *p == path).expect("the module is in the table");
    // Compiled as a top-level shader, because naga_oil mangles the names of imported modules.
    let text = text.replace("#define_import_path", "// ");
    compose(&mut composer(), path, &text, &[])
}

/// Offsets and size of a WGSL struct.
fn layout(module: &naga::Module, name: &str) -> (Vec<(String, usize)>, usize) {
    let (_, ty) = module
        .types
        .iter()
        .find(|(_, t)| t.name.as_deref().is_some_and(|n| n == name || n.starts_with(&format!("{name}X_naga_oil"))))
        .unwrap_or_else(|| panic!("there is no struct {name}"));
    let TypeInner::Struct { members, span } = &ty.inner else { panic!("{name} is not a struct") };
    (members.iter().map(|m| (m.name.clone().expect("members have names"), m.offset as usize)).collect(), *span as usize)
}

macro_rules! same {
    ($module:ident: $($name:ident),* $(,)?) => {
        $(
            let (_, constant) = $module.constants.iter()
                .find(|(_, c)| c.name.as_deref() == Some(stringify!($name)))
                .expect(stringify!($name));
            let value = match $module.global_expressions[constant.init] {
                Expression::Literal(Literal::U32(value)) => value,
                ref other => panic!("{} is {other:?}", stringify!($name)),
            };
            assert_eq!(value, $name, stringify!($name));
        )*
    };
}

macro_rules! agrees {
    ($module:expr, $wgsl:literal, $rust:ident { $($field:ident),* $(,)? }) => {{
        let rust = vec![$((stringify!($field).to_string(), offset_of!($rust, $field))),*];
        assert_eq!(layout(&$module, $wgsl), (rust, size_of::<$rust>()), "{}", $wgsl);
    }};
}

#[test]
fn scene_structs_are_the_same_in_rust_and_wgsl() {
    let types = module("scene/types.wgsl");
    agrees!(
        types,
        "SceneUniforms",
        GpuSceneUniforms {
            tlas_root,
            tlas_indices,
            previous_tlas_root,
            previous_tlas_indices,
            lights_end,
            instance_count,
            light_power,
            radius,
            center,
            previous_first_bin,
            shapes_root,
            shapes_indices,
            sun_count,
            environment_limit,
            previous_center,
            previous_radius,
            light_bins,
            previous_light_bins,
            first_bin,
            first_mesh_bin,
        }
    );
    agrees!(types, "Triangle", GpuTriangle { a, b, c });
    agrees!(types, "Vertex", GpuVertex { position, normal, uv, tangent });
    same!(types: NOT_GIVEN);
    agrees!(
        types,
        "Instance",
        GpuInstance {
            world_from_object,
            object_from_world,
            previous_world_from_object,
            blas_root,
            first_triangle,
            triangle_count,
            material,
            first_light,
            flags,
            layers,
            entity,
        }
    );
    agrees!(
        types,
        "Material",
        GpuMaterial {
            base_color,
            alpha,
            emissive,
            perceptual_roughness,
            dielectric_reflectance,
            metallic,
            attenuation,
            specular_transmission,
            ior,
            thickness,
            alpha_cutoff,
            flags,
            textures,
            texture_record,
            anisotropy_direction,
            anisotropy_strength,
            diffuse_transmission,
            clearcoat,
            clearcoat_perceptual_roughness,
        }
    );
    agrees!(
        types,
        "Light",
        GpuLight { position, kind, emission, pmf, direction, alias_probability, alias_index, link, data }
    );
}

#[test]
fn the_body_is_the_same_in_rust_and_wgsl() {
    let body = module("deformation/types.wgsl");
    agrees!(
        body,
        "Body",
        GpuBody {
            rest_triangle,
            triangle,
            triangle_count,
            rest_vertex,
            vertex,
            vertex_count,
            rest_node,
            node,
            first_box,
            influences,
            targets,
            levels,
            level_count,
            joints,
            joint_count,
            weights,
            weight_count,
            flags,
        }
    );
    same!(body: BODY_APPEARED);
}

#[test]
fn view_structs_are_the_same_in_rust_and_wgsl() {
    let types = module("view/types.wgsl");
    agrees!(types, "Camera", GpuCamera { clip_from_offset, world_from_view, view_from_clip, image_normal, image_area });
    agrees!(
        types,
        "ViewUniforms",
        GpuViewUniforms {
            current,
            previous,
            environment_rotation,
            previous_environment_rotation,
            environment_color,
            exposure,
            previous_environment_color,
            firefly_limit,
            background,
            debug_view,
            size,
            jitter,
            previous_jitter,
            frame,
            seed,
            bounces,
            flags,
            origin,
            accumulated,
            layers,
            target_size,
            background_alpha,
            band_rows,
            first_pixel,
        }
    );
    let counters = module("view/counter_bindings.wgsl");
    agrees!(
        counters,
        "Counters",
        GpuCounters { rays, non_finite_pixels, overflow_flags, light_vertices, splats, guards }
    );
    let bindings: Vec<_> = counters.global_variables.iter().map(|(_, variable)| variable.binding).collect();
    assert_eq!(bindings, [Some(ResourceBinding { group: 2, binding: COUNTERS_BINDING })]);
}

#[test]
fn a_copy_into_the_texture_atlas_is_the_same_in_rust_and_wgsl() {
    let atlas = module("pass/atlas.wgsl");
    agrees!(atlas, "Copy", GpuCopy { source_corner, source_size, corner, size, layer, decode, encode, pad });
}

#[test]
fn the_settings_of_the_denoiser_are_the_same_in_rust_and_wgsl() {
    let types = module("denoiser/types.wgsl");
    agrees!(types, "DenoiserSettings", GpuDenoiserSettings { step, history, has_history, pad });
}

#[test]
fn resampling_structs_are_the_same_in_rust_and_wgsl() {
    let types = module("restir/types.wgsl");
    agrees!(
        types,
        "ResampleSettings",
        GpuResampleSettings {
            candidates,
            subset_count,
            subset_size,
            light_tile_size,
            temporal_samples,
            spatial_samples,
            disocclusion_samples,
            neighbor_attempts,
            temporal_attempts,
            radius,
            confidence_cap,
            decorrelation,
            mis,
            flags,
            normal_threshold,
            depth_threshold,
            visibility_radius,
            reservoir_layout,
            iteration,
            reconnection,
            roughness,
            separation,
            jacobian_limit,
            light_paths,
            splats,
            nee_share,
            caustic_share,
            subsurface_shift,
            pair_layers,
            pair_tile_bits,
            domain,
        }
    );
    let presampled = layout(&module("light/presampled.wgsl"), "PresampledLight");
    assert_eq!(presampled.1 as u64, PRESAMPLED_LIGHT_SIZE);
    for (path, size) in [
        ("restir/di/reservoir.wgsl", DIRECT_RESERVOIR_SIZE),
        ("restir/gi/reservoir.wgsl", INDIRECT_RESERVOIR_SIZE),
        ("restir/pt/reservoir.wgsl", PATH_RESERVOIR_SIZE),
        ("restir/bdpt/reservoir.wgsl", BIDIRECTIONAL_RESERVOIR_SIZE),
        ("restir/sss/reservoir.wgsl", SUBSURFACE_RESERVOIR_SIZE),
        ("restir/splats/reservoir.wgsl", SPLAT_RESERVOIR_SIZE),
        ("restir/reconnected/reservoir.wgsl", RECONNECTED_RESERVOIR_SIZE),
    ] {
        assert_eq!(layout(&module(path), "PackedReservoir").1 as u64, size, "{path}");
    }
}

#[test]
fn resampling_constants_are_the_same_in_rust_and_wgsl() {
    let types = module("restir/types.wgsl");
    same!(
        types:
        RESAMPLE_BSDF_CANDIDATE,
        RESAMPLE_CANDIDATE_RAYS,
        RESAMPLE_TARGET_RAYS,
        RESAMPLE_DISCARD_OCCLUDED,
        RESAMPLE_MIS_RAYS,
        RESAMPLE_SHADING_RAYS,
        RESAMPLE_REUSE_VISIBILITY,
        RESAMPLE_HEURISTICS,
        RESAMPLE_SHADE_ALL,
        RESAMPLE_FROM_PREVIOUS,
        RESAMPLE_SHADE,
        RESAMPLE_CANDIDATES_VISIBLE,
        RESAMPLE_TARGET_WITHOUT_BSDF,
        RESAMPLE_BILINEAR,
        RESAMPLE_SAME_MATERIAL,
        RESAMPLE_MOVED,
        RESAMPLE_RETRACE_FORWARD,
        RESAMPLE_RETRACE_BACKWARD,
        RESAMPLE_DIFFUSE_SECONDARY,
        RESAMPLE_RECONNECT_LIGHT_PATHS,
        RESAMPLE_DUAL_MOTION,
        RESAMPLE_NO_ROULETTE,
        RESAMPLE_STILL,
        RESAMPLE_SAME_RAYS,
        RESAMPLE_SAME_DENSITIES,
        RESAMPLE_INVERT_PROBES,
        SUBSURFACE_RECONNECTION,
        SUBSURFACE_DELAYED,
        SUBSURFACE_HYBRID,
        RECONNECT_FOOTPRINTS,
        RECONNECT_BLACK_BOX,
        RECONNECT_BLACK_BOX_PRINTED,
        RECONNECT_JACOBIAN_BOUND,
        RECONNECT_PATH_FOOTPRINT,
        RECONNECT_DISTANCE,
        RECONNECT_FIRST,
        LAYOUT_ROWS,
        LAYOUT_COLUMNS,
    );
    let light_map = module("restir/bdpt/light_map.wgsl");
    same!(light_map: SPLATS_OF_A_PATH, SPLAT_WORDS);
    let light_vertex = module("restir/connection/light_vertex.wgsl");
    same!(light_vertex: VERTEX_TEXELS, VERTICES_PER_ROW);
    let mis = module("restir/mis.wgsl");
    same!(mis: MIS_UNIFORM, MIS_ONE_OVER_Z, MIS_BALANCE, MIS_PAIRWISE, MIS_DEFENSIVE_PAIRWISE, MIS_DEFENSIVE_PAIRWISE_GRIS);
}

#[test]
fn constants_are_the_same_in_rust_and_wgsl() {
    let constants = module("common/constants.wgsl");
    same!(
        constants:
        NONE,
        WORLD_TREE,
        LIGHT_TRIANGLE,
        LIGHT_POINT,
        LIGHT_SPOT,
        LIGHT_DIRECTIONAL,
        LIGHT_KIND_BITS,
        LIGHT_HIDDEN_SHIFT,
        LIGHT_SPHERE,
        LIGHT_RECT,
        LIGHT_SUN,
        LIGHT_MESH,
        INSTANCE_MIRRORED,
        INSTANCE_ALPHA,
        INSTANCE_SECOND_UV,
        INSTANCE_SUBSURFACE,
        INSTANCE_APPEARED,
        INSTANCE_GONE,
        INSTANCE_DEFORMED,
        INSTANCE_VERTEX_COLORS,
        INSTANCE_SUBSURFACE_SHIFT,
        MATERIAL_DOUBLE_SIDED,
        MATERIAL_UNLIT,
        MATERIAL_ALPHA_MASK,
        MATERIAL_ALPHA_BLEND,
        MATERIAL_FLIP_NORMAL_MAP_Y,
        MATERIAL_CULL_BACK,
        MATERIAL_CULL_FRONT,
        SLOT_BASE_COLOR,
        SLOT_METALLIC_ROUGHNESS,
        SLOT_NORMAL,
        SLOT_EMISSIVE,
        SLOT_SPECULAR_TRANSMISSION,
        SLOT_DIFFUSE_TRANSMISSION,
        SLOT_THICKNESS,
        SLOT_CLEARCOAT,
        SLOT_CLEARCOAT_ROUGHNESS,
        SLOT_CLEARCOAT_NORMAL,
        SLOT_ANISOTROPY,
        SLOT_SPECULAR,
        SLOT_SPECULAR_TINT,
        SLOT_TRANSFORM,
        VIEW_ENVIRONMENT_IS_BACKDROP,
        VIEW_ORTHOGRAPHIC,
        VIEW_NO_BACKDROP,
        VIEW_SEES_BACK_FACES,
        VIEW_JITTERED_MEAN,
        OVERFLOW_STACK,
        OVERFLOW_STEPS,
        NON_FINITE,
        OVERFLOW_PROBE,
    );
}

/// Name and value of each `u32` constant of a module.
fn constants(module: &naga::Module) -> Vec<(String, u32)> {
    let value = |init| match module.global_expressions[init] {
        Expression::Literal(Literal::U32(value)) => Some(value),
        _ => None,
    };
    module.constants.iter().filter_map(|(_, c)| Some((c.name.clone()?, value(c.init)?))).collect()
}

#[test]
fn every_guard_has_its_name_and_its_bit_in_rust_and_wgsl() {
    let of_traces = constants(&module("common/constants.wgsl"));
    let is_guard = |name: &str| name.starts_with("OVERFLOW_") || name == "NON_FINITE";
    let of_traces = of_traces.into_iter().filter(|(name, _)| is_guard(name));
    let own = constants(&module("common/guard.wgsl")).into_iter().filter(|(name, _)| name.starts_with("GUARD_"));
    let mut wgsl: Vec<(String, u32)> =
        of_traces.chain(own).map(|(name, bit)| (name.trim_start_matches("GUARD_").to_lowercase(), bit)).collect();
    wgsl.sort_by_key(|(_, bit)| *bit);
    let rust: Vec<(String, u32)> = GUARDS.iter().map(|guard| (guard.name.to_string(), guard.bit)).collect();
    assert_eq!(wgsl, rust);
    for (i, (name, bit)) in rust.iter().enumerate() {
        assert_eq!((bit.count_ones(), bit.trailing_zeros()), (1, i as u32), "{name}");
    }
}
