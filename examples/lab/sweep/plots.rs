//! The plots of a sweep, as SVG.

use bevy_restir::Technique;
use bevy_restir_support::front::{Point, front};
use plotters::prelude::*;

use super::{Entry, Sweep, plan};
use crate::plot::{Area, FONT, SIZE, around, chart, drawn, failed, legend};

/// File names, titles and pictures.
pub fn all(sweep: &Sweep) -> Result<Vec<(&'static str, &'static str, String)>, String> {
    Ok(vec![
        (
            "error-over-time.svg",
            "Error over time (pale: presets with a change; numbers: rows of the table)",
            drawn(|area| error_over_time(sweep, area))?,
        ),
        (
            "error-over-frames.svg",
            "Error over frames after a cut, presets Balanced",
            drawn(|area| error_over_frames(sweep, area))?,
        ),
        ("cost-by-pass.svg", "Cost by pass", drawn(|area| cost_by_pass(sweep, area))?),
    ])
}

/// The color of a technique.
fn color(technique: Technique) -> RGBColor {
    match technique {
        Technique::Reference => RGBColor(110, 110, 110),
        Technique::Di => RGBColor(0, 114, 178),
        Technique::Gi => RGBColor(0, 158, 115),
        Technique::Pt => RGBColor(213, 94, 0),
        Technique::Bdpt => RGBColor(160, 60, 160),
        // `Technique` is not exhaustive: a new one is black until it has a color here.
        _ => RGBColor(0, 0, 0),
    }
}

/// Every configuration, the front, and the reference tracer with more and more samples.
fn error_over_time(sweep: &Sweep, area: &Area) -> Result<(), String> {
    let competitors: Vec<&Entry> = sweep.competitors().collect();
    let points: Vec<Point> = competitors.iter().map(|m| m.point(sweep.by)).collect();
    let curve = sweep.reference_curve();
    let every = || points.iter().chain(&curve);
    let (x, y) = (around(every().map(|p| p.time))?, around(every().map(|p| p.error))?);
    let mut chart = chart(area, x.log_scale(), y, ["ms a frame", sweep.by.name()])?;

    let gray = color(Technique::Reference);
    let line = LineSeries::new(curve.iter().map(|p| (p.time, p.error)), gray.stroke_width(2)).point_size(3);
    chart
        .draw_series(line)
        .map_err(failed)?
        .label("reference tracer: 1, 2, 3, 5, 9 ... samples")
        .legend(move |(x, y)| Circle::new((x + 8, y), 5, gray.filled()));
    let mut techniques: Vec<Technique> = Vec::new();
    competitors.iter().map(|m| m.configuration.technique).for_each(|t| {
        if !techniques.contains(&t) {
            techniques.push(t);
        }
    });
    for technique in techniques {
        let color = color(technique);
        let of = competitors.iter().zip(&points).filter(|(m, _)| m.configuration.technique == technique);
        let circle = |(m, p): (&&Entry, &Point)| {
            let is_preset = m.configuration.section == plan::PRESETS;
            let style = if is_preset { color.filled() } else { color.mix(0.35).filled() };
            Circle::new((p.time, p.error), if is_preset { 6 } else { 4 }, style)
        };
        chart
            .draw_series(of.map(circle))
            .map_err(failed)?
            .label(format!("ReSTIR {}: presets", format!("{technique:?}").to_uppercase()))
            .legend(move |(x, y)| Circle::new((x + 8, y), 5, color.filled()));
    }
    let on_front = front(&points);
    let steps = on_front.iter().map(|&i| (points[i].time, points[i].error));
    chart
        .draw_series(LineSeries::new(steps, BLACK.mix(0.6).stroke_width(1)))
        .map_err(failed)?
        .label("Pareto front")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 16, y)], BLACK.mix(0.6)));
    let first = sweep.all.len() - competitors.len();
    let number = |&i: &usize| {
        Text::new((first + i + 1).to_string(), (1.03 * points[i].time, points[i].error), (FONT, 14).into_font())
    };
    chart.draw_series(on_front.iter().map(number)).map_err(failed)?;
    legend(&mut chart)
}

/// The presets of all techniques in the first frames.
fn error_over_frames(sweep: &Sweep, area: &Area) -> Result<(), String> {
    let shown: Vec<&Entry> = sweep
        .all
        .iter()
        .filter(|m| [plan::PRESETS, plan::REFERENCE].contains(&m.configuration.section))
        .filter(|m| m.configuration.label.contains("Balanced"))
        .collect();
    let errors = |m: &Entry| -> Vec<(f64, f64)> {
        m.record.frames.iter().map(|(n, e)| (f64::from(n + 1), sweep.by.of(e))).collect()
    };
    let every = || shown.iter().flat_map(|m| errors(m));
    let (x, y) = (around(every().map(|e| e.0))?, around(every().map(|e| e.1))?);
    let mut chart = chart(area, x.log_scale(), y, ["frames since the cut", sweep.by.name()])?;
    for m in shown {
        let color = color(m.configuration.technique);
        let name = match m.is_reference() {
            true => "reference tracer, the mean of all frames".into(),
            false => format!("ReSTIR {}", format!("{:?}", m.configuration.technique).to_uppercase()),
        };
        chart
            .draw_series(LineSeries::new(errors(m), color.stroke_width(2)).point_size(4))
            .map_err(failed)?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
    }
    legend(&mut chart)
}

/// The stage of a frame that a pass belongs to: the index of its name in [`STAGES`].
fn stage(pass: &str) -> usize {
    match pass {
        "presample" => 0,
        "light_paths" => 4,
        _ if pass.starts_with("splats") || pass.starts_with("reconnected") => 5,
        _ if pass.ends_with("_candidates") => 1,
        _ if pass.ends_with("_reuse") => 2,
        _ if pass.contains("_reuse_") || pass.contains("_pair_") => 3,
        _ => 6,
    }
}

const STAGES: [(&str, RGBColor); 7] = [
    ("light subsets", RGBColor(150, 150, 150)),
    ("candidates", RGBColor(0, 114, 178)),
    ("reuse over time", RGBColor(230, 159, 0)),
    ("reuse over pixels", RGBColor(213, 94, 0)),
    ("light paths", RGBColor(0, 158, 115)),
    ("light paths on the screen", RGBColor(120, 200, 170)),
    ("other", RGBColor(200, 200, 200)),
];

/// One bar for each preset of each technique, divided by passes.
fn cost_by_pass(sweep: &Sweep, area: &Area) -> Result<(), String> {
    const LEFT: f64 = 150.0;
    const RIGHT: f64 = 690.0;
    let shown: Vec<&Entry> = sweep.all.iter().filter(|m| m.configuration.section == plan::PRESETS).collect();
    let scale = (RIGHT - LEFT) / shown.iter().map(|m| m.record.lighting()).fold(f64::MIN_POSITIVE, f64::max);
    let height = (f64::from(SIZE.1) - 30.0) / shown.len().max(1) as f64;
    let text = |text: String, at: (i32, i32)| area.draw(&Text::new(text, at, (FONT, 13).into_font())).map_err(failed);
    let bar = |corners, color: RGBColor| area.draw(&Rectangle::new(corners, color.filled())).map_err(failed);
    for (i, m) in shown.iter().enumerate() {
        let top = 15.0 + height * i as f64;
        let middle = (top + 0.3 * height) as i32;
        text(m.configuration.label.clone(), (14, middle))?;
        let mut left = LEFT;
        for (pass, ms) in &m.record.passes {
            let right = left + ms * scale;
            // A pixel between the bars keeps passes of one stage apart.
            bar([(left as i32 + 1, top as i32), (right as i32, (top + 0.8 * height) as i32)], STAGES[stage(pass)].1)?;
            left = right;
        }
        text(format!("{:.1} ms", m.record.lighting()), (left as i32 + 6, middle))?;
    }
    for (k, (name, color)) in STAGES.into_iter().enumerate() {
        let top = 18 + 20 * k as i32;
        bar([(778, top), (790, top + 12)], color)?;
        text(name.into(), (796, top))?;
    }
    Ok(())
}
