//! `alvis select`: a part of a tile set, or a painted copy.

use super::args::Common;
use super::chosen::ChosenArgs;
use super::lod::note_dropped;
use super::{Outcome, output};
use crate::error::{Error, Result};
use crate::table::Table;
use crate::transform::select::{
    ColourRule, Map, PaintRule, SelectOptions, SelectReport, parse_colour, select,
};
use clap::{Args, ValueHint};
use std::path::PathBuf;

/// Write a part of a tile set, or a painted copy, as a tile set of its own
///
/// Cells, objects or surfaces are kept or left out, cells and objects with all their surfaces; geometry is copied, ids
/// and measures stay those of the whole, and colours those of a painted set unless others are given. Conditions are those of `alvis cells`. Caps are kept only if all surfaces of
/// the objects that are left are kept.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis select OUT PART --where 'not touches_border'\n  \
    alvis select OUT PART --objects --largest 1\n  \
    alvis select OUT PART --paint best:100=green --paint worst:100=red\n  \
    alvis select OUT PART --colour-by volume --map magma --paint 'volume > 3=#ff8800'")]
pub struct SelectArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// The directory to write
    #[arg(value_hint = ValueHint::DirPath)]
    dest: PathBuf,
    #[command(flatten)]
    chosen: ChosenArgs,
    /// Leave out what --where and --largest choose, and keep the others
    #[arg(long)]
    omit: bool,
    /// Paint those for which a condition holds, or best:N or worst:N by form factor, in a CSS
    /// colour; later ones paint over earlier ones
    #[arg(long, value_name = "EXPR=COLOUR", allow_hyphen_values = true, value_parser = paint)]
    paint: Vec<PaintRule>,
    /// Colour all by a column or an expression
    #[arg(
        long,
        alias = "color-by",
        value_name = "COLUMN",
        allow_hyphen_values = true
    )]
    colour_by: Option<String>,
    /// Colour map: viridis, magma, plasma, inferno, cividis or turbo
    #[arg(long, value_name = "NAME", default_value = "viridis", value_parser = map, requires = "colour_by")]
    map: Map,
    /// Values of the map's first and last colour [default: those of what is kept]
    #[arg(long, value_name = "A:B", allow_hyphen_values = true, value_parser = range, requires = "colour_by")]
    range: Option<[f64; 2]>,
    /// Replace a tile set that is in the directory
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    common: Common,
}

/// `EXPR=COLOUR`; the condition may have `=` in it, a colour has none.
fn paint(text: &str) -> Result<PaintRule, String> {
    let (condition, colour) = text
        .rsplit_once('=')
        .ok_or("expected EXPR=COLOUR, as in best:100=green or 'volume > 3=#ff8800'")?;
    let colour = parse_colour("--paint", colour)
        .map_err(|_| format!("{colour:?} is not a CSS colour, such as orange or #ff8800"))?;
    Ok(PaintRule {
        condition: condition.trim().to_string(),
        colour,
    })
}

pub fn map(text: &str) -> Result<Map, String> {
    Map::named(text).map_err(|_| format!("expected {}", Map::names().join(", ")))
}

pub fn range(text: &str) -> Result<[f64; 2], String> {
    const EXPECTED: &str = "expected two different finite numbers, as in 0:2.5";
    let (a, b) = text.split_once(':').ok_or(EXPECTED)?;
    let numbers = [a, b].map(|t| t.trim().parse::<f64>().ok().filter(|v| v.is_finite()));
    match numbers {
        [Some(a), Some(b)] if a != b => Ok([a, b]),
        _ => Err(EXPECTED.to_string()),
    }
}

impl SelectArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        let chosen = self.chosen.chosen();
        if self.omit && chosen.is_all() {
            let expected = "it together with --where or --largest";
            return Err(Error::usage("--omit", "it alone", expected));
        }
        if chosen.is_all() && self.paint.is_empty() && self.colour_by.is_none() {
            return Err(Error::usage(
                "select",
                "nothing to do",
                "--where, --largest, --paint or --colour-by",
            ));
        }
        let ranked = |rule: &PaintRule| rule.condition.contains(':');
        if chosen.table == Table::Surfaces
            && let Some(rule) = self.paint.iter().find(|rule| ranked(rule))
        {
            let found = format!("{} with --surfaces", rule.condition);
            let expected = "a condition: surfaces have no form factor";
            return Err(Error::usage("--paint", found, expected));
        }
        let options = SelectOptions {
            chosen,
            omit: self.omit,
            paint: self.paint,
            colour_by: self.colour_by.map(|column| ColourRule {
                column,
                map: self.map,
                range: self.range,
            }),
            force: self.force,
        };
        let report = select(&self.out, &self.dest, &options, &console)?;
        note_dropped(&self.out, &self.dest, &console)?;
        drop(console);
        if self.common.json {
            output::print_json(&report)?;
        } else if self.common.talks() {
            output::print(&summary(&report))?;
        }
        Ok(Outcome::Done)
    }
}

fn summary(report: &SelectReport) -> String {
    let of = &report.selection.of;
    let share = |part: u64, all: u64| format!("{} of {}", output::count(part), output::count(all));
    let mut rows = vec![
        ("cells", share(report.cells, of.cells)),
        ("objects", share(report.objects, of.objects)),
        ("surfaces", share(report.surfaces, of.surfaces)),
        (
            "tiles",
            format!(
                "{}, {}",
                output::count(report.tiles),
                output::bytes(report.bytes)
            ),
        ),
        ("triangles", output::count(report.triangles)),
    ];
    for paint in &report.selection.painted {
        let count = output::count(paint.count.count());
        rows.push((
            "painted",
            format!("{count} {}: {}", paint.colour, paint.condition),
        ));
    }
    if let Some(by) = &report.selection.colour_by {
        let values = format!("{} to {} {}", by.min, by.max, by.unit);
        rows.push((
            "coloured",
            format!("by {}, {}: {}", by.column, by.map, values.trim()),
        ));
    }
    output::table(&rows)
}
