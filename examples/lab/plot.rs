//! Parts of plots, which are SVG.

use plotters::{
    coord::{
        Shift,
        ranged1d::{AsRangedCoord, Ranged, ValueFormatter},
    },
    prelude::*,
};

/// Width and height.
pub const SIZE: (u32, u32) = (960, 560);
pub const FONT: &str = "sans-serif";

pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

pub fn drawn(draw: impl FnOnce(&Area) -> Result<(), String>) -> Result<String, String> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        draw(&area)?;
        area.present().map_err(failed)?;
    }
    Ok(svg)
}

pub fn failed(error: impl core::fmt::Display) -> String {
    format!("a plot could not be drawn: {error}")
}

/// A range around values on a logarithmic scale.
pub fn around(values: impl Iterator<Item = f64>) -> Result<core::ops::Range<f64>, String> {
    let shown = values.filter(|v| v.is_finite() && *v > 0.0);
    let (low, high) = shown.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    if low > high { Err("there is nothing to plot".into()) } else { Ok(0.8 * low..1.25 * high) }
}

/// The number at a line of an axis.
fn tick(value: f64) -> String {
    let decimals = if value == 0.0 { 0 } else { (-value.abs().log10().floor()).clamp(0.0, 6.0) as usize };
    format!("{value:.decimals$}")
}

/// A chart with a logarithmic vertical axis.
pub fn chart<'a, 'b, X: AsRangedCoord<Value = f64>>(
    area: &Area<'b>,
    x: X,
    y: core::ops::Range<f64>,
    names: [&str; 2],
) -> Result<ChartContext<'a, SVGBackend<'b>, Cartesian2d<X::CoordDescType, LogCoord<f64>>>, String>
where
    X::CoordDescType: ValueFormatter<f64>,
{
    let mut builder = ChartBuilder::on(area);
    builder.margin(14).x_label_area_size(42).y_label_area_size(66);
    let mut chart = builder.build_cartesian_2d(x, y.log_scale()).map_err(failed)?;
    chart
        .configure_mesh()
        .x_desc(names[0])
        .y_desc(names[1])
        .axis_desc_style((FONT, 15))
        .label_style((FONT, 13))
        .x_label_formatter(&|x| tick(*x))
        .y_label_formatter(&|y| tick(*y))
        .light_line_style(RGBColor(240, 240, 240))
        .draw()
        .map_err(failed)?;
    Ok(chart)
}

/// The legend of a chart.
pub fn legend<'a, X: Ranged<ValueType = f64>>(
    chart: &mut ChartContext<'a, SVGBackend<'a>, Cartesian2d<X, LogCoord<f64>>>,
) -> Result<(), String> {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(RGBColor(210, 210, 210))
        .label_font((FONT, 14))
        .draw()
        .map_err(failed)
}
