//! The table of cells, where these are parts of components.

use super::necks::OwnNecks;
use super::sums::Begins;
use crate::error::Result;
use crate::manifest::PartsBy;
use crate::verify::code::Code;
use crate::verify::components::{
    AREA, BORDER, COLUMNS, ComponentRows, EULER, MESH_VOLUME, TILES, VOXELS, Wrong, compare,
    stated_box,
};
use crate::verify::laws::Listed;
use crate::verify::ledger::{Group, Kind};
use crate::verify::report::Issues;
use crate::verify::spill::Spill;
use crate::verify::tables::{Exactness, Table, check_carried};
use crate::verify::tile::Context;

/// Places of columns behind those of components.
const COMPONENT: usize = COLUMNS.len();
const NECKS: usize = COMPONENT + 1;
const LARGEST_NECK: usize = COMPONENT + 2;

/// How far from the centre of a voxel the end of a box may be that is computed from it, in steps of voxels.
const OFF_VOXEL: f64 = 1e-6;

/// Words of a row that is sorted by component: that, 0 for a cell of several, and the columns, NaN for none.
pub(super) const SHARE: usize = 1 + COLUMNS.len() + 1;
/// Rows that the sort keeps in memory.
const SHARES: usize = 1 << 11;

/// A row of the table.
pub(super) struct CellRow {
    pub id: u64,
    pub values: Vec<Option<f64>>,
}

impl CellRow {
    /// Its component; `None` if it has voxels in several.
    pub fn component(&self) -> Option<u64> {
        self.values[COMPONENT].map(|id| id as u64)
    }

    /// Its necks.
    pub fn necks(&self) -> Option<f64> {
        self.values[NECKS]
    }

    /// The box that it states.
    pub fn stated_box(&self) -> [[f64; 3]; 2] {
        stated_box(&self.values)
    }
}

/// The table while it is read.
pub(super) struct CellTable<'a> {
    cx: &'a Context<'a>,
    table: Table,
    pub rows: ComponentRows<'a>,
    exact: Exactness,
    unit: &'static str,
    last: u64,
    last_voxels: Option<f64>,
    /// Rows by component.
    pub shares: Spill<SHARE>,
}

impl<'a> CellTable<'a> {
    /// As of [`Table::open`].
    pub fn open(cx: &'a Context, issues: &mut Issues) -> Option<Self> {
        Some(CellTable {
            cx,
            table: Table::open(cx, Kind::Cell, issues)?,
            rows: ComponentRows::new(cx.manifest),
            exact: Exactness::of(cx.manifest),
            unit: cx.manifest.measured().unit.name(),
            last: 0,
            last_voxels: None,
            shares: Spill::new(SHARES),
        })
    }

    /// The next row, of a larger id than the one before.
    pub fn next_row(&mut self, issues: &mut Issues) -> Result<Option<CellRow>> {
        let Some(values) = self.table.lines.next_row(issues) else {
            return Ok(None);
        };
        let id = values[0].unwrap_or(0.0);
        if id <= self.last as f64 || id > (1u64 << 53) as f64 {
            let message = format!(
                "found id {id} behind {}, expected cells by rising id",
                self.last
            );
            issues.add(Code::TableRows, self.table.lines.place(), message);
            self.table.lines.give_up();
            return Ok(None);
        }
        self.last = id as u64;
        self.last_voxels = values[VOXELS];
        Ok(Some(CellRow {
            id: self.last,
            values,
        }))
    }

    /// True if all rows could be read.
    pub fn is_whole(&self) -> bool {
        !self.table.lines.damaged
    }

    /// Where the last row stands.
    pub fn place(&self) -> String {
        self.table.lines.place()
    }

    /// Voxels of the last row.
    pub fn last_voxels(&self) -> Option<f64> {
        self.last_voxels
    }

    /// Checks a row by itself, with the pieces of the cell, and with its necks, if these are known; and keeps it for its
    /// component.
    pub fn check(
        &mut self,
        row: &CellRow,
        pieces: Option<&Group>,
        begins: &Begins,
        necks: Option<&OwnNecks>,
        listed: &mut Listed,
    ) -> Result<()> {
        let mut wrong = Vec::new();
        self.rows.formulas(&row.values, &mut wrong);
        self.check_box(row, &mut wrong);
        check_empty(row, pieces, &mut wrong);
        let split = matches!(self.cx.manifest.cells, Some(PartsBy::Split { .. }));
        if let Some(necks) = necks {
            check_necks(row, necks, split, &mut wrong);
        }
        let most = self.cx.manifest.totals.components;
        if let Some(stated) = row.values[COMPONENT]
            && !(1.0..=most as f64).contains(&stated)
        {
            wrong.push(format!("component {stated}, of {most}"));
        }
        self.check_pieces(row, pieces, begins, &mut wrong);
        if let Some(pieces) = pieces {
            let total = &pieces.total;
            let carried = (!total.mixed).then_some(total.measures);
            let place = self.table.lines.place();
            check_carried(
                &row.values,
                carried,
                self.unit,
                row.id,
                &place,
                &mut listed.values,
            );
        }
        if !wrong.is_empty() {
            let message = format!("cell {}: {}", row.id, wrong.join("; "));
            listed
                .values
                .add(Code::TableValue, self.table.lines.place(), message);
        }
        let mut share = [f64::NAN.to_bits(); SHARE];
        share[0] = row.component().unwrap_or(0);
        for (word, value) in share[1..].iter_mut().zip(&row.values) {
            *word = value.unwrap_or(f64::NAN).to_bits();
        }
        share[SHARE - 1] = row.values[NECKS].unwrap_or(f64::NAN).to_bits();
        self.shares.push(share)
    }

    /// Compares the box with the grid, and with the number of voxels.
    fn check_box(&self, row: &CellRow, wrong: &mut Wrong) {
        let place = &self.rows.grid;
        let dims = self.cx.manifest.grid.dims.0;
        let whole = place.box_around([[0.0; 3], dims.map(|n| f64::from(n - 1))]);
        let stated = row.stated_box();
        let error = |at: f64| self.rows.error(at);
        let inside = (0..3).all(|a| {
            stated[0][a] >= whole[0][a] - error(whole[0][a])
                && stated[1][a] <= whole[1][a] + error(whole[1][a])
        });
        if !inside {
            wrong.push("its box reaches beyond the grid".to_owned());
        }
        if place.is_rotated() {
            return;
        }
        let reaches = (0..3).any(|a| {
            (0..2).any(|side| (stated[side][a] - whole[side][a]).abs() <= error(whole[side][a]))
        });
        let may_touch = reaches || self.cx.manifest.region.is_some();
        if reaches && row.values[BORDER] != Some(1.0)
            || !may_touch && row.values[BORDER] != Some(0.0)
        {
            wrong.push("touches_border is not what its box says".to_owned());
        }
        let step = |r: usize| -> f64 {
            let along = |i: usize| place.directions[i][r].abs() * place.spacing[i];
            (0..3).map(along).sum()
        };
        let at_voxels = |r: usize| {
            let slack = error(whole[0][r]).max(error(whole[1][r]));
            stated.iter().all(|end| {
                let steps = (end[r] - whole[0][r]) / step(r);
                (steps - steps.round()).abs() * step(r) <= slack + OFF_VOXEL * step(r)
            })
        };
        if !(0..3).all(at_voxels) {
            wrong.push("its box does not end at voxels".to_owned());
        }
        let room: f64 = (0..3)
            .map(|r| ((stated[1][r] - stated[0][r]) / step(r)).round() + 1.0)
            .product();
        // a NaN compares false
        if !row.values[VOXELS].is_some_and(|voxels| voxels <= room) {
            wrong.push(format!("its box has room for {room} voxels"));
        }
    }

    /// Compares what follows from the pieces: of a cell that touches no other one all that follows from its body.
    fn check_pieces(
        &self,
        row: &CellRow,
        pieces: Option<&Group>,
        begins: &Begins,
        wrong: &mut Wrong,
    ) {
        let Some(pieces) = pieces else {
            compare("area", row.values[AREA], 0.0, 0.0, wrong);
            compare("tiles", row.values[TILES], 0.0, 0.0, wrong);
            return;
        };
        if row.values[NECKS] == Some(0.0) {
            let body = pieces.body(Kind::Cell, self.cx);
            self.table
                .component(&row.values, pieces, body.as_ref(), &self.rows, wrong);
            return;
        }
        let (sums, tiles) = (&pieces.total.sums, pieces.total.cell_tiles);
        let error = self.exact.area_error(sums.area, sums.triangles);
        compare("area", row.values[AREA], sums.area, error, wrong);
        compare("tiles", row.values[TILES], tiles as f64, 0.0, wrong);
        let stated = row.stated_box();
        let found = self.rows.box_of(&begins.span, begins.far);
        let error = |at: f64| self.rows.error(at);
        let inside = (0..3).all(|a| {
            stated[0][a] <= found[0][a] + error(found[0][a])
                && stated[1][a] >= found[1][a] - error(found[1][a])
        });
        if !inside {
            wrong.push("its triangles begin beyond its box".to_owned());
        }
        let dims = self.cx.manifest.grid.dims.0;
        let touches =
            (0..3).any(|a| begins.span.lo[a] == 0 || u32::from(begins.span.hi[a]) + 1 == dims[a]);
        if touches && row.values[BORDER] != Some(1.0) {
            wrong.push("touches_border: triangles of it begin at the border".to_owned());
        }
    }
}

/// Looks for fields that are empty and should not be, or the other way round.
fn check_empty(row: &CellRow, pieces: Option<&Group>, wrong: &mut Wrong) {
    let values = &row.values;
    let has_necks = values[NECKS] != Some(0.0);
    let open = values[BORDER] != Some(0.0) || has_necks;
    if !matches!(values[BORDER], Some(0.0 | 1.0)) {
        wrong.push("touches_border is neither 0 nor 1".to_owned());
    }
    let mut expect = |at: usize, empty: bool, why: &str| {
        let name = COLUMNS[at].0;
        match (values[at], empty) {
            (Some(value), true) => wrong.push(format!("{name} {value}, expected none: {why}")),
            (None, false) => wrong.push(format!("{name} nothing, expected a value")),
            _ => {}
        }
    };
    // sphericity and form factor follow from it
    let no_mesh = open || pieces.is_none();
    expect(MESH_VOLUME, no_mesh, "it is open");
    expect(EULER, has_necks, "other cells touch it");
}

/// Compares what the row says of necks with the table of these.
fn check_necks(row: &CellRow, necks: &OwnNecks, split: bool, wrong: &mut Wrong) {
    let text = |v: Option<f64>| v.map_or("nothing".to_owned(), |v| v.to_string());
    let (stated, found) = (row.values[NECKS], necks.count);
    if stated != Some(found as f64) {
        wrong.push(format!(
            "necks {}, the table of necks has {found}",
            text(stated)
        ));
    }
    let largest = necks.largest.filter(|_| split);
    if row.values[LARGEST_NECK] != largest {
        wrong.push(format!(
            "largest_neck {}, the table of necks has {}",
            text(row.values[LARGEST_NECK]),
            text(largest)
        ));
    }
}
