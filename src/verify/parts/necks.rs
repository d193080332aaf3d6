//! The table of necks: where cells of one component touch.

use super::cells::CellRow;
use super::rule::SplitRule;
use crate::error::Result;
use crate::grid::Placement;
use crate::verify::code::Code;
use crate::verify::laws::Listed;
use crate::verify::ledger::Kind;
use crate::verify::spill::{Merge, Spill};
use crate::verify::table_files::Lines;
use crate::verify::tile::Context;

/// Records that each sort keeps in memory.
const IN_MEMORY: usize = 1 << 12;

/// Places of columns.
const RADIUS: usize = 2;
const RATIO: usize = 3;
const PLACE: usize = 4;
const AREA: usize = 7;

/// Words of a neck by one of its cells: that, the line, the radius and the place, NaN for none.
const OF_CELL: usize = 6;
/// Words of a cell by one of its necks: the line, the component, 0 for several, and the box.
const OF_NECK: usize = 8;
/// Words of them before the box.
const BOX: usize = 2;

/// What the table says of a cell.
#[derive(Debug, Default)]
pub(super) struct OwnNecks {
    pub count: u64,
    /// The largest radius.
    pub largest: Option<f64>,
}

/// The necks by their cells.
pub(super) struct NeckTable {
    pub path: String,
    /// False if the table could not be read: then nothing is compared with it.
    pub is_whole: bool,
    /// Rows.
    pub count: u64,
    sorted: Merge<OF_CELL>,
    next: Option<[u64; OF_CELL]>,
    place: Placement,
    /// How far a place may be from the voxels of a cell, along each axis of the world.
    reach: [f64; 3],
    /// Both cells of each neck.
    pub pairs: Spill<OF_NECK>,
}

/// By how much the coordinates of voxels beside each other differ at most, along each axis of the world.
fn step(place: &Placement) -> [f64; 3] {
    let along = |r: usize| (0..3).map(move |i| place.directions[i][r].abs() * place.spacing[i]);
    // what is rounded is far less
    std::array::from_fn(|r| along(r).sum::<f64>() * (1.0 + 1e-6))
}

impl NeckTable {
    /// Reads the table and checks what rows say by themselves.
    pub fn read(cx: &Context, split: bool, listed: &mut Listed) -> Result<Self> {
        let mut by_cell = Spill::new(IN_MEMORY);
        let lines = Lines::open(cx, Kind::Neck, &mut listed.unopened);
        let path = lines
            .as_ref()
            .map_or(String::new(), |lines| lines.path.clone());
        let (mut is_whole, mut count) = (false, 0);
        let (mut rule, mut sound) = (SplitRule::of(cx.manifest), true);
        if let Some(mut lines) = lines {
            let mut last = [0.0; 2];
            while let Some(row) = lines.next_row(&mut listed.values) {
                count += 1;
                let cells = [0, 1].map(|i| row[i].unwrap_or(0.0));
                let wrong = wrong_in(&row, &cells, &last, split).or_else(|| {
                    let message = rule.as_mut()?.check_row(&row)?;
                    Some((Code::TableValue, message))
                });
                sound &= wrong.is_none();
                if let Some(wrong) = wrong {
                    let (code, message) = wrong;
                    listed.values.add(code, lines.place(), message);
                }
                last = cells;
                let number = |at: usize| row[at].unwrap_or(f64::NAN).to_bits();
                for cell in cells {
                    let own = [RADIUS, PLACE, PLACE + 1, PLACE + 2].map(number);
                    let [radius, x, y, z] = own;
                    by_cell.push([cell as u64, lines.line, radius, x, y, z])?;
                }
            }
            is_whole = !lines.damaged;
        }
        // of rows that are wrong nothing more is said
        if let Some(rule) = rule.filter(|_| is_whole && sound) {
            rule.finish(cx.manifest, &mut listed.values);
        }
        let mut sorted = by_cell.into_sorted()?;
        let place = cx.manifest.measured();
        let share = if split { 1.0 } else { 0.5 };
        Ok(NeckTable {
            next: sorted.next()?,
            path,
            // else what the index states is not compared
            count: if is_whole {
                count
            } else {
                cx.manifest.totals.necks
            },
            is_whole,
            sorted,
            reach: step(&place).map(|v| share * v),
            place,
            pairs: Spill::new(IN_MEMORY),
        })
    }

    /// The necks of a cell, whose places have to be at its box; those of cells before have no row.
    pub fn of_cell(&mut self, row: &CellRow, listed: &mut Listed) -> Result<OwnNecks> {
        let mut own = OwnNecks::default();
        let [lo, hi] = row.stated_box();
        self.skip_before(row.id, listed)?;
        while let Some(record) = self.next.filter(|record| record[0] == row.id) {
            let [_, line, radius, place @ ..] = record;
            own.count += 1;
            let radius = f64::from_bits(radius);
            if !radius.is_nan() {
                own.largest = Some(own.largest.map_or(radius, |known| known.max(radius)));
            }
            let place = place.map(f64::from_bits);
            let near = |a: usize| {
                let reach = self.reach[a] + 1e-11 * (place[a].abs() + self.place.origin[a].abs());
                lo[a] - reach <= place[a] && place[a] <= hi[a] + reach
            };
            if !place[0].is_nan() && !(0..3).all(near) {
                let message = format!("it lies beside the box of cell {}", row.id);
                let at = format!("{}:{line}", self.path);
                listed.values.add(Code::TableValue, at, message);
            }
            let component = row.component().unwrap_or(0);
            let ends = [lo, hi]
                .as_flattened()
                .iter()
                .map(|v| v.to_bits())
                .collect::<Vec<_>>();
            let mut pair = [0; OF_NECK];
            pair[..BOX].copy_from_slice(&[line, component]);
            pair[BOX..].copy_from_slice(&ends);
            self.pairs.push(pair)?;
            self.next = self.sorted.next()?;
        }
        Ok(own)
    }

    fn skip_before(&mut self, id: u64, listed: &mut Listed) -> Result<()> {
        while let Some([cell, line, ..]) = self.next.filter(|record| record[0] < id) {
            let message = format!("found cell {cell}, which has no row in the table of cells");
            let at = format!("{}:{line}", self.path);
            listed.values.add(Code::TableRows, at, message);
            self.next = self.sorted.next()?;
        }
        Ok(())
    }

    /// All cells have been seen.
    pub fn finish(&mut self, listed: &mut Listed) -> Result<()> {
        self.skip_before(u64::MAX, listed)
    }
}

/// What is wrong with a row by itself, and with its place behind the last one.
fn wrong_in(
    row: &[Option<f64>],
    cells: &[f64; 2],
    last: &[f64; 2],
    split: bool,
) -> Option<(Code, String)> {
    let [a, b] = cells;
    if !(*a >= 1.0 && a < b && last < cells) {
        let message = format!(
            "found cells {a} and {b} behind {} and {}, expected each pair once, the smaller id first, by rising ids",
            last[0], last[1]
        );
        return Some((Code::TableRows, message));
    }
    let none = |at: usize| row[at].is_none();
    let above_0 = |at: usize| row[at].is_some_and(|v| v > 0.0);
    let places = (PLACE..PLACE + 3).filter(|&at| none(at)).count();
    let message = if split && !above_0(RADIUS) {
        "found no radius above 0"
    } else if split && !none(RATIO) && !row[RATIO].is_some_and(|v| v > 0.0 && v <= 1.0) {
        "found a ratio that is not above 0 and at most 1"
    } else if !(split || none(RADIUS) && none(RATIO)) {
        "found a radius or a ratio, which labels do not give"
    } else if places != 0 && (split || places != 3) {
        "found a place without some of its coordinates"
    } else if !row[AREA].is_some_and(|v| v >= 0.0)
        || places == 3 && !row[AREA].is_some_and(|v| v == 0.0)
    {
        "found an area that is none, or one without a place"
    } else {
        return None;
    };
    Some((Code::TableValue, message.to_owned()))
}

/// Checks that both cells of each neck are of one component, as far as rows name it, and lie beside each other.
pub(super) fn check_pairs(
    pairs: Spill<OF_NECK>,
    path: &str,
    cx: &Context,
    listed: &mut Listed,
) -> Result<()> {
    let reach = step(&cx.manifest.measured());
    let mut sorted = pairs.into_sorted()?;
    let mut first: Option<[u64; OF_NECK]> = None;
    while let Some(own) = sorted.next()? {
        let Some(other) = first.replace(own).filter(|other| other[0] == own[0]) else {
            continue;
        };
        let end = |record: &[u64; OF_NECK], i: usize| f64::from_bits(record[BOX + i]);
        let touch = |a: usize| {
            let gap = (end(&own, a) - end(&other, 3 + a)).max(end(&other, a) - end(&own, 3 + a));
            gap <= reach[a]
        };
        let [one, two] = [own[1], other[1]];
        let message = if one != two && one != 0 && two != 0 {
            format!("found cells of components {two} and {one}, expected those of one")
        } else if !(0..3).all(touch) {
            "found cells whose boxes do not touch".to_owned()
        } else {
            continue;
        };
        let at = format!("{path}:{}", own[0]);
        listed.values.add(Code::TableValue, at, message);
    }
    Ok(())
}
