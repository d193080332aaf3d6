//! The cells of each component together, held against its row.

use super::cells::SHARE;
use crate::error::Result;
use crate::verify::code::Code;
use crate::verify::components::{
    AREA, BORDER, CENTROID, COLUMNS, ComponentRows, ROUNDING, VOXELS, Wrong, compare, stated_box,
};
use crate::verify::laws::Listed;
use crate::verify::ledger::Kind;
use crate::verify::report::Issues;
use crate::verify::spill::{Merge, Spill};
use crate::verify::tables::Lines;
use crate::verify::tile::Context;

/// Relative error of the sum of areas, which the tables round one by one.
const AREA_ERROR: f64 = 1e-9;

/// Sums over the rows of the cells of a component.
struct Shares {
    cells: u64,
    voxels: f64,
    /// Voxels times centroid, and the sum of their absolute values.
    first: [f64; 3],
    size: [f64; 3],
    bounds: [[f64; 3]; 2],
    area: f64,
    touches: bool,
    /// Necks of all, and the fewest of one.
    necks: [f64; 2],
    /// The columns of the last one.
    last: Vec<Option<f64>>,
}

impl Default for Shares {
    fn default() -> Self {
        Shares {
            cells: 0,
            voxels: 0.0,
            first: [0.0; 3],
            size: [0.0; 3],
            bounds: [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]],
            area: 0.0,
            touches: false,
            necks: [0.0, f64::INFINITY],
            last: Vec::new(),
        }
    }
}

impl Shares {
    fn add(&mut self, share: &[u64; SHARE]) {
        let value = |word: &u64| Some(f64::from_bits(*word)).filter(|v| !v.is_nan());
        self.last = share[1..SHARE - 1].iter().map(value).collect();
        let number = |at: usize| self.last[at].unwrap_or(f64::NAN);
        let [lo, hi] = stated_box(&self.last);
        self.cells += 1;
        self.voxels += number(VOXELS);
        self.area += number(AREA);
        for a in 0..3 {
            let moment = number(VOXELS) * number(CENTROID + a);
            self.first[a] += moment;
            self.size[a] += moment.abs();
            self.bounds[0][a] = self.bounds[0][a].min(lo[a]);
            self.bounds[1][a] = self.bounds[1][a].max(hi[a]);
        }
        self.touches |= self.last[BORDER] == Some(1.0);
        let necks = f64::from_bits(share[SHARE - 1]);
        self.necks = [self.necks[0] + necks, self.necks[1].min(necks)];
    }

    /// Compares all of them with the row of their component, of which they have all voxels.
    fn compare(&self, row: &[Option<f64>], rows: &ComponentRows, wrong: &mut Wrong) {
        for a in 0..3 {
            let found = self.first[a] / self.voxels;
            let error = ROUNDING * self.size[a] / self.voxels + rows.error(found);
            compare(
                COLUMNS[CENTROID + a].0,
                row[CENTROID + a],
                found,
                error,
                wrong,
            );
        }
        let stated = stated_box(row);
        let near = |side: usize, a: usize| {
            let found = self.bounds[side][a];
            (stated[side][a] - found).abs() <= rows.error(found)
        };
        if !(0..3).all(|a| near(0, a) && near(1, a)) {
            wrong.push("its box is not that of its cells".to_owned());
        }
        compare("area", row[AREA], self.area, AREA_ERROR * self.area, wrong);
        let touches = f64::from(u8::from(self.touches));
        compare("touches_border", row[BORDER], touches, 0.0, wrong);
        // all hang together
        let least = 2 * (self.cells - 1);
        let [all, fewest] = self.necks;
        if all < least as f64 || (fewest == 0.0) != (self.cells == 1) {
            wrong.push(format!(
                "its {} cells have {} necks, which do not join them",
                self.cells,
                all / 2.0
            ));
        }
        if self.cells > 1 {
            return;
        }
        let differs = |at: &usize| self.last[*at] != row[*at];
        if let Some(at) = (1..COLUMNS.len()).find(differs) {
            let text = |v: Option<f64>| v.map_or("nothing".to_owned(), |v| v.to_string());
            wrong.push(format!(
                "{} {}, its only cell has {}",
                COLUMNS[at].0,
                text(row[at]),
                text(self.last[at])
            ));
        }
    }
}

/// Rows of cells by component.
struct Sorted {
    merge: Merge<SHARE>,
    next: Option<[u64; SHARE]>,
}

impl Sorted {
    fn of(&mut self, component: u64) -> Result<Shares> {
        let mut shares = Shares::default();
        while let Some(share) = self.next.filter(|share| share[0] <= component) {
            if share[0] == component {
                shares.add(&share);
            }
            self.next = self.merge.next()?;
        }
        Ok(shares)
    }
}

/// Compares the rows of cells, sorted by component, with the table of components. Cells that have voxels in several
/// components have those that the others leave.
pub(super) fn check_shares(shares: Spill<SHARE>, cx: &Context, listed: &mut Listed) -> Result<()> {
    let mut merge = shares.into_sorted()?;
    let mut sorted = Sorted {
        next: merge.next()?,
        merge,
    };
    let in_several = sorted.of(0)?;
    let rows = ComponentRows::new(cx.manifest);
    // what is wrong with the table itself has been said
    let mut quiet = Issues::new(1);
    let Some(mut lines) = Lines::open(cx, Kind::Component, &mut quiet) else {
        return Ok(());
    };
    let (mut left, mut open) = (0.0, 0);
    let (mut sound, mut rows_found) = (true, 0);
    while let Some(row) = lines.next_row(&mut quiet) {
        rows_found += 1;
        let id = row[0].unwrap_or(0.0) as u64;
        let shares = sorted.of(id)?;
        let rest = row[VOXELS].unwrap_or(f64::NAN) - shares.voxels;
        left += rest;
        open += u64::from(rest > 0.0);
        let mut wrong = Vec::new();
        if rest == 0.0 {
            shares.compare(&row, &rows, &mut wrong);
        } else if !(rest > 0.0 && in_several.cells > 0) {
            wrong.push(format!("its cells have {} voxels", shares.voxels));
        }
        if !wrong.is_empty() {
            sound = false;
            let message = format!("component {id}: {}", wrong.join("; "));
            listed.values.add(Code::TableValue, lines.place(), message);
        }
    }
    sound &= !lines.damaged && rows_found == cx.manifest.totals.components;
    // cells of several components leave at least two of them with voxels of theirs
    if sound && in_several.cells > 0 && (left != in_several.voxels || open < 2) {
        let message = format!(
            "{} cells without a component have {} voxels, the cells of {open} components leave {left}",
            in_several.cells, in_several.voxels
        );
        listed.values.add(Code::TableValue, "cells.csv", message);
    }
    Ok(())
}
