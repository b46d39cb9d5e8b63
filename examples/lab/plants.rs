//! Known faults that `fuzz` and `soak` must find: a search that finds nothing proves nothing unless it can find something.

use bevy_restir::testing::shader_library::MODULES;
use std::{
    collections::BTreeSet,
    process::{Command, Output, Stdio},
};

/// Plants faults into the renderer, one after the other, and checks that `lab fuzz` or `lab soak` finds each of them: weights that are
/// negative, too large or not a number, light that drifts, and light that is lost. A fault that is not found fails. Each command runs without
/// a fault first, and must succeed.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Plants only the faults whose names contain this text.
    #[arg(long, default_value = "")]
    only: String,
    /// Lists the faults and plants none.
    #[arg(long)]
    list: bool,
}

/// A wrong edit of a shader, and the command that must find it.
struct Plant {
    name: &'static str,
    /// The path below `shaders/`.
    file: &'static str,
    /// A text that occurs once in the file, and its replacement.
    old: &'static str,
    new: &'static str,
    command: &'static str,
}

const fn plant(
    name: &'static str,
    file: &'static str,
    old: &'static str,
    new: &'static str,
    command: &'static str,
) -> Plant {
    Plant { name, file, old, new, command }
}

const SOAK_DI: &str = "soak --technique di --frames 288 --size 8x6";
const SOAK_PT: &str = "soak --technique pt --frames 288 --size 8x6";
const SOAK_GI: &str = "soak --technique gi --frames 288 --size 8x6";
const FUZZ: &str = "fuzz --count 12 --size 8x6";
const BIAS: &str = "fuzz --count 12 --size 8x6 --against-reference";

static PLANTS: [Plant; 20] = [
    // Numbers that must not exist.
    plant(
        "a resampling weight is negative",
        "restir/reservoir_sampling.wgsl",
        "let w = guarded(weight, GUARD_RESAMPLING_WEIGHT);",
        "let w = guarded(weight - 1.0e-3, GUARD_RESAMPLING_WEIGHT);",
        SOAK_DI,
    ),
    plant(
        "a contribution weight is negative",
        "restir/reservoir_sampling.wgsl",
        "return guarded(sum_over_target(stream.sum, selected_target), GUARD_CONTRIBUTION_WEIGHT);",
        "return guarded(-sum_over_target(stream.sum, selected_target), GUARD_CONTRIBUTION_WEIGHT);",
        SOAK_DI,
    ),
    plant(
        "a MIS weight is above 1",
        "restir/mis.wgsl",
        "let weight = guarded(unguarded_weight(inputs, kind, sample), GUARD_MIS_WEIGHT);",
        "let weight = guarded(1.0 + unguarded_weight(inputs, kind, sample), GUARD_MIS_WEIGHT);",
        SOAK_DI,
    ),
    plant(
        "a density of a direction is negative",
        "bsdf/bsdf.wgsl",
        "s.pdf = guarded(terms.pdf, GUARD_BSDF_SAMPLE);",
        "s.pdf = guarded(-terms.pdf, GUARD_BSDF_SAMPLE);",
        FUZZ,
    ),
    plant(
        "a density of a light is negative",
        "light/types.wgsl",
        "s.pdf_solid_angle = guarded(s.pdf_solid_angle, GUARD_LIGHT_SAMPLE);",
        "s.pdf_solid_angle = guarded(-s.pdf_solid_angle, GUARD_LIGHT_SAMPLE);",
        FUZZ,
    ),
    plant(
        "a density of a light is not a number",
        "light/types.wgsl",
        "s.pdf_scale = guarded(s.pdf_scale, GUARD_LIGHT_SAMPLE);",
        "s.pdf_scale = guarded(sqrt(-1.0 - s.pdf_scale), GUARD_LIGHT_SAMPLE);",
        FUZZ,
    ),
    plant(
        "a Jacobian is negative",
        "pass/reuse.wgsl",
        "guarded((*inputs).ucw[j] * jacobian, GUARD_CONTRIBUTION_WEIGHT)",
        "guarded((*inputs).ucw[j] * -jacobian, GUARD_CONTRIBUTION_WEIGHT)",
        SOAK_PT,
    ),
    plant(
        "the target of a neighbor is negative",
        "pass/reuse.wgsl",
        "known_target(inputs, j, s) / jacobian",
        "known_target(inputs, j, s) / -jacobian",
        SOAK_PT,
    ),
    plant(
        "the weight of an indirect sample is negative",
        "restir/gi/domain.wgsl",
        "m.ucw = guarded(c.ucw / m.path.density, GUARD_GI_MEASURE);",
        "m.ucw = guarded(-c.ucw / m.path.density, GUARD_GI_MEASURE);",
        SOAK_GI,
    ),
    plant(
        "a pixel is not a number after some hundred frames",
        "pass/resolve.wgsl",
        "limited(scattered_light(pixel), pixel, ids.x)",
        "limited(scattered_light(pixel), pixel, ids.x) * sqrt(200.0 - f32(view.frame))",
        SOAK_DI,
    ),
    // Light that drifts.
    plant(
        "the picture gets brighter by a thousandth a frame",
        "pass/resolve.wgsl",
        "limited(scattered_light(pixel), pixel, ids.x)",
        "limited(scattered_light(pixel), pixel, ids.x) * (1.0 + 1.0e-3 * f32(view.frame))",
        SOAK_DI,
    ),
    // Light that is wrong.
    plant(
        "the contribution weight lacks the Jacobian",
        "pass/reuse.wgsl",
        "guarded((*inputs).ucw[j] * jacobian, GUARD_CONTRIBUTION_WEIGHT)",
        "guarded((*inputs).ucw[j], GUARD_CONTRIBUTION_WEIGHT)",
        BIAS,
    ),
    plant(
        "the last input is preferred",
        "restir/reservoir_sampling.wgsl",
        "if u * (*stream).sum < w {",
        "if u * u * (*stream).sum < w {",
        BIAS,
    ),
    plant(
        "the balance heuristic has no confidence",
        "restir/mis.wgsl",
        "let share = (*inputs).confidence[i] * select",
        "let share = select",
        BIAS,
    ),
    plant(
        "pairwise weights have the canonical confidence on both sides",
        "restir/mis.wgsl",
        "var neighbor_scale = neighbor_confidence;",
        "var neighbor_scale = canonical_confidence;",
        BIAS,
    ),
    plant(
        "the share of a pair is too large",
        "restir/mis.wgsl",
        "weight = 1.0 / f32(k + 1u);",
        "weight = 1.0 / f32(k);",
        BIAS,
    ),
    plant(
        "the defensive share is missing",
        "restir/mis.wgsl",
        "sum += select(0.0, canonical_confidence / total, kind == MIS_DEFENSIVE_PAIRWISE);",
        "",
        BIAS,
    ),
    plant(
        "a pair's shift keeps the density",
        "restir/pt/domain.wgsl",
        "shifted.density = kept.a * s.path.density;",
        "shifted.density = s.path.density;",
        BIAS,
    ),
    plant(
        "both shifts of a pair are the pixel's",
        "pass/reuse.wgsl",
        "select(layers[at_pixel].y, layers[j].x, at_pixel == 0u)",
        "select(layers[at_pixel].x, layers[j].x, at_pixel == 0u)",
        BIAS,
    ),
    plant(
        "a pair ignores visibility",
        "pass/pair_shifts.wgsl",
        "target_value(e) > 0.0 && is_visible(r, e, alpha_seed_of(pixel, pair))",
        "target_value(e) > 0.0",
        BIAS,
    ),
];

impl Args {
    /// Fails if nothing is named as `--only` asks.
    pub fn check(&self) -> Result<(), String> {
        (!self.chosen().is_empty()).then_some(()).ok_or(format!("--only: no fault is named {}", self.only))
    }

    fn chosen(&self) -> Vec<&'static Plant> {
        PLANTS.iter().filter(|plant| plant.name.contains(&self.only)).collect()
    }
}

pub fn run(args: &Args) -> Result<(), String> {
    let chosen = args.chosen();
    chosen.iter().try_for_each(|plant| plant.check_text())?;
    if args.list {
        chosen.iter().for_each(|plant| println!("{} ({}): lab {}", plant.name, plant.file, plant.command));
        return Ok(());
    }
    for command in chosen.iter().map(|plant| plant.command).collect::<BTreeSet<_>>() {
        check_control(command)?;
        println!("no fault: nothing is found by lab {command}");
    }
    let mut missed = 0;
    for plant in chosen {
        let found = plant.is_found()?;
        println!("{}: {} by lab {}", plant.name, if found { "found" } else { "NOT FOUND" }, plant.command);
        missed += u32::from(!found);
    }
    if missed > 0 { Err(format!("{missed} planted faults are not found")) } else { Ok(()) }
}

/// Runs a command of this program in a process of its own, with these variables in its environment.
fn lab(command: &str, variables: &[(&str, &str)]) -> Result<Output, String> {
    let program = std::env::current_exe().map_err(|e| e.to_string())?;
    let folder = std::env::temp_dir().join(format!("bevy_restir_plants_{}", std::process::id()));
    let output = Command::new(program)
        .args(command.split_whitespace())
        .arg("--out")
        .arg(&folder)
        .envs(variables.iter().copied())
        .stdin(Stdio::null())
        .output()
        .map_err(|e| e.to_string());
    let _ = std::fs::remove_dir_all(&folder);
    output
}

/// Fails unless a command succeeds without a fault: one that fails by itself would seem to find all of them.
fn check_control(command: &str) -> Result<(), String> {
    let output = lab(command, &[])?;
    if output.status.success() {
        return Ok(());
    }
    let error = String::from_utf8_lossy(&output.stderr);
    let last = error.trim().lines().next_back().unwrap_or_default();
    Err(format!("lab {command} fails without a planted fault, so it cannot show that it finds one: {last}"))
}

impl Plant {
    /// Fails unless the text that it replaces occurs once.
    fn check_text(&self) -> Result<(), String> {
        let text = MODULES.iter().find(|(path, _)| *path == self.file).map_or("", |(_, text)| text);
        match text.matches(self.old).count() {
            1 => Ok(()),
            count => Err(format!("{}: {} has its text {count} times: {}", self.name, self.file, self.old)),
        }
    }

    /// Runs the command with the fault.
    fn is_found(&self) -> Result<bool, String> {
        let variables = [("MUTANT_FILE", self.file), ("MUTANT_OLD", self.old), ("MUTANT_NEW", self.new)];
        let output = lab(self.command, &variables)?;
        let (printed, error) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        // An edit that cannot be made or compiled is not found by a check.
        if printed.contains("panicked") || error.contains("panicked") || printed.contains("not ready") {
            return Err(format!("{}: the fault could not be planted: {}", self.name, error.trim()));
        }
        Ok(error.contains("checks of the soak fail") || error.contains("cases fail"))
    }
}
