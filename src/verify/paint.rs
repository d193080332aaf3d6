//! The cells that a selection keeps, and their colours, to be compared with those of its pieces.
//!
//! The conditions that the manifest states are evaluated once more on the table's rows, as they come. Only
//! of `best:N` and `worst:N`, which need all rows, the ids of N cells are kept.

use super::code::Code;
use super::files;
use super::report::Issues;
use crate::error::{Error, Result};
use crate::manifest::{ColourBy, Manifest, Selection};
use crate::picture::ColourBar;
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

/// The name of the picture of colours.
pub(super) const LEGEND: &str = "legend.png";
/// The name of the same as SVG, which sets may have too.
pub(super) const LEGEND_SVG: &str = "legend.svg";
/// Bytes that are read of either; they have a few thousand.
const LARGEST_LEGEND: u64 = 1 << 20;

/// Which cells have a colour.
enum Who {
    Where(Expr),
    /// The best or the worst, by id.
    Ranked(BTreeSet<u64>),
}

/// One colour.
struct Rule {
    who: Who,
    colour: Colour,
    /// Cells so far.
    cells: u64,
}

/// Colours by value.
struct Scale {
    value: Expr,
    map: Gradient,
    min: f64,
    max: f64,
}

/// The cells of the table, one after the other.
pub(super) struct Paints<'a> {
    selection: &'a Selection,
    table: TableReader,
    id: usize,
    condition: Option<Expr>,
    scale: Option<Scale>,
    rules: Vec<Rule>,
    /// The first cell that should not be there.
    stray: Option<u64>,
}

impl<'a> Paints<'a> {
    /// Reads what the selection states; `None` without one, or if that is an issue.
    pub fn open(root: &Path, manifest: &'a Manifest, issues: &mut Issues) -> Option<Self> {
        const AT: &str = "index.json#/selection";
        let selection = manifest.selection.as_ref()?;
        if let Some(by) = &selection.colour_by {
            check_legend(root, by, issues);
        }
        // what is wrong with the table itself is said elsewhere
        let table = Table::Cells.open(root, manifest).ok()?;
        match Self::read(selection, table, root, manifest) {
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
    ) -> Result<Self> {
        let columns = table.columns();
        let id = table.column("id").unwrap_or(0);
        let condition = selection.condition.as_deref();
        let condition = condition.map(|text| Expr::condition("where", text, columns));
        let scale = selection
            .colour_by
            .as_ref()
            .map(|by| Scale::new(by, columns));
        let rule = |paint: &crate::manifest::Paint| {
            let who = match rank(&paint.condition) {
                None => Who::Where(Expr::condition("where", &paint.condition, columns)?),
                Some((n, best)) => {
                    let again = Table::Cells.open(root, manifest)?;
                    Who::Ranked(ranked(again, n, best)?)
                }
            };
            let colour = colour(Some(hex(&paint.colour)?));
            Ok(Rule {
                who,
                colour,
                cells: 0,
            })
        };
        let rules: Result<Vec<Rule>> = selection.painted.iter().map(rule).collect();
        Ok(Paints {
            condition: condition.transpose()?,
            scale: scale.transpose()?,
            rules: rules?,
            selection,
            id,
            table,
            stray: None,
        })
    }

    /// The colour of the next row's cell, which should be this one; `None` if it is not, or the row is damaged.
    pub fn next(&mut self, cell: u64) -> Option<Colour> {
        let row = self.table.next_row().ok()??;
        let id = row.whole(self.id).ok().filter(|id| *id == cell)?;
        if let Some(condition) = &self.condition
            && condition.test(&row).ok()? == self.selection.omit
        {
            self.stray.get_or_insert(id);
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
                rule.cells += 1;
                found = rule.colour;
            }
        }
        Some(found)
    }

    /// Says what does not fit, once all rows have been seen.
    pub fn finish(&self, issues: &mut Issues) {
        if let Some(cell) = self.stray {
            let holds = if self.selection.omit {
                "holds"
            } else {
                "does not hold"
            };
            let message =
                format!("cell {cell} is in the part, though the condition {holds} for it");
            issues.add(Code::Selection, "index.json#/selection/where", message);
        }
        for (i, (rule, paint)) in self.rules.iter().zip(&self.selection.painted).enumerate() {
            if rule.cells != paint.cells {
                let message = format!("found {}, it holds for {} cells", paint.cells, rule.cells);
                let at = format!("index.json#/selection/painted/{i}/cells");
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
    if root.join(LEGEND_SVG).symlink_metadata().is_err() {
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

/// The ids of the `n` cells of the largest or smallest form factor; of equal ones the first.
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
