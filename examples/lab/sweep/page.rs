//! The report as a page for a browser.

use bevy_restir_support::files::write_text;
use std::{fmt::Write, path::Path};

use super::{
    Sweep,
    advice::{advice, judged},
    plots, report,
};

const STYLE: &str = "body{font:15px system-ui,sans-serif;max-width:76em;margin:2em auto;padding:0 1em;color:#222}\
table{border-collapse:collapse;font-size:13px}td,th{padding:.2em .6em;border-bottom:1px solid #ddd;text-align:right}\
td:nth-child(-n+2),th:nth-child(-n+2){text-align:left}b{color:#0a5}pre{background:#f5f5f5;padding:.7em;font-size:13px}\
figure{display:inline-block;margin:.4em;font-size:12px;max-width:22em;vertical-align:top}figure img{image-rendering:pixelated;width:22em}\
.plots svg{max-width:100%;height:auto}";

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Text in which bold marks of markdown may stand.
fn cell(text: &str) -> String {
    match text.strip_prefix("**").and_then(|t| t.strip_suffix("**")) {
        Some(bold) => format!("<b>{}</b>", escaped(bold)),
        None => escaped(text),
    }
}

fn table((head, rows): &report::Cells) -> String {
    let row = |tag: &str, cells: &[String]| {
        let cells: String = cells.iter().map(|c| format!("<{tag}>{}</{tag}>", cell(c))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let body: String = rows.iter().map(|cells| row("td", cells)).collect();
    format!("<table>\n{}{body}</table>\n", row("th", head))
}

/// Writes report.html.
pub fn write(sweep: &Sweep, folder: &Path) -> Result<(), String> {
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{0}: speed and accuracy</title><style>{STYLE}</style>\
         <h1>Speed and accuracy: {0}</h1>\n<ul>",
        escaped(&sweep.scene)
    );
    for line in &sweep.header {
        let _ = write!(page, "<li>{}</li>", escaped(line));
    }
    let _ = write!(
        page,
        "</ul>\n<h2>What to pick</h2>\n<p>Error: {}. Settings whose squared error is mostly bias are left out if there are others.</p>\n",
        sweep.by.name()
    );
    for advice in advice(sweep) {
        let _ = writeln!(
            page,
            "<p>{}: <b>{}</b> ({})</p><pre>{}</pre>",
            escaped(&advice.budget),
            escaped(&advice.pick),
            escaped(&advice.figures),
            escaped(&advice.code)
        );
    }
    let judged = judged(sweep);
    if !judged.is_empty() {
        let ([title, meaning], table) = (report::JUDGED, table(&report::judged_cells(&judged)));
        let _ = write!(page, "<h2>{title}</h2>\n<p>{}</p>\n{table}", escaped(meaning));
    }
    page += "<div class=\"plots\">";
    for (_, title, svg) in plots::all(sweep)? {
        let _ = writeln!(page, "<h2>{title}</h2>\n{svg}");
    }
    let _ = write!(
        page,
        "</div>\n<h2>All settings</h2>\n<p>{}</p>\n{}",
        report::LEGEND,
        table(&report::figures(sweep, false))
    );
    let _ = write!(page, "<h2>The first frames after a cut</h2>\n{}", table(&report::first_frames(sweep)));
    page += "<h2>Pictures</h2>\n<p>Left: the frame; right: four times its error.</p>\n\
             <figure><img src=\"pictures/reference.png\" alt=\"\" style=\"width:11em\"><figcaption>the converged picture</figcaption></figure>\n";
    for (i, measured) in sweep.all.iter().enumerate() {
        let configuration = &measured.configuration;
        let _ = writeln!(
            page,
            "<figure><img src=\"{}\" alt=\"\"><figcaption>{}. {}: {}</figcaption></figure>",
            report::picture(configuration),
            i + 1,
            escaped(configuration.section),
            escaped(&configuration.label)
        );
    }
    write_text(&folder.join("report.html"), &(page + "</html>\n"))
}
