//! The passes of light sub-paths alone: camera paths are left out, so that the picture is the light of light sub-paths.

use super::{
    light_reuse::{corner, pose_corner_at},
    shifts::leave_out,
};
use crate::support::{app::*, reuse_settings::paths, small_scenes::*};
use LightTechniques::*;
use bevy::{math::DVec3, prelude::*};
use bevy_restir::{
    Bdpt, DebugView, Jitter, LightTechniques, Restir, Subsurface, Technique,
    testing::{plant_shader_defs, replace_pass_shader, shader_library::ShaderEdit},
};

/// A rig without camera paths.  Light sub-paths have no competitors: each technique of theirs has the weight 1.
fn without_camera_paths(make: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = scene(32, make)?;
    leave_out(&mut rig, &[("bdpt_candidates", "path_candidates"), ("bdpt_reuse", "reuse")]);
    plant_shader_defs(&mut rig.app, &["TEST_SPLATS", "TEST_ALONE"]);
    let bdpt = Bdpt { light_paths: 8.0, ..default() };
    let (technique, jitter, paths) = (Technique::Bdpt, Jitter::Always, paths::temporal());
    rig.set(|r| *r = Restir { technique, bdpt, paths, jitter, bounces: 1, ..plain() });
    Some(rig)
}

/// A wall that fills the picture, a blue lamp and a red one, which the camera does not see.
fn two_lamps(rig: &mut Rig) {
    rig.spawn(square(8.0), lambert(0.8), Transform::from_xyz(0.0, 0.0, -1.2));
    for (name, x, glow) in [("blue", -1.9, lamp(0.0, 0.0, 8.0)), ("red", 1.9, lamp(8.0, 0.0, 0.0))] {
        let lamp = rig.spawn(square(0.5), glow, facing(Vec3::new(x, 0.3, 1.0), Vec3::new(0.0, 0.0, -1.2)));
        rig.insert(lamp, Name::new(name));
    }
}

fn show_red_lamp(rig: &mut Rig, there: bool) {
    let red = rig.named("red");
    *rig.get_mut::<Visibility>(red) = if there { Visibility::Inherited } else { Visibility::Hidden };
}

fn mean_color(picture: &Picture) -> DVec3 {
    picture.iter().map(|(_, color)| color.as_dvec3()).sum::<DVec3>() / picture.pixels.len() as f64
}

/// Splats of a pixel have different MIS weights in the frame in which a lamp appears, because only one of them exists in the last frame.
/// The color of all splats with the weight of one of them would have half as much blue again.
#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_have_their_own_colors_in_the_frame_in_which_a_lamp_appears() {
    let Some(mut rig) = without_camera_paths(two_lamps) else { return };
    // Both lamps are loaded before the first frame that counts.
    rig.until_ready();
    let colors: Vec<DVec3> = (0..40)
        .map(|seed| {
            show_red_lamp(&mut rig, false);
            rig.set(|r| (r.seed, r.accumulate) = (seed, false));
            rig.frames(4);
            show_red_lamp(&mut rig, true);
            mean_color(&rig.next())
        })
        .collect();
    rig.assert_sound();
    rig.set(|r| (r.technique, r.accumulate) = (Technique::Reference, true));
    let truth = mean_color(&rig.picture(128));
    for (channel, name) in [(0, "red"), (2, "blue")] {
        let (mean, error) = mean_and_error(colors.iter().map(|color| color[channel] / truth[channel]));
        eprintln!("{name}: {mean:.4} +- {error:.4} of the reference");
        assert!(error < 0.02 && (mean - 1.0).abs() < 4.0 * error + 0.01, "{name}: {mean} +- {error}");
    }
}

/// Without light tracing, reservoirs of splats count frames without a sample.  Kept, they would darken the frames after that.
#[test]
#[ignore = "second tier: ./run test --more"]
fn histories_of_light_paths_begin_with_the_technique_that_fills_them() {
    let Some(mut rig) = without_camera_paths(two_lamps) else { return };
    rig.set(|r| r.debug_view = DebugView::LightPathConfidence);
    for techniques in [Full, NoLightTracing] {
        rig.set(|r| r.bdpt.techniques = techniques);
        rig.until_ready();
        rig.frames(6);
    }
    rig.set(|r| r.bdpt.techniques = Full);
    for frame in [1.0, 2.0, 3.0] {
        let confidence = rig.next();
        assert!(confidence.iter().all(|(_, c)| c.x == frame), "frame {frame}: {:?}", confidence.center());
    }
}

/// Edits that make a share of the light negative, one in each pass of light sub-paths.
const NEGATIVE: [ShaderEdit; 4] = [
    ShaderEdit {
        module: "light/emission.wgsl",
        from: "    var ray = emitted_ray(light, u_point, u_direction, previous);\n",
        to: "    var ray = emitted_ray(light, u_point, u_direction, previous);\n    ray.power *= select(1.0, -1.0, u_point.x < 0.1);\n",
    },
    ShaderEdit {
        module: "path/light_path.wgsl",
        from: "    w.by_delta = b.delta != 0u;\n",
        to: "    w.by_delta = b.delta != 0u;\n    w.throughput *= select(1.0, -1.0, u < 0.1);\n",
    },
    ShaderEdit {
        module: "restir/bdpt/splat.wgsl",
        from: "    let cosine = abs(dot(s.bsdf.n_geo, wo));\n",
        to: "    let cosine = abs(dot(s.bsdf.n_geo, wo)) * select(1.0, -1.0, (alpha_seed & 7u) == 0u);\n",
    },
    ShaderEdit {
        module: "pass/splats_forward.wgsl",
        from: "        let splat = replayed_splat(r.path, r.frame, light, r.events, false);\n",
        to: "        var splat = replayed_splat(r.path, r.frame, light, r.events, false);\n        splat.value *= select(1.0, -1.0, (pixel.x & 7u) == 0u);\n",
    },
];

/// A wrong number that is dropped without a report would hide an error.
#[test]
#[ignore = "second tier: ./run test --more"]
fn negative_light_of_light_paths_raises_a_guard_wherever_it_arises() {
    let Some(mut rig) = without_camera_paths(|rig| corner(rig, false)) else { return };
    plant_edits(&mut rig.app, &NEGATIVE);
    rig.set(|r| r.bounces = 3);
    rig.until_ready();
    rig.reset_guards();
    for step in 0..=STEPS {
        pose_corner_at(&mut rig, step as f32);
        assert!(rig.next().is_finite());
    }
    rig.assert_raised(&["light_sample", "light_contribution", "throughput", "shift_contribution"]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn negative_light_of_connections_raises_a_guard() {
    let Some(mut rig) = scene(32, |rig| corner(rig, false)) else { return };
    leave_out(&mut rig, &[("bdpt_reuse", "reuse")]);
    let bdpt = Bdpt { techniques: NoLightTracing, ..default() };
    rig.set(|r| {
        *r = Restir { technique: Technique::Bdpt, bdpt, paths: paths::candidates_only(), bounces: 3, ..plain() };
    });
    rig.until_ready();
    rig.next();
    rig.assert_sound();
    let negative = ShaderEdit {
        module: "restir/connection/connection.wgsl",
        from: "    let cosine = abs(dot(lit.bsdf.n_geo, k.wi));\n",
        to: "    let cosine = abs(dot(lit.bsdf.n_geo, k.wi)) * select(1.0, -1.0, (path.seed & 7u) == 0u);\n",
    };
    plant_edits(&mut rig.app, &[negative]);
    rig.until_ready();
    rig.reset_guards();
    assert!(rig.next().is_finite());
    rig.assert_raised(&["light_contribution"]);
}

/// Light sub-paths and weights look at surfaces from the side that a sub-path leaves to.  Light scatters below the front side only, so that
/// the shares of all lobes of the two sides differ.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_surface_that_is_turned_is_the_surface_seen_from_its_other_side() {
    let Some(mut rig) = scene(32, |rig| {
        let leaf = StandardMaterial {
            diffuse_transmission: 0.4,
            specular_transmission: 0.3,
            thickness: 0.5,
            clearcoat: 0.5,
            ..lambert(0.8)
        };
        let ball = rig.spawn(Sphere::new(1.2).mesh().ico(12).expect("few triangles"), leaf, Transform::default());
        rig.insert(ball, Subsurface { mean_free_path: Vec3::splat(0.1), weight: 0.7 });
    }) else {
        return;
    };
    replace_pass_shader(&mut rig.app, "reference", include_str!("../../support/kernels/surface_sides.wgsl"));
    let picture = rig.picture(1);
    let seen: Vec<Vec3> = picture.iter().map(|(_, c)| c).filter(|c| c.y > 0.0).collect();
    assert!(seen.len() > 300, "{} pixels", seen.len());
    for c in seen {
        assert!(c.x < 1e-5 && (c.y - 0.7).abs() < 1e-5 && c.z == 0.0, "{c}");
    }
}
