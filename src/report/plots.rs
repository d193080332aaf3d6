//! Plots as SVG, as text.

use crate::words::number;
use plotters::coord::Shift;
use plotters::prelude::*;

/// Width and height of a plot that stands beside another one, and of one that fills the page.
const HALF: (u32, u32) = (460, 260);
const WHOLE: (u32, u32) = (900, 320);
/// Colours that are told apart by those who see few: of Okabe and Ito.
const BLUE: RGBColor = RGBColor(0, 114, 178);
const ORANGE: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 158, 115);
/// Lines of the grid.
const GRID: RGBColor = RGBColor(200, 200, 200);
const INK: RGBColor = RGBColor(0, 0, 0);
/// The most points of a line: more are joined to means.
const POINTS: usize = 1000;

/// What the axes of a plot mean, with units.
pub struct Axes<'a> {
    pub x: &'a str,
    pub y: &'a str,
}

/// A line with its name; points that are missing leave a gap.
pub struct Line<'a> {
    pub name: &'a str,
    pub points: Vec<(f64, Option<f64>)>,
}

type Failed = DrawingAreaErrorKind<std::io::Error>;
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Draws into a new SVG. What fails is drawn as far as it went: a text in memory cannot be refused.
fn svg(size: (u32, u32), draw: impl FnOnce(&Area) -> Result<(), Failed>) -> String {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        // writing to a string cannot fail, and ranges have been made sound
        let _ = draw(&area);
        let _ = area.present();
    }
    // a size of its own would keep the page from fitting it
    let sized = format!("<svg width=\"{}\" height=\"{}\" ", size.0, size.1);
    text.replacen(&sized, "<svg ", 1)
}

/// A range that is not empty, for an axis.
fn range(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in values.filter(|v| v.is_finite()) {
        (low, high) = (low.min(v), high.max(v));
    }
    match low < high {
        true => low..high,
        false if low.is_finite() && low != 0.0 => low - 0.5 * low.abs()..low + 0.5 * low.abs(),
        false => 0.0..1.0,
    }
}

/// The same with some room above, and from 0 on.
fn from_zero(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let high = values.filter(|v| v.is_finite()).fold(0.0, f64::max);
    0.0..if high > 0.0 { 1.06 * high } else { 1.0 }
}

/// The same with some room below, and above for a legend.
fn with_room(y: std::ops::Range<f64>) -> std::ops::Range<f64> {
    let length = y.end - y.start;
    y.start - 0.05 * length..y.end + 0.15 * length
}

/// Bars of equal width between two ends.
pub fn bars(ends: [f64; 2], heights: &[f64], axes: &Axes) -> String {
    let width = (ends[1] - ends[0]) / heights.len().max(1) as f64;
    let x = range(ends.into_iter());
    let y = from_zero(heights.iter().copied());
    svg(HALF, |area| {
        let mut chart = chart(area, x, y.clone(), axes)?;
        let bars = heights.iter().enumerate().filter(|(_, h)| **h > 0.0);
        chart.draw_series(bars.map(|(i, &height)| {
            let left = ends[0] + i as f64 * width;
            let right = if width > 0.0 {
                left + width
            } else {
                left + 1e-3
            };
            Rectangle::new([(left, 0.0), (right, height)], BLUE.mix(0.8).filled())
        }))?;
        Ok(())
    })
}

/// Lines, with a legend if there are several.
pub fn lines<'a>(lines: &[Line<'a>], axes: &Axes) -> String {
    let short = |line: &Line<'a>| Line {
        name: line.name,
        points: thinned(&line.points),
    };
    let lines: Vec<Line> = lines.iter().map(short).collect();
    let all = || lines.iter().flat_map(|line| &line.points);
    let x = range(all().map(|p| p.0));
    let y = with_room(range(all().filter_map(|p| p.1)));
    svg(WHOLE, |area| {
        let mut chart = chart(area, x, y, axes)?;
        for (line, colour) in lines.iter().zip([BLUE, ORANGE, GREEN]) {
            let mut named = false;
            for run in line.points.split(|p| p.1.is_none()) {
                let run = run.iter().filter_map(|&(x, y)| Some((x, y?)));
                let series = LineSeries::new(run, colour.stroke_width(2));
                let drawn = chart.draw_series(series)?;
                if !named {
                    drawn.label(line.name).legend(move |(x, y)| {
                        PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2))
                    });
                    named = true;
                }
            }
        }
        if lines.len() > 1 {
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .label_font(("sans-serif", 14).into_font().color(&INK))
                .draw()?;
        }
        Ok(())
    })
}

/// Means with their standard deviations over a logarithmic axis, and a line of single values.
pub struct Growing<'a> {
    /// Size, mean, standard deviation.
    pub means: &'a [(f64, f64, Option<f64>)],
    /// Size and value.
    pub single: &'a [(f64, f64)],
}

/// Draws means that become sharper with size.
pub fn growing(data: &Growing, axes: &Axes) -> String {
    let sizes = || data.means.iter().map(|m| m.0);
    let x = range(sizes());
    let ends = |m: &(f64, f64, Option<f64>)| {
        let sd = m.2.unwrap_or(0.0);
        [m.1 - sd, m.1 + sd]
    };
    let values = data.means.iter().flat_map(ends);
    let y = with_room(range(values.chain(data.single.iter().map(|s| s.1))));
    svg(WHOLE, |area| {
        let low = x.start.max(1e-300);
        let mut chart = ChartBuilder::on(area);
        let mut chart = chart
            .margin(8)
            .x_label_area_size(46)
            .y_label_area_size(66)
            .build_cartesian_2d((low..x.end.max(low * 1.001)).log_scale(), y.clone())?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID)
            .x_desc(axes.x)
            .y_desc(axes.y)
            .x_label_formatter(&|v| number(*v, 3))
            .y_label_formatter(&|v| tick(*v, &y))
            .label_style(("sans-serif", 14).into_font().color(&INK))
            .draw()?;
        for mean in data.means {
            let [low, high] = ends(mean);
            chart.draw_series([PathElement::new(
                [(mean.0, low), (mean.0, high)],
                BLUE.stroke_width(2),
            )])?;
        }
        let means = data.means.iter().map(|m| (m.0, m.1));
        chart
            .draw_series(means.map(|at| Circle::new(at, 4, BLUE.filled())))?
            .label("boxes side by side")
            .legend(|(x, y)| Circle::new((x + 9, y), 4, BLUE.filled()));
        let line = LineSeries::new(data.single.iter().copied(), ORANGE.stroke_width(2));
        chart
            .draw_series(line)?
            .label("the box in the middle")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], ORANGE.stroke_width(2)));
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .label_font(("sans-serif", 14).into_font().color(&INK))
            .draw()
    })
}

/// A tick's number; what is left of a tick at 0 is 0.
fn tick(v: f64, range: &std::ops::Range<f64>) -> String {
    let left = v.abs() < 1e-9 * (range.end - range.start);
    number(if left { 0.0 } else { v }, 3)
}

type Chart<'a> = ChartContext<
    'a,
    SVGBackend<'a>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

/// Axes with round ticks and a light grid.
fn chart<'a>(
    area: &Area<'a>,
    x: std::ops::Range<f64>,
    y: std::ops::Range<f64>,
    axes: &Axes,
) -> Result<Chart<'a>, Failed> {
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .x_label_area_size(46)
        .y_label_area_size(66)
        .build_cartesian_2d(x.clone(), y.clone())?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID)
        .x_desc(axes.x)
        .y_desc(axes.y)
        .x_label_formatter(&|v| tick(*v, &x))
        .y_label_formatter(&|v| tick(*v, &y))
        .label_style(("sans-serif", 14).into_font().color(&INK))
        .draw()?;
    Ok(chart)
}

/// A line of at most [`POINTS`]: means of as many neighbours each.
fn thinned(points: &[(f64, Option<f64>)]) -> Vec<(f64, Option<f64>)> {
    let each = points.len().div_ceil(POINTS).max(1);
    points
        .chunks(each)
        .map(|some| {
            let x = some.iter().map(|p| p.0).sum::<f64>() / some.len() as f64;
            let known: Vec<f64> = some.iter().filter_map(|p| p.1).collect();
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            (x, (!known.is_empty()).then_some(mean))
        })
        .collect()
}
