//! Tables with one column per scene, as markdown and as csv.

use std::{borrow::Cow, fmt::Write};

/// The unit of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    Count,
    /// Mean radiance, cd/m².
    Radiance,
    Ms,
    /// Mean squared error, relative to the squared mean of the reference.
    Mse,
    /// Mean squared error, each pixel's relative to the reference there.
    RelMse,
    /// Mean FLIP.
    Flip,
    RaysAPixel,
    /// Microseconds a pixel.
    UsAPixel,
    Samples,
    Ratio,
    /// A difference relative to the reference.
    Relative,
    /// The same in percent.
    Percent,
    /// A number without a unit.
    Plain,
    BytesAPixel,
    MiB,
    Bytes,
    BytesATriangle,
    /// Millions of rays a second.
    Rate,
}

impl Unit {
    fn name(self) -> &'static str {
        match self {
            Self::Count | Self::Plain => "",
            Self::Radiance => "cd/m²",
            Self::Ms => "ms",
            Self::Mse => "MSE",
            Self::RelMse => "relMSE",
            Self::Flip => "FLIP",
            Self::RaysAPixel => "rays a pixel",
            Self::UsAPixel => "µs a pixel",
            Self::Samples => "samples",
            Self::Ratio => "x",
            Self::Relative => "relative",
            Self::Percent => "%",
            Self::BytesAPixel => "bytes a pixel",
            Self::MiB => "MiB",
            Self::Bytes => "bytes",
            Self::BytesATriangle => "bytes a triangle",
            Self::Rate => "M rays/s",
        }
    }

    fn show(self, value: f64) -> String {
        match self {
            Self::Count | Self::BytesAPixel | Self::Bytes => with_decimals(value, 0),
            Self::RaysAPixel => with_decimals(value, 2),
            // Without the sign of a number that rounds to 0.
            Self::Percent => with_decimals((100.0 * value).round() / 100.0 + 0.0, 2),
            _ => digits(value),
        }
    }
}

/// Three significant digits, with at most six decimals.
pub fn digits(value: f64) -> String {
    let decimals = if value == 0.0 { 0 } else { (2 - value.abs().log10().floor() as i32).clamp(0, 6) as usize };
    with_decimals(value, decimals)
}

fn with_decimals(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}") } else { "–".into() }
}

/// The name of a figure within its row, and its unit.
pub type Quantity = (&'static str, Unit);

/// Related figures of one scene.
#[derive(Clone, Debug)]
pub struct Row {
    pub section: Cow<'static, str>,
    pub label: String,
    pub quantities: Vec<Quantity>,
    pub values: Vec<f64>,
}

impl Row {
    pub fn new(
        section: impl Into<Cow<'static, str>>,
        label: impl Into<String>,
        figures: &[(&'static str, Unit, f64)],
    ) -> Self {
        Self {
            section: section.into(),
            label: label.into(),
            quantities: figures.iter().map(|&(name, unit, _)| (name, unit)).collect(),
            values: figures.iter().map(|f| f.2).collect(),
        }
    }

    /// Names and units of the figures.
    fn units(&self) -> String {
        let join = |of: &dyn Fn(&Quantity) -> String| self.quantities.iter().map(of).collect::<Vec<_>>().join(" / ");
        let unit = self.quantities.first().map_or("", |q| q.1.name());
        if self.quantities.iter().all(|q| q.1.name() == unit && !q.0.is_empty()) {
            return format!("{}: {unit}", join(&|q| q.0.into()));
        }
        let all = join(&|q| format!("{} {}", q.0, q.1.name()).trim().into());
        // Figures without names and units.
        all.trim_matches([' ', '/']).into()
    }
}

/// A table with the origin of its figures.
#[derive(Default)]
pub struct Table {
    /// The command, the adapter, the commit and so on.
    pub header: Vec<String>,
    /// Names and rows of the columns. A row that a column lacks is empty there.
    pub columns: Vec<(String, Vec<Row>)>,
    /// Lines below the table.
    pub notes: Vec<String>,
}

impl Table {
    /// All rows, each with its cells in the columns. Scenes may have different passes, so that rows are matched by their names.
    fn rows(&self) -> Vec<(&Row, Vec<Option<&Row>>)> {
        let name = |row: &Row| (row.section.clone(), row.label.clone());
        let mut rows: Vec<&Row> = Vec::new();
        for (_, column) in &self.columns {
            let mut at = 0;
            for row in column {
                match rows.iter().position(|known| name(known) == name(row)) {
                    Some(place) => at = place + 1,
                    // After the row that it follows in its own column.
                    None => {
                        rows.insert(at, row);
                        at += 1;
                    }
                }
            }
        }
        let cell = |column: &'_ [Row], row: &Row| column.iter().position(|own| name(own) == name(row));
        rows.into_iter()
            .map(|row| (row, self.columns.iter().map(|(_, column)| Some(&column[cell(column, row)?])).collect()))
            .collect()
    }

    pub fn markdown(&self) -> String {
        let mut text = String::new();
        for line in &self.header {
            let _ = writeln!(text, "- {line}");
        }
        let names: Vec<&str> = self.columns.iter().map(|c| c.0.as_str()).collect();
        let _ = writeln!(text, "\n| | | {} |", names.join(" | "));
        let _ = writeln!(text, "|---|---|{}", "---:|".repeat(names.len()));
        let mut section = "";
        for (row, cells) in self.rows() {
            if row.section != section {
                section = &*row.section;
                let _ = writeln!(text, "| **{section}** | |{}", " |".repeat(names.len()));
            }
            let cells: Vec<String> = cells
                .iter()
                .map(|cell| {
                    let shown = cell.iter().flat_map(|cell| cell.quantities.iter().zip(&cell.values));
                    shown.map(|(q, v)| q.1.show(*v)).collect::<Vec<_>>().join(" / ")
                })
                .collect();
            let _ = writeln!(text, "| {} | {} | {} |", row.label, row.units(), cells.join(" | "));
        }
        for note in &self.notes {
            let _ = writeln!(text, "\n{note}");
        }
        text
    }

    /// One line per figure, in full precision; a figure that is not finite is empty.
    pub fn csv(&self) -> String {
        let mut text = String::new();
        for line in self.header.iter().chain(&self.notes) {
            let _ = writeln!(text, "# {line}");
        }
        let mut head: Vec<String> = ["section", "row", "quantity", "unit"].map(String::from).into();
        head.extend(self.columns.iter().map(|c| c.0.clone()));
        text += &csv_line(&head);
        for (row, cells) in self.rows() {
            for (i, (name, unit)) in row.quantities.iter().enumerate() {
                let mut fields =
                    vec![row.section.clone().into_owned(), row.label.clone(), (*name).into(), unit.name().into()];
                fields.extend(cells.iter().map(|cell| {
                    let value = cell.and_then(|cell| cell.values.get(i)).filter(|value| value.is_finite());
                    value.map(f64::to_string).unwrap_or_default()
                }));
                text += &csv_line(&fields);
            }
        }
        text
    }
}

/// A line of csv.
pub fn csv_line(fields: &[impl AsRef<str>]) -> String {
    fields.iter().map(|field| quoted(field.as_ref())).collect::<Vec<_>>().join(",") + "\n"
}

fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field.into() }
}
