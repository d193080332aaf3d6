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
/// Walls of fewer faces of a voxel, of a smaller part of the area of the one of both cells that has less, or as many times
/// thicker than the walls of either cell, make no neighbours.
const LEAST_FACES: f64 = 5.0;
const LEAST_PART: f64 = 0.005;
const MOST_TIMES: f64 = 1.8;

/// Records of numbers, which are the bits of those that are not whole, by their first one.
struct Sorted<const N: usize> {
    merge: Merge<N>,
    next: Option<[u64; N]>,
}

impl<const N: usize> Sorted<N> {
    fn of(spill: Spill<N>) -> Result<Self> {
        let mut merge = spill.into_sorted()?;
        let next = merge.next()?;
        Ok(Sorted { merge, next })
    }

    /// The next one, if it begins with a number up to `key`.
    fn up_to(&mut self, key: u64) -> Result<Option<[u64; N]>> {
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
    /// Line, area, thickness, and whether it is stated to make its cells neighbours.
    rows: Spill<4>,
    /// Cells that are stated to be neighbours, in both orders.
    pairs: Spill<2>,
}

impl OfCells {
    pub fn new() -> Self {
        OfCells {
            walls: Spill::new(IN_MEMORY),
            rows: Spill::new(IN_MEMORY),
            pairs: Spill::new(IN_MEMORY),
        }
    }

    /// Adds the wall of a line.
    pub fn add(&mut self, wall: &Wall, line: u64) -> Result<()> {
        let [thickness, area] = [wall.thickness, wall.area].map(f64::to_bits);
        for cell in wall.cells {
            self.walls.push([cell, thickness, area, line])?;
        }
        let neighbours = wall.neighbour == Some(1.0);
        if neighbours {
            add_pair(&mut self.pairs, wall.cells)?;
        }
        self.rows.push([line, area, thickness, neighbours.into()])
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
        let mut sizes = Spill::new(IN_MEMORY);
        let mut stated = Spill::new(IN_MEMORY);
        let mut last = 0;
        while let Some(row) = lines.next_row(&mut unsaid) {
            let cell = row[0].unwrap_or(0.0) as u64;
            if cell <= last {
                return Ok(());
            }
            last = cell;
            let [neighbours, thickness] = columns.map(|at| row[at]);
            let mut own = Own::new(thickness);
            let size = [row[AREA], thickness].map(|v| v.unwrap_or(0.0).to_bits());
            while let Some([of, thickness, area, line]) = walls.up_to(cell)? {
                if of < cell {
                    no_row(of, line, path, issues);
                    continue;
                }
                own.add(f64::from_bits(thickness), f64::from_bits(area));
                sizes.push([line, size[0], size[1]])?;
            }
            if let (Some(message), false) = (own.fault(), cx.manifest.is_part()) {
                let message = format!("cell {cell}: {message}");
                issues.add(Code::TableValue, lines.place(), message);
            }
            let neighbours = neighbours.unwrap_or(f64::NAN).to_bits();
            stated.push([cell, neighbours, lines.line])?;
        }
        if lines.damaged {
            return Ok(());
        }
        while let Some([of, _, _, line]) = walls.up_to(u64::MAX)? {
            no_row(of, line, path, issues);
        }
        check_rows(self.rows, sizes, scale, path, issues)?;
        let mut pairs = self.pairs;
        if let Some(mut lines) = Lines::open(cx, Kind::Neck, &mut unsaid) {
            while let Some(row) = lines.next_row(&mut unsaid) {
                add_pair(&mut pairs, [0, 1].map(|at| row[at].unwrap_or(0.0) as u64))?;
            }
        }
        check_neighbours(pairs, stated, &lines.path, cx, issues)
    }
}

/// Adds two cells in both orders.
fn add_pair(pairs: &mut Spill<2>, [a, b]: [u64; 2]) -> Result<()> {
    pairs.push([a, b])?;
    pairs.push([b, a])
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

/// Compares what rows of walls state of neighbours with their areas and thickness and those of their cells, of which
/// `sizes` has for each line the area of a cell, and the thickness of its walls.
fn check_rows(
    rows: Spill<4>,
    sizes: Spill<3>,
    scale: &WallScale,
    path: &str,
    issues: &mut Issues,
) -> Result<()> {
    let mut rows = Sorted::of(rows)?;
    let mut sizes = Sorted::of(sizes)?;
    let mean_face = scale.faces.iter().sum::<f64>() / 3.0 * scale.smallest_face;
    while let Some([line, area, thickness, stated]) = rows.up_to(u64::MAX)? {
        let (mut smaller, mut thicker, mut known) = (f64::INFINITY, 0.0f64, 0);
        while let Some([_, area, thickness]) = sizes.up_to(line)? {
            smaller = smaller.min(f64::from_bits(area));
            thicker = thicker.max(f64::from_bits(thickness));
            known += 1;
        }
        let [area, thickness] = [area, thickness].map(f64::from_bits);
        let least = (LEAST_FACES * mean_face).max(LEAST_PART * smaller);
        let most = MOST_TIMES * thicker;
        // numbers of tables are rounded
        let holds = |by: f64| area >= least * (1.0 + by) && thickness <= most * (1.0 - by);
        let fits = match stated {
            0 => !holds(ROUNDING),
            _ => holds(-ROUNDING),
        };
        if known == 2 && !fits {
            let message = format!(
                "found neighbour {stated}, expected {}: between neighbours wall_area is {least} at least, and wall_thickness \
                 {most} at most",
                1 - stated
            );
            issues.add(Code::TableValue, format!("{path}:{line}"), message);
        }
    }
    Ok(())
}

/// Compares neighbours with what rows of cells state: cell, neighbours, line.
fn check_neighbours(
    pairs: Spill<2>,
    stated: Spill<3>,
    path: &str,
    cx: &Context,
    issues: &mut Issues,
) -> Result<()> {
    let mut pairs = Sorted::of(pairs)?;
    let mut rows = Sorted::of(stated)?;
    while let Some([cell, stated, line]) = rows.up_to(u64::MAX)? {
        let stated = f64::from_bits(stated);
        let (mut count, mut last) = (0.0, None);
        while let Some([of, other]) = pairs.up_to(cell)? {
            if of == cell && last.replace(other) != Some(other) {
                count += 1.0;
            }
        }
        // a part lacks some of the walls
        let fits = stated == count || (stated > count && cx.manifest.is_part());
        if !fits {
            let message =
                format!("cell {cell}: neighbours {stated}, by walls and openings it has {count}");
            issues.add(Code::TableValue, format!("{path}:{line}"), message);
        }
    }
    Ok(())
}
