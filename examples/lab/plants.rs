//! Known faults that `fuzz` and `soak` must find: a search that finds nothing proves nothing unless it can find something.

use bevy_restir::testing::{planted::Fault, shader_library::MODULES};
use bevy_restir_support::mutant;
use std::{
    collections::BTreeSet,
    process::{Command, Output, Stdio},
    time::Instant,
};

use crate::soundness::FAULT;

/// Plants faults into the renderer, one after the other, and checks that `lab fuzz` or `lab soak` finds each of them: weights that are
/// negative, too large or not a number, light that drifts, light that is lost, memory that is not freed, and slots and ranges that have two
/// owners. A fault that is not found fails. Each command runs without a fault first, and must succeed.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Plants only the faults whose names contain this text.
    #[arg(long, default_value = "", hide_default_value = true)]
    only: String,
    /// Lists the faults and plants none.
    #[arg(long)]
    list: bool,
}

/// A fault, and the command that must find it.
struct Plant {
    name: &'static str,
    place: Place,
    command: &'static str,
}

/// Where a fault is planted.
enum Place {
    /// A wrong edit of a shader: the path below `shaders/`, a text that occurs once in the file, and its replacement.
    Shader { file: &'static str, old: &'static str, new: &'static str },
    /// The library itself.
    Library(Fault),
}

const fn plant(
    name: &'static str,
    file: &'static str,
    old: &'static str,
    new: &'static str,
    command: &'static str,
) -> Plant {
    Plant { name, place: Place::Shader { file, old, new }, command }
}

const fn fault(name: &'static str, fault: Fault, command: &'static str) -> Plant {
    Plant { name, place: Place::Library(fault), command }
}

const SOAK_REFERENCE: &str = "soak --technique reference --frames 288 --size 8x6 --first";
const SOAK_DI: &str = "soak --technique di --frames 288 --size 8x6 --first";
const SOAK_PT: &str = "soak --technique pt --frames 288 --size 8x6 --first";
const SOAK_GI: &str = "soak --technique gi --frames 288 --size 8x6 --first";
const FUZZ_REFERENCE: &str = "fuzz --technique reference --count 12 --size 8x6 --first";
const FUZZ: &str = "fuzz --count 12 --size 8x6 --first";
const BIAS: &str = "fuzz --count 12 --size 8x6 --against-reference --first";

static PLANTS: [Plant; 25] = [
    // Memory, slots and ids.
    fault("buffers of reservoirs leak", Fault::ReservoirsLeak, SOAK_DI),
    fault("a freed range keeps its last element", Fault::RangeKeepsElement, SOAK_REFERENCE),
    fault("two ranges overlap by an element", Fault::RangesOverlap, SOAK_REFERENCE),
    fault("a free slot keeps its record", Fault::StaleSlot, FUZZ_REFERENCE),
    fault("a light is not remapped", Fault::LightNotRemapped, FUZZ_REFERENCE),
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
    // An error that waits for the frame counter to grow.  The number of frames is small, so that a short soak reaches it.
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
        chosen.iter().for_each(|plant| println!("{} ({}): lab {}", plant.name, plant.place, plant.command));
        return Ok(());
    }
    for command in chosen.iter().map(|plant| plant.command).collect::<BTreeSet<_>>() {
        let start = Instant::now();
        check_control(command)?;
        println!("no fault: nothing is found by lab {command}, {:.0} s", start.elapsed().as_secs_f64());
    }
    let mut missed = 0;
    for plant in chosen {
        let start = Instant::now();
        let found = plant.finding()?;
        missed += u32::from(found.is_none());
        let found = found.map_or("NOT FOUND".into(), |text| format!("found ({text})"));
        println!("{}: {found} by lab {}, {:.0} s", plant.name, plant.command, start.elapsed().as_secs_f64());
    }
    if missed > 0 { Err(format!("{missed} planted faults are not found")) } else { Ok(()) }
}

/// Runs a command of this program in a process of its own, with these variables in its environment.
fn lab(command: &str, variables: &[(&str, String)]) -> Result<Output, String> {
    let program = std::env::current_exe().map_err(|e| e.to_string())?;
    let folder = std::env::temp_dir().join(format!("bevy_restir_plants_{}", std::process::id()));
    let output = Command::new(program)
        .args(command.split_whitespace())
        .arg("--out")
        .arg(&folder)
        .envs(variables.iter().map(|(name, value)| (name, value)))
        .stdin(Stdio::null())
        .output()
        .map_err(|e| e.to_string());
    let _ = std::fs::remove_dir_all(&folder);
    output
}

/// Fails unless a command succeeds without a fault: one that fails by itself would seem to find all of them.
fn check_control(command: &str) -> Result<(), String> {
    match finding(&lab(command, &[])?) {
        None => Ok(()),
        Some(text) => {
            Err(format!("lab {command} fails without a planted fault, so it cannot show that it finds one: {text}"))
        }
    }
}

/// Why a command has failed, with the case or frame; `None` if it has succeeded.
fn finding(output: &Output) -> Option<String> {
    if output.status.success() {
        return None;
    }
    let [printed, errors] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
    let fault = printed.lines().find_map(|line| line.strip_prefix(FAULT));
    Some(fault.or(errors.trim().lines().next_back()).unwrap_or_default().into())
}

impl core::fmt::Display for Place {
    fn fmt(&self, f: &mut core::fmt::Formatter) -> core::fmt::Result {
        match self {
            Self::Shader { file, .. } => f.write_str(file),
            Self::Library(fault) => write!(f, "{fault:?}"),
        }
    }
}

impl Plant {
    /// Fails unless the text that it replaces occurs once.
    fn check_text(&self) -> Result<(), String> {
        let Place::Shader { file, old, .. } = self.place else { return Ok(()) };
        let text = MODULES.iter().find(|(path, _)| *path == file).map_or("", |(_, text)| text);
        match text.matches(old).count() {
            1 => Ok(()),
            count => Err(format!("{}: {file} has its text {count} times: {old}", self.name)),
        }
    }

    /// Runs the command with the fault, and returns what it has found.
    fn finding(&self) -> Result<Option<String>, String> {
        match self.place {
            Place::Library(fault) => Ok(finding(&lab(self.command, &[(mutant::FAULT, format!("{fault:?}"))])?)),
            Place::Shader { file, old, new } => {
                let variables = [("MUTANT_FILE", file), ("MUTANT_OLD", old), ("MUTANT_NEW", new)];
                let found = finding(&lab(self.command, &variables.map(|(name, value)| (name, value.into())))?);
                // An edit that cannot be made or compiled is not found by a check.
                match found {
                    Some(text) if text.contains("panicked") || text.contains("not ready") => {
                        Err(format!("{}: the fault could not be planted: {text}", self.name))
                    }
                    found => Ok(found),
                }
            }
        }
    }
}
