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
use crate::verify::ledger::{Group, Kind, Rows};
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
    let Some(table) = Table::open(cx, Kind::Component, &mut listed.unopened) else {
        return Ok(None);
    };
    let mut merge = of.shares.into_sorted()?;
    let mut shares = Sorted {
        next: merge.next()?,
        merge,
    };
    let mut check = Check {
        in_several: shares.of(0)?,
        cx,
        connected,
        table,
        shares,
        sums: of.sums.into_sorted()?,
        tiles: Pairs::of(of.tiles)?,
        left: 0.0,
        open: 0,
        sound: true,
    };
    while let Some(row) = check.table.lines.next_row(&mut listed.values) {
        if !check.row(&row, listed, bodies)? {
            break;
        }
    }
    if check.table.lines.damaged || !check.finish(listed) {
        return Ok(None);
    }
    let several = check.in_several.cells > 0;
    check_objects(of.objects, connected, several, listed)?;
    Ok(Some(listed.laws.count))
}

/// The table of components while it is checked.
struct Check<'a> {
    cx: &'a Context<'a>,
    connected: u64,
    table: Table,
    shares: Sorted,
    /// Those of cells that have voxels in several components.
    in_several: Shares,
    /// What pieces say, by components.
    sums: Rows,
    tiles: Pairs,
    /// Voxels that components have beside those of their own cells, and how many have some.
    left: f64,
    open: u64,
    /// No row was found wrong.
    sound: bool,
}

impl Check<'_> {
    /// Checks a row; false if it is not the next one, and nothing can be said of those that follow.
    fn row(
        &mut self,
        row: &[Option<f64>],
        listed: &mut Listed,
        bodies: &mut ComponentRows,
    ) -> Result<bool> {
        let id = row[0].unwrap_or(0.0) as u64;
        if id != listed.laws.count + 1 {
            let message = format!("found id {id}, expected {}", listed.laws.count + 1);
            let at = self.table.lines.place();
            listed.values.add(Code::TableRows, at, message);
            self.table.lines.give_up();
            return Ok(false);
        }
        let group = self.pieces_of(id)?;
        let shares = self.shares.of(id)?;
        let rest = row[VOXELS].unwrap_or(f64::NAN) - shares.voxels;
        self.left += rest;
        self.open += u64::from(rest > 0.0);
        let mut wrong = Vec::new();
        bodies.check_row(Kind::Component, row, &mut wrong);
        if rest == 0.0 {
            shares.compare(row, bodies, &mut wrong);
            self.compare_body(row, group, listed, bodies, &mut wrong);
        } else {
            listed.laws.pass(id);
            if !(rest > 0.0 && self.in_several.cells > 0) {
                wrong.push(format!("its cells have {} voxels", shares.voxels));
            }
        }
        if !wrong.is_empty() {
            self.sound = false;
            let message = format!("component {id}: {}", wrong.join("; "));
            let at = self.table.lines.place();
            listed.values.add(Code::TableValue, at, message);
        }
        Ok(true)
    }

    /// The sums over the pieces of a component, with its tiles.
    fn pieces_of(&mut self, id: u64) -> Result<Option<Group>> {
        while self.sums.peek().is_some_and(|other| other < id) {
            self.sums.next_group()?;
        }
        let mut group = match self.sums.peek() {
            Some(other) if other == id => self.sums.next_group()?,
            _ => None,
        };
        let mut count = 0;
        self.tiles.each(id, |_| {
            count += 1;
            Ok(())
        })?;
        if self.connected == 0 {
            group = Some(Group::single_phase());
        }
        if let Some(group) = &mut group {
            group.total.cell_tiles = count;
        }
        Ok(group)
    }

    /// Compares the row of a component whose cells have all its voxels with the body that their pieces bound.
    fn compare_body(
        &self,
        row: &[Option<f64>],
        group: Option<Group>,
        listed: &mut Listed,
        bodies: &ComponentRows,
        wrong: &mut Wrong,
    ) {
        let Some(group) = group else {
            listed.laws.pass(listed.laws.count + 1);
            wrong.push("none of its cells has a surface".to_owned());
            return;
        };
        let body = group.body(Kind::Component, self.cx);
        listed.laws.add(&group, body.as_ref(), &mut listed.own);
        self.table
            .component(row, &group, body.as_ref(), bodies, wrong);
    }

    /// Checks what is left when all rows have been seen; false if a row is missing.
    fn finish(&self, listed: &mut Listed) -> bool {
        // of a larger one, the row of the cell has been found wrong
        let stated = self.cx.manifest.totals.components;
        if let Some(id) = self.sums.peek().filter(|id| *id <= stated) {
            let message = format!("found no row for component {id}, which has cells");
            let at = self.table.lines.path.clone();
            listed.values.add(Code::TableRows, at, message);
            return false;
        }
        // cells of several components leave at least two of them with voxels of theirs
        let (several, open, left) = (&self.in_several, self.open, self.left);
        let all_seen = self.sound && listed.laws.count == stated;
        if all_seen && several.cells > 0 && (left != several.voxels || open < 2) {
            let message = format!(
                "{} cells without a component have {} voxels, the cells of {open} components leave {left}",
                several.cells, several.voxels
            );
            listed.values.add(Code::TableValue, "cells.csv", message);
        }
        true
    }
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
