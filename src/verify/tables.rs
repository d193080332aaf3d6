//! The tables, compared row by row with the rebuilt surface.

use super::bodies::{Body, euler_of};
use super::code::Code;
use super::components::{
    self, AREA, BORDER, ComponentRows, MESH_VOLUME, TILES, VOXELS, Wrong, compare,
};
use super::extras;
use super::laws::may_be_cut;
use super::ledger::{Group, Kind};
use super::piece::Sums;
use super::report::Issues;
use super::table_files::Lines;
use super::tile::Context;
use crate::manifest::Manifest;
use crate::tile::read::{MEASURES, Measured};

/// Relative error that areas, sums of square roots in any order, may have.
const AREA_ERROR: f64 = 1e-6;
/// Error that each triangle may add to an area, in voxel faces (of the largest face, with anisotropic
/// spacing): twice its area is rounded to 1/65,536 of a squared lattice step.
const TRIANGLE_ERROR: f64 = 1.0 / (4.0 * 65_536.0 * 65_536.0);
/// Relative error of areas by the rounding of sums alone.
const ROUNDING: f64 = 1e-11;
/// Half the area of the largest face of a box of one lattice step, below which no surface is, in [`TRIANGLE_ERROR`]s.
const LEAST_SURFACE: f64 = 0.5 / 65_536.0 / TRIANGLE_ERROR;
/// Relative error that volumes, exact up to their decimal form, may have.
const VOLUME_ERROR: f64 = 1e-9;

/// A table that is being read.
pub(super) struct Table {
    kind: Kind,
    pub lines: Lines,
    /// Unit of length.
    unit: &'static str,
    exact: Exactness,
    /// True for bodies of a selected subset that may lack surfaces: their measures are those of the whole set.
    of_subset: bool,
    /// Any row may be one that the edge of a mask cuts.
    edge_unknown: bool,
    /// Cells are parts of components.
    of_parts: bool,
}

impl Table {
    /// As of [`Lines::open`].
    pub fn open(cx: &Context, kind: Kind, issues: &mut Issues) -> Option<Self> {
        let manifest = cx.manifest;
        Some(Table {
            kind,
            lines: Lines::open(cx, kind, issues)?,
            unit: manifest.measured().unit.name(),
            exact: Exactness::of(manifest),
            of_subset: may_be_cut(manifest, kind),
            edge_unknown: cx.edge.is_unknown(),
            of_parts: manifest.cells.is_some(),
        })
    }

    /// Compares the next row with the surfaces of the next id, and the body that they bound, if they do. Returns the
    /// row if it is of that id.
    pub fn check(
        &mut self,
        group: &Group,
        body: Option<&Body>,
        components: &mut ComponentRows,
        issues: &mut Issues,
    ) -> Option<Vec<Option<f64>>> {
        if self.lines.done {
            return None;
        }
        let Some(line) = self.lines.next_line(issues) else {
            if self.lines.done && self.lines.line > 0 {
                let message = format!("found no row for {} {}", self.kind.name(), group.id);
                issues.add(Code::TableRows, &self.lines.path, message);
            }
            return None;
        };
        let row = self.lines.fields(&line, issues)?;
        if row[0] != Some(group.id as f64) {
            let path = self.lines.place();
            let message = format!(
                "found id {}, expected {} {}: a row for each, by rising id",
                row[0].unwrap_or(f64::NAN),
                self.kind.name(),
                group.id
            );
            issues.add(Code::TableRows, path, message);
            self.lines.done = true;
            return None;
        }
        let mut wrong = Vec::new();
        match self.kind {
            Kind::Surface => self.surface(&row, group, &mut wrong),
            kind => {
                components.check_row(kind, &row, &mut wrong);
                self.component(&row, group, body, components, &mut wrong);
            }
        }
        if self.kind == Kind::Cell && group.parts > 0 {
            self.check_extras(&row, group, issues);
        }
        if !wrong.is_empty() {
            let message = format!("{} {}: {}", self.kind.name(), group.id, wrong.join("; "));
            issues.add(Code::TableValue, self.lines.place(), message);
        }
        Some(row)
    }

    /// Compares a row with the measures in the extras of the cell's pieces.
    fn check_extras(&self, row: &components::Row, group: &Group, issues: &mut Issues) {
        let found = &group.total;
        let carried = (!found.mixed).then_some(found.measures);
        let place = self.lines.place();
        check_carried(row, carried, self.unit, group.id, &place, issues);
    }

    /// Compares a row of cells, components or objects with the sums over its surfaces and its body.
    pub fn component(
        &self,
        row: &components::Row,
        group: &Group,
        body: Option<&Body>,
        components: &ComponentRows,
        wrong: &mut Wrong,
    ) {
        let total = &group.total;
        let own_tiles = match self.kind {
            Kind::Cell | Kind::Component => total.cell_tiles,
            _ => total.object_tiles,
        };
        if self.of_subset && self.is_cut(row, group, body) {
            let least = |at: usize, found: f64| row[at].is_some_and(|v| v >= found);
            let area = total.sums.area - self.area_error(&total.sums);
            if !least(AREA, area) || !least(TILES, own_tiles as f64) {
                wrong.push("its surfaces have more area, or lie in more tiles".to_owned());
            }
            if !components.holds(self.kind, row, &total.sums.inside) {
                wrong.push("its surfaces reach beyond its box".to_owned());
            }
            return;
        }
        let Some(body) = body else {
            wrong.push("its surfaces bound no body of voxels".to_owned());
            return;
        };
        let error = self.area_error(&total.sums);
        compare("area", row[AREA], total.sums.area, error, wrong);
        let sign = if self.kind.is_below() { -1.0 } else { 1.0 };
        let found = sign * total.sums.volume6 as f64 * self.exact.sixth;
        let said_to_touch = row[BORDER] == Some(1.0);
        let touches = body.touches || (self.edge_unknown && said_to_touch);
        match (touches, row[MESH_VOLUME]) {
            (true, Some(v)) => wrong.push(format!("mesh_volume {v}, expected none: it is open")),
            (true, None) => {}
            (false, volume) => {
                compare(
                    "mesh_volume",
                    volume,
                    found,
                    VOLUME_ERROR * found.abs(),
                    wrong,
                );
            }
        }
        compare("tiles", row[TILES], own_tiles as f64, 0.0, wrong);
        compare(
            "touches_border",
            row[BORDER],
            f64::from(u8::from(touches)),
            0.0,
            wrong,
        );
        components.check_body(row, body, wrong);
    }

    /// True if the row is that of a body that has more surfaces than are known here: then these bound another number of
    /// voxels, and have less area. The least surface, around a corner of one voxel, shows in the area unless there are so
    /// many triangles that rounding may hide it.
    fn is_cut(&self, row: &components::Row, group: &Group, body: Option<&Body>) -> bool {
        let sums = &group.total.sums;
        let rounding = ROUNDING * sums.area + self.exact.triangle_error * sums.triangles as f64;
        let same_area = row[AREA].is_some_and(|v| (v - sums.area).abs() <= rounding);
        let Some(body) = body else {
            return !same_area;
        };
        let same_voxels = row[VOXELS] == Some(body.moments.voxels as f64);
        !same_voxels && (!same_area || rounding >= self.exact.triangle_error * LEAST_SURFACE)
    }

    fn area_error(&self, sums: &Sums) -> f64 {
        self.exact.area_error(sums.area, sums.triangles)
    }

    /// A row of surfaces.
    fn surface(&self, row: &components::Row, group: &Group, wrong: &mut Wrong) {
        let sums = &group.total.sums;
        let ids = group.total.ids;
        let euler = euler_of(sums) as f64;
        let found = [
            ("cell", ids.cell as f64, 0.0),
            ("object", ids.object as f64, 0.0),
            ("triangles", sums.triangles as f64, 0.0),
            ("vertices", sums.vertices as f64, 0.0),
            ("area", sums.area, self.area_error(sums)),
            ("euler_characteristic", euler, 0.0),
            ("border_edges", sums.border as f64, 0.0),
            ("touches_border", f64::from(u8::from(sums.border > 0)), 0.0),
            ("tiles", group.total.tiles as f64, 0.0),
        ];
        for ((name, value, error), stated) in found.into_iter().zip(&row[1..]) {
            // of the surface of a cell that others touch it has no meaning
            let may_lack = self.of_parts && name == "euler_characteristic";
            if !(may_lack && stated.is_none()) {
                compare(name, *stated, value, error, wrong);
            }
        }
    }

    /// Expects the end of the table, after `rows` more rows without a surface.
    pub fn finish(&mut self, rows: u64, issues: &mut Issues) {
        let mut found = 0u64;
        while !self.lines.done {
            found += u64::from(self.lines.next_line(issues).is_some());
        }
        if found != rows {
            let message = format!("found {found} rows after those with a surface, expected {rows}");
            issues.add(Code::TableRows, &self.lines.path, message);
        }
    }
}

/// How exact the numbers of a set are.
pub(super) struct Exactness {
    /// Physical volume of a lattice cell, over 6.
    sixth: f64,
    /// [`TRIANGLE_ERROR`] in physical units.
    triangle_error: f64,
}

impl Exactness {
    pub fn of(manifest: &Manifest) -> Self {
        let spacing = manifest.measured().spacing;
        let voxel: f64 = spacing.iter().product();
        let thinnest = spacing.into_iter().fold(f64::INFINITY, f64::min);
        Exactness {
            sixth: voxel / 6.0 / f64::from(1 << 24),
            triangle_error: voxel / thinnest * TRIANGLE_ERROR,
        }
    }

    /// The error that the area of so many triangles may have.
    pub fn area_error(&self, area: f64, triangles: u64) -> f64 {
        AREA_ERROR * area + self.triangle_error * triangles as f64
    }
}

/// Compares the row of a cell, which is at `place`, with the hash of the measures on its pieces, which is missing if they
/// differ.
pub(super) fn check_carried(
    row: &components::Row,
    carried: Option<u64>,
    unit: &'static str,
    cell: u64,
    place: &str,
    issues: &mut Issues,
) {
    let mut stated = Measured {
        unit: Some(unit),
        ..Measured::default()
    };
    for (value, name) in stated.values.iter_mut().zip(MEASURES) {
        let at = components::COLUMNS.iter().position(|c| c.0 == name);
        *value = at.and_then(|at| row[at]).unwrap_or(f64::NAN);
    }
    if carried != Some(extras::hash(&stated)) {
        let message = match carried {
            None => format!("the measures on pieces of cell {cell} differ from piece to piece"),
            Some(_) => format!("the measures on pieces of cell {cell} are not those of {place}"),
        };
        issues.add(Code::CarriedMeasure, "tiles", message);
    }
}
