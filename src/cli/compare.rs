//! `alvis compare`: two tile sets of one body, cell by cell.

use super::args::Common;
use super::output::LongText;
use super::{Outcome, output};
use crate::compare::{Align, Change, CompareOptions, ComparedCell, Comparison, compare};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::words::measure;
use clap::{Args, ValueEnum, ValueHint};
use std::path::PathBuf;

/// Rows of the table for people, unless they ask for others.
const ROWS: usize = 20;

/// How the second set is laid over the first, as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum AlignArg {
    /// As they lie
    None,
    /// So that the boxes around all objects coincide: a body that was moved or compressed as a whole
    Box,
}

/// Form of the rows, as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FormatArg {
    /// The sums, and the pairs whose volume changed most
    Table,
    /// A row for each pair, lost and new cell
    Csv,
    /// One JSON object
    Json,
}

/// Match the cells of two tile sets of one body, as before and after compression
///
/// Cells are matched by the overlap of their boxes, a tenth at least, and the distance of their centroids, each to one
/// at most. Cells of A that B has not are lost, those of B that A has not are new. Lengths, also in conditions, are in the
/// unit of A's tables. Cells at the border may be cut, or be the air around the sample: they are told apart.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis compare BEFORE AFTER\n  \
    alvis compare BEFORE AFTER --align box --where 'voxels > 100'\n  \
    alvis compare BEFORE AFTER --format csv > pairs.csv")]
pub struct CompareArgs {
    /// The directory of the first tile set
    #[arg(value_name = "A", value_hint = ValueHint::DirPath)]
    a: PathBuf,
    /// The directory of the second one
    #[arg(value_name = "B", value_hint = ValueHint::DirPath)]
    b: PathBuf,
    /// How the cells of B are laid over those of A before they are matched; measures stay as they are
    #[arg(long, value_name = "HOW", default_value = "none")]
    align: AlignArg,
    /// Compare only cells for which this holds, and pairs for one of which it does
    #[arg(long = "where", value_name = "EXPR", allow_hyphen_values = true)]
    condition: Option<String>,
    /// At most this many rows of the table; CSV and JSON have all
    #[arg(long, value_name = "N")]
    top: Option<usize>,
    /// Form of the rows [default: table, or json with --json]
    #[arg(long, value_name = "FORM", conflicts_with = "json")]
    format: Option<FormatArg>,
    #[command(flatten)]
    common: Common,
}

impl CompareArgs {
    pub fn run(self) -> Result<Outcome> {
        let whole = match self.format {
            _ if self.common.json => Some("JSON"),
            Some(FormatArg::Json) => Some("JSON"),
            Some(FormatArg::Csv) => Some("CSV"),
            Some(FormatArg::Table) | None => None,
        };
        if let (Some(_), Some(form)) = (self.top, whole) {
            let found = format!("it with {form}, which holds all pairs");
            let expected = "it with the table for people alone";
            return Err(Error::usage("--top", found, expected));
        }
        let console = self.common.start();
        let options = CompareOptions {
            align: match self.align {
                AlignArg::None => Align::None,
                AlignArg::Box => Align::Box,
            },
            condition: self.condition,
        };
        let comparison = compare(&self.a, &self.b, &options)?;
        comparison.warnings.iter().for_each(|w| console.warn(w));
        drop(console);
        match self.format {
            _ if self.common.json => output::print_json(&comparison)?,
            Some(FormatArg::Json) => output::print_json(&comparison)?,
            Some(FormatArg::Csv) => print_csv(&comparison)?,
            Some(FormatArg::Table) | None => {
                output::print(&text(&comparison, self.top.unwrap_or(ROWS)))?;
            }
        }
        Ok(Outcome::Done)
    }
}

/// A number, or nothing.
fn field(value: Option<impl ToString>) -> String {
    value.map_or(String::new(), |v| v.to_string())
}

fn print_csv(comparison: &Comparison) -> Result<()> {
    let mut out = LongText::default();
    let unit = comparison.unit;
    let mut head = vec!["a".to_owned(), "b".to_owned(), "overlap".to_owned()];
    for (name, unit) in [
        ("volume", format!(" [{unit}^3]")),
        ("sphericity", String::new()),
        ("elongation", String::new()),
        ("flatness", String::new()),
    ] {
        head.extend([
            format!("{name}_a{unit}"),
            format!("{name}_b{unit}"),
            format!("{name}_change"),
        ]);
    }
    head.extend(["x", "y", "z"].map(|axis| format!("shift_{axis} [{unit}]")));
    head.push("touches_border".to_owned());
    out.push(&(head.join(",") + "\n"))?;
    for pair in &comparison.pairs {
        let mut fields = vec![field(pair.a), field(pair.b), field(pair.overlap)];
        for Change { a, b, change } in
            [pair.volume, pair.sphericity, pair.elongation, pair.flatness]
        {
            fields.extend([field(a), field(b), field(change)]);
        }
        fields.extend((0..3).map(|i| field(pair.shift.map(|s| s[i]))));
        fields.push(u8::from(pair.touches_border).to_string());
        out.push(&(fields.join(",") + "\n"))?;
    }
    out.finish()
}

/// `+12.3 %`.
fn percent(change: f64) -> String {
    format!("{:+.1} %", 100.0 * change)
}

/// A number as a text, or `-`.
fn or_none(value: Option<f64>, text: fn(f64) -> String) -> String {
    value.map_or("-".to_owned(), text)
}

/// Volumes of both, and their change.
fn volumes(volume: &Change, unit: &str) -> String {
    format!(
        "{} to {} {unit}^3, {}",
        or_none(volume.a, measure),
        or_none(volume.b, measure),
        or_none(volume.change, percent)
    )
}

/// The numbers of cells and their volume.
fn sums(comparison: &Comparison) -> String {
    let count = output::count;
    let unit = comparison.unit;
    output::table(&[
        (
            "cells",
            format!(
                "{} in A, {} in B",
                count(comparison.cells[0]),
                count(comparison.cells[1])
            ),
        ),
        (
            "at the border",
            format!(
                "{} in A, {} in B",
                count(comparison.cells_border[0]),
                count(comparison.cells_border[1])
            ),
        ),
        ("matched", count(comparison.matched)),
        ("lost", format!("{} of A", count(comparison.lost))),
        ("new", format!("{} of B", count(comparison.new))),
        ("volume of all", volumes(&comparison.volume, unit)),
        ("volume of whole", volumes(&comparison.volume_whole, unit)),
        ("of matched", volumes(&comparison.volume_matched, unit)),
        (
            "change of volume",
            format!(
                "{} (median), {} (mean) of whole cells",
                or_none(comparison.volume_change_median, percent),
                or_none(comparison.volume_change_mean, percent)
            ),
        ),
    ])
}

/// The sums, and the pairs whose volume changed most.
fn text(comparison: &Comparison, rows: usize) -> String {
    let mut most: Vec<&ComparedCell> = comparison
        .pairs
        .iter()
        .filter(|p| p.volume.change.is_some() && !p.touches_border)
        .collect();
    let size = |p: &ComparedCell| p.volume.change.unwrap_or(0.0).abs();
    most.sort_by(|p, q| size(q).total_cmp(&size(p)).then(p.a.cmp(&q.a)));
    let mut text = sums(comparison);
    if most.is_empty() || rows == 0 {
        return text;
    }
    text += "\nwhole cells whose volume changed most\n";
    text += &table(&most[..most.len().min(rows)], comparison.unit);
    if most.len() > rows {
        text += "... (more with --top N; all with --format csv or json)\n";
    }
    text
}

/// Pairs in columns.
fn table(pairs: &[&ComparedCell], unit: &str) -> String {
    const WIDTHS: [usize; 8] = [7, 7, 7, 10, 10, 8, 10, 8];
    let line = |cells: [String; 8]| {
        let cells = cells.iter().zip(WIDTHS);
        let cells: Vec<String> = cells
            .map(|(text, width)| format!("{text:>width$}"))
            .collect();
        format!("{}\n", cells.join(" ").trim_end())
    };
    let volume = format!("[{unit}^3]");
    let [one, two] = ["volume A", "volume B"].map(str::to_owned);
    let head = [
        "A",
        "B",
        "overlap",
        &one,
        &two,
        "change",
        "sphericity",
        "shift",
    ]
    .map(str::to_owned);
    let mut text = line(head);
    text += &line(
        [
            "",
            "",
            "",
            &volume,
            &volume,
            "",
            "change",
            &format!("[{unit}]"),
        ]
        .map(str::to_owned),
    );
    for pair in pairs {
        let shift = pair
            .shift
            .map(|s| s.iter().map(|v| v * v).sum::<f64>().sqrt());
        text += &line([
            field(pair.a),
            field(pair.b),
            or_none(pair.overlap, |v| format!("{v:.3}")),
            or_none(pair.volume.a, measure),
            or_none(pair.volume.b, measure),
            or_none(pair.volume.change, percent),
            or_none(pair.sphericity.change, percent),
            or_none(shift, measure),
        ]);
    }
    text
}
