//! The cells of each component together, held against its row.

use super::cells::SHARE;
use super::check::OfComponents;
use super::sums::Pairs;
use crate::error::Result;
use crate::verify::code::Code;
use crate::verify::components::{
    AREA, BORDER, CENTROID, COLUMNS, ComponentRows, ROUNDING, VOXELS, Wrong, compare, stated_box,
};
use crate::verify::laws::Listed;
use crate::verify::ledger::{Group, Kind};
use crate::verify::spill::{Merge, Spill};
use crate::verify::tables::Table;
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

/// Checks components with their table, which `connected` surfaces bound; returns how many there are, if all rows can be
/// read. Cells that have voxels in several components have those that the others leave, so of a component whose cells have
/// all voxels all surfaces are known.
pub(super) fn check_components(
    of: OfComponents,
    connected: u64,
    listed: &mut Listed,
    bodies: &mut ComponentRows,
    cx: &Context,
) -> Result<Option<u64>> {
    let Some(mut table) = Table::open(cx, Kind::Component, &mut listed.unopened) else {
        return Ok(None);
    };
    let mut merge = of.shares.into_sorted()?;
    let mut sorted = Sorted {
        next: merge.next()?,
        merge,
    };
    let in_several = sorted.of(0)?;
    let mut sums = of.sums.into_sorted()?;
    let mut tiles = Pairs::of(of.tiles)?;
    let (mut left, mut open, mut sound) = (0.0, 0, true);
    while let Some(row) = table.lines.next_row(&mut listed.values) {
        let id = row[0].unwrap_or(0.0) as u64;
        if id != listed.laws.count + 1 {
            let message = format!("found id {id}, expected {}", listed.laws.count + 1);
            listed
                .values
                .add(Code::TableRows, table.lines.place(), message);
            table.lines.give_up();
            break;
        }
        while sums.peek().is_some_and(|other| other < id) {
            sums.next_group()?;
        }
        let mut group = match sums.peek() {
            Some(other) if other == id => sums.next_group()?,
            _ => None,
        };
        let mut count = 0;
        tiles.each(id, |_| {
            count += 1;
            Ok(())
        })?;
        let shares = sorted.of(id)?;
        let rest = row[VOXELS].unwrap_or(f64::NAN) - shares.voxels;
        left += rest;
        open += u64::from(rest > 0.0);
        let mut wrong = Vec::new();
        bodies.check_row(Kind::Component, &row, &mut wrong);
        if rest == 0.0 {
            shares.compare(&row, bodies, &mut wrong);
            if connected == 0 {
                group = Some(Group::single_phase());
            }
            match &mut group {
                Some(group) => {
                    group.total.cell_tiles = count;
                    let body = group.body(Kind::Component, cx);
                    listed.laws.add(group, body.as_ref(), &mut listed.own);
                    table.component(&row, group, body.as_ref(), bodies, &mut wrong);
                }
                None => {
                    listed.laws.pass(id);
                    wrong.push("none of its cells has a surface".to_owned());
                }
            }
        } else {
            listed.laws.pass(id);
            if !(rest > 0.0 && in_several.cells > 0) {
                wrong.push(format!("its cells have {} voxels", shares.voxels));
            }
        }
        if !wrong.is_empty() {
            sound = false;
            let message = format!("component {id}: {}", wrong.join("; "));
            listed
                .values
                .add(Code::TableValue, table.lines.place(), message);
        }
    }
    if table.lines.damaged {
        return Ok(None);
    }
    let found = listed.laws.count;
    // of a larger one, the row of the cell has been found wrong
    let stated = cx.manifest.totals.components;
    if let Some(id) = sums.peek().filter(|id| *id <= stated) {
        let message = format!("found no row for component {id}, which has cells");
        listed
            .values
            .add(Code::TableRows, &table.lines.path, message);
        return Ok(None);
    }
    // cells of several components leave at least two of them with voxels of theirs
    if sound && in_several.cells > 0 && found == stated && (left != in_several.voxels || open < 2) {
        let message = format!(
            "{} cells without a component have {} voxels, the cells of {open} components leave {left}",
            in_several.cells, in_several.voxels
        );
        listed.values.add(Code::TableValue, "cells.csv", message);
    }
    check_objects(of.objects, connected, in_several.cells > 0, listed)?;
    Ok(Some(found))
}

/// Compares the pairs of a component and an object that have a surface with what is connected: each is of one pair, and each
/// pair has one. Of cells in `several` components it is not known.
fn check_objects(
    objects: Spill<2>,
    connected: u64,
    several: bool,
    listed: &mut Listed,
) -> Result<()> {
    let mut pairs = Pairs::of(objects)?;
    pairs.each(0, |_| Ok(()))?;
    let count = pairs.count()?;
    if count > connected || count < connected && !several {
        let message = format!(
            "by the components of cells, {count} pairs of a component and an object have surfaces, found {connected}"
        );
        listed.values.add(Code::TableValue, "cells.csv", message);
    }
    Ok(())
}
