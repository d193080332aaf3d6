//! The cells, objects and surfaces that a selection keeps, and their colours, to be compared with those of its pieces.
//!
//! The conditions that the manifest states are evaluated once more on the table's rows, as they come. Only
//! of `best:N` and `worst:N`, which need all rows, the ids of N of them are kept.

use super::code::Code;
use super::files;
use super::ledger::Kind;
use super::report::Issues;
use crate::error::{Error, Result};
use crate::manifest::{ColourBy, LEGEND, LEGEND_SVG, Manifest, Painted, Selection, Step};
use crate::picture::ColourBar;
use crate::store;
use crate::table::{Column, Expr, Row, Table, TableReader};
use colorous::Gradient;
use std::collections::{BTreeSet, BinaryHeap};
use std::io::Read;
use std::path::Path;

/// The colour of a piece: 0 for the common grey, [`PAINTED`] and sRGB, or [`MIXED`].
pub(super) type Colour = u32;
pub(super) const PAINTED: Colour = 1 << 24;
/// Several colours, or one that is none of the format.
pub(super) const MIXED: Colour = 1 << 25;

/// A colour of sRGB, or the common grey.
pub(super) fn colour(rgb: Option<[u8; 3]>) -> Colour {
    rgb.map_or(0, |[r, g, b]| PAINTED | u32::from_be_bytes([0, r, g, b]))
}

/// For messages.
pub(super) fn name(colour: Colour) -> String {
    match colour {
        0 => "the common grey".to_owned(),
        MIXED.. => "no colour, or several".to_owned(),
        c => format!("#{:06x}", c - PAINTED),
    }
}

/// Colours that a manifest lists of a map, and that a map has.
const LISTED: usize = 9;
const STEPS: usize = 256;

/// Bytes that are read of either; they have a few thousand.
const LARGEST_LEGEND: u64 = 1 << 20;

/// Which rows have a colour.
enum Who {
    Where(Expr),
    /// The best or the worst, by id.
    Ranked(BTreeSet<u64>),
}

/// One colour.
struct Rule {
    who: Who,
    colour: Colour,
    /// Rows so far.
    count: u64,
}

/// Colours by value.
struct Scale {
    value: Expr,
    map: Gradient,
    min: f64,
    max: f64,
}

/// A condition that all rows of a table have to be kept by.
struct Filter {
    condition: Expr,
    /// It must not hold.
    omit: bool,
    /// Where the index states it.
    at: String,
    /// The first row that should not be there.
    stray: Option<u64>,
}

/// The rows of a table, one after the other.
pub(super) struct Paints<'a> {
    kind: Kind,
    selection: &'a Selection,
    table: TableReader,
    id: usize,
    filters: Vec<Filter>,
    scale: Option<Scale>,
    rules: Vec<Rule>,
}

/// The table of a kind; those of components, necks and walls are not chosen from.
fn table_of(kind: Kind) -> Option<Table> {
    match kind {
        Kind::Cell => Some(Table::Cells),
        Kind::Object => Some(Table::Objects),
        Kind::Surface => Some(Table::Surfaces),
        Kind::Component | Kind::Neck | Kind::Wall => None,
    }
}

/// True if pieces are painted as the rows of this kind are: those that were chosen from, and cells where none were.
pub(super) fn paints(manifest: &Manifest, kind: Kind) -> bool {
    let table = manifest.selection.as_ref().map(|s| s.last.table);
    Some(table.unwrap_or_default()) == table_of(kind)
}

impl<'a> Paints<'a> {
    /// Reads what the selection states of the rows of a kind; `None` without one, or if that is an issue.
    pub fn open(
        root: &Path,
        manifest: &'a Manifest,
        kind: Kind,
        issues: &mut Issues,
    ) -> Option<Self> {
        const AT: &str = "index.json#/selection";
        let selection = manifest.selection.as_ref()?;
        if let Some(by) = selection
            .colour_by
            .as_ref()
            .filter(|_| paints(manifest, kind))
        {
            check_legend(root, by, issues);
        }
        // what is wrong with the table itself is said elsewhere
        let table = table_of(kind)?.open(root, manifest).ok()?;
        match Self::read(selection, table, root, manifest, kind) {
            Ok(paints) => Some(paints),
            Err(Error::Io { .. }) => None,
            Err(e) => {
                issues.add(Code::Selection, AT, e.to_string());
                None
            }
        }
    }

    fn read(
        selection: &'a Selection,
        table: TableReader,
        root: &Path,
        manifest: &Manifest,
        kind: Kind,
    ) -> Result<Self> {
        let columns = table.columns();
        let id = table.column("id").unwrap_or(0);
        let filters = filters(selection, kind, columns)?;
        if !paints(manifest, kind) {
            return Ok(Paints {
                kind,
                selection,
                table,
                id,
                filters,
                scale: None,
                rules: Vec::new(),
            });
        }
        let scale = selection
            .colour_by
            .as_ref()
            .map(|by| Scale::new(by, columns));
        let rule = |paint: &crate::manifest::Paint| {
            let count = paint.count.count();
            if paint.count != Painted::of(selection.last.table, count) {
                let expected = format!("{count} {}", selection.last.table.name());
                return Err(Error::usage(
                    "painted",
                    format!("{:?}", paint.count),
                    expected,
                ));
            }
            let who = match rank(&paint.condition) {
                None => Who::Where(Expr::condition("where", &paint.condition, columns)?),
                Some((n, best)) => {
                    let again = selection.last.table.open(root, manifest)?;
                    Who::Ranked(ranked(again, n, best)?)
                }
            };
            let colour = colour(Some(hex(&paint.colour)?));
            Ok(Rule {
                who,
                colour,
                count: 0,
            })
        };
        let rules: Result<Vec<Rule>> = selection.painted.iter().map(rule).collect();
        Ok(Paints {
            kind,
            filters,
            scale: scale.transpose()?,
            rules: rules?,
            selection,
            id,
            table,
        })
    }

    /// The colour of the next row, which should be this one; `None` if it is not, or the row is damaged.
    pub fn next(&mut self, expected: u64) -> Option<Colour> {
        let row = self.table.next_row().ok()??;
        let id = row.whole(self.id).ok().filter(|id| *id == expected)?;
        for filter in &mut self.filters {
            if filter.condition.test(&row).ok()? == filter.omit {
                filter.stray.get_or_insert(id);
            }
        }
        let mut found = match &self.scale {
            None => 0,
            Some(scale) => colour(scale.colour(&row).ok()?),
        };
        for rule in &mut self.rules {
            let holds = match &rule.who {
                Who::Where(condition) => condition.test(&row).ok()?,
                Who::Ranked(ids) => ids.contains(&id),
            };
            if holds {
                rule.count += 1;
                found = rule.colour;
            }
        }
        Some(found)
    }

    /// Says what does not fit, once all rows have been seen.
    pub fn finish(&self, issues: &mut Issues) {
        for filter in &self.filters {
            let Some(id) = filter.stray else { continue };
            let holds = if filter.omit {
                "holds"
            } else {
                "does not hold"
            };
            let name = self.kind.name();
            let message =
                format!("{name} {id} is in the part, though the condition {holds} for it");
            issues.add(Code::Selection, &filter.at, message);
        }
        for (i, (rule, paint)) in self.rules.iter().zip(&self.selection.painted).enumerate() {
            if rule.count != paint.count.count() {
                let plural = self.kind.plural();
                let message = format!(
                    "found {}, it holds for {} {plural}",
                    paint.count.count(),
                    rule.count
                );
                let at = format!("index.json#/selection/painted/{i}/{plural}");
                issues.add(Code::Paint, at, message);
            }
        }
        if let (Some(scale), Some(by)) = (&self.scale, &self.selection.colour_by) {
            let listed: Vec<String> = (0..LISTED)
                .map(|i| i as f64 / (LISTED - 1) as f64)
                .map(|share| {
                    let [r, g, b] = scale.at(share);
                    format!("#{r:02x}{g:02x}{b:02x}")
                })
                .collect();
            let columns = self.table.columns();
            let unit = columns.iter().find(|c| c.name == by.column);
            let unit = unit.map_or("", |c| c.unit.as_str());
            if by.colours != listed || by.unit != unit {
                let message = format!(
                    "found {:?} of unit {:?}, the map has {listed:?} and the column {unit:?}",
                    by.colours, by.unit
                );
                issues.add(Code::Paint, "index.json#/selection/colour_by", message);
            }
        }
    }
}

/// The conditions that the rows of a kind have to be kept by. Of the largest that were left out nothing is to be seen.
fn filters(selection: &Selection, kind: Kind, columns: &[Column]) -> Result<Vec<Filter>> {
    let of_kind =
        |step: &Step| Some(step.table) == table_of(kind) && !(step.omit && step.largest.is_some());
    let before = selection.before.len();
    let mut filters = Vec::new();
    for (i, step) in selection.steps().enumerate().filter(|(_, s)| of_kind(s)) {
        let at = match i < before {
            true => format!("index.json#/selection/before/{i}/where"),
            false => "index.json#/selection/where".to_owned(),
        };
        if let Some(text) = &step.condition {
            filters.push(Filter {
                condition: Expr::condition("where", text, columns)?,
                omit: step.omit,
                at,
                stray: None,
            });
        }
    }
    Ok(filters)
}

/// Compares the picture of colours with what the manifest says of them.
fn check_legend(root: &Path, by: &ColourBy, issues: &mut Issues) {
    const AT: &str = "index.json#/selection/colour_by/legend";
    let Some(real) = files::resolve(root, &by.legend, AT, issues) else {
        return;
    };
    if by.legend != LEGEND {
        let message = format!("found {}, expected {LEGEND}", by.legend);
        return issues.add(Code::PathName, AT, message);
    }
    let Some(png) = legend_bytes(&real, LEGEND, issues) else {
        return;
    };
    // a map that is none is said elsewhere
    let Ok(map) = gradient(&by.map) else {
        return;
    };
    let bar = ColourBar {
        title: &by.title(),
        ends: [by.min, by.max],
        colour: &|share| colour_at(map, share),
    };
    if let Some(message) = bar.picture().differs(&png) {
        let message = format!("it is not the picture of the colours in {AT}: {message}");
        issues.add(Code::Paint, LEGEND, message);
    }
    // sets may lack it, so that only what is there is compared
    let legend = root.join(LEGEND_SVG);
    if legend.symlink_metadata().is_err() && !store::is_file(&legend) {
        return;
    }
    let Some(real) = files::resolve(root, LEGEND_SVG, AT, issues) else {
        return;
    };
    let svg = legend_bytes(&real, LEGEND_SVG, issues);
    if svg.is_some_and(|svg| svg != bar.svg().as_bytes()) {
        let message = format!("it is not the picture of the colours in {AT}");
        issues.add(Code::Paint, LEGEND_SVG, message);
    }
}

/// The first bytes of a legend; `None` if that is an issue.
fn legend_bytes(real: &Path, name: &str, issues: &mut Issues) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let read = files::open(real).and_then(|f| f.take(LARGEST_LEGEND).read_to_end(&mut bytes));
    match read {
        Ok(_) => Some(bytes),
        Err(e) => {
            issues.add(Code::MissingFile, name, format!("cannot be read: {e}"));
            None
        }
    }
}

/// The colour map of a name.
fn gradient(name: &str) -> Result<Gradient> {
    Ok(match name {
        "viridis" => colorous::VIRIDIS,
        "magma" => colorous::MAGMA,
        "plasma" => colorous::PLASMA,
        "inferno" => colorous::INFERNO,
        "cividis" => colorous::CIVIDIS,
        "turbo" => colorous::TURBO,
        other => return Err(Error::usage("map", other, "a colour map")),
    })
}

/// The colour of a map at a share from 0 to 1.
fn colour_at(map: Gradient, share: f64) -> [u8; 3] {
    let step = (share.clamp(0.0, 1.0) * (STEPS - 1) as f64).round() as usize;
    let c = map.eval_rational(step, STEPS);
    [c.r, c.g, c.b]
}

impl Scale {
    fn new(by: &ColourBy, columns: &[Column]) -> Result<Self> {
        Ok(Scale {
            value: Expr::number("column", &by.column, columns)?,
            map: gradient(&by.map)?,
            min: by.min,
            max: by.max,
        })
    }

    fn at(&self, share: f64) -> [u8; 3] {
        colour_at(self.map, share)
    }

    /// The colour of a row; none if it has no value.
    fn colour(&self, row: &Row) -> Result<Option<[u8; 3]>> {
        let wide = self.max - self.min;
        let share = |v: f64| {
            if wide == 0.0 {
                0.5
            } else {
                (v - self.min) / wide
            }
        };
        Ok(self.value.value(row)?.map(|v| self.at(share(v))))
    }
}

/// A colour `#rrggbb`.
fn hex(text: &str) -> Result<[u8; 3]> {
    let lower = |d: &&str| d.len() == 6 && !d.contains(|c: char| c.is_ascii_uppercase());
    let digits = text.strip_prefix('#').filter(lower);
    match digits.and_then(|d| u32::from_str_radix(d, 16).ok()) {
        Some(number) => {
            let [_, r, g, b] = number.to_be_bytes();
            Ok([r, g, b])
        }
        None => Err(Error::usage("colour", text, "#rrggbb")),
    }
}

/// Reads `best:N` and `worst:N`: N, and true for the best.
fn rank(text: &str) -> Option<(usize, bool)> {
    let (word, number) = text.split_once(':')?;
    let best = match word.trim() {
        "best" => true,
        "worst" => false,
        _ => return None,
    };
    Some((number.trim().parse().ok()?, best))
}

/// The ids of the `n` rows of the largest or smallest form factor; of equal ones the first.
fn ranked(mut table: TableReader, n: usize, best: bool) -> Result<BTreeSet<u64>> {
    let value = Expr::number("where", "form_factor", table.columns())?;
    let id = table.column("id").unwrap_or(0);
    let mut heap = BinaryHeap::new();
    while let Some(row) = table.next_row()? {
        let Some(v) = value.value(&row)? else {
            continue;
        };
        // rises as the number does
        let bits = (if best { -v } else { v }).to_bits();
        let key = if bits >> 63 == 1 {
            !bits
        } else {
            bits | 1 << 63
        };
        heap.push((key, row.whole(id)?));
        if heap.len() > n {
            heap.pop();
        }
    }
    Ok(heap.into_iter().map(|(_, id)| id).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_and_ranks_are_read_as_they_are_written() {
        assert_eq!(name(colour(Some([255, 136, 0]))), "#ff8800");
        assert_eq!(hex("#ff8800").unwrap(), [255, 136, 0]);
        assert!(hex("ff8800").is_err() && hex("#ff880").is_err() && hex("#FF8800").is_err());
        assert_eq!(rank("best:10"), Some((10, true)));
        assert_eq!(rank("volume > 1"), None);
    }
}
