//! The table of walls, held against the chords between cells.

use super::cells::OfCells;
use super::chords::{AREA_PARTS, BINS, Chords, SortedChords, THIN, WIDEST, WallLedger, WallScale};
use crate::error::Result;
use crate::verify::code::Code;
use crate::verify::ledger::Kind;
use crate::verify::report::Issues;
use crate::verify::table_files::Lines;
use crate::verify::tile::Context;

/// Places of columns.
const AREA: usize = 2;
const THICKNESS: usize = 3;
const CHORDS: usize = 4;
const THIN_FLAG: usize = 5;
const NEIGHBOUR: usize = 6;

/// Relative error of numbers as tables round them.
pub(super) const ROUNDING: f64 = 1e-9;
/// More than the area that a chord may stand for, in the face of a voxel.
const MOST_FACES: f64 = 1.2;

/// A row of the table.
pub(super) struct Wall {
    /// The cells, the smaller id first.
    pub cells: [u64; 2],
    /// Area and thickness, in the units of the tables.
    pub area: f64,
    pub thickness: f64,
    chords: f64,
    thin: Option<f64>,
    /// Whether it makes its cells neighbours.
    pub neighbour: Option<f64>,
}

/// Checks the tables of a set that has one of walls. `ledger` are the chords of its tiles, if these have all surfaces.
///
/// # Errors
/// If a temporary file cannot be written or read back.
pub(in crate::verify) fn check(
    ledger: Option<WallLedger>,
    cx: &Context,
    issues: &mut Issues,
) -> Result<()> {
    let stated = &cx.manifest.tables;
    if stated.walls.is_none() || cx.manifest.may_gape() || issues.broken() {
        return Ok(());
    }
    let Some(mut lines) = Lines::open(cx, Kind::Wall, issues) else {
        return Ok(());
    };
    let chords = ledger.map(WallLedger::into_sorted).transpose()?;
    let mut rows = Rows {
        scale: WallScale::of(&cx.manifest.measured()),
        unknown: chords.as_ref().map_or(0, |chords| chords.unknown) as f64,
        chords,
        of_cells: OfCells::new(),
        last: [0; 2],
        more: 0.0,
        count: 0,
        own: Issues::new(cx.max_issues),
    };
    while let Some(row) = lines.next_row(&mut rows.own) {
        rows.row(&row, &mut lines)?;
    }
    if let (Some(chords), false) = (&mut rows.chords, lines.damaged) {
        skip_before([u64::MAX; 2], chords, &lines.path, &mut rows.own)?;
    }
    let is_sound = rows.own.list.is_empty() && rows.own.omitted == 0;
    issues.append(rows.own);
    if lines.damaged {
        return Ok(());
    }
    let (more, unknown) = (rows.more, rows.unknown);
    if more > unknown {
        let message = format!(
            "found {more} chords more than lie between known cells, expected at most the {unknown} of others"
        );
        issues.add(Code::TableValue, &lines.path, message);
    }
    let (count, expected) = (rows.count, cx.manifest.totals.walls);
    if count != expected {
        let message = format!("found {count}, stated {expected}");
        issues.add(Code::TotalsMismatch, "index.json#/totals/walls", message);
    }
    // of wrong walls cells say nothing more
    match is_sound {
        true => rows.of_cells.check(cx, &rows.scale, &lines.path, issues),
        false => Ok(()),
    }
}

/// The rows as they are read.
struct Rows {
    scale: WallScale,
    /// Chords of which a cell is not known.
    unknown: f64,
    chords: Option<SortedChords>,
    of_cells: OfCells,
    /// The cells of the last one.
    last: [u64; 2],
    /// Chords beyond those that lie between known cells.
    more: f64,
    count: u64,
    /// What is wrong with them.
    own: Issues,
}

impl Rows {
    /// Takes the next one, which `lines` has just read.
    fn row(&mut self, row: &[Option<f64>], lines: &mut Lines) -> Result<()> {
        self.count += 1;
        let wall = Wall::read(row);
        let ([a, b], [c, d]) = (wall.cells, self.last);
        if !(a > 0 && a < b && self.last < wall.cells) {
            let message = format!(
                "found cells {a} and {b} behind {c} and {d}, expected each pair once, the smaller id first, by rising ids"
            );
            self.own.add(Code::TableRows, lines.place(), message);
            // what follows is none of what is looked for
            lines.give_up();
            return Ok(());
        }
        self.last = wall.cells;
        self.of_cells.add(&wall, lines.line)?;
        let mut fault = wall.fault(&self.scale);
        if let Some(chords) = &mut self.chords {
            skip_before(wall.cells, chords, &lines.path, &mut self.own)?;
            let mut between = Between::new(&wall, &self.scale);
            while chords.peek() == Some(wall.cells) {
                chords.next()?.iter().for_each(|own| between.add(own));
            }
            fault = fault.or_else(|| between.fault(&wall, &self.scale, self.unknown));
            self.more += (wall.chords - between.count[MAY]).max(0.0);
        }
        if let Some(message) = fault {
            self.own.add(Code::TableValue, lines.place(), message);
        }
        Ok(())
    }
}

impl Wall {
    fn read(row: &[Option<f64>]) -> Self {
        let number = |at: usize| row[at].unwrap_or(f64::NAN);
        Wall {
            // what is beyond is no id, and 0 is none
            cells: [0, 1].map(|at| {
                row[at]
                    .filter(|id| *id < (1u64 << 53) as f64)
                    .unwrap_or(0.0) as u64
            }),
            area: number(AREA),
            thickness: number(THICKNESS),
            chords: number(CHORDS),
            thin: row[THIN_FLAG],
            neighbour: row[NEIGHBOUR],
        }
    }

    /// What is wrong with it by itself. What is missing compares false.
    fn fault(&self, scale: &WallScale) -> Option<String> {
        let Wall {
            area,
            thickness,
            chords,
            ..
        } = *self;
        let widest = WIDEST * scale.finest * (1.0 + ROUNDING);
        let faces = scale.faces.into_iter().fold(1.0, f64::max);
        let most = MOST_FACES * faces * chords * scale.smallest_face;
        let coarsest = scale.finest_over.into_iter().fold(1.0, f64::min);
        let bin = scale.finest / BINS;
        match self.thin {
            _ if chords.is_nan() || chords < 1.0 => {
                Some(format!("found {chords} chords, expected 1 at least"))
            }
            _ if !(thickness > 0.0 && thickness <= widest) => Some(format!(
                "found wall_thickness {thickness}, expected one above 0 and at most {widest}"
            )),
            _ if !(area > 0.0 && area <= most) => Some(format!(
                "found wall_area {area}, expected at most {most} of {chords} chords"
            )),
            Some(1.0) if thickness > THIN * scale.finest / coarsest + bin => {
                Some("found thin 1, expected 0 of that thickness".to_owned())
            }
            Some(0.0 | 1.0) => match self.neighbour {
                Some(0.0 | 1.0) => None,
                _ => Some("found a neighbour that is neither 0 nor 1".to_owned()),
            },
            _ => Some("found a thin that is neither 0 nor 1".to_owned()),
        }
    }
}

/// Passes chords of cells before these, which have no row.
fn skip_before(
    cells: [u64; 2],
    chords: &mut SortedChords,
    path: &str,
    issues: &mut Issues,
) -> Result<()> {
    let mut last = None;
    while chords.peek().is_some_and(|own| own < cells) {
        let own = chords.next()?.filter(|own| own.certain);
        let Some([a, b]) = own.map(|own| own.cells).filter(|own| last != Some(*own)) else {
            continue;
        };
        last = Some([a, b]);
        let message = format!("found no row for the wall between cells {a} and {b}");
        issues.add(Code::TableRows, path, message);
    }
    Ok(())
}

/// Of two numbers, the one of chords that count beyond doubt, and the one of all that may count.
const IS: usize = 0;
const MAY: usize = 1;

/// What the chords between two cells say of their wall.
struct Between {
    /// The bin that the stated thickness lies in: up to its end.
    bin: u32,
    count: [f64; 2],
    /// The areas of those in bins before that one, of those up to it, of those that are thin, and of all.
    before: [f64; 2],
    upto: [f64; 2],
    thin: [f64; 2],
    area: [f64; 2],
}

impl Between {
    fn new(wall: &Wall, scale: &WallScale) -> Self {
        let bins = wall.thickness / scale.finest * BINS;
        Between {
            bin: ((bins * (1.0 - ROUNDING)).ceil() - 1.0).max(0.0) as u32,
            count: [0.0; 2],
            before: [0.0; 2],
            upto: [0.0; 2],
            thin: [0.0; 2],
            area: [0.0; 2],
        }
    }

    fn add(&mut self, chords: &Chords) {
        let [least, greatest] = chords.bins;
        let [low, high] = chords.area.map(|area| area as f64);
        let [may_be_thin, is_thin] = chords.thin;
        let mut sum = |into: usize, bin: u32, thin: bool, area: f64| {
            self.count[into] += chords.count as f64;
            self.before[into] += if bin < self.bin { area } else { 0.0 };
            self.upto[into] += if bin <= self.bin { area } else { 0.0 };
            self.thin[into] += if thin { area } else { 0.0 };
            self.area[into] += area;
        };
        if chords.certain {
            sum(IS, greatest, is_thin, low);
        }
        sum(MAY, least, may_be_thin, high);
    }

    /// How the row differs, if as many as `unknown` chords may be of any row.
    fn fault(&self, wall: &Wall, scale: &WallScale, unknown: f64) -> Option<String> {
        let stated = wall.chords;
        let [is, may] = self.count;
        if !(is <= stated && stated <= may + unknown) {
            let expected = range(self.count, unknown);
            return Some(format!("found {stated} chords, expected {expected}"));
        }
        let has_unknown = unknown > 0.0 && stated > is;
        let more = if has_unknown { f64::INFINITY } else { 0.0 };
        let face = scale.smallest_face / AREA_PARTS;
        let area = wall.area / face;
        let [least, most] = [
            self.area[IS] * (1.0 - ROUNDING),
            self.area[MAY] * (1.0 + ROUNDING),
        ];
        if !(least <= area && area <= most + more) {
            let expected = range(self.area.map(|area| area * face), more);
            return Some(format!(
                "found wall_area {}, expected {expected}",
                wall.area
            ));
        }
        let half = area / 2.0;
        let median = self
            .median(half, more)
            .map(|bins| bins / BINS * scale.finest);
        let [thinnest, thickest] = [median[0] * (1.0 - ROUNDING), median[1] * (1.0 + ROUNDING)];
        if !(thinnest <= wall.thickness && wall.thickness <= thickest) {
            return Some(format!(
                "found wall_thickness {}, which is not the median over its chords",
                wall.thickness
            ));
        }
        let is_thin = wall.thin == Some(1.0);
        let may_be = match is_thin {
            true => (self.thin[MAY] + more) * (1.0 + ROUNDING) > half,
            false => self.thin[IS] * (1.0 - ROUNDING) <= half,
        };
        let name = u8::from(is_thin);
        (!may_be).then(|| format!("found thin {name}, expected {}", 1 - name))
    }

    /// Bounds of the median in the bin that it is stated to be in, in bins; empty ones if it cannot be there.
    fn median(&self, half: f64, more: f64) -> [f64; 2] {
        let start = f64::from(self.bin);
        let off = ROUNDING * half;
        if self.before[IS] >= half + off || self.upto[MAY] + more < half - off {
            return [f64::INFINITY, 0.0];
        }
        // what is in a bin lies evenly in it: a share of it is below the median, which is less the more there is before
        // it and in it
        let share = |before: f64, upto: f64, otherwise: f64| match upto > before {
            true => ((half - before) / (upto - before)).clamp(0.0, 1.0),
            false => otherwise,
        };
        let least = share(self.before[MAY] + more, self.upto[MAY] + more, 0.0);
        let most = share(self.before[IS], self.upto[IS], 1.0);
        [start + least, start + most]
    }
}

/// From what is beyond doubt to all that may be.
fn range([is, may]: [f64; 2], more: f64) -> String {
    let most = may + more;
    match is == most {
        true => format!("{is}"),
        false => format!("{is} to {most}"),
    }
}
