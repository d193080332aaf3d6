//! What rows of cells say of their neighbours and walls, held against the tables of walls and necks.

use super::chords::WallScale;
use super::table::{ROUNDING, Wall};
use crate::error::Result;
use crate::verify::code::Code;
use crate::verify::components::AREA;
use crate::verify::ledger::Kind;
use crate::verify::report::Issues;
use crate::verify::spill::{Merge, Spill};
use crate::verify::table_files::Lines;
use crate::verify::tile::Context;

/// Records that each sort keeps in memory.
const IN_MEMORY: usize = 1 << 12;
/// Walls of fewer faces of a voxel, or of a smaller part of the area of the one of both cells that has less, make no
/// neighbours.
const LEAST_FACES: f64 = 10.0;
const LEAST_PART: f64 = 0.01;

/// A record of numbers, which are the bits of those that are not whole.
type Record = [u64; 4];

/// Records by their first number.
struct Sorted {
    merge: Merge<4>,
    next: Option<Record>,
}

impl Sorted {
    fn of(spill: Spill<4>) -> Result<Self> {
        let mut merge = spill.into_sorted()?;
        let next = merge.next()?;
        Ok(Sorted { merge, next })
    }

    /// The next one, if it begins with a number up to `key`.
    fn up_to(&mut self, key: u64) -> Result<Option<Record>> {
        let Some(record) = self.next.filter(|record| record[0] <= key) else {
            return Ok(None);
        };
        self.next = self.merge.next()?;
        Ok(Some(record))
    }
}

/// The walls by their cells.
pub(super) struct OfCells {
    /// Cell, thickness, area, line in the table.
    walls: Spill<4>,
    /// Line, cells, area.
    pairs: Spill<4>,
}

impl OfCells {
    pub fn new() -> Self {
        OfCells {
            walls: Spill::new(IN_MEMORY),
            pairs: Spill::new(IN_MEMORY),
        }
    }

    /// Adds the wall of a line.
    pub fn add(&mut self, wall: &Wall, line: u64) -> Result<()> {
        for cell in wall.cells {
            let [thickness, area] = [wall.thickness, wall.area].map(f64::to_bits);
            self.walls.push([cell, thickness, area, line])?;
        }
        let [a, b] = wall.cells;
        self.pairs.push([line, a, b, wall.area.to_bits()])
    }

    /// Compares them with the table of cells. What is wrong with that alone, or with the table of necks, is said elsewhere.
    pub fn check(
        self,
        cx: &Context,
        scale: &WallScale,
        path: &str,
        issues: &mut Issues,
    ) -> Result<()> {
        let mut unsaid = Issues::new(0);
        let Some(mut lines) = Lines::open(cx, Kind::Cell, &mut unsaid) else {
            return Ok(());
        };
        let columns = lines.walls_at();
        let mut walls = Sorted::of(self.walls)?;
        let [mut areas, mut stated] = [0; 2].map(|_| Spill::new(IN_MEMORY));
        let mut last = 0;
        while let Some(row) = lines.next_row(&mut unsaid) {
            let cell = row[0].unwrap_or(0.0) as u64;
            if cell <= last {
                return Ok(());
            }
            last = cell;
            let [neighbours, thickness] = columns.map(|at| row[at]);
            let mut own = Own::new(thickness);
            while let Some([of, thickness, area, line]) = walls.up_to(cell)? {
                if of < cell {
                    no_row(of, line, path, issues);
                    continue;
                }
                own.add(f64::from_bits(thickness), f64::from_bits(area));
                areas.push([line, cell, row[AREA].unwrap_or(0.0).to_bits(), 0])?;
            }
            if let (Some(message), false) = (own.fault(), cx.manifest.is_part()) {
                let message = format!("cell {cell}: {message}");
                issues.add(Code::TableValue, lines.place(), message);
            }
            let neighbours = neighbours.unwrap_or(f64::NAN).to_bits();
            stated.push([cell, neighbours, lines.line, 0])?;
        }
        if lines.damaged {
            return Ok(());
        }
        while let Some([of, _, _, line]) = walls.up_to(u64::MAX)? {
            no_row(of, line, path, issues);
        }
        let pairs = neighbours(self.pairs, areas, scale, cx)?;
        check_neighbours(pairs, stated, &lines.path, cx, issues)
    }
}

fn no_row(cell: u64, line: u64, path: &str, issues: &mut Issues) {
    let message = format!("found cell {cell}, which has no row in the table of cells");
    issues.add(Code::TableRows, format!("{path}:{line}"), message);
}

/// The walls of a cell.
struct Own {
    stated: Option<f64>,
    /// Areas of those that are thinner than stated, of those that are not thicker, and of all.
    thinner: f64,
    upto: f64,
    all: f64,
    /// The thickest of those that are not thicker than stated.
    nearest: f64,
}

impl Own {
    fn new(stated: Option<f64>) -> Self {
        Own {
            stated,
            thinner: 0.0,
            upto: 0.0,
            all: 0.0,
            nearest: 0.0,
        }
    }

    fn add(&mut self, thickness: f64, area: f64) {
        let stated = self.stated.unwrap_or(0.0);
        self.all += area;
        if thickness < stated {
            self.thinner += area;
        }
        if thickness <= stated {
            self.upto += area;
            self.nearest = self.nearest.max(thickness);
        }
    }

    fn fault(&self) -> Option<String> {
        let stated = match (self.stated, self.all > 0.0) {
            (None, false) => return None,
            (Some(stated), false) => {
                return Some(format!(
                    "wall_thickness {stated}, expected none: it has no walls"
                ));
            }
            (None, true) => {
                return Some("no wall_thickness, expected that of its walls".to_owned());
            }
            (Some(stated), true) => stated,
        };
        let half = self.all / 2.0;
        let off = ROUNDING * self.all;
        let fits = self.nearest == stated && self.thinner < half + off && self.upto >= half - off;
        (!fits).then(|| {
            format!("wall_thickness {stated}, expected the median over its walls by their area")
        })
    }
}

/// Cells with their neighbours: by openings, and by walls that are large enough, of which the last number is 1 if that is
/// beyond doubt.
fn neighbours(
    pairs: Spill<4>,
    areas: Spill<4>,
    scale: &WallScale,
    cx: &Context,
) -> Result<Spill<4>> {
    let mut found = Spill::new(IN_MEMORY);
    let mut both = |a: u64, b: u64, is: bool| {
        let is = u64::from(is);
        // the surest first
        found.push([a, b, 1 - is, 0])?;
        found.push([b, a, 1 - is, 0])
    };
    let mut pairs = Sorted::of(pairs)?;
    let mut areas = Sorted::of(areas)?;
    let mean_face = scale.faces.iter().sum::<f64>() / 3.0 * scale.smallest_face;
    while let Some([line, a, b, area]) = pairs.up_to(u64::MAX)? {
        let (mut smaller, mut known) = (f64::INFINITY, 0);
        while let Some([_, _, area, _]) = areas.up_to(line)? {
            smaller = smaller.min(f64::from_bits(area));
            known += 1;
        }
        let least = (LEAST_FACES * mean_face).max(LEAST_PART * smaller);
        let area = f64::from_bits(area);
        if known == 2 && area >= least * (1.0 - ROUNDING) {
            both(a, b, area >= least * (1.0 + ROUNDING))?;
        }
    }
    let mut unsaid = Issues::new(0);
    if let Some(mut lines) = Lines::open(cx, Kind::Neck, &mut unsaid) {
        while let Some(row) = lines.next_row(&mut unsaid) {
            let [a, b] = [0, 1].map(|at| row[at].unwrap_or(0.0) as u64);
            both(a, b, true)?;
        }
    }
    Ok(found)
}

/// Compares neighbours with what rows of cells state: cell, neighbours, line.
fn check_neighbours(
    pairs: Spill<4>,
    stated: Spill<4>,
    path: &str,
    cx: &Context,
    issues: &mut Issues,
) -> Result<()> {
    let mut pairs = Sorted::of(pairs)?;
    let mut rows = Sorted::of(stated)?;
    while let Some([cell, stated, line, _]) = rows.up_to(u64::MAX)? {
        let stated = f64::from_bits(stated);
        let (mut is, mut may, mut last) = (0.0, 0.0, None);
        while let Some([of, other, doubt, _]) = pairs.up_to(cell)? {
            if of == cell && last.replace(other) != Some(other) {
                is += if doubt == 0 { 1.0 } else { 0.0 };
                may += 1.0;
            }
        }
        // a part lacks some of the walls
        let fits = is <= stated && (stated <= may || cx.manifest.is_part());
        if !fits {
            let message =
                format!("cell {cell}: neighbours {stated}, by walls and openings it has {may}");
            issues.add(Code::TableValue, format!("{path}:{line}"), message);
        }
    }
    Ok(())
}
