//! Plots with their captions.

use super::super::plots::{Axes, Growing, Line, bars, growing, lines};
use super::super::{Report, Walls};
use super::{SPREAD, rows, spread_row, unit};
use crate::picture::printed_unit;
use crate::structure::{AxisProfile, Profile};
use crate::words::{count, measure, percent};
use maud::{Markup, PreEscaped, html};

/// A plot with what it shows.
fn figure(svg: String, caption: &str) -> Markup {
    html! {
        figure role="img" aria-label=(caption) {
            (PreEscaped(svg))
            figcaption { (caption) }
        }
    }
}

/// Distributions of diameters, by number and by volume.
pub fn sizes(report: &Report) -> Markup {
    let Some(d) = &report.summary.equivalent_diameter else {
        return html! { h2 { "Cell size" } p { "No cell is whole." } };
    };
    let h = &d.histogram;
    let diameter = format!("equivalent diameter [{}]", printed_unit(&d.unit));
    let numbers: Vec<f64> = h.bins.iter().map(|&n| n as f64).collect();
    let all: f64 = h.volumes.iter().sum();
    let shares: Vec<f64> = h.volumes.iter().map(|v| 100.0 * v / all).collect();
    let axes = |y: &'static str| Axes { x: &diameter, y };
    html! {
        h2 { "Cell size" }
        p { "Equivalent diameter of whole cells [" (printed_unit(&d.unit)) "]." }
        (rows(&SPREAD, &[spread_row("by number", &d.number), spread_row("by volume", &d.volume)]))
        div.plots {
            (figure(bars([h.min, h.max], &numbers, &axes("cells")), "Cells by their equivalent diameter."))
            (figure(bars([h.min, h.max], &shares, &axes("share of volume [%]")), "Their volume by their diameter."))
        }
    }
}

/// Distributions of the measures of form.
pub fn form(report: &Report) -> Markup {
    let shown = report.form.iter();
    let shown = shown.filter(|f| f.column != "equivalent_diameter");
    html! {
        div.plots {
            @for form in shown {
                @let h = &form.histogram;
                @let numbers: Vec<f64> = h.bins.iter().map(|&n| n as f64).collect();
                @let axes = Axes { x: form.column, y: "cells" };
                (figure(bars([h.min, h.max], &numbers, &axes), &format!("Cells by their {}.", form.column)))
            }
        }
    }
}

/// Porosity by slices and boxes.
pub fn porosity(report: &Report) -> Markup {
    let structure = &report.structure;
    let Some(profile) = &structure.profile else {
        return html! {};
    };
    let slices = [&profile.x, &profile.y, &profile.z];
    let mut known = slices
        .iter()
        .flat_map(|axis| axis.porosity.iter().flatten());
    let first = known.next().copied();
    // all or nothing is below the threshold, or nothing counts: plots would show noise of rounding
    if first.is_none_or(|first| (first == 0.0 || first == 1.0) && known.all(|p| *p == first)) {
        let all = first.map_or("no porosity".to_owned(), |first| {
            format!("the same porosity, {}", percent(first))
        });
        return html! {
            h2 { "Porosity by place" }
            p { "All slices and boxes have " (all) "." }
        };
    }
    let length = printed_unit(unit(report));
    html! {
        h2 { "Porosity by place" }
        (along(profile, &length))
        @if !structure.boxes.is_empty() { (boxes(report, &length)) }
    }
}

fn along(profile: &Profile, unit: &str) -> Markup {
    let axes = [("x", &profile.x), ("y", &profile.y), ("z", &profile.z)];
    let line = |(name, axis): &(&'static str, &AxisProfile)| Line {
        name,
        points: axis
            .porosity
            .iter()
            .enumerate()
            .map(|(i, p)| (i as f64 * axis.step, p.map(|p| 100.0 * p)))
            .collect(),
    };
    let all: Vec<Line> = axes.iter().map(line).collect();
    let x = format!("from the first voxel [{unit}]");
    let plot = lines(
        &all,
        &Axes {
            x: &x,
            y: "porosity [%]",
        },
    );
    let spread: Vec<Vec<String>> = axes
        .iter()
        .map(|(name, axis)| {
            let share = |v: Option<f64>| v.map_or("-".to_owned(), percent);
            let known = || axis.porosity.iter().copied().flatten();
            let least = known().reduce(f64::min);
            let most = known().reduce(f64::max);
            let mut line = vec![
                format!("slices across {name}"),
                count(axis.voxels.len() as u64),
            ];
            line.extend([axis.mean, axis.sd, least, most].map(share));
            line
        })
        .collect();
    html! {
        (figure(plot, "Porosity of slices across x, y and z."))
        (rows(&["", "slices", "mean", "sd", "min", "max"], &spread))
    }
}

fn boxes(report: &Report, unit: &str) -> Markup {
    let all = &report.structure.boxes;
    let percent_of = |p: f64| 100.0 * p;
    let means: Vec<(f64, f64, Option<f64>)> = all
        .iter()
        .map(|b| (b.side, percent_of(b.mean), b.sd.map(percent_of)))
        .collect();
    let single: Vec<(f64, f64)> = all
        .iter()
        .map(|b| (b.side, percent_of(b.centred)))
        .collect();
    let x = format!("side of the box [{unit}]");
    let axes = Axes {
        x: &x,
        y: "porosity [%]",
    };
    let data = Growing {
        means: &means,
        single: &single,
    };
    let lines: Vec<Vec<String>> = all
        .iter()
        .map(|b| {
            let sd = b.sd.map_or("-".to_owned(), percent);
            let mut line = vec![measure(b.side), count(b.boxes)];
            line.extend([
                percent(b.mean),
                sd,
                percent(b.min),
                percent(b.max),
                percent(b.centred),
            ]);
            line
        })
        .collect();
    let side = format!("side [{unit}]");
    html! {
        (figure(
            growing(&data, &axes),
            "Porosity of boxes of growing size: mean and standard deviation of boxes side by side, and the box in the \
             middle. Where they no longer change, a box stands for the whole.",
        ))
        (rows(&[&side, "boxes", "mean", "sd", "min", "max", "in the middle"], &lines))
    }
}

/// Thickness of walls.
pub fn walls(walls: &Walls) -> Markup {
    let Some(h) = &walls.histogram else {
        return html! {};
    };
    let all: f64 = h.volumes.iter().sum();
    let shares: Vec<f64> = h.volumes.iter().map(|v| 100.0 * v / all).collect();
    let x = format!("thickness [{}]", printed_unit(&walls.unit));
    let axes = Axes {
        x: &x,
        y: "share of area [%]",
    };
    figure(
        bars([h.min, h.max], &shares, &axes),
        "Area of walls by their thickness.",
    )
}
