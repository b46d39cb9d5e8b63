//! The tables and the advice of a sweep, as markdown and as csv.

use bevy_restir_support::{
    files::write_text,
    front::{at_time, front},
};
use std::{fmt::Write, path::Path};

use super::{
    Entry, Sweep,
    advice::{Judged, advice, judged},
    measure::Record,
    plan,
    plan::Configuration,
    plots,
};
use crate::table::{csv_line, digits};

/// A table: its head and its rows.
pub type Cells = (Vec<String>, Vec<Vec<String>>);

/// The picture file of a configuration, below the folder of the report.
pub fn picture(configuration: &Configuration) -> String {
    format!("pictures/{}.png", configuration.id())
}

/// The bias and its standard error.
pub fn bias(record: &Record) -> String {
    format!("{:+.1} % ± {:.1}", 100.0 * record.bias, 100.0 * record.bias_error)
}

/// Figures of all configurations, or of the presets.
pub fn figures(sweep: &Sweep, presets_only: bool) -> Cells {
    let head = [
        "",
        "",
        "ms",
        "rays a pixel",
        "MiB",
        sweep.by.name(),
        "FLIP",
        "against the reference tracer",
        "bias",
        "bias of blocks",
        "variance",
        "flicker",
        "error in motion",
        "flicker in motion",
    ];
    let curve = sweep.reference_curve();
    let points: Vec<_> = sweep.all.iter().map(|m| m.point(sweep.by)).collect();
    let competitors: Vec<usize> = (0..points.len()).filter(|&i| !sweep.all[i].is_reference()).collect();
    let of_competitors: Vec<_> = competitors.iter().map(|&i| points[i]).collect();
    let on_front: Vec<usize> = front(&of_competitors).into_iter().map(|i| competitors[i]).collect();
    let row = |(i, m): (usize, &Entry)| {
        let Entry { configuration, record } = m;
        let is_wanted = !presets_only || configuration.is_of_presets();
        is_wanted.then(|| {
            let errors = m.errors();
            let error = sweep.by.of(&errors);
            let ratio = at_time(&curve, record.lighting()).map_or(f64::NAN, |reference| reference / error);
            let moving = |of: &dyn Fn(&super::measure::Moving) -> f64| {
                record.moving.as_ref().map_or("–".into(), |m| digits(of(m)))
            };
            let mark = if on_front.contains(&i) { "**" } else { "" };
            let frame = |value: f64| if m.is_reference() { "–".into() } else { digits(value) };
            vec![
                (i + 1).to_string(),
                format!("{mark}{}{mark}", name(configuration)),
                digits(record.lighting()),
                digits(record.rays_a_pixel),
                digits(record.bytes as f64 / f64::from(1 << 20)),
                digits(error),
                digits(errors.flip),
                if m.is_reference() { "–".into() } else { format!("{} x", digits(ratio)) },
                bias(record),
                digits(record.block_bias),
                frame(record.variance),
                frame(record.flicker),
                moving(&|m| sweep.by.of(&m.errors)),
                moving(&|m| m.flicker),
            ]
        })
    };
    (head.map(String::from).into(), sweep.all.iter().enumerate().filter_map(row).collect())
}

/// The section and the label; those of presets and of the reference tracer need no section.
pub fn name(configuration: &Configuration) -> String {
    match configuration.section {
        plan::PRESETS => configuration.label.clone(),
        plan::REFERENCE => format!("Reference tracer, one sample, bounces of {}", configuration.label),
        section => format!("{}: {}", section.split(',').next().unwrap_or(section), configuration.label),
    }
}

/// Errors of the first frames after a cut.
pub fn first_frames(sweep: &Sweep) -> Cells {
    let shown = |m: &&Entry| m.configuration.section == plan::PRESETS;
    let numbers = sweep.all.first().map_or(&[][..], |m| &m.record.frames);
    let head = core::iter::once(String::new()).chain(numbers.iter().map(|(n, _)| format!("frame {n}")));
    let row = |m: &Entry| {
        let errors = m.record.frames.iter().map(|(_, errors)| digits(sweep.by.of(errors)));
        core::iter::once(name(&m.configuration)).chain(errors).collect()
    };
    (head.collect(), sweep.all.iter().filter(shown).map(row).collect())
}

/// Meaning of the columns.
pub const LEGEND: &str = "Bold rows: no other row is faster and has less error; differences below 2 % do not count. Times are of still \
    frames without jitter. Frames in motion take longer, because temporal reuse of paths then evaluates a sample twice and traces rays. Without \
    jitter Bdpt is at a disadvantage: what the camera sees of light paths is averaged over a pixel, and all other light, also that of \
    the converged picture, is that of the pixel's center. Rows with fewer traced pixels are compared after a plain interpolation, which blurs edges \
    more than what the plugin shows. \"Against the reference tracer\": its error at equal \
    time, relative to the row's. Bias: relative difference of the mean, with its standard error; bias of blocks: root mean square over \
    blocks of 8 x 8 pixels, where noise hides anything smaller. The noise of a converged picture that the sweep rendered is part of the \
    standard error, but not of the bias of blocks; the noise of a picture that the user gave is not known. Variance: between runs. \
    Flicker: mean squared change of the error from a frame to the next. Bias of blocks, variance and flicker are relative to the \
    reference as relMSE is. In motion: the camera moves sideways by 0.4 % of the median depth in a frame.";

fn markdown_table((head, rows): &Cells) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = line(head) + "|" + &"---|".repeat(head.len()) + "\n";
    rows.iter().for_each(|row| text += &line(row));
    text
}

fn advice_text(sweep: &Sweep) -> String {
    let mut text = format!(
        "Time, error ({}) and bias of the recommended settings. Settings without bounced light count only where there are no others, and so do \
         those whose squared error is mostly bias.\n\n",
        sweep.by.name()
    );
    let rows = advice(sweep).into_iter().map(|a| vec![a.budget, a.pick, a.figures]).collect();
    text += &markdown_table(&(["budget", "pick", "time, error and bias"].map(String::from).into(), rows));
    text
}

/// The title and the meaning of [`judged_cells`].
pub const JUDGED: [&str; 2] = [
    "The advice of the first report against all settings",
    "What a sweep without --full recommends, beside the best of all measured settings within the same budget. The ratio is that of their \
     times where the error is limited, and that of their errors where the time is.",
];

/// The advice of the first report beside the best of all settings.
pub fn judged_cells(all: &[Judged]) -> Cells {
    let head = ["budget", "pick", "best", "ratio"];
    let row = |j: &Judged| vec![j.budget.clone(), j.pick.clone(), j.best.clone(), digits(j.ratio)];
    (head.map(String::from).into(), all.iter().map(row).collect())
}

/// The advice and the presets, for documents.
pub fn short(sweep: &Sweep) -> String {
    let mut text: String = sweep.header.iter().map(|line| format!("- {line}\n")).collect();
    let _ = write!(text, "\n{}\n{}", advice_text(sweep), markdown_table(&figures(sweep, true)));
    text
}

/// Writes report.md and the csv files.
pub fn write(sweep: &Sweep, folder: &Path) -> Result<(), String> {
    let mut text = format!("# Speed and accuracy: {}\n\n", sweep.scene);
    sweep.header.iter().for_each(|line| text += &format!("- {line}\n"));
    let _ = write!(text, "\n## What to pick\n\n{}\n", advice_text(sweep));
    for advice in advice(sweep) {
        let _ = write!(text, "{}:\n\n```rust\n{}```\n\n", advice.budget, advice.code);
    }
    let judged = judged(sweep);
    if !judged.is_empty() {
        let [title, meaning] = JUDGED;
        let _ = write!(text, "## {title}\n\n{meaning}\n\n{}\n", markdown_table(&judged_cells(&judged)));
        judged_csv(sweep, &judged, &folder.join("advice.csv"))?;
    }
    let _ = write!(text, "## All settings\n\n{LEGEND}\n\n{}\n", markdown_table(&figures(sweep, false)));
    let _ = write!(text, "## The first frames after a cut\n\n{}\n", markdown_table(&first_frames(sweep)));
    for (file, title, svg) in plots::all(sweep)? {
        write_text(&folder.join(file), &svg)?;
        let _ = write!(text, "## {title}\n\n![{title}]({file})\n\n");
    }
    write_text(&folder.join("report.md"), &text)?;
    results(sweep, &folder.join("results.csv"))?;
    frames(sweep, &folder.join("frames.csv"))?;
    passes(sweep, &folder.join("passes.csv"))
}

/// Writes rows of text as csv, below the lines of the header as comments.
fn csv(sweep: &Sweep, path: &Path, head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> Result<(), String> {
    let comments = sweep.header.iter().map(|line| format!("# {line}\n"));
    let lines = comments.chain([csv_line(head)]).chain(rows.map(|row| csv_line(&row)));
    write_text(path, &lines.collect::<String>())
}

/// One line for each budget.
fn judged_csv(sweep: &Sweep, all: &[Judged], path: &Path) -> Result<(), String> {
    let rows = all.iter().map(|j| vec![j.budget.clone(), j.pick.clone(), j.best.clone(), j.ratio.to_string()]);
    csv(sweep, path, &["budget", "pick", "best", "ratio"], rows)
}

fn start(m: &Entry) -> Vec<String> {
    vec![m.configuration.section.into(), m.configuration.label.clone()]
}

/// One line for each configuration.
fn results(sweep: &Sweep, path: &Path) -> Result<(), String> {
    let head = [
        "section",
        "label",
        "technique",
        "preset",
        "changes",
        "ms",
        "rays a pixel",
        "reservoir bytes a pixel",
        "bytes",
        "MSE",
        "relMSE",
        "relMSE trimmed",
        "MAPE",
        "FLIP",
        "black",
        "bias",
        "bias error",
        "block bias",
        "variance",
        "flicker",
        "relMSE trimmed moving",
        "FLIP moving",
        "flicker moving",
    ];
    let rows = sweep.all.iter().map(|m| {
        let (Record { moving, .. }, e, c) = (&m.record, m.errors(), &m.configuration);
        let mut row = start(m);
        row.extend([format!("{:?}", c.technique), format!("{:?}", c.preset), c.changes.join(" ")]);
        let r = &m.record;
        let numbers = [
            r.lighting(),
            r.rays_a_pixel,
            r.reservoir_bytes_a_pixel as f64,
            r.bytes as f64,
            e.mse,
            e.rel_mse,
            e.rel_mse_trimmed,
            e.mape,
            e.flip,
            e.black,
            r.bias,
            r.bias_error,
            r.block_bias,
            r.variance,
            r.flicker,
            moving.map_or(f64::NAN, |m| m.errors.rel_mse_trimmed),
            moving.map_or(f64::NAN, |m| m.errors.flip),
            moving.map_or(f64::NAN, |m| m.flicker),
        ];
        row.extend(numbers.map(|x| if x.is_finite() { x.to_string() } else { String::new() }));
        row
    });
    csv(sweep, path, &head, rows)
}

/// One line for each captured frame of each configuration.
fn frames(sweep: &Sweep, path: &Path) -> Result<(), String> {
    let head = ["section", "label", "frame", "MSE", "relMSE", "relMSE trimmed", "MAPE", "FLIP", "black"];
    let rows = sweep.all.iter().flat_map(|m| {
        m.record.frames.iter().map(|(n, e)| {
            let numbers = [e.mse, e.rel_mse, e.rel_mse_trimmed, e.mape, e.flip, e.black].map(|x| x.to_string());
            start(m).into_iter().chain([n.to_string()]).chain(numbers).collect()
        })
    });
    csv(sweep, path, &head, rows)
}

/// One line for each lighting pass of each configuration.
fn passes(sweep: &Sweep, path: &Path) -> Result<(), String> {
    let rows = sweep.all.iter().flat_map(|m| {
        m.record.passes.iter().map(|(name, ms)| start(m).into_iter().chain([name.clone(), ms.to_string()]).collect())
    });
    csv(sweep, path, &["section", "label", "pass", "ms"], rows)
}
