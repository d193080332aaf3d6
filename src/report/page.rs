//! A report as one page of HTML. Whatever comes from files goes through the template, which escapes it; plots have
//! numbers and words of this program alone.

mod plotted;
mod settings;
mod split;

use super::{Necks, Outlier, Report, Walls};
use crate::picture::printed_unit;
use crate::structure::{Fabric, MeanIntercept, SurfaceOf};
use crate::table::{Outside, PorosityOf, Spread, Summary};
use crate::words::{count, measure, percent, things};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// What the page may load: its own styles, and pictures in it.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

/// The page.
pub fn page(report: &Report) -> String {
    let name = &report.settings.source.name;
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "Report: " (name) }
                style { (PreEscaped(include_str!("page.css"))) }
            }
            body {
                h1 { (name) }
                p.made {
                    "Report by " (report.generator.name) " " (report.generator.version) " of a tile set by "
                    (report.settings.made_by.name) " " (report.settings.made_by.version)
                }
                @for warning in &report.warnings { p.warning { (warning) } }
                (results(report))
                (picture(report))
                (settings::section(report))
                (plotted::sizes(report))
                (form(report))
                (plotted::porosity(report))
                (anisotropy(report))
                @if let Some(cells) = &report.split { (split::section(cells)) }
                @if let Some(necks) = &report.necks { (of_necks(necks, unit(report))) }
                @if let Some(walls) = &report.walls { (of_walls(walls, &report.summary)) }
                (outliers(report))
                (definitions(report))
            }
        }
    };
    page.into_string()
}

/// The unit of lengths.
fn unit(report: &Report) -> &'static str {
    report.settings.table_unit.name()
}

/// A number with a unit as people read it.
fn with_unit(v: f64, unit: &str) -> String {
    format!("{} {}", measure(v), printed_unit(unit))
}

/// A table of names and values.
fn pairs(rows: &[(&str, String)]) -> Markup {
    html! {
        table.pairs {
            @for (name, value) in rows { tr { th scope="row" { (name) } td { (value) } } }
        }
    }
}

/// A table with a line of names; the first column is text, the others are numbers.
fn rows(names: &[&str], lines: &[Vec<String>]) -> Markup {
    html! {
        div.wide {
            table.rows {
                thead { tr {
                    @for (i, name) in names.iter().enumerate() {
                        th scope="col" .n[i > 0] { (name) }
                    }
                } }
                tbody {
                    @for line in lines {
                        tr { @for (i, value) in line.iter().enumerate() { td .n[i > 0] { (value) } } }
                    }
                }
            }
        }
    }
}

fn spread_row(name: &str, s: &Spread) -> Vec<String> {
    let values = [s.min, s.q1, s.median, s.q3, s.max, s.mean, s.sd].map(measure);
    std::iter::once(name.to_owned()).chain(values).collect()
}

const SPREAD: [&str; 8] = ["", "min", "q1", "median", "q3", "max", "mean", "sd"];

/// The numbers that are looked for first.
fn results(report: &Report) -> Markup {
    let s = &report.summary;
    let base = match s.porosity_of {
        PorosityOf::Grid => "of the grid",
        PorosityOf::GridWithoutOutside => "of the grid without what is outside",
        PorosityOf::Region => "of the region of interest",
    };
    let share = |v: Option<f64>| v.map_or("none".to_owned(), |v| format!("{} {base}", percent(v)));
    let border = s.border.share.map_or(String::new(), |share| {
        format!(
            ", {} ({}) of them at the border",
            count(s.border.count),
            percent(share)
        )
    });
    let mut lines = vec![
        ("porosity", share(s.porosity)),
        ("cells", format!("{}{border}", count(s.count))),
        ("objects", count(report.totals.objects)),
    ];
    if report.settings.cells.is_some() {
        let components = count(report.totals.components);
        lines.insert(2, ("connected components", components));
    }
    if s.outside == Outside::BorderCell {
        let voxels = things(s.outside_voxels, "voxel");
        let text = format!(
            "{} with {voxels}, left out",
            things(s.outside_cells, "cell")
        );
        lines.push(("outside", text));
    }
    if let Some(d) = &s.equivalent_diameter {
        let text = format!(
            "mean {}, sd {}, median {}; median by volume {}",
            measure(d.mean),
            measure(d.sd),
            measure(d.median),
            with_unit(d.by_volume_median, &d.unit)
        );
        lines.push(("equivalent diameter", text));
    }
    lines.extend(edge_corrected(s));
    if let Some(median) = s.sphericity_median {
        lines.push(("sphericity", format!("{} (median)", measure(median))));
    }
    if let Some(neighbours) = &s.neighbours {
        let [mean, median] = [neighbours.mean, neighbours.median].map(measure);
        lines.push((
            "neighbours",
            format!("mean {mean}, median {median}, of whole cells"),
        ));
    }
    if let (Some(of_cells), Some(walls)) = (&s.wall_thickness, &report.walls) {
        let median = with_unit(of_cells.median, &walls.unit);
        lines.push((
            "wall thickness",
            format!("{median} (median of whole cells)"),
        ));
    }
    if let Some(lines_in) = &report.structure.mean_intercept_length {
        let text = with_unit(lines_in.mean, lines_in.unit);
        lines.push(("mean intercept length", text));
        if let Some(degree) = lines_in.degree_of_anisotropy {
            lines.push(("degree of anisotropy", format!("{degree:.3}")));
        }
    }
    html! { h2 { "Results" } (pairs(&lines)) }
}

/// Number by volume and mean volume, or why they cannot be corrected.
fn edge_corrected(s: &Summary) -> Vec<(&'static str, String)> {
    let correction = &s.edge_correction;
    let volume = &correction.unit;
    let (Some(density), Some(mean)) = (s.number_density, s.mean_volume_corrected) else {
        let reason = correction.reason.as_deref().unwrap_or_default();
        return vec![("number density", format!("not corrected: {reason}"))];
    };
    let per = printed_unit(volume);
    let alone = |whole: f64| format!(" ({} of whole cells alone)", measure(whole));
    let whole = correction.mean_volume_whole.map_or(String::new(), alone);
    let mean = format!("{}, edge corrected{whole}", with_unit(mean, volume));
    vec![
        (
            "number density",
            format!("{} per {per}, edge corrected", measure(density)),
        ),
        ("mean volume", mean),
    ]
}

fn picture(report: &Report) -> Markup {
    let Some(picture) = &report.picture else {
        return html! {};
    };
    let [width, height] = picture.size;
    let data = format!(
        "data:image/png;base64,{}",
        BASE64_STANDARD.encode(&picture.png)
    );
    html! {
        figure {
            img src=(data) width=(width) height=(height) alt=(picture.caption);
            figcaption { (picture.caption) }
        }
    }
}

fn form(report: &Report) -> Markup {
    if report.form.is_empty() {
        return html! { h2 { "Form" } p { "No cell is whole." } };
    }
    let lines: Vec<Vec<String>> = report
        .form
        .iter()
        .map(|f| {
            let name = match f.column {
                "equivalent_diameter" => format!("{} [{}]", f.column, printed_unit(unit(report))),
                column => column.to_owned(),
            };
            spread_row(&name, &f.spread)
        })
        .collect();
    html! {
        h2 { "Form" }
        p { "Whole cells, by number." }
        (rows(&SPREAD, &lines))
        (plotted::form(report))
    }
}

fn anisotropy(report: &Report) -> Markup {
    let structure = &report.structure;
    let (Some(fabric), Some(lines)) = (&structure.fabric, &structure.mean_intercept_length) else {
        return html! { h2 { "Anisotropy" } p { "There is no surface that counts." } };
    };
    let whose = match structure.surface_of {
        SurfaceOf::Cells => "all cells",
        SurfaceOf::CellsWithoutOutside => "all cells but what is outside",
        SurfaceOf::WholeCells => "whole cells",
    };
    html! {
        h2 { "Anisotropy" }
        p {
            "Of the surface of " (whose) ", " (with_unit(fabric.area, &format!("{}^2", lines.unit))) "."
        }
        (of_lines(lines))
        (of_fabric(fabric))
    }
}

fn of_lines(lines: &MeanIntercept) -> Markup {
    let known = |v: Option<f64>| v.map_or("-".to_owned(), measure);
    let unit = printed_unit(lines.unit);
    let along = vec![vec![
        format!("mean intercept length [{unit}]"),
        known(lines.x),
        known(lines.y),
        known(lines.z),
        measure(lines.mean),
    ]];
    let axes: Vec<Vec<String>> = match (lines.axes, lines.directions) {
        (Some(axes), Some(directions)) => std::iter::zip(axes, directions)
            .zip(["longest", "middle", "shortest"])
            .map(|((axis, d), name)| {
                let mut line = vec![format!("{name} semi-axis of the ellipsoid"), measure(axis)];
                line.extend(d.map(|v| format!("{v:.3}")));
                line
            })
            .collect(),
        _ => Vec::new(),
    };
    html! {
        (rows(&["", "along x", "along y", "along z", "all directions"], &along))
        @if axes.is_empty() {
            p { "No ellipsoid fits the lengths: in some direction lines meet no surface." }
        } @else {
            (rows(&["", &format!("[{unit}]"), "x", "y", "z"], &axes))
        }
    }
}

fn of_fabric(fabric: &Fabric) -> Markup {
    let lines: Vec<Vec<String>> = std::iter::zip(fabric.eigenvalues, fabric.eigenvectors)
        .zip(["first", "second", "third"])
        .map(|((value, d), name)| {
            let mut line = vec![
                format!("{name} eigenvalue of the fabric tensor"),
                format!("{value:.4}"),
            ];
            line.extend(d.map(|v| format!("{v:.3}")));
            line
        })
        .collect();
    html! {
        (rows(&["", "", "x", "y", "z"], &lines))
        p { "Isotropy, the third by the first: " (format!("{:.3}", fabric.isotropy)) "." }
    }
}

fn of_necks(necks: &Necks, unit: &str) -> Markup {
    let spreads = [("radius", &necks.neck_radius), ("ratio", &necks.ratio)];
    let lines: Vec<Vec<String>> = spreads
        .iter()
        .filter_map(|(name, s)| Some(spread_row(name, s.as_ref()?)))
        .collect();
    let widest: Vec<Vec<String>> = necks
        .widest
        .iter()
        .map(|n| {
            let mut line = vec![format!("{} and {}", n.cell_a, n.cell_b)];
            line.push(measure(n.neck_radius));
            line.push(n.ratio.map_or(String::new(), measure));
            line.extend(n.at.map(measure));
            line
        })
        .collect();
    html! {
        h2 { "Necks" }
        p {
            (things(necks.count, "opening")) " between cells; radii in " (printed_unit(&necks.unit))
            ", places in " (printed_unit(unit)) ", ratios by the radius of the smaller cell, where cells were cut from each other."
        }
        @if !lines.is_empty() {
            (rows(&SPREAD, &lines))
            p { "The widest:" }
            (rows(&["cells", "radius", "ratio", "x", "y", "z"], &widest))
        }
    }
}

fn of_walls(walls: &Walls, summary: &Summary) -> Markup {
    let area = with_unit(walls.wall_area, &format!("{}^2", walls.unit));
    let spreads = [
        ("whole cells, each by its median", &summary.wall_thickness),
        ("walls, by their area", &walls.wall_thickness),
    ];
    let lines: Vec<Vec<String>> = spreads
        .iter()
        .filter_map(|(name, s)| Some(spread_row(name, s.as_ref()?)))
        .collect();
    html! {
        h2 { "Walls" }
        p {
            (things(walls.count, "wall")) " of " (area) " together; thickness in " (printed_unit(&walls.unit)) "."
            @if walls.thin > 0 {
                " Of these, " (count(walls.thin)) " are thinner than the scan shows: their thickness is that of its blur."
            }
            @if walls.left_out > 0 {
                " " (things(walls.left_out, "pair")) " of cells whose wall is too small or too thick to make them neighbours "
                "count in nothing here."
            }
        }
        @if !lines.is_empty() { (rows(&SPREAD, &lines)) }
        (plotted::walls(walls))
    }
}

fn outliers(report: &Report) -> Markup {
    let line = |o: &Outlier| {
        let mut line = vec![o.id.to_string(), o.column.to_owned()];
        line.extend([o.value, o.fence].map(measure));
        line.push(format!("{:.1}", o.distance));
        line.push(measure(o.volume));
        line.extend(o.centroid.map(measure));
        line
    };
    let lines: Vec<Vec<String>> = report.outliers.iter().map(line).collect();
    let beyond: u64 = report.form.iter().map(|f| f.outliers).sum();
    let unit = printed_unit(unit(report));
    let volume = format!("volume [{unit}³]");
    html! {
        h2 { "Outliers" }
        @if lines.is_empty() {
            p { "No whole cell lies far from the others." }
        } @else {
            p {
                (things(beyond, "value")) " of whole cells beyond the fences, the farthest " (lines.len())
                " here. Distances are in those between the quartiles; centroids in " (unit) "."
            }
            (rows(&["cell", "measure", "value", "fence", "distance", &volume, "x", "y", "z"], &lines))
        }
    }
}

fn definitions(report: &Report) -> Markup {
    html! {
        h2 { "Definitions and sources" }
        dl {
            @for d in &report.definitions {
                dt { (d.quantity) }
                dd { (d.definition) }
                dd.source { (d.source) }
            }
        }
        p { "Cells at the border are cut by it: they count in porosity, but in no distribution." }
    }
}
