//! The sums of a table as people read them.

use super::{chart, output};
use crate::structure::{Fabric, MeanIntercept, SurfaceOf};
use crate::table::{
    Border, EdgeCorrection, Outside, PorosityOf, Spread, Summary, SurfaceSummary, Table,
};
use crate::words::measure;
use serde::Serialize;

/// What `--summary` prints.
#[derive(Debug, Serialize)]
pub struct Sums<'a> {
    #[serde(flatten)]
    pub summary: &'a Summary,
    /// Whose surface the two that follow are of; all three are absent unless all cells are summed up.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_of: Option<SurfaceOf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fabric: Option<&'a Fabric>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_intercept_length: Option<&'a MeanIntercept>,
}

/// Columns before the values of a summary: its longest name and two blanks.
const NAMES: usize = 16;

/// Which cells are taken as air around the sample.
fn outside_text(summary: &Summary) -> String {
    match summary.outside {
        Outside::None if summary.porosity_of == PorosityOf::Region => {
            "what is outside of the region".to_string()
        }
        Outside::None => "no cell (border-cell takes air around a sample)".to_string(),
        Outside::BorderCell => format!(
            "{} with {}",
            output::things(summary.outside_cells, "cell"),
            output::things(summary.outside_voxels, "voxel")
        ),
    }
}

/// A share with two decimals, or more if these show nothing of it.
fn percent(share: f64) -> String {
    match share > 0.0 && share < 5e-5 {
        true => crate::words::percent(share),
        false => format!("{:.2} %", 100.0 * share),
    }
}

/// How many rows were chosen.
fn chosen(count: u64, of: u64) -> String {
    match count == of {
        true => output::count(count),
        false => format!("{} of {}", output::count(count), output::count(of)),
    }
}

/// How many of them may go on outside.
fn at_border(border: &Border, shares_of: PorosityOf) -> String {
    let cut_by = match shares_of {
        PorosityOf::Region => "the grid or the edge of the region cuts",
        _ => "the grid cuts",
    };
    let share = border
        .share
        .map_or(String::new(), |share| format!(" ({})", percent(share)));
    let count = output::count(border.count);
    format!("{count}{share}, in no distribution: {cut_by} them")
}

/// What shares are of.
fn base(shares_of: PorosityOf) -> &'static str {
    match shares_of {
        PorosityOf::Grid => "the grid",
        PorosityOf::GridWithoutOutside => "the grid without what is outside",
        PorosityOf::Region => "the region of interest",
    }
}

/// The numbers of a summary that are no distribution.
fn counts(summary: &Summary, which: Table) -> Vec<(&'static str, String)> {
    let of_base = |share: Option<f64>, base: &str| match share {
        Some(share) => format!("{} of {base}", percent(share)),
        None if summary.porosity.is_some() => {
            "not known: what is outside of the region is part of it".to_owned()
        }
        None => "none: all of the grid is outside".to_owned(),
    };
    let base = base(summary.porosity_of);
    let mut rows = vec![
        (which.name(), chosen(summary.count, summary.of)),
        (
            "at the border",
            at_border(&summary.border, summary.porosity_of),
        ),
        ("outside", outside_text(summary)),
        ("volume", of_base(summary.volume_fraction, base)),
        ("porosity", of_base(summary.porosity, base)),
    ];
    if let Some(median) = summary.sphericity_median {
        rows.push(("sphericity", format!("{} (median)", measure(median))));
    }
    rows.extend(walls(summary));
    rows.extend(edge_corrected(summary));
    rows
}

/// What walls tell of cells.
fn walls(summary: &Summary) -> Vec<(&'static str, String)> {
    let mut rows = Vec::new();
    if let Some(s) = &summary.neighbours {
        let text = format!("{} (mean), {} (median)", measure(s.mean), measure(s.median));
        rows.push(("neighbours", text));
    }
    if let (Some(s), Some(d)) = (&summary.wall_thickness, &summary.equivalent_diameter) {
        let text = format!("{} {} (median of cells)", measure(s.median), d.unit);
        rows.push(("wall thickness", text));
    }
    rows
}

/// Number by volume and mean volume, corrected for the edge of the grid, or why they are not.
fn edge_corrected(summary: &Summary) -> Vec<(&'static str, String)> {
    let EdgeCorrection {
        reason,
        unit,
        mean_volume_whole,
        ..
    } = &summary.edge_correction;
    if let Some(reason) = reason {
        let text = format!("not corrected: {reason}");
        let text = output::wrapped(&text, output::width(), NAMES);
        return vec![("number density", text)];
    }
    let mut rows = Vec::new();
    if let Some(density) = summary.number_density {
        let text = format!("{} per {unit}, edge corrected", measure(density));
        rows.push(("number density", text));
    }
    if let (Some(mean), Some(whole)) = (summary.mean_volume_corrected, mean_volume_whole) {
        let [mean, whole] = [mean, *whole].map(measure);
        let text = format!("{mean} {unit}, edge corrected ({whole} of whole ones alone)");
        rows.push(("mean volume", text));
    }
    rows
}

/// Mean lengths of lines in cells, and how they depend on the direction.
fn anisotropy(lines: &MeanIntercept) -> (&'static str, String) {
    let [x, y, z] = [lines.x, lines.y, lines.z].map(|l| l.map_or("-".to_owned(), measure));
    let degree = match lines.degree_of_anisotropy {
        Some(degree) => format!("{degree:.3}"),
        None => "no ellipsoid".to_owned(),
    };
    let text = format!("{degree}; mean intercepts {x}, {y}, {z} {}", lines.unit);
    ("anisotropy", text)
}

/// A summary of surfaces for people.
pub fn of_surfaces(summary: &SurfaceSummary) -> String {
    let unit = &summary.area_unit;
    let base = base(summary.specific_surface_of);
    let mut area = format!("{} {unit}", measure(summary.area));
    if let Some(specific) = summary.specific_surface {
        let per = &summary.specific_surface_unit;
        area += &format!(", {} {per} of the volume of {base}", measure(specific));
    }
    let mut rows = vec![
        ("surfaces", chosen(summary.count, summary.of)),
        (
            "at the border",
            at_border(&summary.border, summary.specific_surface_of),
        ),
        ("triangles", output::count(summary.triangles)),
        ("area", area),
    ];
    let Some(spread) = &summary.areas else {
        return output::table(&rows);
    };
    rows.push((
        "of whole ones",
        format!(
            "{} {unit} (median), {} (mean), {} to {}",
            measure(spread.median),
            measure(spread.mean),
            measure(spread.min),
            measure(spread.max)
        ),
    ));
    output::table(&rows)
}

/// A summary for people.
pub fn text(sums: &Sums, which: Table) -> String {
    let summary = sums.summary;
    let mut rows = counts(summary, which);
    rows.extend(sums.mean_intercept_length.map(anisotropy));
    let Some(d) = &summary.equivalent_diameter else {
        return output::table(&rows);
    };
    let name = format!("equivalent diameter [{}]", d.unit);
    let head = ["min", "q1", "median", "q3", "max", "mean", "sd"];
    let line = |name: &str, values: [String; 7]| {
        let values = values.map(|v| format!("{v:>8}")).join(" ");
        format!("{name:13}{values}\n")
    };
    let spread = |s: &Spread| [s.min, s.q1, s.median, s.q3, s.max, s.mean, s.sd].map(measure);
    let h = &d.histogram;
    let doubled: Vec<f64> = h.bins.iter().flat_map(|&n| [n as f64; 2]).collect();
    let ends = [h.min, h.max];
    let mark = chart::Mark {
        sign: '▲',
        share: chart::place(ends, d.number.median),
        text: format!("median {}", measure(d.number.median)),
    };
    let bars = chart::draw(&doubled, ends, &[mark], output::width());
    format!(
        "{}\n{name} of whole {}\n{}{}{}\nnumber of whole {} by equivalent diameter (log scale)\n{bars}",
        output::table(&rows),
        which.name(),
        line("", head.map(String::from)),
        line("by number", spread(&d.number)),
        line("by volume", spread(&d.volume)),
        which.name(),
    )
}
