//! Upper estimates of the rays of passes.  Where a pass may trace many, it runs over bands of the picture one after another.

use super::{
    domain::{Domain, LightPart},
    frame::Step,
    pass::{Pass, Rays},
    reuse_schedule::ReuseSchedule,
};
use crate::settings::Restir;

/// Rays of an optical image (`MAX_SURFACES` in `shaders/pass/denoiser_images.wgsl`).
const RAYS_OF_IMAGE: u32 = 6;
/// Rays of the candidates of direct light.  On a surface: those of the BSDF candidate and of the selected one; below it: a probe, and the ray
/// to the selected light.
const RAYS_OF_DIRECT_CANDIDATES: u32 = 2;
/// Rays of a shift of light that enters an object: two probes, and the ray to the light.
const RAYS_OF_SUBSURFACE_SHIFT: u32 = 3;

/// Rays that a step traces for each pixel, by an upper estimate: no path ends early, every neighbor is similar, and every shift replays its
/// path.  A ray through surfaces with alpha counts as one, and probes within paths do not count.
pub(crate) fn rays_of_pixel(step: &Step, settings: &Restir) -> u64 {
    let Pass::Compute(pass) = step.pass else { return 0 };
    let of_domain = |rays: &dyn Fn(&Domain, ReuseSchedule) -> u32| {
        step.domain.map_or(0, |domain| rays(domain, (domain.schedule)(settings)))
    };
    // At each event, the path goes on and looks for a light.
    let of_path = 2 * settings.bounces;
    u64::from(match pass.rays {
        Rays::None => 0,
        Rays::Path => of_path,
        Rays::Candidates => of_domain(&|domain, _| match domain.part {
            LightPart::Direct | LightPart::Subsurface => RAYS_OF_DIRECT_CANDIDATES,
            LightPart::Paths if settings.connects_light_paths() => of_path + settings.bounces,
            LightPart::Paths => of_path,
            LightPart::Splats => 0,
            // Each event of the light sub-path, and the ray from the camera.
            LightPart::Reconnected => settings.bounces + 1,
        }),
        // The last ray is that of the selected sample, which some settings test alone.
        Rays::Shifts => {
            of_domain(&|domain, schedule| schedule.max_searched_shifts() * rays_of_shift(domain, settings) + 1)
        }
        Rays::PairShifts => of_domain(&|domain, schedule| schedule.pair_layers() * rays_of_shift(domain, settings)),
        Rays::ShortPairShifts => of_domain(&|_, schedule| schedule.pair_layers()),
        Rays::LightPaths => settings.bdpt.light_paths.ceil() as u32 * of_path,
        Rays::Shift => of_domain(&|domain, _| rays_of_shift(domain, settings)),
        Rays::Images => RAYS_OF_IMAGE,
    })
}

/// Rays of a shift.
fn rays_of_shift(domain: &Domain, settings: &Restir) -> u32 {
    match domain.part {
        LightPart::Direct => 1,
        LightPart::Subsurface => RAYS_OF_SUBSURFACE_SHIFT,
        // Those between its vertices, and the one to the light.
        LightPart::Paths | LightPart::Splats => settings.bounces + 1,
        // Those of the light sub-path, the one from the camera, and the one between the two.
        LightPart::Reconnected => settings.bounces + 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        scene::SceneFeatures,
        settings::Technique,
        shader_library::MODULES,
        technique::{frame::Frame, pass::Dispatch},
    };

    fn steps(settings: &Restir) -> Vec<Step> {
        steps_in(settings, SceneFeatures::SUBSURFACE | SceneFeatures::SMOOTH)
    }

    fn steps_in(settings: &Restir, scene: SceneFeatures) -> Vec<Step> {
        let iterations = |domain: &Domain| (domain.schedule)(settings).iteration_kinds();
        Frame::of(settings).of_scene(scene).steps(iterations)
    }

    #[test]
    fn passes_that_trace_rays_can_run_over_bands() {
        for technique in Technique::ALL {
            for step in steps(&Restir { technique, ..Restir::default() }) {
                let Pass::Compute(pass) = step.pass else { continue };
                let path = format!("pass/{}.wgsl", pass.file);
                let (_, text) = MODULES.iter().find(|(module, _)| *module == path).expect("a pass has a module");
                let has_bands = text.contains("view.first_pixel");
                assert!(has_bands || pass.rays == Rays::None, "{}", pass.name);
                assert!(pass.dispatch != Dispatch::Subsets || pass.rays == Rays::None, "{}", pass.name);
                // Every pass that counts rays traces some.
                let is_paired = pass.defs.contains(&"PAIRED");
                let counts = text.contains("count_rays(") || text.contains("add_rays(");
                assert!(!counts || has_bands && (is_paired || pass.rays != Rays::None), "{}", pass.name);
            }
        }
    }

    #[test]
    fn optical_images_have_as_many_rays_as_the_shader_traces() {
        let (_, text) = MODULES.iter().find(|(path, _)| *path == "pass/denoiser_images.wgsl").expect("a module");
        assert!(text.contains(&format!("const MAX_SURFACES: u32 = {RAYS_OF_IMAGE}u;")));
    }

    /// The documents state how many submissions such frames take.
    #[test]
    fn a_default_frame_is_estimated() {
        let settings = Restir::default();
        let steps = steps_in(&settings, SceneFeatures::SMOOTH);
        assert_eq!(steps.iter().map(|step| rays_of_pixel(step, &settings)).sum::<u64>(), 110);
    }

    #[test]
    fn estimates_follow_the_settings() {
        let rays = |name: &str, settings: &Restir| {
            let step = steps(settings).into_iter().find(|step| step.name == name).expect("the step exists");
            rays_of_pixel(&step, settings)
        };
        let with = |technique, bounces| Restir { technique, bounces, ..Restir::default() };
        assert_eq!(rays("reference", &with(Technique::Reference, 8)), 16);
        assert_eq!(rays("pt_indirect_candidates", &with(Technique::Pt, 8)), 16);
        assert_eq!(rays("bdpt_candidates", &with(Technique::Bdpt, 8)), 24);
        assert_eq!(rays("light_paths", &with(Technique::Bdpt, 3)), 6);
        // One temporal neighbor, there and back; then six shifts of pairs.
        assert_eq!(rays("pt_indirect_reuse", &with(Technique::Pt, 8)), 2 * 9 + 1);
        assert_eq!(rays("pt_indirect_pair_shifts_2", &with(Technique::Pt, 8)), 6);
        assert_eq!(rays("pt_indirect_pair_replays_2", &with(Technique::Pt, 8)), 6 * 9);
        assert_eq!(rays("denoiser_input", &with(Technique::Pt, 8)), 0);
    }
}
